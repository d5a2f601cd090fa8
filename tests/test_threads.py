"""Chunks and threads: the same bits for any number of threads, and nothing lost at the seams."""

import threading
from contextlib import contextmanager
from copy import deepcopy

import numpy as np
import pytest

from floebmi import advance, bmi, listing, threads, tiles
from floebmi.boundaries import Domain, Wall
from floebmi.contact import cohesive, frictional
from floebmi.dynamics import Step
from floebmi.errors import InputError
from floebmi.floes import COAST, FIXED_Y, Floes
from floebmi.forces import AirDrag, OceanDrag
from floebmi.kernels import BLOCK
from floebmi.model import Model
from floebmi.packing import scatter
from floebmi.running import run
from floebmi.sizes import PowerLaw

SIZES = PowerLaw(10.0, 40.0)


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr(tiles, "CHUNK", 80)
    for width in ("FEW", "NARROWEST"):  # so narrow a list is renewed on the way
        monkeypatch.setattr(listing, width, 0)


def pack_of_floes(law, threads=1, walls=False, drag=(), step=Step()):
    edges = ("periodic",) * 2 + ("closed" if walls else "periodic",) * 2
    domain = Domain((0.0, 1000.0), (0.0, 1000.0), *edges)
    floes = scatter(domain, SIZES, concentration=0.7, seed=3)
    rng = np.random.default_rng(2)
    floes.u[:], floes.v[:] = rng.normal(0.0, 0.3, (2, len(floes)))
    floes.motion[::20] = FIXED_Y
    floes.motion[7::40], floes.u[7::40], floes.v[7::40] = COAST, 0.0, 0.0
    walls = [Wall("south", velocity=0.1)] if walls else []
    return Model(domain, floes, law, drag, threads=threads, walls=walls, step=step)


@pytest.mark.parametrize(
    "law, walls, drag, residual",
    [
        (frictional(), True, [], 1e-3),
        pytest.param(cohesive(), False, [OceanDrag(), AirDrag()], 1e-2, marks=pytest.mark.long),
    ],
)
def test_any_number_of_threads_gives_the_same_bits_and_closed_books(
    small_chunks, law, walls, drag, residual
):
    models = [pack_of_floes(law, threads, walls, drag) for threads in (1, 3)]
    for model in models:
        if drag:
            model.atmosphere.u[:] = 15.0
        for _ in range(3):
            model.advance(2.0)
        assert len(model._now().lists.tiles.chunks) > 3
    for other in models[1:]:
        for name in ("x", "y", "u", "v"):
            assert np.array_equal(getattr(models[0].floes, name), getattr(other.floes, name))
        assert np.array_equal(models[0].ledger.now, other.ledger.now)
        assert all(np.array_equal(row, other.ledger.accounts[n]) for n, row in models[0].ledger.accounts.items())  # fmt: skip
    assert models[0].counters.rebuilds > 1
    for quantity in ("momentum_x", "momentum_y"):
        assert models[0].ledger.balance(quantity).relative < 1e-12
    assert models[0].ledger.balance("energy").relative < residual


def test_a_thread_that_fails_keeps_nobody_waiting(small_chunks, monkeypatch):
    share = threads._share

    def fails(thread, *others):
        if thread == 1:
            raise MemoryError("no room")
        return share(thread, *others)

    monkeypatch.setattr(threads, "_share", fails)
    model = pack_of_floes(frictional(), threads=2, walls=True)
    before = model.floes.copy()
    with pytest.raises(MemoryError, match="no room"):
        model.advance(0.5)
    assert np.array_equal(model.floes.x, before.x) and model.time == 0.0


def test_a_thread_that_cannot_start_keeps_nobody_waiting(small_chunks, monkeypatch):
    """Those that had started waited for it for ever."""
    start, started = threading.Thread.start, []

    def starts_once(thread):
        if started:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        start(thread)

    model = pack_of_floes(frictional(), threads=3, walls=True)
    with monkeypatch.context() as limited:
        limited.setattr(threading.Thread, "start", starts_once)
        with pytest.raises(RuntimeError, match="can't start new thread"):
            model.advance(0.5)
    assert started and not started[0].is_alive() and model.time == 0.0
    model.advance(0.5)


def test_chunks_change_the_order_of_sums_and_nothing_else(monkeypatch):
    whole = pack_of_floes(frictional(), walls=True, step=Step(fraction=0.3))
    whole.advance(0.3)
    monkeypatch.setattr(tiles, "CHUNK", 80)
    cut = pack_of_floes(frictional(), walls=True, step=Step(fraction=0.3))
    cut.advance(0.3)
    assert len(cut._now().lists.tiles.chunks) > 3
    # blows of contacts that open are struck one after the other, so their order shows a little
    assert cut.floes.x == pytest.approx(whole.floes.x, abs=1e-6)
    assert cut.ledger.now == pytest.approx(whole.ledger.now, rel=1e-7)


def test_what_pairs_remember_outlives_a_new_list_on_both_sides_of_a_seam(small_chunks):
    model = pack_of_floes(frictional(), walls=True)
    model.advance(0.5)
    slip = model.state()["pair_slip"]
    model._state.kept = None
    now = model._now()
    pairs, tiled = now.pairs, now.lists.tiles
    bounds, parts, chunks = tiled.bounds, tiled.parts, tiled.chunks
    assert np.count_nonzero(pairs.slip) == np.count_nonzero(slip) > 50
    across = slice(parts[-2], parts[-1])
    chunk = [np.searchsorted(bounds[chunks], ends, side="right") for ends in (pairs.i, pairs.j)]
    assert (chunk[0][across] != chunk[1][across]).all() and np.count_nonzero(pairs.slip[across])
    assert (chunk[0] == chunk[1])[: parts[-2]].all()


def test_tiles_are_whole_blocks_that_fit_the_cache_and_small_packs_are_one():
    for n, count in (
        (1, 1),
        (5_000, 1),
        (40_000, 1),
        (50_000, 2),
        (80_000, 2),
        (123_457, 4),
        (10**6, 8),
    ):
        bounds, chunks = tiles.cut(n)
        assert bounds[0] == 0 and bounds[-1] == n and len(chunks) - 1 == count
        assert (bounds[:-1] % BLOCK == 0).all() and np.diff(bounds).max() < 1.5 * tiles.TILE
        assert chunks[0] == 0 and chunks[-1] == len(bounds) - 1
        if count > 1:
            assert np.ptp(np.diff(bounds[chunks])) < 0.02 * n


def test_a_pair_is_touched_when_the_later_of_its_floes_has_moved(monkeypatch):
    monkeypatch.setattr(tiles, "TILE", 128)
    now = pack_of_floes(frictional())._now()
    bounds, parts = now.lists.tiles.bounds, now.lists.tiles.parts
    assert len(now.lists.tiles.chunks) == 2 and len(bounds) > 4 and parts[-1] == parts[-2]
    tile = np.searchsorted(bounds, np.maximum(now.pairs.i, now.pairs.j), side="right") - 1
    assert np.array_equal(np.bincount(tile, minlength=len(bounds) - 1), np.diff(parts[:-1]))
    assert (np.diff(tile) >= 0).all()


def test_coast_is_the_last_of_its_tile_and_nothing_changes_places_with_another_tile(monkeypatch):
    monkeypatch.setattr(tiles, "TILE", 128)
    land = np.random.default_rng(1).random(700) < 0.3
    order, (bounds, _) = tiles.coast_last(land), tiles.cut(700)
    for begin, end in zip(bounds[:-1], bounds[1:], strict=True):
        here = order[begin:end]
        pieces = np.count_nonzero(land[begin:end])
        ice, coast = here[: len(here) - pieces], here[len(here) - pieces :]
        assert not land[ice].any() and (np.diff(ice) > 0).all()
        assert land[coast].all() and np.array_equal(np.sort(here), np.arange(begin, end))


@pytest.mark.parametrize("number", [0, 1.5, "two"])
def test_a_number_of_threads_that_is_none_is_refused(number):
    with pytest.raises(InputError, match="threads = .*: must be a whole number, at least 1"):
        Model(Domain((0, 9), (0, 9)), Floes(5.0, 5.0, 1.0, 1.0), threads=number)


# ---- threads of somebody else -------------------------------------------------------------------


@contextmanager
def at_work(monkeypatch, call):
    """Another thread in the middle of the steps of `call`; at the end it has come to its end."""
    begun, go_on = threading.Event(), threading.Event()
    steps, caller = advance.Advance.run, threading.get_ident()

    def wait(self, *others):
        if threading.get_ident() != caller:
            begun.set()
            assert go_on.wait(60.0)
        return steps(self, *others)

    monkeypatch.setattr(advance.Advance, "run", wait)
    worker = threading.Thread(target=call)
    worker.start()
    try:
        assert begun.wait(60.0)
        yield
    finally:
        go_on.set()
        worker.join()


def two_floes():
    box = Domain((0.0, 1000.0), (0.0, 1000.0))
    floes = Floes([300.0, 336.0], [500.0, 508.0], [20.0, 15.0], 1.0, u=[0.5, 0.0])
    return Model(box, floes, frictional())


@pytest.mark.parametrize(
    "second",
    [
        lambda model, state: model.advance(5.0),
        lambda model, state: model.restore(state),
        lambda model, state: run(model, 5.0),
        lambda model, state: model.state(),
        lambda model, state: model.contacts(),
        lambda model, state: deepcopy(model),
    ],
)
@pytest.mark.parametrize("by_run", [False, True])
def test_what_a_second_thread_asks_of_a_model_is_refused_and_the_first_goes_on(
    second, by_run, monkeypatch
):
    def first(model):
        if by_run:
            run(model, 30.0)
        else:
            model.advance(30.0)

    model, other = two_floes(), two_floes()
    first(other)
    state = model.state()
    with (
        at_work(monkeypatch, lambda: first(model)),
        pytest.raises(InputError, match="another thread is at work on this model; wait for it"),
    ):
        second(model, state)
    assert model.time == 30.0
    for name in ("x", "y", "u", "v"):
        assert np.array_equal(getattr(model.floes, name), getattr(other.floes, name))
    assert np.array_equal(model.ledger.now, other.ledger.now)
    for one in (model, other, deepcopy(model)):  # and it is free again
        one.advance(5.0)
        assert np.array_equal(one.floes.x, model.floes.x)


def test_what_a_second_thread_asks_of_a_component_is_refused_and_the_first_goes_on(
    tmp_path, monkeypatch
):
    (tmp_path / "scene.toml").write_text(
        """
        time.exchange = 30.0
        contact = "frictional"
        domain = {x = [0.0, 1000.0], y = [0.0, 1000.0]}
        floes = {count = 8, size = {distribution = "single", radius = 100.0}, velocity = [0.5, 0.0]}
        """
    )
    component, other = bmi.FloeBmi(), bmi.FloeBmi()
    for one in (component, other):
        one.initialize(str(tmp_path / "scene.toml"))
    component.save_state(tmp_path / "state.nc")
    thickness = component.get_output_var_names()[0]
    for second in (
        component.update,
        lambda: component.update_until(component.get_current_time() + 9.0),
        lambda: component.load_state(tmp_path / "state.nc"),
        lambda: component.save_state(tmp_path / "other.nc"),
        lambda: component.get_value_ptr(thickness),
    ):
        with (
            at_work(monkeypatch, component.update),
            pytest.raises(InputError, match="another thread is at work on this model; wait for it"),
        ):
            second()
        other.update()
        assert component.get_current_time() == other.get_current_time()
        assert np.array_equal(component.model.floes.x, other.model.floes.x)
