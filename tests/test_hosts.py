"""Real hosts, both ways: what one loses the other gains, on the host's own faces and masks."""

import numpy as np
import pytest
from test_examples import example

from floebmi.errors import InputError


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
    refused("value nan on open point 67")
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
