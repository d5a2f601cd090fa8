"""Real hosts, both ways: what one loses the other gains, on the host's own faces and masks."""

import glob
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_examples import ROOT, example

from coupling.books import Books
from coupling.veros import SeaIce, surface_cells
from floebmi import Domain, Floes, Grid, Model
from floebmi.coast import from_land_fraction, on_land
from floebmi.errors import InputError
from floebmi.forces import AirDrag, CoriolisField, OceanDrag, Tilt
from floebmi.restarts import load_restart


def test_a_line_of_the_books_is_of_its_exchange_and_goes_on_from_a_file(tmp_path):
    grid = Grid.uniform((0.0, 4e3), (0.0, 2e3), spacing=2e3)
    floes = Floes([1e3, 3e3], 1e3, 500.0, 1.0, u=[0.3, 0.2])
    model = Model(Domain((0.0, 4e3), (0.0, 2e3)), floes, forces=[OceanDrag()], grid=grid)
    books, host = Books(model), np.array([5.0, -6.0])
    for number, duration in ((1, 60.0), (2, 30.0)):
        books.open()
        model.advance(duration)
        to_host = np.array([model.ocean.last_x.sum(), model.ocean.last_y.sum()])
        line = books.close(to_host, np.zeros(2), host)
        assert (line.number, line.duration, line.host.tolist()) == (number, duration, [5.0, -6.0])
        assert line.relative < 1e-12
    books.save(tmp_path / "books.nc")
    again = Books(model)
    again.load(tmp_path / "books.nc")
    again.open()
    model.advance(10.0)
    assert again.close(np.zeros(2), np.zeros(2)).number == 3
    assert again.last.turnover > line.turnover and again.last.time == 100.0


@pytest.fixture
def shallow():
    pytest.importorskip("shallowwater", reason="shallowwater is not installed")
    return example("shallow_water")


def small(shallow, rescue=None):
    return shallow.basin((15, 20), 0.5, (600.0, 1200.0), rescue)


# ---- Landlab: the other tests are in test_landlab -----------------------------------------------------


def test_ice_goes_out_of_a_lagoon_with_the_ebb_and_the_tide_does_not_feel_it(
    tmp_path, monkeypatch, capsys
):
    pytest.importorskip("landlab", reason="the extra `landlab` is not installed")
    lagoon = example("tidal_lagoon")
    monkeypatch.setattr(lagoon, "STEPS", 3)
    found = lagoon.main(tmp_path, concentration=0.1)
    assert found.worst <= 1e-12
    assert found.through > 0
    assert found.host_unchanged
    assert "residual" in capsys.readouterr().out
    assert (tmp_path / "tidal-lagoon.png").stat().st_size > 50_000


def test_the_tide_with_an_empty_ice_component_is_the_tide_alone_bit_for_bit():
    pytest.importorskip("landlab", reason="the extra `landlab` is not installed")
    lagoon = example("tidal_lagoon")
    grids = lagoon.lagoon(), lagoon.lagoon()
    flows = [lagoon.TidalFlowCalculator(grid, tidal_range=1.5, roughness=0.03) for grid in grids]
    ice = lagoon.SeaIceFloes(grids[0])
    for _ in range(2):
        for flow in flows:
            flow.run_one_step()
        lagoon.give_water(grids[0], "ebb")
        ice.run_one_step(600.0)
    assert np.abs(grids[0].at_node[lagoon.VELOCITY[0]]).max() > 0.1
    for where in ("node", "link"):
        for name in grids[1][where]:
            np.testing.assert_array_equal(grids[0][where][name], grids[1][where][name])


def test_river_flow_dynamics_loses_what_is_written_into_its_velocity_so_ice_cannot_push_it():
    landlab = pytest.importorskip("landlab", reason="the extra `landlab` is not installed")
    from landlab.components import RiverFlowDynamics

    grid = landlab.RasterModelGrid((5, 12))
    grid.add_field("topographic__elevation", 1.0 - 0.01 * grid.x_of_node, at="node")
    grid.add_ones("surface_water__depth", at="node")
    grid.add_field("surface_water__elevation", 2.0 - 0.01 * grid.x_of_node, at="node")
    grid.add_zeros("surface_water__velocity", at="link")
    river = RiverFlowDynamics(grid, dt=0.1, mannings_n=0.03)
    river.run_one_step()
    grid.at_link["surface_water__velocity"][:] = 99.0
    river.run_one_step()
    assert 0 < np.abs(grid.at_link["surface_water__velocity"]).max() < 1.0


# ---- shallowwater -----------------------------------------------------------------------------------


def test_a_seiche_under_ice_keeps_volume_and_momentum_to_round_off(shallow, tmp_path):
    found = shallow.main(tmp_path, 3.0, 0.6, (15, 20), (500.0, 1000.0))
    assert found.worst <= 1e-12 and found.water <= 1e-12
    assert found.volume <= 1e-15
    assert found.seiche < 0.9  # the ice holds it back
    assert (tmp_path / "shallow-water.png").stat().st_size > 30_000


def test_plain_means_of_the_stress_would_lose_momentum_at_the_shore(shallow):
    icy = small(shallow)
    icy.exchange(1800.0)
    cells = icy.model.ocean.last_x.reshape(15, 20)
    means = 0.5 * (cells[:, 1:] + cells[:, :-1])  # what a C grid does at its inner faces
    lost = abs(means.sum() - cells.sum()) / np.abs(cells).sum()
    assert lost > 1e-3
    assert abs(icy.books.last.to_host[0] - cells.sum()) <= 1e-12 * np.abs(cells).sum()


def test_the_shallow_water_without_ice_is_the_host_alone_bit_for_bit(shallow):
    import shallowwater as sw

    free = shallow.basin((15, 20), 0.0, (1.0, 1.0))
    start = free.snapshot()
    for until in (600.0, 1800.0, 2400.0):
        free.exchange(until)
    alone = sw.run_model(
        2400.0, free.dt, free.grid, free.params, sw.zero_forcing,
        ic_fn=lambda grid, params: tuple(start[name] for name in ("eta", "u", "v")), save_every=1000,
    )  # fmt: skip
    for name in ("eta", "u", "v"):
        assert np.abs(alone[name][-1]).max() > 0
        np.testing.assert_array_equal(free.state[name], alone[name][-1])


def equal(one, other):
    for name, values in one.snapshot().items():
        np.testing.assert_array_equal(values, other.snapshot()[name])
    np.testing.assert_array_equal(one.model.floes.x, other.model.floes.x)
    np.testing.assert_array_equal(one.model.ocean.impulse_x, other.model.ocean.impulse_x)


def test_a_host_that_fails_leaves_a_line_and_a_state_from_which_the_run_goes_on(
    shallow, tmp_path, monkeypatch
):
    rescue = tmp_path / "rescue.nc"
    whole, broken = small(shallow), small(shallow, rescue)
    for basin in (whole, broken):
        basin.exchange(600.0)
    whole.exchange(1200.0)

    def refused(match, until=1200.0):
        with pytest.raises((InputError, RuntimeError), match=match) as caught:
            broken.exchange(until)
        assert "\n" not in str(caught.value)
        assert f"floes at 600 s, their state saved in {rescue}" in str(caught.value)

    held = {name: values.copy() for name, values in broken.state.items()}
    broken.state["u"][3, 4] = np.nan  # the host sends NaN
    refused("value nan on open u point 67, row 3, column 4")
    broken.state["u"] = held["u"][:, :-1]  # another grid
    refused("300 values for 315 points")
    broken.state["u"] = held["u"].copy()
    refused("from 600 to 0 s: must be a whole number", until=0.0)  # backwards

    def dies(*args, **kwargs):
        raise MemoryError("the host died\nand told a long story")

    with monkeypatch.context() as patch:
        patch.setattr(shallow.sw, "run_model", dies)  # after the ice has moved
        refused("the host died; floes at 600 s")

    broken.exchange(1200.0)
    equal(broken, whole)
    again = small(shallow)  # another process: from the file alone
    again.put(again.books.load(rescue))
    assert again.model.time == 600.0
    again.exchange(1200.0)
    equal(again, whole)


# ---- Veros --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def veros():
    pytest.importorskip("veros", reason="the extra `veros` is not installed")
    return example("veros_fram_strait")


@pytest.fixture(scope="module")
def channel(veros, tmp_path_factory):
    folder = tmp_path_factory.mktemp("veros")
    found = veros.main(folder, 0.25, True, size=12, radius=(5e3, 9e3), show=False)
    assert (folder / "veros-channel.png").stat().st_size > 30_000
    assert {path.name for path in folder.iterdir()} >= {"veros-24.h5", "ice-24.nc"}
    assert 0.0 < found.overhead < 1.0
    return found


def test_momentum_closes_on_the_faces_of_veros_and_in_its_own_velocities(channel):
    assert channel.worst <= 1e-12
    assert channel.momentum <= 1e-12
    assert all(line.undelivered.tolist() == [0.0, 0.0] for line in channel.ledger)
    assert channel.ledger[-1].to_host[0] > 0  # the wind's push, handed on by the ice


def test_veros_without_ice_is_veros_alone_bit_for_bit_in_the_channel_and_between_coasts(
    veros, channel
):
    assert channel.same == 0.0
    alone, empty = (
        veros.Ocean(12, 900.0, make_ice=maker).go(0.125, False)
        for maker in (None, veros.make_ice((8e3, 14e3), 0.0, False))
    )
    assert len(empty.ice.ledger) == 3
    for name in ("u", "v", "w", "temp", "salt", "psi", "tke"):
        values = [np.asarray(getattr(ocean.state.variables, name)) for ocean in (alone, empty)]
        assert np.abs(values[0]).max() > 0
        np.testing.assert_array_equal(*values)


def fram(veros, tmp_path, **options):
    tmp_path.mkdir(exist_ok=True)
    ocean = veros.Ocean(
        12,
        900.0,
        make_ice=veros.make_ice((8e3, 14e3), 0.6, False),
        folder=tmp_path,
        **options,
    )
    ocean.setup()
    return ocean


def test_the_ledger_closes_at_the_coasts_of_fram_strait_and_fractions_are_blended_once(
    veros, tmp_path
):
    ocean = fram(veros, tmp_path)
    vs, ice = ocean.state.variables, ocean.ice
    for _ in range(8):
        ocean.step(ocean.state)
    assert max(line.relative for line in ice.ledger) <= 1e-12
    assert not ice.model.grid.wet.all()
    inner = (slice(2, -2), slice(2, -2))
    tau, area = np.asarray(vs.surface_tauy)[inner], np.asarray(vs.area_v)[inner]
    mask = np.asarray(vs.maskV)[..., -1][inner]
    wind = np.asarray(ocean.wind[1])[inner]
    fraction = ice.fraction.T
    beside = 0.5 * (fraction + np.roll(fraction, -1, axis=1))
    expected = ((1 - beside) * wind * area * mask).sum() + ice.ledger[-1].to_host[1] / 3600.0
    assert (tau * area * mask).sum() == pytest.approx(expected, rel=1e-12)
    twice = ((1 - beside) ** 2 * wind * area * mask).sum() + ice.ledger[-1].to_host[1] / 3600.0
    assert abs(twice - expected) > 1e-2 * abs(
        expected
    )  # the blend of the step before, blended again
    open_water = np.asarray(vs.forc_tke_surface)[inner][(fraction == 0) & (ice.model.grid.wet.reshape(12, 12).T)]  # fmt: skip
    assert open_water.max() > 0


def test_the_coast_of_the_floes_is_that_of_veros(veros, tmp_path, monkeypatch):
    coasts = []

    def noted(*where):
        coasts.append(from_land_fraction(*where))
        return coasts[-1]

    monkeypatch.setattr(veros, "from_land_fraction", noted)
    model = fram(veros, tmp_path).ice.model
    on_land_of_floes = on_land(coasts[0].polygons, model.grid.x, model.grid.y, model.domain)
    np.testing.assert_array_equal(on_land_of_floes, ~model.grid.wet)


def test_what_veros_is_given_is_what_the_air_and_the_ice_gave(veros, tmp_path):
    ocean = fram(veros, tmp_path)
    vs, ice = ocean.state.variables, ocean.ice
    inner, put = (slice(2, -2), slice(2, -2)), np.zeros(2)
    for _ in range(8):  # two exchanges
        ocean.step(ocean.state)
        for axis, (tau, mask, area) in enumerate(
            ((vs.surface_taux, vs.maskU, vs.area_u), (vs.surface_tauy, vs.maskV, vs.area_v))
        ):
            put[axis] += 900.0 * (np.asarray(tau * mask[..., -1] * area))[inner].sum()
    of_ice = sum(line.to_host for line in ice.ledger)
    assert np.abs(of_ice).min() > 0
    np.testing.assert_allclose(put, ice.open_water + of_ice, rtol=1e-12)


def test_layers_between_whose_points_veros_finds_no_distance_are_refused(
    veros, tmp_path, monkeypatch
):
    jumps = [500, 400, 300, 220, 150, 100, 60, 35, 20, 15]
    monkeypatch.setattr(veros, "LAYERS", np.array(jumps, float))
    with pytest.raises(InputError, match="dzw = .*-10.*thicknesses dzt must vary smoothly"):
        fram(veros, tmp_path)


def test_a_clock_of_veros_that_goes_back_another_mask_and_a_current_that_is_nan_are_refused(
    veros, tmp_path
):
    ocean = fram(veros, tmp_path)
    vs, ice = ocean.state.variables, ocean.ice
    for _ in range(4):
        ocean.step(ocean.state)
    place = f"floes at 3600 s, their state saved in {tmp_path / 'ice-rescue.nc'}"
    with vs.unlock():
        good = vs.u
        vs.u = np.where(np.ones_like(good, bool), np.nan, good)
        with pytest.raises(InputError, match="value nan on open u point") as caught:
            ice.force(ocean.state, *ocean.wind)
        assert str(caught.value).endswith(place)
        vs.u = good
        was, vs.time = vs.time, vs.time - 4500.0
        with pytest.raises(InputError, match="a clock went back or jumped") as caught:
            ice.force(ocean.state, *ocean.wind)
        assert str(caught.value).endswith(place)
        vs.time = was
        mask = vs.maskU
        vs.maskU = np.zeros_like(mask)
        with pytest.raises(InputError, match="masks or areas .* have changed") as caught:
            ice.force(ocean.state, *ocean.wind)
        assert str(caught.value).endswith(place)
        vs.maskU = mask
    assert (tmp_path / "ice-rescue.nc").exists()
    ocean.step(ocean.state)
    assert ice.model.time == 7200.0


def test_ice_on_veros_goes_on_from_its_file(veros, tmp_path):
    ocean = fram(veros, tmp_path)
    vs, ice = ocean.state.variables, ocean.ice
    for _ in range(6):
        ocean.step(ocean.state)
    ice.save_state(tmp_path / "saved.nc")
    again = fram(veros, tmp_path).ice
    again.load_state(tmp_path / "saved.nc")
    with vs.unlock():
        for now in (5400.0, 7200.0):  # in the exchange under way, and at the next one
            vs.time = now
            for one in (ice, again):
                one.force(ocean.state, *ocean.wind)
                written = np.array(vs.surface_taux), np.array(vs.forc_tke_surface)
                if one is ice:
                    expected = written
            for values, right in zip(written, expected, strict=True):
                np.testing.assert_array_equal(values, right)
    assert again.model.time == ice.model.time == 10800.0
    np.testing.assert_array_equal(again.model.floes.x, ice.model.floes.x)


def test_a_run_on_veros_that_was_cut_off_goes_on_to_the_same_result(veros, tmp_path):
    """Veros dies in its own step, when the ice has gone ahead; both have saved in the middle of an exchange.

    Veros' own restart, without ice as well, is the same to round-off and not to the last bit.
    """
    straight, broken = fram(veros, tmp_path / "straight"), fram(veros, tmp_path, save_every=5400.0)
    for _ in range(12):
        straight.step(straight.state)

    def dies(state):
        if state.variables.time >= 8 * 900.0:
            raise RuntimeError("node lost")

    broken.after_timestep = dies
    with pytest.raises(RuntimeError, match="node lost"):
        for _ in range(12):
            broken.step(broken.state)
    assert broken.ice.model.time == 7200.0
    resumed = fram(veros, tmp_path, restart=6)
    assert float(resumed.state.variables.time) == 5400.0
    for _ in range(6):
        resumed.step(resumed.state)
    for name in ("u", "v", "temp", "salt", "tke", "psi"):
        a, b = (np.asarray(getattr(of.state.variables, name)) for of in (straight, resumed))
        mark = 1e-12 if name == "psi" else 1e-13  # which is found by iteration, as near as that
        np.testing.assert_allclose(b, a, rtol=0, atol=mark * np.abs(a).max())
    a, b = straight.ice, resumed.ice
    np.testing.assert_allclose(b.model.floes.x, a.model.floes.x, rtol=1e-14)
    np.testing.assert_allclose(b.open_water, a.open_water, rtol=1e-13)
    assert b.ledger[-1].time == a.ledger[-1].time
    np.testing.assert_allclose(b.ledger[-1].to_host, a.ledger[-1].to_host, rtol=1e-11)
    assert b.ledger[-1].turnover == pytest.approx(a.ledger[-1].turnover, rel=1e-12)


# ---- what `SeaIce` reads and writes of Veros' arrays, without Veros ------------------------------------


def made_up_veros(**settings):
    """A state of 5 × 5 cells within ghost cells of two, as Veros has it; 3 layers, the last the surface.

    One cell of the surface is land; the layers below are land in other places.  Cells differ in both directions.
    """
    nx, ny = 9, 9
    dxt, dyt = 1e3 * np.linspace(1.0, 1.8, nx), 1e3 * np.linspace(2.0, 3.6, ny)
    xu, yu = np.cumsum(dxt) - dxt[:2].sum(), np.cumsum(dyt) - dyt[:2].sum()  # east and north faces
    xt, yt = xu - 0.5 * dxt, yu - 0.5 * dyt
    inner = np.zeros((nx, ny))
    inner[2:-2, 2:-2] = 1.0
    maskT = np.stack([inner, inner, inner], axis=2)
    maskT[4, 4, 2] = maskT[2, 5, :2] = 0.0
    maskU, maskV = np.zeros_like(maskT), np.zeros_like(maskT)
    maskU[:-1], maskV[:, :-1] = (
        np.minimum(maskT[:-1], maskT[1:]),
        np.minimum(maskT[:, :-1], maskT[:, 1:]),
    )
    dxu, dyu = np.append(np.diff(xt), dxt[-1]), np.append(np.diff(yt), dyt[-1])
    slope = 2e-6 * xt[:, None] - 3e-6 * yt[None, :]
    variables = SimpleNamespace(
        xu=xu, yu=yu, dxt=dxt, dyt=dyt, dxu=dxu, dyu=dyu, dzt=np.array([100.0, 30.0, 10.0]),
        dzw=np.array([65.0, 20.0, 10.0]), maskT=maskT, maskU=maskU, maskV=maskV,
        area_u=dxu[:, None] * dyt, area_v=dxt[:, None] * dyu,
        coriolis_t=1e-4 * np.ones((nx, 1)) + 1e-8 * np.arange(ny) + 1e-7 * np.arange(nx)[:, None],
        psi=np.stack([0.0 * slope, 9.81 * slope, 0.0 * slope], axis=2), tau=1, time=0.0, itt=0,
        u=np.zeros((nx, ny, 3, 3)), v=np.zeros((nx, ny, 3, 3)), forc_tke_surface=np.zeros((nx, ny)),
        surface_taux=None, surface_tauy=None,
    )  # fmt: skip
    variables.u[:, :, 2, 1], variables.v[:, :, 2, 1] = 0.3, -0.1  # at the surface, now
    given = {
        "dt_mom": 900.0, "dt_tracer": 900.0, "coord_degree": False, "enable_cyclic_x": False,
        "enable_streamfunction": False, "enable_tke": True, "rho_0": 1025.0, "grav": 9.81,
        "restart_frequency": 0.0,
    }  # fmt: skip
    return SimpleNamespace(variables=variables, settings=SimpleNamespace(**given | settings))


def ice_of(state, x, y, radius, every=1800.0):
    cells = surface_cells(state)
    forces = [OceanDrag(), AirDrag(), CoriolisField(), Tilt()]
    floes = Floes(x, y, radius, 1.0)
    model = Model(Domain(*cells_box(cells)), floes, None, forces, cells)
    return SeaIce(state, model, every=every)


def cells_box(cells):
    west, east, south, north = cells.bounds
    return (west, east), (south, north)


def test_the_cells_of_the_ice_are_those_of_the_surface_of_veros():
    state = made_up_veros()
    vs, cells = state.variables, surface_cells(state)
    np.testing.assert_allclose(cells.x_edges, np.append(0.0, np.cumsum(vs.dxt[2:-2])))
    np.testing.assert_allclose(cells.y_edges, np.append(0.0, np.cumsum(vs.dyt[2:-2])))
    assert np.argwhere(~cells.wet.reshape(cells.shape)).tolist() == [[2, 2]]  # row, column


@pytest.mark.long
def test_the_ice_reads_of_veros_what_its_forces_need():
    state = made_up_veros()
    vs, ice = state.variables, ice_of(state, [3e3], [8e3], 500.0)
    none = np.zeros_like(vs.area_u)
    ice.force(state, none, none)
    ocean, wet = ice.model.ocean, ice.model.grid.wet
    for name, value in (("u", 0.3), ("v", -0.1), ("tilt_x", 2e-6), ("tilt_y", -3e-6)):
        np.testing.assert_allclose(getattr(ocean, name)[wet], value, rtol=1e-12, err_msg=name)
    np.testing.assert_array_equal(ocean.coriolis, vs.coriolis_t[2:-2, 2:-2].T.ravel())
    assert ocean.layer_thickness == 10.0


@pytest.mark.long
def test_what_stirs_the_water_is_of_the_wind_beside_the_ice_and_of_the_ice():
    state = made_up_veros()
    vs, ice = state.variables, ice_of(state, [3e3, 4.5e3], [8e3, 5.5e3], [700.0, 500.0])
    wind = np.full_like(vs.area_u, 0.2) + 0.01 * np.arange(9)[:, None]
    ice.force(state, wind, 0.5 * wind)
    a = ice.fraction.T
    ocean = ice.model.ocean
    of_ice = ocean.magnitude.reshape(a.shape[::-1]).T / 1800.0  # |τ| over time, per cell
    x = 0.5 * (wind[2:-2, 2:-2] + wind[1:-3, 2:-2])  # of the faces on both sides of a cell
    of_air = np.hypot(x, 0.5 * wind[2:-2, 2:-2])
    per_ice = np.divide(of_ice, a, out=np.zeros_like(a), where=a > 0)
    expected = (1 - a) * (of_air / 1025.0) ** 1.5 + a * (per_ice / 1025.0) ** 1.5
    np.testing.assert_allclose(vs.forc_tke_surface[2:-2, 2:-2], expected, rtol=1e-12)
    assert 0 < a.max() < 1 and of_ice.max() > 0


@pytest.mark.long
def test_the_impulse_of_ice_in_a_cell_without_open_faces_is_told_as_undelivered():
    state = made_up_veros()
    state.variables.maskU[1:3, 2] = state.variables.maskV[2, 1:3] = 0.0  # around the first cell
    ice = ice_of(state, [600.0], [1200.0], 400.0)
    state.variables.u[..., 1] = 0.0
    ice.model.floes.u[:] = 0.2
    ice.force(state, *np.zeros((2, 9, 9)))
    line = ice.ledger[-1]
    assert line.to_host.tolist() == [0.0, 0.0] and line.undelivered[0] > 0.0
    assert line.relative < 1e-12


@pytest.mark.parametrize(
    ("settings", "every", "said"),
    [
        ({"coord_degree": True}, 1800.0, "coord_degree = True: floes need metres"),
        ({"dt_tracer": 450.0}, 1800.0, "dt_tracer = 450 s, dt_mom = 900 s: must be equal"),
        ({}, 1000.0, "every = 1000.0 s: must be a whole number of Veros' steps, 900 s"),
        ({}, 400.0, "every = 400.0 s: must be a whole number"),
        ({}, np.nan, "every = nan s: must be a whole number"),
        ({}, -900.0, "every = -900.0 s: must be a whole number"),
        ({}, "1800", "every = '1800' s: must be a whole number"),
    ],
)
def test_what_does_not_fit_veros_is_refused(settings, every, said):
    with pytest.raises(InputError, match=said):
        ice_of(made_up_veros(**settings), [3e3], [8e3], 500.0, every)


def test_a_model_of_other_cells_is_refused():
    state = made_up_veros()
    model = ice_of(state, [3e3], [8e3], 500.0).model
    state.variables.xu = state.variables.xu + 1.0
    with pytest.raises(InputError, match="grid must be surface_cells"):
        SeaIce(state, model, every=1800.0)


# ---- YAC ----------------------------------------------------------------------------------------------

MPI = glob.glob(sys.prefix + "/lib/libmpi.so.40")
with_yac = pytest.mark.skipif(
    importlib.util.find_spec("yac") is None or not MPI,
    reason="the extra `yac` (YAC and Open MPI) is not installed",
)


def in_its_own_process(*command, fails=False):
    """YAC ends the process on an error, and MPI starts once: never in the process of the tests."""
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "examples")]),
    }  # fmt: skip
    done = subprocess.run(
        [str(word) for word in command],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.returncode != 0) == fails, done.stdout + done.stderr
    return done.stdout + done.stderr


YAC = ROOT / "examples" / "yac_coupler.py"
TWO = (Path(sys.prefix) / "bin" / "mpirun", "--oversubscribe", "-n", "2", sys.executable)


@with_yac
def test_through_yac_the_ocean_gets_the_force_that_the_floes_felt(tmp_path, capsys):
    in_its_own_process(sys.executable, YAC, "--folder", tmp_path)
    found = example("yac_coupler").compare(tmp_path)
    assert found.worst <= 1e-9
    assert found.force > 1e7
    assert np.abs([line.host for line in found.ledger]).min() > 0
    assert "residual" in capsys.readouterr().out
    assert (tmp_path / "yac-coupler.png").stat().st_size > 30_000


@with_yac
def test_through_yac_an_ice_model_without_floes_leaves_the_ocean_as_it_is_alone(tmp_path):
    in_its_own_process(sys.executable, YAC, "--folder", tmp_path, "--no-ice")
    water = load_restart(tmp_path / "ocean-8.nc")[0]["water"]
    cells = np.tile(np.arange(-3.75, 4.0, 0.5), 12)  # the slab alone keeps what it starts with
    np.testing.assert_array_equal(water, [0.3 * np.cos(np.radians(30.0 * cells)), 0 * cells])


DIES = """
import os, signal, sys
from pathlib import Path
import yac_coupler as yac

get, calls = yac.Side.get, []

def dies(self, fields):
    values = get(self, fields)
    calls.append(fields)
    if self.name == sys.argv[1] and len(calls) == 5:
        if sys.argv[2] == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        values[0, 7] = float("nan")
    return values

yac.Side.get = dies
yac.main(Path(sys.argv[3]))
"""


@with_yac
@pytest.mark.long
def test_a_partner_that_dies_in_yac_is_told_in_a_line_and_a_restart_ends_the_same(tmp_path):
    (tmp_path / "dies.py").write_text(DIES)
    in_its_own_process(*TWO, YAC, "--folder", tmp_path / "whole")
    assert example("yac_coupler").compare(tmp_path / "whole").worst <= 1e-9
    for who, how, teller, text in (
        ("ocean", "killed", "ice", "exchange 6: ended from outside, the other component is gone"),
        ("ice", "killed", "ocean", "exchange 5: ended from outside, the other component is gone"),
        ("ice", "nan", "ice", "exchange 5: .*velocity: nan at index 7, a wet cell: must be finite"),
    ):
        folder = tmp_path / f"{who}-{how}"
        said = in_its_own_process(*TWO, tmp_path / "dies.py", who, how, folder, fails=True)
        line = f"^{teller}: {text}; the state after exchange . is saved in {folder}: go on with"
        assert len(re.findall(line, said, re.MULTILINE)) == 1, said
        in_its_own_process(*TWO, YAC, "--folder", folder, "--restart")
        for name in ("ice.json", "ocean.json"):
            assert (folder / name).read_text() == (tmp_path / "whole" / name).read_text()


# ---- another process, through gRPC --------------------------------------------------------------------


def test_a_host_in_another_process_gets_the_numbers_of_a_host_in_the_same_and_outlives_it(tmp_path):
    pytest.importorskip("grpc4bmi", reason="the extra `grpc` is not installed")
    found = example("two_processes").main(tmp_path, hours=0.5)
    assert found.same
    assert found.alone  # without ice, the ocean alone
    assert found.worst <= 1e-12
    assert "must be finite" in found.refusal and "\n" not in found.refusal
    assert found.fault.startswith("exchange ") and found.fault.endswith("floes do not answer")
    assert "\n" not in found.fault
    assert found.resumed  # from the checkpoint of the process that was killed
    assert (tmp_path / "two-processes.png").stat().st_size > 20_000
