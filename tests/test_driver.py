"""Two BMI models coupled both ways: the books close, and whatever goes wrong is said in one line."""

import contextlib
import importlib.util
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cf_units
import numpy as np
import pytest

from coupling.connection import COUNT, OVER_ICE, Connection
from coupling.driver import (
    HEADER,
    Coupling,
    CouplingError,
    Exchange,
    Link,
    bmi_grid,
    couple,
)
from coupling.regrid import Regrid
from coupling.slab import MOMENTUM, RECEIVED, STRESS, SURFACE, TwoSlabOcean
from floebmi.errors import InputError
from floebmi.grid import Grid
from floebmi.variables import outputs

OCEAN = """
[grid]
x = [0.0, 20e3]
y = [0.0, 12e3]
spacing = 2e3
[ocean]
surface_thickness = 3.0
deep_thickness = 12.0
surface_velocity = [0.4, -0.1]
[time]
step = 300.0
"""
RUNNING = tuple(
    f"sea_ice_bottom_water_flowing__time_integral_of_{a}_z_component_of_stress" for a in "xy"
)
ICE_MOMENTUM = tuple(f"sea_ice_flowing__domain_integral_of_{a}_component_of_momentum" for a in "xy")
OTHER = tuple(
    f"sea_ice_flowing__domain_time_integral_of_{a}_component_of_other_force" for a in "xy"
)
FRACTION, THICKNESS = "sea_ice__area_fraction", "sea_ice__thickness"
UNITS = {
    **dict.fromkeys(SURFACE, "m s-1"), **dict.fromkeys(STRESS, "Pa"), **dict.fromkeys(RUNNING, "Pa s"),
    **dict.fromkeys(ICE_MOMENTUM + OTHER, "kg m s-1"), FRACTION: "1", THICKNESS: "m",
}  # fmt: skip


class Ice:
    """A stand-in for floes: ice in every cell, pushed by water and wind, in steps of 60 s.

    It speaks as much BMI as a coupler needs.  `stress` is that of the last step only, which is what many
    components give.
    """

    def __init__(self, grid, wind=(0.0, 0.0), fraction=0.7):
        self.grid, self.wind = grid, wind
        self.fraction = np.where(grid.wet, fraction, 0.0)
        self.now = 0.0
        self.values = {name: np.zeros(grid.size) for name in (*SURFACE, *STRESS, *RUNNING)}
        self.values |= {name: np.zeros(1) for name in ICE_MOMENTUM + OTHER}
        self.values |= {FRACTION: self.fraction, THICKNESS: np.linspace(1, 2, grid.size)}
        self.velocity = np.zeros((2, grid.size))
        self.mass = 900.0 * self.fraction * self.values[THICKNESS]  # per cell area

    def update(self):
        dt = 60.0
        slip = np.stack([self.values[name] for name in SURFACE]) - self.velocity
        drag = 1000.0 * 5e-3 * self.fraction * np.hypot(*slip) * slip
        push = self.fraction * np.asarray(self.wind)[:, None]
        mass = np.where(self.mass > 0, self.mass, 1.0)
        self.velocity += np.where(self.mass > 0, (drag + push) * dt / mass, 0.0)
        for axis in (0, 1):
            self.values[STRESS[axis]][:] = -drag[axis]
            self.values[RUNNING[axis]] -= drag[axis] * dt
            self.values[OTHER[axis]] += (push[axis] * self.grid.area).sum() * dt
            momentum = (self.mass * self.velocity[axis] * self.grid.area).sum()
            self.values[ICE_MOMENTUM[axis]][0] = momentum
        self.now += dt

    def update_until(self, end):
        for _ in range(round((end - self.now) / 60.0)):
            self.update()

    def save_state(self, path):
        arrays = {f"v{k}": values for k, values in enumerate(self.values.values())}
        np.savez(path, now=self.now, velocity=self.velocity, **arrays)

    def load_state(self, path):
        stored = np.load(path)
        self.now, self.velocity = float(stored["now"]), stored["velocity"]
        for k, values in enumerate(self.values.values()):
            values[:] = stored[f"v{k}"]

    def get_component_name(self):
        return "stand-in"

    def get_input_var_names(self):
        return SURFACE

    def get_output_var_names(self):
        return (*STRESS, *RUNNING, *ICE_MOMENTUM, *OTHER, FRACTION, THICKNESS)

    def get_time_units(self):
        return "s"

    def get_time_step(self):
        return 60.0

    def get_start_time(self):
        return 0.0

    def get_current_time(self):
        return self.now

    def get_end_time(self):
        return sys.float_info.max

    def get_var_grid(self, name):
        return 3 if self.values[name].size == self.grid.size else 4

    def get_var_location(self, name):
        return "face"

    def get_var_units(self, name):
        return UNITS[name]

    def get_var_type(self, name):
        return "float64"

    def get_var_itemsize(self, name):
        return 8

    def get_var_nbytes(self, name):
        return self.values[name].nbytes

    def get_value(self, name, dest):
        dest[:] = self.values[name]
        return dest

    def set_value(self, name, src):
        self.values[name][:] = src

    def get_grid_type(self, grid):
        return "unstructured"

    def get_grid_size(self, grid):
        return self.grid.size

    def get_grid_node_count(self, grid):
        return self.grid.node_x.size

    def get_grid_face_count(self, grid):
        return self.grid.size

    def get_grid_x(self, grid, x):
        x[:] = self.grid.node_x
        return x

    def get_grid_y(self, grid, y):
        y[:] = self.grid.node_y
        return y

    def get_grid_nodes_per_face(self, grid, nodes):
        nodes[:] = (self.grid.face_nodes >= 0).sum(1)
        return nodes

    def get_grid_face_nodes(self, grid, nodes):
        nodes[:] = self.grid.face_nodes[self.grid.face_nodes >= 0]
        return nodes


class Altered:
    """A model with some answers changed; everything else goes through."""

    def __init__(self, model, **answers):
        self._model = model
        self.__dict__.update(answers)

    def __getattr__(self, name):
        return getattr(self._model, name)


@pytest.fixture
def ocean(tmp_path):
    def started(kind=TwoSlabOcean):
        path = tmp_path / "ocean.toml"
        path.write_text(OCEAN)
        model = kind()
        model.initialize(str(path))
        return model

    return started


def same_cells():
    return Grid.uniform((0, 20e3), (0, 12e3), spacing=2e3)


def hexagons():
    """Polygons that fill part of the ocean: squares with a corner cut off, and the corners."""
    faces, x, y = [], [], []
    for j in range(5):
        for i in range(7):
            k = len(x)
            x += [3e3 + 1.7e3 * (i + a) for a in (0, 1, 1, 0.6, 0)]
            y += [2e3 + 1.5e3 * (j + b) for b in (0, 0, 0.5, 1, 1)]
            x += [3e3 + 1.7e3 * (i + 1)]
            y += [2e3 + 1.5e3 * (j + 1)]
            faces += [[k, k + 1, k + 2, k + 3, k + 4], [k + 2, k + 5, k + 3]]
    return Grid.unstructured(x, y, faces)


CELLS = {
    "the same cells": same_cells,
    "finer, and part of the ocean": lambda: Grid.uniform((3e3, 14e3), (1e3, 10e3), spacing=500.0),
    "polygons": hexagons,
}


def momentum_of(ocean, ice, axis):
    return ocean.get_value_ptr(MOMENTUM[axis])[0] + ice.values[ICE_MOMENTUM[axis]][0]


@pytest.mark.parametrize("cells", CELLS)
def test_ocean_and_ice_momentum_is_constant_and_every_line_of_the_ledger_closes(cells, ocean):
    ocean, ice, lines = ocean(), Ice(CELLS[cells]()), []
    before = [momentum_of(ocean, ice, axis) for axis in (0, 1)]
    ledger = couple(ocean, ice, every=600.0, until=24 * 600.0, show=lines.append)
    assert len(ledger) == 24
    assert (ice.now, ocean.get_current_time()) == (24 * 600.0, 24 * 600.0)
    exchanged = ledger[-1].turnover
    assert exchanged > 1e8
    for axis in (0, 1):
        assert abs(momentum_of(ocean, ice, axis) - before[axis]) < 1e-12 * exchanged
    for line in ledger:
        assert line.relative < 1e-12
        np.testing.assert_allclose(line.host, line.to_host, rtol=0, atol=1e-12 * exchanged)
        np.testing.assert_allclose(line.floes, line.from_host, rtol=0, atol=1e-12 * exchanged)
    assert ledger[0].from_host[0] > 0 > ledger[0].to_host[0]  # the water drags the ice along +x
    assert lines[1] == HEADER
    assert len(lines) == 2 + 24
    assert len(lines[-1]) == len(HEADER)
    assert "nobody fills: nothing" in lines[0]
    assert "differenced" in lines[0]


def test_a_stress_that_goes_to_two_inputs_is_in_the_ledger_once(ocean):
    """One moves the water, one stirs it: the floes lost the momentum once."""
    stirring = "sea_water__stirring_stress"

    class Stirred(TwoSlabOcean):
        def initialize(self, config_file):
            super().initialize(config_file)
            self._values[stirring] = np.zeros(60)

        def get_input_var_names(self):
            return (*super().get_input_var_names(), stirring)

        def get_var_units(self, name):
            return "Pa" if name == stirring else super().get_var_units(name)

        @staticmethod
        def _grid_of(name):
            return TwoSlabOcean._grid_of(STRESS[0] if name == stirring else name)

        def set_value(self, name, src):
            if name == stirring:
                self._values[name][:] = src
            else:
                super().set_value(name, src)

    for cells in (same_cells, hexagons):
        once, twice = ocean(), ocean(Stirred)
        expected = couple(once, Ice(cells()), every=600.0, until=1800.0)
        ledger = couple(
            twice, Ice(cells()), every=600.0, until=1800.0, to_host={stirring: RUNNING[0]}
        )
        np.testing.assert_array_equal(twice.get_value_ptr(stirring), twice.get_value_ptr(STRESS[0]))
        for line, right in zip(ledger, expected, strict=True):
            assert line.relative < 1e-12
            np.testing.assert_array_equal(line.from_host, right.from_host)
            np.testing.assert_array_equal(line.to_host, right.to_host)
            np.testing.assert_allclose(line.host, line.to_host, rtol=0, atol=1e-12 * line.turnover)


@pytest.mark.parametrize("until", [None, "600", [600.0], np.nan])
def test_an_exchange_to_what_is_no_time_is_refused_before_anything_happens(until, ocean):
    coupling = Coupling(ocean(), Ice(same_cells()), 600.0)
    with pytest.raises(InputError, match="until = .*: must be a finite number"):
        coupling.exchange(until)
    assert not coupling.ledger


def test_the_stress_of_the_last_step_loses_momentum(ocean):
    ocean, ice = ocean(), Ice(same_cells())
    before = momentum_of(ocean, ice, 0)
    wrong = {name: name for name in STRESS}
    ledger = couple(ocean, ice, every=1800.0, until=4 * 1800.0, to_host=wrong)
    exchanged = ledger[-1].turnover
    assert abs(momentum_of(ocean, ice, 0) - before) > 0.3 * ice.values[ICE_MOMENTUM[0]][0]
    assert ledger[-1].relative > 0.02  # and the ledger shows it
    assert exchanged > 0


def test_what_the_wind_gives_has_its_own_column(ocean):
    ice = Ice(hexagons(), wind=(0.1, -0.2))
    ledger = couple(ocean(), ice, every=1200.0, until=6000.0)
    for line in ledger:
        assert line.relative < 1e-12
        assert line.other[0] > 0 > line.other[1]
        np.testing.assert_allclose(line.floes, line.from_host + line.other, rtol=1e-9)


def test_an_ocean_without_ice_is_the_ocean_alone_to_the_last_bit(ocean):
    coupled, alone = ocean(), ocean()
    couple(coupled, Ice(hexagons(), fraction=0.0), every=600.0, until=6000.0)
    for k in range(1, 11):
        alone.update_until(600.0 * k)
    for name in alone.get_output_var_names():
        np.testing.assert_array_equal(alone.get_value_ptr(name), coupled.get_value_ptr(name))


def test_land_of_the_host_gets_no_stress_and_its_velocities_are_not_read(ocean):
    ocean, ice = ocean(), Ice(Grid.uniform((0, 20e3), (0, 12e3), spacing=1.5e3 / 1.5))
    wet = np.ones(60, bool)
    wet[[0, 1, 10, 11, 25]] = False
    land = bmi_grid(ocean, SURFACE[0]).with_wet(wet)
    ocean.get_value_ptr(SURFACE[0])[~wet] = np.nan
    lines = []
    coupling = Coupling(ocean, ice, 600.0, host_grids={0: land})
    line = coupling.exchange(600.0)
    assert (ocean.get_value_ptr(STRESS[0])[~wet] == 0).all()
    assert (ocean.get_value_ptr(STRESS[0])[wet] != 0).all()
    assert line.relative < 1e-13
    assert "not at all" in repr(coupling)
    with pytest.raises(CouplingError, match=r"is nan in cell 0 \(5 such cells\) at 600 s"):
        couple(ocean, ice, every=600.0, until=1200.0)
    assert lines == []


def test_the_floes_budget_counts_what_they_gave_to_no_water():
    """Wind gave 4 N s; the water got 3, and 2 more were lost on the floes' own grid: they are slower by 1."""
    given, none = np.array([3.0, 0.0]), np.zeros(2)
    change = {"floes": [-1.0, 0.0], "other": [4.0, 0.0], "no_water": [2.0, 0.0]}
    change = {name: np.array(pair) for name, pair in change.items()}
    stress = {"given": given, "taken": given, "missed": none, "turnover": 10.0}
    line = Exchange.balanced(1, 600.0, 600.0, **stress, **change)
    assert (line.budget_residual == 0.0).all() and line.relative == 0.0


def test_stress_over_land_cells_only_is_reported_as_undelivered(ocean):
    ocean, ice = ocean(), Ice(Grid.uniform((0, 20e3), (0, 12e3), spacing=500.0))
    wet = np.ones(60, bool)
    wet[:20] = False
    ice_grid_wet = bmi_grid(ocean, SURFACE[0]).with_wet(wet)
    coupling = Coupling(ocean, ice, 600.0, host_grids={0: ice_grid_wet})
    coupling.exchange(600.0)
    ice.values[SURFACE[0]][:] = 0.0
    ice.velocity[0, :100] = 1.0  # ice slides over the land, where the water stands still
    line = coupling.exchange(1200.0)
    assert line.undelivered[0] > 0
    assert np.abs(line.exchange_residual).max() < 1e-12 * line.turnover


# ---- what belongs together --------------------------------------------------------------------


def test_explicit_names_come_first_and_what_nobody_fills_is_listed(ocean):
    ice = Ice(same_cells())
    deep = "sea_deep_water_flowing__x_component_of_velocity"
    coupling = Coupling(ocean(), ice, 600.0, to_floes={SURFACE[0]: deep, SURFACE[1]: None})
    assert coupling.unmatched == (f"floes: {SURFACE[1]}",)
    coupling.run(600.0)
    np.testing.assert_array_equal(ice.values[SURFACE[0]], 0.0)
    ice = Ice(same_cells())
    one_way = couple(ocean(), ice, every=600.0, until=600.0, to_host=dict.fromkeys(STRESS))
    assert one_way[0].to_host[0] == 0
    assert one_way[0].budget_residual is None
    assert np.isnan(one_way[0].from_host).all() and np.isnan(one_way[0].relative)  # not 0: it moved
    assert ice.velocity[0].min() > 0


def test_what_the_ledger_cannot_see_of_the_stress_is_nan_and_no_residual_of_zero(ocean):
    """A host that takes a mean (or the stress per ice area) makes a force of it that nobody adds up."""
    running = [name.replace("__", "__time_integral_of_", 1) for name in STRESS]
    links = {name: Link(source, "mean") for name, source in zip(STRESS, running, strict=True)}
    unseen = couple(ocean(), Ice(hexagons()), every=600.0, until=600.0, to_host=links)[0]
    for pair in (unseen.from_host, unseen.to_host, unseen.undelivered, unseen.exchange_residual):
        assert np.isnan(pair).all()
    assert np.isnan(unseen.relative) and "nan" in str(unseen)
    one = couple(
        ocean(), Ice(hexagons()), every=600.0, until=600.0, to_host={STRESS[1]: links[STRESS[1]]}
    )[0]
    assert one.from_host[0] > 0 and np.isnan(one.from_host[1]) and np.isnan(one.relative)


def test_ice_fraction_keeps_its_area_and_thickness_its_volume(ocean):
    """A host that asks for both gets Σ A c and Σ A c h as they were."""
    got = {}

    def extended(model):
        return Altered(
            model,
            get_input_var_names=lambda: (*STRESS, FRACTION, THICKNESS),
            get_var_grid=lambda name: 0 if name in UNITS else 1,
            get_var_units=lambda name: UNITS.get(name, "N s"),
            get_var_location=lambda name: "node",
            get_var_type=lambda name: "float64",
            get_var_itemsize=lambda name: 8,
            get_var_nbytes=lambda name: 8 if "domain" in name else 480,
            set_value=lambda name, values: got.update({name: values}),
        )

    ice = Ice(hexagons())
    ice.fraction[::3] = 0.0
    ice.values[THICKNESS][ice.fraction == 0] = 0.0
    host = extended(ocean())
    couple(host, ice, every=600.0, until=600.0)
    area = bmi_grid(ocean(), SURFACE[0]).area
    ice_area = ice.fraction * ice.grid.area
    np.testing.assert_allclose((got[FRACTION] * area).sum(), ice_area.sum(), rtol=1e-13)
    volume = (got[FRACTION] * got[THICKNESS] * area).sum()
    np.testing.assert_allclose(volume, (ice_area * ice.values[THICKNESS]).sum(), rtol=1e-12)
    assert got[THICKNESS][got[THICKNESS] > 0].min() >= 1.0  # never thinned by open water


def test_what_is_per_cell_area_crosses_with_its_integral_kept(ocean):
    """All such outputs of the table; the cells of the ice cover those of the host in part."""
    units = {
        row.csdms: row.units
        for row in outputs()
        if row.units in ("Pa", "kg m-2", "kg m-2 s-1") or row.name.endswith("fraction")
        if row.grid == "exchange" and row.csdms not in (*STRESS, *OVER_ICE)
    }
    assert len(units) == 7
    got, model, cells = {}, ocean(), hexagons()
    host = Altered(
        model,
        get_input_var_names=lambda: tuple(units),
        get_var_grid=lambda name: 0 if name in units else model.get_var_grid(name),
        get_var_units=lambda name: units.get(name) or model.get_var_units(name),
        get_var_location=lambda name: "node",
        get_var_type=lambda name: "float64",
        get_var_itemsize=lambda name: 8,
        get_var_nbytes=lambda name: 480 if name in units else model.get_var_nbytes(name),
        set_value=lambda name, values: got.update({name: values}),
    )
    field = np.linspace(1.0, 2.0, cells.size)
    ice = Ice(cells)
    ice.values |= {name: field * (k + 1) for k, name in enumerate(units)}
    names = (*ice.get_output_var_names(), *units)
    giver = Altered(
        ice,
        get_output_var_names=lambda: tuple(dict.fromkeys(names)),
        get_var_units=lambda name: units.get(name) or ice.get_var_units(name),
    )
    couple(host, giver, every=600.0, until=600.0)
    area = bmi_grid(ocean(), SURFACE[0]).area
    for k, name in enumerate(units):
        assert (got[name] * area).sum() == pytest.approx((k + 1) * field @ cells.area), name


def carried(name, values, regrid):
    """An output of floes that have these values, carried to an input of the host with the same name."""
    one = cf_units.Unit("1")
    of_both = {"unit": lambda name: one, "grid_number": lambda name: 0}
    giver = SimpleNamespace(
        name="floes", get=values.__getitem__, outputs=tuple(values),
        know_grid=lambda name: regrid.target, **of_both,
    )  # fmt: skip
    taker = SimpleNamespace(
        name="host", know_grid=lambda name: regrid.source,
        model=SimpleNamespace(get_var_type=lambda name: "float64"), **of_both,
    )  # fmt: skip
    return Connection(giver, taker, name, Link(name), lambda *_: regrid).carry(values[name])


def test_means_over_the_ice_are_weighted_by_what_makes_them_amounts_again():
    """Two cells of the floes in one of the host: velocity keeps momentum, thickness and stress per ice area theirs."""
    cells = Grid.uniform((0.0, 2.0), (0.0, 1.0), spacing=1.0)
    regrid = Regrid(Grid.uniform((0.0, 2.0), (0.0, 1.0), shape=(1, 1)), cells)
    fraction, mass = "sea_ice__area_fraction", "sea_ice__mass-per-area_density"
    amounts = {fraction: np.array([0.2, 0.6]), mass: np.array([900.0, 100.0])}
    of_x = "sea_ice_flowing__x_component_of_velocity"
    per_ice = "sea_ice_floe_bottom_water_flowing__x_z_component_of_stress"
    for name, weight, mean in (
        (THICKNESS, fraction, (0.2 * 1 + 0.6 * 3) / 0.8),
        (of_x, mass, (900 * 1 + 100 * 3) / 1000),
        (of_x.replace("x_", "y_"), mass, 1.2),
        (per_ice, fraction, 2.5),
        (per_ice.replace("x_z", "y_z"), fraction, 2.5),
    ):
        assert OVER_ICE[name] == weight
        values = amounts | {name: np.array([1.0, 3.0])}
        assert carried(name, values, regrid) == pytest.approx([mean])


def test_amounts_of_ice_and_floes_are_kept_at_land_of_the_host_and_on_uneven_cells():
    """Volume, momentum, force, number of floes, their radii, contacts, and pressure, on cells half over land."""
    floes = Grid.rectilinear([0.0, 1.0, 4.0, 6.0], [0.0, 2.0, 3.0])
    wet = np.ones((3, 4), bool)
    wet[1, 1] = wet[2, 3] = False
    host = Grid.uniform((0.0, 6.0), (0.0, 3.0), shape=(3, 4), wet=wet)
    regrid = Regrid(host, floes)
    rng = np.random.default_rng(6)
    fraction, mass, count = "sea_ice__area_fraction", "sea_ice__mass-per-area_density", COUNT
    of_x = "sea_ice_flowing__x_component_of_velocity"
    per_ice = "sea_ice_floe_bottom_water_flowing__x_z_component_of_stress"
    sigma = "sea_ice_flowing__z_integral_of_{a}_{a}_component_of_stress"
    stress = [sigma.format(a=a) for a in "xy"]
    pressure = "sea_ice_flowing__z_integral_of_pressure"
    radius, contacts = "sea_ice_floe__mean_of_radius", "sea_ice_floe_contact__mean_of_count"
    values = {
        name: rng.uniform(1.0, 2.0, floes.size)
        for name in (fraction, mass, count, of_x, per_ice, *stress, radius, contacts, THICKNESS)
    }
    values[pressure] = -(values[stress[0]] + values[stress[1]]) / 2
    got = {}
    for name in values:
        got[name] = carried(name, values, regrid)
    for behind, name in ((fraction, THICKNESS), (fraction, per_ice), (mass, of_x)):
        kept = (values[behind] * values[name]) @ floes.area
        assert (got[behind] * got[name]) @ host.area == pytest.approx(kept, rel=1e-13), name
    assert got[count].sum() == pytest.approx(values[count].sum(), rel=1e-13)
    for name in (radius, contacts):
        assert got[count] @ got[name] == pytest.approx(values[count] @ values[name], rel=1e-13), (
            name
        )
    np.testing.assert_allclose(got[pressure], -(got[stress[0]] + got[stress[1]]) / 2, rtol=1e-13)


def test_convertible_units_are_converted_and_others_are_refused(ocean):
    plain, ice = ocean(), Ice(hexagons())
    couple(plain, ice, every=600.0, until=1800.0)

    def units(name):
        return {SURFACE[0]: "km h-1", STRESS[0]: "dyne cm-2"}.get(name) or model.get_var_units(name)

    def get_value(name, dest):
        dest[:] = model.get_value_ptr(name) * (3.6 if name == SURFACE[0] else 1.0)
        return dest

    model = ocean()
    other = Altered(
        model,
        get_var_units=units,
        get_value=get_value,
        set_value=lambda name, v: model.set_value(name, v / (10.0 if name == STRESS[0] else 1.0)),
    )
    ledger = couple(other, again := Ice(hexagons()), every=600.0, until=1800.0)
    np.testing.assert_allclose(
        plain.get_value_ptr(SURFACE[0]), model.get_value_ptr(SURFACE[0]), rtol=1e-13
    )
    assert ledger[-1].relative < 1e-12
    assert "[km h-1]" in repr(Coupling(other, again, 600.0))

    cases = {
        "kg m-3": "of the floes wants .m s-1.: not the same quantity", "": "not units that UDUNITS knows", "metres per hour!": "not units"
    }  # fmt: skip
    for wrong, text in cases.items():
        host = Altered(ocean(), get_var_units=lambda name, wrong=wrong: wrong)
        with pytest.raises(InputError, match=text) as caught:
            Coupling(host, Ice(hexagons()), 600.0)
        assert "\n" not in str(caught.value)
    told = dict.fromkeys(SURFACE, "m s-1") | dict.fromkeys(STRESS, "N m-2")
    Coupling(
        Altered(ocean(), get_var_units=lambda name: ""), Ice(hexagons()), 600.0, host_units=told
    )


@pytest.mark.parametrize("says", ["", "-", "m s-1"])
def test_units_said_for_one_model_are_not_those_of_the_other(ocean, says):
    """The two have the same names: a host in cm/s must not make the ice take cm/s for m/s."""
    model = ocean()

    def set_value(name, values):
        model.set_value(name, values / 10.0 if name in STRESS else values)

    def get_value(name, values):
        model.get_value(name, values)
        if name in SURFACE:
            values *= 100.0
        return values

    host = Altered(model, get_value=get_value, set_value=set_value, get_var_units=lambda name: says)
    told = dict.fromkeys(SURFACE, "cm s-1") | dict.fromkeys(STRESS, "dyne cm-2")
    plain = ocean()
    couple(host, Ice(hexagons()), every=600.0, until=1200.0, host_units=told)
    couple(plain, Ice(hexagons()), every=600.0, until=1200.0)
    np.testing.assert_allclose(
        model.get_value_ptr(SURFACE[0]), plain.get_value_ptr(SURFACE[0]), rtol=1e-13
    )
    # and the other way round: floes that say nothing
    mute, model = Altered(Ice(hexagons()), get_var_units=lambda name: ""), ocean()
    known = {name: Ice(hexagons()).get_var_units(name) for name in (*SURFACE, *RUNNING)}
    couple(model, mute, every=600.0, until=1200.0, floes_units=known)
    np.testing.assert_allclose(
        model.get_value_ptr(SURFACE[0]), plain.get_value_ptr(SURFACE[0]), rtol=1e-13
    )
    with pytest.raises(InputError, match="say them with floes_units"):
        Coupling(ocean(), mute, 600.0)


@pytest.mark.parametrize("asked", ["get_grid_spacing", "get_var_units", "get_start_time"])
def test_a_host_that_fails_when_it_is_asked_what_it_has_is_told_in_one_line(ocean, asked):
    def fails(*_):
        raise RuntimeError("mesh lost\nTraceback of a server")

    with pytest.raises(CouplingError, match="^couple: as the models were asked.*: mesh lost$"):
        Coupling(Altered(ocean(), **{asked: fails}), Ice(hexagons()), 600.0)


def test_clocks_in_other_units_and_with_other_starts_are_compared(ocean):
    plain, ice = ocean(), Ice(hexagons())
    couple(plain, ice, every=600.0, until=1800.0)
    model = ocean()
    hours = Altered(
        model,
        get_time_units=lambda: "hours since 2016-02-01 00:00",
        get_start_time=lambda: 24.0,
        get_current_time=lambda: 24.0 + model.get_current_time() / 3600,
        get_end_time=lambda: 1e6,
        update_until=lambda t: model.update_until(round((t - 24.0) * 3600, 6)),
    )
    couple(hours, Ice(hexagons()), every=600.0, until=1800.0)
    np.testing.assert_allclose(
        plain.get_value_ptr(SURFACE[0]), model.get_value_ptr(SURFACE[0]), rtol=1e-14
    )
    with pytest.raises(InputError, match="no unit of time"):
        Coupling(Altered(model, get_time_units=lambda: "m"), Ice(hexagons()), 600.0)
    model = ocean()
    model.update_until(900.0)
    with pytest.raises(InputError, match="host is at 900 s, the floes at 0 s"):
        couple(model, Ice(hexagons()), every=600.0, until=1800.0)
    couple(model, Ice(hexagons()), every=600.0, until=1800.0, offset=900.0)
    assert model.get_current_time() == 2700.0


@pytest.mark.parametrize("every", [300.0, 600.0])
@pytest.mark.parametrize(
    ("units", "second", "start"),
    [
        ("days since 0001-01-01", 1 / 86400, 736330.123),
        ("hours since 1900-01-01", 1 / 3600, 1.095e6),
    ],
)
def test_a_clock_that_counts_from_long_ago_tells_time_as_well_as_it_can(
    ocean, units, second, start, every
):
    """A day's count since the year 1 tells 1e-5 s apart, and no less."""
    model = ocean()
    host = Altered(
        model,
        get_time_units=lambda: units,
        get_start_time=lambda: start,
        get_current_time=lambda: start + model.get_current_time() * second,
        get_end_time=lambda: start + 9000.0 * second,
        update_until=lambda t: model.update_until(round((t - start) / second)),
    )
    assert len(couple(host, Ice(hexagons()), every=every, until=9000.0)) == 9000.0 / every
    model = ocean()  # a hundredth of a second is not round-off
    host.update_until = lambda t: model.update_until(round((t - start) / second) + 0.01)
    with pytest.raises(CouplingError, match="the host stands at"):
        couple(host, Ice(hexagons()), every=every, until=9000.0)


def test_a_host_of_single_precision_gets_what_the_ledger_says(ocean):
    """What single precision cuts off is a residual of the exchange."""
    model = ocean()
    single = Altered(
        model,
        get_var_type=lambda name: "float32",
        get_var_itemsize=lambda name: 4,
        get_var_nbytes=lambda name: model.get_var_nbytes(name) // 2,
    )
    ledger = couple(single, Ice(hexagons()), every=600.0, until=6000.0)
    assert 1e-10 < ledger[-1].relative < 1e-6
    given = sum(line.to_host for line in ledger)
    taken = [model.get_value_ptr(name)[0] for name in RECEIVED]
    np.testing.assert_allclose(given, taken, rtol=0, atol=1e-13 * ledger[-1].turnover)


def test_a_host_that_can_only_step_is_stepped_and_must_land_on_the_exchange(ocean):
    def refuse(_):
        raise NotImplementedError

    model = ocean()
    couple(Altered(model, update_until=refuse), Ice(hexagons()), every=600.0, until=1200.0)
    assert model.get_current_time() == 1200.0
    ice = Ice(hexagons())
    jumping = Altered(ice, update_until=lambda t: setattr(ice, "now", t))
    with pytest.raises(
        CouplingError, match="stands at 900 s after an update to 700 s .its own step is 300"
    ):
        couple(Altered(ocean(), update_until=refuse), jumping, every=700.0, until=700.0)


# ---- cells ------------------------------------------------------------------------------------


class Told:
    """A model of which only the grid is asked."""

    def __init__(self, kind, location, shape=(), size=0, **arrays):
        self.kind, self.location, self.shape, self.size, self.arrays = (
            kind,
            location,
            shape,
            size,
            arrays,
        )

    def get_var_grid(self, name):
        return 2

    def get_var_location(self, name):
        return self.location

    def get_grid_type(self, grid):
        return self.kind

    def get_grid_rank(self, grid):
        return len(self.shape)

    def get_grid_size(self, grid):
        return self.size

    def get_grid_shape(self, grid, shape):
        shape[:] = self.shape
        return shape

    def __getattr__(self, name):
        def fill(grid, out):
            out[:] = np.ravel(self.arrays[name.removeprefix("get_grid_")])
            return out

        return fill


def test_cells_follow_from_what_bmi_tells_and_are_not_invented():
    x, y = np.array([0.0, 1.0, 3.0]), np.array([5.0, 6.0])
    X, Y = np.meshgrid(x, y)
    uniform = {"spacing": (3.0, 2.0), "origin": (10.0, 1.0)}
    cells = bmi_grid(Told("uniform_rectilinear", "node", (2, 4), **uniform), "u")
    assert cells.bounds == (0.0, 8.0, 8.5, 14.5)
    assert cells.shape == (2, 4)
    cells = bmi_grid(Told("uniform_rectilinear", "face", (3, 5), **uniform), "u")
    assert (cells.bounds, cells.shape) == ((1.0, 9.0, 10.0, 16.0), (2, 4))
    cells = bmi_grid(Told("rectilinear", "face", (2, 3), x=x, y=y), "u")
    np.testing.assert_array_equal(cells.area, [1.0, 2.0])
    cells = bmi_grid(Told("rectilinear", "node", (2, 2), x=[0.0, 4.0], y=y), "u")
    assert cells.bounds == (-2.0, 6.0, 4.5, 6.5)
    cells = bmi_grid(Told("structured_quadrilateral", "face", (2, 3), x=X, y=Y), "u")
    np.testing.assert_array_equal(cells.area, [1.0, 2.0])
    unclear = [
        Told("rectilinear", "node", (2, 3), x=x, y=y),
        Told("structured_quadrilateral", "node", (2, 3), x=X, y=Y),
        Told("unstructured", "node"),
        Told("points", "node"),
        Told("uniform_rectilinear", "edge", (2, 4), **uniform),
        Told("uniform_rectilinear", "node", (2, 4, 3), spacing=(1, 1, 1), origin=(0, 0, 0)),
    ]
    for model in unclear:
        with pytest.raises(InputError, match="BMI does not tell its cells"):
            bmi_grid(model, "u")


def test_rows_from_north_to_south_are_cells_in_that_order():
    x, y = np.array([0.0, 1.0, 3.0]), np.array([9.0, 6.0, 5.0])
    cells = bmi_grid(Told("rectilinear", "face", (3, 3), x=x, y=y), "u")
    np.testing.assert_array_equal(cells.area, [3.0, 6.0, 1.0, 2.0])
    np.testing.assert_array_equal(cells.y, [7.5, 7.5, 5.5, 5.5])
    cells = bmi_grid(Told("rectilinear", "node", (2, 2), x=[0.0, 4.0], y=[6.0, 5.0]), "u")
    np.testing.assert_array_equal(cells.y, [6.0, 6.0, 5.0, 5.0])
    uniform = {"spacing": (-3.0, 2.0), "origin": (10.0, 1.0)}
    cells = bmi_grid(Told("uniform_rectilinear", "node", (2, 2), **uniform), "u")
    np.testing.assert_allclose(cells.y, [10.0, 10.0, 7.0, 7.0], rtol=1e-15)
    cells = bmi_grid(Told("uniform_rectilinear", "face", (3, 2), **uniform), "u")
    np.testing.assert_allclose(cells.y, [8.5, 5.5], rtol=1e-15)
    np.testing.assert_allclose(cells.area, 6.0, rtol=1e-15)


def test_a_host_that_is_late_does_not_hide_behind_a_clock_in_single_precision(ocean):
    class Ago(TwoSlabOcean):
        def get_current_time(self):
            return np.float32(super().get_current_time() + 6e7)  # seconds in fours

    with pytest.raises(
        InputError, match="the host is at 60000000 s, the floes at 0 s, which should"
    ):
        couple(ocean(Ago), Ice(hexagons()), every=60.0, until=60.0, offset=6e7 + 2)


def test_weights_made_before_are_used_and_must_fit(ocean):
    host, ice = ocean(), Ice(hexagons())
    grid = bmi_grid(host, SURFACE[0])
    made = Regrid(
        grid, ice.grid, source_area=grid.area * 2
    )  # a host that counts its areas otherwise
    line = couple(host, ice, every=600.0, until=600.0, regrids={(0, 3): made})[0]
    np.testing.assert_allclose(line.to_host, -line.from_host, rtol=1e-13)
    np.testing.assert_allclose(line.host, 0.5 * line.to_host, rtol=1e-10)
    with pytest.raises(InputError, match="weights for 59 cells"):
        other = Regrid(
            Grid.uniform((0, 59), (0, 1), spacing=1.0), Grid.uniform((0, 9), (0, 1), spacing=1.0)
        )
        Coupling(host, ice, 600.0, regrids={(0, 3): other})
    ny, nx = grid.shape
    turned = Grid.uniform((0, 20e3), (0, 12e3), shape=(nx, ny))
    with pytest.raises(InputError, match=f"weights for cells of shape .{nx}, {ny}., but those of"):
        Coupling(host, ice, 600.0, regrids={(0, 3): Regrid(turned, ice.grid)})
    x, y, faces = ice.grid.node_x + 500.0, ice.grid.node_y, ice.grid.face_nodes
    moved = Grid.unstructured(x, y, faces)
    with pytest.raises(InputError, match="weights for other cells than those of .*of the floes"):
        Coupling(host, ice, 600.0, regrids={(0, 3): Regrid(grid, moved)})


# ---- faults -----------------------------------------------------------------------------------


def failing(model, after, fault):
    """A model whose `after`-th update_until does something else."""
    calls = iter(range(1, 1000))

    def update_until(t):
        if next(calls) == after:
            return fault(t)
        return model.update_until(t)

    return Altered(model, update_until=update_until)


def test_each_fault_is_one_line_and_the_state_is_saved(ocean, tmp_path):
    def die(t):
        raise RuntimeError("segmentation fault in the ocean\nwith a long traceback")

    def nan(model):
        def fault(t):
            model.update_until(t)
            model.get_value_ptr(SURFACE[1])[7] = np.nan

        return fault

    cases = []
    model = ocean()
    cases.append(
        (failing(model, 2, die), "exchange 2, 600 … 1200 s: segmentation fault in the ocean;")
    )
    model = ocean()
    cases.append(
        (failing(model, 2, nan(model)), "exchange 3.*nan in cell 7 .1 such cells. at 1200 s")
    )
    model = ocean()
    cases.append(
        (failing(model, 2, lambda t: None), "exchange 2.*stands at 600 s after an update to 1200")
    )
    model = ocean()
    cases.append(
        (
            failing(model, 2, lambda t, m=model: m.__dict__.update(_time=0.0)),
            "went back|stands at 0 s",
        )
    )
    model = ocean()
    shrink = Grid.uniform((0, 19e3), (0, 12e3), shape=(6, 10))
    cases.append(
        (
            failing(
                model, 1, lambda t, m=model: (m.update_until(t), m.__dict__.update(_grid=shrink))
            ),
            "exchange 2.*grid 0 of the host .* is not what it was",
        )
    )
    for k, (host, text) in enumerate(cases):
        rescue = tmp_path / f"state{k}.npz"
        with pytest.raises(CouplingError, match=text) as caught:
            couple(host, Ice(hexagons()), every=600.0, until=6000.0, rescue=rescue)
        assert "\n" not in str(caught.value)
        assert "their state saved in" in str(caught.value)
        assert rescue.exists()


def test_a_run_that_was_cut_off_goes_on_to_the_same_result(ocean, tmp_path):
    """The host died while it took its step: it is one exchange behind, and gets the stress it missed."""

    def die(t):
        raise RuntimeError("node lost")

    straight, ice = ocean(), Ice(hexagons())
    couple(straight, ice, every=60.0, until=600.0)
    model, rescue = ocean(), tmp_path / "state.npz"
    with pytest.raises(CouplingError, match="exchange 4.*node lost; floes at 240 s"):
        couple(failing(model, 4, die), Ice(hexagons()), every=60.0, until=600.0, rescue=rescue)
    assert model.get_current_time() == 180.0
    for name in STRESS:
        model.set_value(name, np.zeros(60))  # the host's own restart knows nothing of the stress
    restored = Ice(hexagons())
    restored.load_state(rescue)
    ledger = couple(model, restored, every=60.0, until=600.0)
    assert [line.time for line in ledger] == [240.0 + 60.0 * k for k in range(7)]
    caught_up = ledger[0]
    np.testing.assert_allclose(caught_up.host, caught_up.to_host, rtol=1e-9)
    assert caught_up.to_host[0] < 0 and caught_up.relative < 1e-12
    assert caught_up.floes is None and caught_up.budget_residual is None
    for name in SURFACE:
        np.testing.assert_allclose(
            model.get_value_ptr(name), straight.get_value_ptr(name), rtol=1e-13, atol=1e-15
        )
    np.testing.assert_allclose(restored.velocity, ice.velocity, rtol=1e-12, atol=1e-15)


def test_the_same_coupling_goes_on_after_a_fault_to_the_same_bits(ocean):
    """It knows the running integral from before the exchange; the stand-in's stress is that of its last step alone."""

    def die(t):
        raise RuntimeError("node lost")

    straight, ice = ocean(), Ice(hexagons())
    whole = Coupling(straight, ice, 300.0)
    whole.run(1800.0)
    model, other = ocean(), Ice(hexagons())
    coupling = Coupling(failing(model, 4, die), other, 300.0)
    with pytest.raises(CouplingError, match="exchange 4.*node lost; floes at 1200 s"):
        coupling.run(1800.0)
    coupling.run(1800.0)
    assert [line.time for line in coupling.ledger] == [line.time for line in whole.ledger]
    assert max(line.relative for line in coupling.ledger) < 1e-12
    assert coupling.ledger[-1].turnover == whole.ledger[-1].turnover
    for name in SURFACE:
        assert np.array_equal(model.get_value_ptr(name), straight.get_value_ptr(name))
    assert np.array_equal(other.velocity, ice.velocity)


class Faulty:
    """A model that fails once, in the n-th call of a name from now, before it has done it or right after."""

    def __init__(self, model):
        self._model, self._fault = model, None

    def fail(self, name, n, after):
        self._fault, self._left, self._after = name, n, after

    def __getattr__(self, name):
        answer = getattr(self._model, name)

        def call(*given):
            if name == self._fault:
                self._left -= 1
            if name != self._fault or self._left:
                return answer(*given)
            self._fault = None
            if self._after:
                answer(*given)
            raise RuntimeError("node lost")

        return call


@pytest.mark.parametrize("seed", range(6))
def test_in_parts_and_with_faults_anywhere_a_coupling_ends_where_one_without_does(seed, ocean):
    """In the middle of an exchange of either model, or right after it: each exchange has its line, once."""
    rng = np.random.default_rng(seed)
    straight, ice = ocean(), Ice(hexagons())
    whole = Coupling(straight, ice, 120.0).run(1800.0)
    model, other = ocean(), Ice(hexagons())
    host, floes = Faulty(model), Faulty(other)
    coupling, faults = Coupling(host, floes, 120.0), 0
    for _ in range(40):
        until = 120.0 * rng.integers(round(other.now / 120.0), 16)
        name = rng.choice(["update_until", "get_value", "set_value", "get_current_time"])
        rng.choice([host, floes]).fail(name, rng.integers(1, 12), after=rng.random() < 0.5)
        try:
            coupling.run(float(until))
        except CouplingError as error:
            assert "\n" not in str(error)
            faults += 1
        host.fail("", 0, False), floes.fail("", 0, False)
    coupling.run(1800.0)
    assert faults > 2
    assert [line.time for line in coupling.ledger] == [line.time for line in whole]
    assert max(line.relative for line in coupling.ledger) < 1e-12
    assert coupling.ledger[-1].turnover == pytest.approx(whole[-1].turnover, rel=1e-12)
    for name in SURFACE:
        assert np.array_equal(model.get_value_ptr(name), straight.get_value_ptr(name))
    assert np.array_equal(other.velocity, ice.velocity)


@pytest.mark.parametrize("silent", [False, True])
def test_a_host_that_fails_right_after_its_step_leaves_the_line_of_that_exchange(silent, ocean):
    model, told = ocean(), []

    def dies_after(t):
        model.update_until(t)
        if silent:  # it tells the time still, and nothing else
            host.get_value = dies
        raise RuntimeError("disk full")

    def dies(*given):
        raise RuntimeError("disk full")

    host = failing(model, 2, dies_after)
    with pytest.raises(CouplingError, match="exchange 2, 300 … 600 s: disk full"):
        couple(host, Ice(hexagons()), every=300.0, until=1800.0, show=told.append)
    straight = couple(ocean(), Ice(hexagons()), every=300.0, until=600.0)
    assert told[1] == HEADER and told[2] == str(straight[0])
    assert len(told) == 4
    if silent:
        assert told[3].split()[:7] == str(straight[1]).split()[:7] and told[3].count("–") == 3
    else:
        assert told[3] == str(straight[1])


def test_a_host_that_is_silent_after_its_step_has_the_line_when_it_answers_again(ocean):
    model = ocean()

    def dies(*given):
        raise RuntimeError("node lost")

    def dies_after(t):
        model.update_until(t)
        host.get_current_time = dies

    host = failing(model, 2, dies_after)
    coupling = Coupling(host, Ice(hexagons()), 300.0)
    with pytest.raises(CouplingError, match="exchange 2, 300 … 600 s: node lost"):
        coupling.run(900.0)
    assert [line.time for line in coupling.ledger] == [300.0]
    del host.get_current_time
    coupling.run(900.0)
    straight = couple(ocean(), Ice(hexagons()), every=300.0, until=900.0)
    assert list(map(str, coupling.ledger)) == list(map(str, straight))


def test_a_running_integral_that_is_no_number_is_refused_before_the_floes_move(ocean):
    ice = Ice(hexagons())
    ice.values[RUNNING[1]][3] = np.nan
    with pytest.raises(CouplingError, match="nan in cell 3 .1 such cells. at 0 s; floes at 0 s"):
        couple(ocean(), ice, every=60.0, until=600.0)


def test_what_cannot_be_coupled_is_refused_in_one_line_before_anything_moves(ocean):
    host, ice = ocean(), Ice(hexagons())
    cases = [
        (lambda: couple(host, ice, every=0.0, until=1.0), "every = 0.0"),
        (lambda: couple(host, ice, every="600", until=1.0), "every = '600'"),
        (lambda: couple(host, ice, every=600.0, until=np.nan), "until = nan"),
        (lambda: couple(host, ice, every=600.0, until=np.inf), "until = inf"),
        (lambda: couple(host, ice, every=600.0, until=600.0, offset=np.nan), "offset = nan"),
        (lambda: couple(host, ice, every=600.0, until=1000.0), "whole number of exchanges"),
        (lambda: couple(host, ice, every=600.0, until=-600.0), "whole number of exchanges"),
        (lambda: couple(host, ice, every=1.0, until=1.0, to_floes={"wind": "x"}), "not an input of the floes"),
        (
            lambda: couple(host, ice, every=1.0, until=1.0, to_host={STRESS[0]: STRESS[0][:-1]}),
            "not an output of the floes.*did you mean",
        ),
        (
            lambda: couple(host, ice, every=1.0, until=1.0, to_host={STRESS[0]: Link(STRESS[0], "sum")}),
            "allowed: integral, mean",
        ),
        (
            lambda: couple(
                host, ice, every=1.0, until=1.0, to_host={STRESS[0]: Link(STRESS[0], "integral", FRACTION)}
            ),
            "for means only",
        ),
        (
            lambda: couple(
                Altered(host, get_input_var_names=tuple), Altered(ice, get_input_var_names=tuple),
                every=1.0, until=1.0,
            ),
            "no output of one model",
        ),
        (
            lambda: couple(Altered(host, get_end_time=lambda: 500.0), ice, every=600.0, until=600.0),
            "after the end of the host",
        ),
        (lambda: couple(host, ice, every=1.0, until=1.0, host_grids={0: hexagons()}), "60 values"),
        (
            lambda: couple(host, ice, every=1.0, until=1.0, host_grids={7: same_cells()}),
            "host_grids: no variable of the host is on grid 7; its grids are 0, 1",
        ),
        (
            lambda: couple(host, ice, every=1.0, until=1.0, floes_grids={3: "hexagons"}),
            r"floes_grids\[3\] = 'hexagons': must be a Grid",
        ),
        (
            lambda: couple(
                host, ice, every=1.0, until=1.0, regrids={(3, 0): Regrid(hexagons(), same_cells())}
            ),
            r"regrids of \(3, 0\).*\(0, 3\)",
        ),
        (
            lambda: couple(host, ice, every=1.0, until=1.0, host_units={SURFACE[0][:-1]: "km/h"}),
            "host_units of .*the host has no such variable",
        ),
        (
            lambda: couple(host, ice, every=1.0, until=1.0, to_floes={SURFACE[0]: (SURFACE[0], "mean")}),
            "must be a name, a Link or None",
        ),
        (
            lambda: couple(host, ice, every=1.0, until=1.0, to_floes={SURFACE[0]: RECEIVED[0]}),
            "only running integrals of the floes",
        ),
        (
            lambda: couple(
                Altered(host, get_var_type=lambda name: "int32"), ice, every=1.0, until=1.0
            ),
            "is of type int32, which would cut",
        ),
    ]  # fmt: skip
    for call, text in cases:
        with pytest.raises(InputError, match=text) as caught:
            call()
        assert "\n" not in str(caught.value)
    assert ice.now == 0.0
    assert host.get_current_time() == 0.0


# ---- with floebmi itself ----------------------------------------------------------------------

FLOES = """
seed = 5
[contact.elastic]
youngs_modulus = 2e6
[contact.friction]
[contact.bonds]
tensile_strength = 10.0  # next to none: other tests have this machine code
[domain]
x = [1e3, 17e3]
y = [2e3, 11e3]
edges = "closed"
[grid]
shape = [7, 9]
[floes]
concentration = 0.5
size = { distribution = "uniform", radius_min = 400.0, radius_max = 900.0 }
[ocean]
drag = "constant-cd"
[atmosphere]
drag = "constant-cd"
velocity = [8.0, 0.0]
[coriolis]
latitude = 80
[time]
exchange = 600.0
"""


@pytest.fixture
def floes(tmp_path):
    from floebmi import FloeBmi

    def started(text=FLOES, cells="nodes", restart=None):
        (tmp_path / "floes.toml").write_text(text)
        table = ["[bmi]", 'scene = "floes.toml"', f'cells = "{cells}"']
        table += [f'restart = "{restart}"'] if restart else []
        path = tmp_path / "host.toml"
        path.write_text("\n".join(table))
        model = FloeBmi()
        model.initialize(str(path))
        return model

    return started


def test_with_walls_wind_and_rotation_of_the_earth_the_floes_books_still_close(ocean, floes):
    ocean, ice = ocean(), floes()
    ledger = couple(ocean, ice, every=600.0, until=7200.0)
    assert max(line.relative for line in ledger) < 1e-12
    assert all(line.other is not None for line in ledger)
    assert np.abs([line.other for line in ledger]).min() > 0
    unfilled = Coupling(ocean, ice, 600.0).unmatched
    assert all("air" in name for name in unfilled)
    assert len(unfilled) == 2


WIND = tuple(f"sea_surface_air_flowing__{a}_component_of_velocity" for a in "xy")
ON_ICE = tuple(f"sea_ice_top_air_flowing__{a}_z_component_of_stress" for a in "xy")
FROM_AIR = tuple(
    f"sea_ice_top_air_flowing__domain_time_integral_of_{a}_z_component_of_stress" for a in "xy"
)


class OceanAndAir(TwoSlabOcean):
    """Two hosts in one BMI, the air on cells of its own (grid 2, a given `Grid`) that it counts a tenth larger."""

    cells = Grid.unstructured([-1e3, 9e3, 19e3], [0, 30e3, 0], [[0, 1, 2]])

    def initialize(self, config):
        super().initialize(config)
        self.air = {name: np.array([5.0]) for name in WIND} | {name: np.zeros(1) for name in ON_ICE}
        self.lost = np.zeros(2)

    def get_input_var_names(self):
        return (*super().get_input_var_names(), *ON_ICE)

    def get_output_var_names(self):
        return (*super().get_output_var_names(), *WIND)

    def get_var_grid(self, name):
        return 2 if name in WIND + ON_ICE else super().get_var_grid(name)

    def get_var_type(self, name):
        return "float64"

    def get_var_location(self, name):
        return "node"

    def get_var_units(self, name):
        return {**dict.fromkeys(WIND, "m s-1"), **dict.fromkeys(ON_ICE, "Pa")}.get(
            name
        ) or super().get_var_units(name)

    def get_var_itemsize(self, name):
        return 8

    def get_var_nbytes(self, name):
        return 8 if name in self.air else super().get_var_nbytes(name)

    def get_grid_type(self, grid):
        return "unstructured" if grid == 2 else super().get_grid_type(grid)

    def get_grid_size(self, grid):
        return 1 if grid == 2 else super().get_grid_size(grid)

    def get_value(self, name, dest):
        if name not in self.air:
            return super().get_value(name, dest)
        dest[:] = self.air[name]
        return dest

    def set_value(self, name, src):
        if name in self.air:
            self.air[name][:] = src
        else:
            super().set_value(name, src)

    def update_until(self, time):
        stress = np.ravel([self.air[name] for name in ON_ICE])
        self.lost += 1.1 * self.cells.area * stress * (time - self.get_current_time())
        for name, value in zip(WIND, stress, strict=True):
            self.air[name] -= value  # so that the wind changes
        super().update_until(time)


def test_ocean_and_air_on_their_own_grids_are_one_host_and_each_gives_what_the_ice_got(
    tmp_path, floes
):
    (tmp_path / "ocean.toml").write_text(OCEAN)
    host = OceanAndAir()
    host.initialize(str(tmp_path / "ocean.toml"))
    text = FLOES.replace("[coriolis]", "[atmosphere.grid]\nshape = [2, 5]\n[coriolis]")
    ice = floes(text.replace("velocity = [8.0, 0.0]\n", ""))
    weights = Regrid(host.cells, bmi_grid(ice, WIND[0]), source_area=1.1 * host.cells.area)
    ledger = couple(
        host, ice, every=600.0, until=3600.0, host_grids={2: host.cells},
        regrids={(2, ice.get_var_grid(WIND[0])): weights},
    )  # fmt: skip
    assert max(line.relative for line in ledger) < 1e-12
    given = [ice.get_value(name, np.empty(1))[0] for name in FROM_AIR]
    assert np.abs(given).min() > 1e9
    np.testing.assert_allclose(host.lost, given, rtol=1e-12)
    assert host.air[WIND[0]] < 5.0


def test_cells_told_as_faces_give_the_same_ocean(ocean, floes):
    one, other = ocean(), ocean()
    couple(one, floes(), every=600.0, until=1800.0)
    couple(other, floes(cells="faces"), every=600.0, until=1800.0)
    for name in SURFACE:
        np.testing.assert_allclose(
            other.get_value_ptr(name), one.get_value_ptr(name), rtol=1e-9, atol=1e-12
        )


def test_floes_saved_at_a_fault_go_on_to_the_same_result(ocean, floes, tmp_path):
    def die(t):
        raise RuntimeError("node lost")

    straight, ice = ocean(), floes()
    couple(straight, ice, every=600.0, until=2400.0)
    model = ocean()
    with pytest.raises(
        CouplingError, match="exchange 3, 1200 … 1800 s: node lost; floes at 1800 s, their"
    ):
        couple(
            failing(model, 3, die), floes(), every=600.0, until=2400.0, rescue=tmp_path / "saved.nc"
        )
    resumed = floes(restart="saved.nc")
    couple(model, resumed, every=600.0, until=2400.0)
    for name in SURFACE:
        np.testing.assert_allclose(
            model.get_value_ptr(name), straight.get_value_ptr(name), rtol=1e-12, atol=1e-14
        )
    for name in ICE_MOMENTUM:
        np.testing.assert_allclose(resumed.get_value_ptr(name), ice.get_value_ptr(name), rtol=1e-10)


def test_the_example_keeps_momentum_and_its_negative_control_does_not(tmp_path, capsys):
    path = Path(__file__).parents[1] / "examples" / "two_slab_ocean.py"
    spec = importlib.util.spec_from_file_location("two_slab_ocean", path)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    right, wrong = example.main(tmp_path / "new", every=1800.0, hours=1.5).values()
    assert right < 1e-12
    assert wrong > 0.3
    assert (tmp_path / "new" / "two-slab-ocean.png").stat().st_size > 10_000
    assert "ocean + ice off by" in capsys.readouterr().out


# ---- another process --------------------------------------------------------------------------


@contextlib.contextmanager
def served(name, timeout=20.0):
    """A BMI model in another process, through grpc4bmi."""
    import grpc
    from grpc4bmi.bmi_grpc_client import BmiClient

    with socket.socket() as free:
        free.bind(("", 0))
        port = free.getsockname()[1]
    root = Path(__file__).parents[1]
    server = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "grpc4bmi.run_server",
            "--name",
            name,
            "--port",
            str(port),
            "--path",
            root,
        ]
    )
    channel = grpc.insecure_channel(f"localhost:{port}")
    try:
        yield BmiClient(channel, timeout=timeout), server
    finally:
        channel.close()
        server.terminate()
        server.wait(10)


class TooLong(Exception):
    """As gRPC says it."""

    def code(self):
        return SimpleNamespace(name="RESOURCE_EXHAUSTED")


def test_arrays_longer_than_a_message_are_set_in_parts(ocean, monkeypatch):
    class Narrow(Ice):
        """Takes no more than eight values at a time."""

        def set_value(self, name, values):
            if values.size > 8:
                raise TooLong("Received message larger than max")
            super().set_value(name, values)

        def set_value_at_indices(self, name, indices, values):
            if values.size > 8:
                raise TooLong("Received message larger than max")
            self.values[name][indices] = values

    monkeypatch.setattr("coupling.side.PART", 8)
    grid = hexagons()
    assert grid.size > 16 and grid.size % 8  # several parts, the last one shorter
    whole, cut = Ice(grid), Narrow(grid)
    for ice in (whole, cut):
        couple(ocean(), ice, every=600.0, until=1800.0)
    np.testing.assert_array_equal(cut.velocity, whole.velocity)
    monkeypatch.setattr("coupling.side.PART", 10**6)  # what a message has room for is not cut
    with pytest.raises(CouplingError, match="larger than max"):
        couple(ocean(), Narrow(grid), every=600.0, until=1800.0)


@pytest.mark.skipif(importlib.util.find_spec("grpc4bmi") is None, reason="needs grpc4bmi")
def test_a_host_in_another_process_gives_the_same_bits_and_may_die(ocean, tmp_path):
    here, ice = ocean(), Ice(hexagons())
    couple(here, ice, every=600.0, until=3000.0)
    with served("coupling.slab.TwoSlabOcean") as (there, server):
        there.initialize(str(tmp_path / "ocean.toml"))
        remote_ice = Ice(hexagons())
        ledger = couple(there, remote_ice, every=600.0, until=3000.0)
        np.testing.assert_array_equal(remote_ice.velocity, ice.velocity)
        for name in SURFACE:
            values = there.get_value(name, np.empty(60))
            np.testing.assert_array_equal(values, here.get_value_ptr(name))
        assert ledger[-1].relative < 1e-12
        coupling = Coupling(there, remote_ice, 600.0)
        server.kill()
        server.wait(10)
        with pytest.raises(CouplingError, match="floes at 3000 s") as caught:
            coupling.exchange(3600.0)
        assert "\n" not in str(caught.value)
        for attempt, where in (
            (lambda: coupling.run(3600.0), "before the first exchange"),
            (lambda: Coupling(there, remote_ice, 600.0), "the host"),
        ):
            with pytest.raises(CouplingError, match=f"^couple: {where}: .*connect") as caught:
                attempt()
            assert "\n" not in str(caught.value)


@pytest.mark.skipif(importlib.util.find_spec("grpc4bmi") is None, reason="needs grpc4bmi")
def test_floes_in_another_process_give_the_same_bits(ocean, floes, tmp_path):
    here, ice = ocean(), floes(cells="faces")
    couple(here, ice, every=600.0, until=1800.0)
    with served("floebmi.FloeBmi") as (there, _):
        there.initialize(str(tmp_path / "host.toml"))
        remote = ocean()
        ledger = couple(remote, there, every=600.0, until=1800.0)
        assert ledger[-1].relative < 1e-12
        for name in SURFACE:
            np.testing.assert_array_equal(remote.get_value_ptr(name), here.get_value_ptr(name))
        with pytest.raises(CouplingError, match=r"nan in cell 3 .* at 1800 s; floes at 1800 s"):
            remote.get_value_ptr(SURFACE[0])[3] = np.nan
            couple(remote, there, every=600.0, until=2400.0)
