"""Drag and the other forces: exact solutions, presets, torques, and the impulse that is given back."""

from typing import get_args

import numpy as np
import pytest

from floebmi.boundaries import Domain
from floebmi.contact import frictional
from floebmi.dynamics import Step
from floebmi.errors import InputError
from floebmi.floes import COAST, FIXED, Floes
from floebmi.forces import (
    DRAG_PRESETS,
    FLUID_U,
    FLUID_V,
    HALF_CURL,
    PARAMETER,
    RATE,
    SPIN_RATE,
    AirDrag,
    BodyForce,
    Coriolis,
    CoriolisField,
    Force,
    GeostrophicTilt,
    OceanDrag,
    Tilt,
    acceleration,
    add_fastest_rate,
    at_floes,
    bulk_coefficient,
    by_block,
    lanes,
    speed_bound,
)
from floebmi.grid import Grid
from floebmi.kernels import BLOCK
from floebmi.model import Model
from floebmi.vorticity import Vorticity, gradient_operators

DOMAIN = Domain((-1e6, 1e6), (-1e6, 1e6))
ROUND = Domain(*DOMAIN[:2], *["periodic"] * 4)
STILL = Coriolis(0.0)  # does nothing, but other tests have its machine code


def one(radius=100.0, thickness=1.0, u=0.0, v=0.0, rotation=False, domain=DOMAIN, **laws):
    return Model(domain, Floes(0.0, 0.0, radius, thickness, u, v), rotation=rotation, **laws)


def moved_by(coriolis=0.0, down=0.0, **start):
    """Forces without a fluid's drag; those that a test does not ask for, and the tilt, are zero."""
    return one(forces=[Coriolis(coriolis), Tilt(), BodyForce(0.0, down)], **start)


def printed_ocean_rate(radius, thickness):
    """K/m from Eq. 12 as printed [1/m]."""
    k = np.pi * 1000.0 * (0.14 * 2 * radius * 0.9 * thickness + 1.6e-4 * radius**2)
    return k / (934.0 * np.pi * radius**2 * thickness)


@pytest.mark.parametrize(
    "contact, duration", [(None, 1.0), (None, 600.0), (None, 86400.0), (frictional(), 600.0)]
)
def test_a_floe_in_still_water_slows_down_as_the_exact_solution(contact, duration):
    model = one(u=0.3, v=-0.4, rotation=bool(contact), forces=[OceanDrag()], contact=contact)
    model.advance(duration)
    slowed = 0.5 / (1 + 0.5 * printed_ocean_rate(100.0, 1.0) * duration)
    # sub-steps follow the exact solution, each of them
    assert np.hypot(model.floes.u, model.floes.v)[0] == pytest.approx(slowed, rel=1e-12)


def test_free_drift_is_that_of_the_printed_coefficients():
    model = one(885.6, forces=[OceanDrag(), AirDrag(), STILL])
    model.atmosphere.u[:] = 30.0
    model.advance(5 * 86400.0)
    assert model.floes.u[0] == pytest.approx(0.490, abs=5e-4)


def test_a_tiny_floe_with_an_hours_step_does_not_overshoot():
    model = one(1.0, forces=[OceanDrag()])
    model.ocean.u[:] = 2.0
    speeds = []
    for _ in range(50):
        model.advance(3600.0)
        speeds.append(model.floes.u[0])
    assert (np.diff(speeds) > 0).all() and max(speeds) < 2.0
    assert speeds[-1] == pytest.approx(2.0, rel=0.01)
    gained = model.floes.mass(934.0)[0] * model.floes.u[0]
    assert -model.ocean.impulse_x.sum() == pytest.approx(gained, rel=1e-12)


def test_explicit_drag_would_overshoot_there():
    rate = printed_ocean_rate(1.0, 1.0)
    assert 0.0 + 3600.0 * rate * 2.0**2 > 2.0


def test_a_floe_takes_the_sub_steps_of_its_own_block():
    """Thick floes come first in space, and take one for an exchange; thin ones many, as many as without the thick."""
    thick, thin = 50.0 * np.arange(BLOCK), 50.0 * np.arange(9)
    speeds = []
    for before in (thick, thick[:0]):
        floes = Floes(
            np.append(before, thin), np.append(0.0 * before, 500.0 + 0.0 * thin), 20.0,
            np.append(0.0 * before + 1e4, 0.0 * thin + 0.01),
        )  # fmt: skip
        step = Step(length=10.0, drag_every=60)
        model = Model(DOMAIN, floes, forces=[OceanDrag(1026.0, 0.0, 5.5e-3)], step=step)
        model.ocean.u[:] = 0.5
        model.advance(600.0)
        speeds.append(floes.u[-9:].tolist())
    assert speeds[0] == speeds[1]


@pytest.mark.parametrize("wind", [40.0, 5.0])
def test_a_light_floe_under_a_sudden_wind_never_outruns_its_free_drift(wind):
    model = one(5.0, 0.05, forces=[OceanDrag(), AirDrag(), STILL])
    model.atmosphere.u[:] = wind
    ocean, air = OceanDrag(), AirDrag()
    k = [
        drag.density * bulk_coefficient(drag, 5.0, side)
        for drag, side in ((ocean, 0.045), (air, 0.005))
    ]
    nansen = np.sqrt(k[1] / k[0])
    drift = wind * nansen / (1 + nansen)
    for _ in range(20):
        model.advance(1800.0)
        assert 0 < model.floes.u[0] <= drift * (1 + 1e-9)
    assert model.floes.u[0] == pytest.approx(drift, rel=1e-6)


def test_a_floe_keeps_to_its_inertial_circle_for_a_day_in_one_exchange():
    f, day = 1.4e-4, 86_400.0
    model = moved_by(coriolis=f, u=0.2)
    model.advance(day)
    velocity = complex(model.floes.u[0], model.floes.v[0])
    # with steps of a quarter radian it is 0.06
    assert abs(velocity / 0.2 - np.exp(-1j * f * day)) < 0.005


def test_coriolis_turns_without_work():
    model = moved_by(coriolis=1e-4, u=1.0)
    model.advance(2 * np.pi / 1e-4 / 4)
    assert model.floes.u[0] ** 2 + model.floes.v[0] ** 2 == pytest.approx(1.0, rel=1e-12)
    assert (model.floes.u[0], model.floes.v[0]) == (
        pytest.approx(0, abs=1e-2),
        pytest.approx(-1, abs=1e-3),
    )


def test_a_tilted_sea_surface_pulls_downhill():
    model = moved_by()
    model.ocean.tilt_x[:] = 1e-6
    model.advance(100.0)
    assert model.floes.u[0] == pytest.approx(-9.81e-6 * 100, rel=1e-12)


@pytest.mark.long
def test_a_geostrophic_current_carries_a_floe_with_it():
    f, u = 1.4e-4, 0.2
    model = one(u=u, forces=[OceanDrag(), CoriolisField(), Tilt()])
    model.ocean.u[:], model.ocean.coriolis[:] = u, f
    model.ocean.tilt_y[:] = -f * u / 9.81
    model.advance(86400.0)
    assert (model.floes.u[0], model.floes.v[0]) == pytest.approx((u, 0.0), abs=1e-12)


@pytest.mark.parametrize("f", [1.4e-4, -1.4e-4])
def test_ice_without_wind_drifts_with_a_current_that_the_slope_balances(f):
    """With the Coriolis force alone it turned out of the current, by a third of a right angle."""
    forces = [OceanDrag(1026.0, 0.0, 5.5e-3), Coriolis(f), GeostrophicTilt(f)]
    grid = Grid.uniform((-1e5, 1e5), (-1e5, 1e5), spacing=1e5)
    model = one(thickness=2.0, u=0.1, v=0.05, grid=grid, forces=forces, domain=ROUND)
    model.ocean.u[:], model.ocean.v[:] = 0.1, 0.05
    model.advance(3600.0)
    assert (model.floes.u[0], model.floes.v[0]) == pytest.approx((0.1, 0.05), abs=1e-15)
    pulled = np.array(model.ledger.accounts["sea-surface tilt"][1:3])
    mass = model.floes.mass(model.ice_density)[0]
    assert pulled == pytest.approx(mass * 3600.0 * f * np.array([-0.05, 0.1]), rel=1e-12)


def test_a_body_force_is_an_acceleration():
    model = moved_by(down=-0.5)
    model.advance(4.0)
    assert model.floes.v[0] == pytest.approx(-2.0)
    assert model.floes.y[0] == pytest.approx(-4.0)


SOME = {
    Coriolis: Coriolis(1e-4),
    GeostrophicTilt: GeostrophicTilt(1e-4),
    BodyForce: BodyForce(1.0, 2.0),
}


@pytest.mark.parametrize("force", [SOME.get(kind) or kind() for kind in get_args(Force)])
def test_the_derivative_of_each_force_is_exact(force):
    one = np.ones(1)
    at = at_floes(force, 100 * one, one, 0.9 * one, 934.0, False, one == 0)
    for row, value in ((FLUID_U, 0.3), (FLUID_V, -0.2), (RATE, 0.02)):
        at[row:] = value  # the rows that there are
    u, v, d = 0.1, 0.25, 1e-6
    here = acceleration(force, at, 0, u, v)
    for (du, dv), slope in (((d, 0), (here.xx, here.yx)), ((0, d), (here.xy, here.yy))):
        ahead, behind = (acceleration(force, at, 0, u + s * du, v + s * dv) for s in (1, -1))
        measured = (ahead.x - behind.x) / (2 * d), (ahead.y - behind.y) / (2 * d)
        assert measured == pytest.approx(slope, rel=1e-6, abs=1e-9)


def test_the_presets_are_those_of_the_table():
    radius, draft = np.array([50.0]), np.array([0.9])
    coefficient = {
        name: bulk_coefficient(o, radius, draft)[0] for name, (o, a) in DRAG_PRESETS.items()
    }
    assert coefficient["damsgaard2018"] == pytest.approx(5.2e-3, rel=0.01)
    ocean, _ = DRAG_PRESETS["granular.jl-0.3.2"]
    newtons = np.pi * 1000 * 50.0**2 * bulk_coefficient(ocean, radius, draft)[0]
    assert newtons == pytest.approx(
        1000 * (0.5 * 0.85 * 2 * 50 * 0.9 + 5e-4 * 4 * 50.0**2), rel=1e-12
    )
    assert coefficient["constant-cd"] == 5.5e-3
    freeboard = np.array([0.1])
    for name, density, newtons in (
        ("damsgaard2018", 1.3, np.pi * (0.064 * 2 * 50 * 0.1 + 8e-5 * 50.0**2)),
        ("granular.jl-0.3.2", 1.2754, 0.5 * 0.85 * 2 * 50 * 0.1 + 2.5e-4 * 4 * 50.0**2),
        ("constant-cd", 1.3, 1.2e-3 * np.pi * 50.0**2),
    ):  # of the wind, over its density
        air = DRAG_PRESETS[name][1]
        assert air.density == density
        assert np.pi * 50.0**2 * bulk_coefficient(air, radius, freeboard) == pytest.approx(newtons)
    assert [ocean.density for ocean, _ in DRAG_PRESETS.values()] == [1000.0, 1000.0, 1026.0]


ROWS = {"u": FLUID_U, "v": FLUID_V, "f": PARAMETER}


def table_of(force, rotation=False, **rows):
    """A table by block of one floe, with these rows."""
    floe = Floes(0.0, 0.0, 100.0, 1.0)
    at = at_floes(
        force, floe.radius, floe.thickness, 0.9 * floe.thickness, 934.0, rotation, floe.land
    )
    table = by_block(at, np.zeros(1, int))
    for row, value in rows.items():
        lanes(table, ROWS[row])[0, 0] = value
    return at, table


def test_a_step_is_as_short_for_a_field_of_coriolis_parameters_as_for_one_and_for_a_fast_spin():
    for force, here in ((Coriolis(-2e-4), {}), (CoriolisField(), {"f": -2e-4})):
        table = table_of(force, **here)[1]
        rate = np.zeros((len(table), BLOCK))
        add_fastest_rate(force, table, 1.0, 1.0, rate)
        assert rate[0, 0] == pytest.approx(16 * 2e-4)
    at, table = table_of(OceanDrag(), True, u=0.3, v=0.4)
    lanes(table, HALF_CURL)[0, 0] = -0.01
    for speed, spin, bound in (
        (1.0, 0.0, 2 * 1.5 * at[RATE, 0]),
        (0.0, 9.0, 2 * 9.01 * at[SPIN_RATE, 0]),
    ):
        rate = np.full((len(table), BLOCK), 0.25)  # of other forces
        add_fastest_rate(OceanDrag(), table, speed, spin, rate)
        assert rate[0, 0] == pytest.approx(0.25 + bound, rel=1e-12)


def test_the_bound_on_the_speed_is_that_at_which_the_ocean_balances_what_pushes():
    at, water = table_of(OceanDrag())
    for push, here in (
        (BodyForce(0.0, -0.01), {}), (BodyForce(0.006, 0.008), {}), (Tilt(10.0), {"u": 6e-4, "v": 8e-4}),
        (GeostrophicTilt(-0.02), {"u": 0.3, "v": 0.4}),
    ):  # fmt: skip
        tables = water, table_of(push, **here)[1]
        bound = speed_bound((OceanDrag(), push), tables, 0.2)
        assert bound == pytest.approx(0.2 + np.sqrt(0.01 / at[RATE, 0]))


def test_the_bound_on_the_speed_takes_wind_and_water_of_one_and_the_same_floe():
    """The largest drag of wind over the least of water, of two floes, had bounded both: ten times too fast here."""
    floes, number = Floes([0.0, 1e3], 0.0, 100.0, [0.1, 10.0]), np.arange(2)
    forces = OceanDrag(1026.0, 0.0, 5.5e-3), AirDrag(1.3, 0.0, 1.2e-3)
    tables = []
    for force, speed in zip(forces, (0.3, 10.0), strict=True):
        draft = 0.9 * floes.thickness
        at = at_floes(force, floes.radius, floes.thickness, draft, 934.0, False, floes.land)
        tables.append(by_block(at, number))
        lanes(tables[-1], FLUID_V)[0, :2] = speed
    driven = 10.0 * np.sqrt(1.3 * 1.2e-3 / (1026.0 * 5.5e-3))
    assert speed_bound(forces, tables, 0.0) == pytest.approx(0.3 + driven)
    assert speed_bound(forces, tables, 5.0) == pytest.approx(5.0 + driven)
    lanes(tables[0], RATE)[:] *= 1e-6  # hardly any water: no faster through it than the wind
    assert speed_bound(forces, tables, 0.0) == pytest.approx(0.3 + 10.0)
    lanes(tables[0], RATE)[:] = 0.0  # no water under them
    assert speed_bound(forces, tables, 0.0) == pytest.approx(10.0)
    assert speed_bound(forces, tables, 20.0) == 20.0


def test_vorticity_spins_a_floe_up_to_half_the_curl_and_no_further():
    grid = Grid.uniform((-1e3, 1e3), (-1e3, 1e3), spacing=100.0)
    floes = Floes(50.0, 50.0, 100.0, 1.0)
    model = Model(DOMAIN, floes, frictional(), [OceanDrag()], grid)
    model.ocean.u[:], model.ocean.v[:] = -1e-3 * grid.y, 1e-3 * grid.x
    spins = []
    for _ in range(30):
        floes.x[:], floes.y[:] = 50.0, 50.0
        model.advance(7200.0)
        spins.append(floes.angular_velocity[0])
    assert (np.diff(spins) > 0).all() and 0.9e-3 < spins[-1] < 1e-3


@pytest.mark.parametrize("contact", [frictional(), pytest.param(None, marks=pytest.mark.long)])
def test_a_fast_spin_decays_monotonically(contact):
    floes = Floes(0.0, 0.0, 10.0, 1.0, rotation=True, angular_velocity=5.0)
    model = Model(DOMAIN, floes, contact, [OceanDrag()], rotation=True)
    spins = [5.0]
    for _ in range(20):
        model.advance(10.0)
        spins.append(floes.angular_velocity[0])
    assert (np.diff(spins) < 0).all() and spins[-1] > 0


def test_torque_has_the_papers_size():
    floes = Floes(0.0, 0.0, 200.0, 1.5, rotation=True)
    at = at_floes(
        OceanDrag(), floes.radius, floes.thickness, 0.9 * floes.thickness, 934.0, True, floes.land
    )
    slip = 1e-3
    torque = floes.moment_of_inertia(934.0)[0] * at[SPIN_RATE, 0] * slip**2
    printed = np.pi * 200.0**4 * 1000 * (200.0 / 5 * 1.6e-4 + 1.35 * 0.14) * slip**2
    assert torque == pytest.approx(printed, rel=1e-12)


def test_what_the_floes_gain_is_what_the_fluids_lose_also_on_a_fixed_floe():
    floes = Floes([0.0, 300.0], 0.0, 100.0, 1.0, motion=[0, FIXED])
    grid = Grid.uniform((-1e4, 1e4), (-1e4, 1e4), spacing=400.0)
    model = Model(DOMAIN, floes, forces=[OceanDrag(), AirDrag()], grid=grid, contact=frictional())
    model.ocean.u[:], model.atmosphere.v[:] = 0.4, 12.0
    model.advance(300.0)
    for axis, held in ((1, "x"), (2, "y")):
        fluids = model.ocean, model.atmosphere
        given = -sum(getattr(fluid, f"impulse_{held}").sum() for fluid in fluids)
        accounts = model.ledger.accounts
        booked = accounts["ocean drag"][axis] + accounts["wind"][axis]
        assert given == pytest.approx(booked, rel=1e-12)
    assert model.ledger.balance("momentum_x").relative < 1e-12
    assert accounts["held floes and coast"][1] < 0


def test_a_floe_over_cells_without_water_is_neither_dragged_nor_slowed_in_its_spin():
    floes = Floes([-500.0, 500.0], 0.0, 100.0, 1.0, u=0.1, rotation=True, angular_velocity=1e-3)
    grid = Grid.uniform((-1e3, 1e3), (-1e3, 1e3), shape=(1, 2), wet=[True, False])
    model = Model(DOMAIN, floes, frictional(), [OceanDrag()], grid)
    model.advance(600.0)
    assert (floes.u[1], floes.angular_velocity[1]) == (0.1, 1e-3)
    assert floes.u[0] < 0.1 and floes.angular_velocity[0] < 1e-3
    assert (model.ocean.undelivered == 0.0).all()


def test_stress_of_floes_that_move_against_each_other_cancels_and_its_magnitude_adds_up():
    floes = Floes([-300.0, 300.0], 0.0, 100.0, 1.0, [0.3, -0.3], [0.4, -0.4])
    grid = Grid.uniform((-1e3, 1e3), (-1e3, 1e3), shape=(1, 1))
    model = Model(DOMAIN, floes, forces=[OceanDrag()], grid=grid)
    model.advance(600.0)
    lost = floes.mass(934.0)[0] * (0.5 - np.hypot(floes.u, floes.v)[0])  # N s, of each
    fields = model.fields()
    assert fields["ocean_stress_magnitude"] == pytest.approx(2 * lost / (4e6 * 600.0))
    assert np.abs(fields["ocean_stress_x"]).max() < 1e-12 * fields["ocean_stress_magnitude"][0]


def test_the_range_of_bulk_coefficients_is_that_of_the_ice_by_draft_and_freeboard():
    floes = Floes(np.arange(4) * 300.0, 0.0, [100.0, 50.0, 1.0, 1.0], 1.0, motion=[0, 0, COAST, 0])
    floes.active[3] = False
    ocean, air = OceanDrag(1026.0, 0.5, 1e-3), AirDrag(1.3, 0.5, 1e-3)
    model = Model(DOMAIN, floes, forces=[ocean, air], draft_fraction=0.8)
    # c_v 2 r side / r² + c_h, with sides of 0.8 and 0.2 m
    assert model.bulk_range(ocean) == pytest.approx((9e-3, 17e-3))
    assert model.bulk_range(air) == pytest.approx((3e-3, 5e-3))


def test_nan_in_a_wet_cell_is_refused_with_field_cell_and_time_and_nothing_moves():
    model = one(forces=[OceanDrag()], u=0.1)
    model.ocean.u[0] = np.nan
    with pytest.raises(InputError, match=r"ocean\.u: nan in wet cell 0 at t = 0 s"):
        model.advance(10.0)
    assert model.time == 0.0 and model.floes.x[0] == 0.0


@pytest.mark.parametrize(
    "forces, word",
    [
        ([OceanDrag(density=-1.0)], "OceanDrag.density"),
        ([BodyForce(np.nan, 0.0)], "BodyForce.x = nan: must be a finite number"),
        ([Coriolis(np.inf)], "Coriolis.parameter"),
        ([OceanDrag(), OceanDrag()], "listed 2 times"),
        ([Coriolis(1e-4), CoriolisField()], "exclude"),
        (["wind"], "is not a force"),
    ],
)
def test_forces_that_cannot_be_right_are_refused(forces, word):
    with pytest.raises(InputError, match=word):
        one(forces=forces)


def test_a_numpy_number_is_a_number():
    one(forces=[OceanDrag(density=np.int64(1000)), Coriolis(np.float32(1e-4))])


@pytest.mark.parametrize("kind", ["uniform", "rectilinear", "curvilinear", "unstructured"])
def test_the_curl_at_the_seam_of_a_periodic_domain_is_that_of_anywhere_else(kind):
    """It had been taken on one side of the seam, and was twice as large beside the crest of a jet."""
    edges_x, edges_y = np.linspace(0.0, 4e3, 9), np.linspace(0.0, 6e3, 13)
    corners = np.meshgrid(edges_x, edges_y)
    grid = Grid.uniform((0.0, 4e3), (0.0, 6e3), spacing=500.0)
    if kind == "rectilinear":
        grid = Grid.rectilinear(edges_x, edges_y)
    elif kind == "curvilinear":
        grid = Grid.curvilinear(*corners)
    elif kind == "unstructured":
        grid = Grid.unstructured(grid.node_x, grid.node_y, grid.face_nodes)
    rng = np.random.default_rng(1)
    u, v = rng.normal(size=(2, 12, 8))
    curls = []
    for period in ((4e3, 6e3), (4e3, None), (None, 6e3)):
        curl = Vorticity(grid, period)
        here = curl(u.ravel(), v.ravel()).reshape(12, 8)
        by = tuple(3 if length else 0 for length in period[::-1])
        there = curl(*(np.roll(w, by, axis=(0, 1)).ravel() for w in (u, v))).reshape(12, 8)
        assert np.roll(here, by, axis=(0, 1)) == pytest.approx(there, abs=1e-15)
        curls.append(here)
    along_y = np.cos(np.pi * grid.y / 3e3)
    assert Vorticity(grid, (4e3, 6e3))(along_y, 0 * u.ravel()) == pytest.approx(
        np.sin(np.pi * grid.y / 3e3) * np.sin(np.pi / 6) / 500.0, abs=1e-15
    )
    two = Grid.uniform(
        (0.0, 1e3), (0.0, 2e3), spacing=500.0
    )  # each column is on both sides of the other
    w = np.arange(8.0)
    assert Vorticity(two, (1e3, None))(w, w) == pytest.approx(Vorticity(two)(w, w), abs=1e-15)


def test_the_water_of_a_periodic_model_turns_floes_across_the_seam():
    model = one(
        forces=[OceanDrag()],
        grid=Grid.uniform(*ROUND[:2], spacing=1e5),
        domain=ROUND,
        rotation=True,
    )
    y = model.grid.y
    model.ocean.u[:] = np.cos(np.pi * y / 1e6)
    turn = 0.5 * np.sin(np.pi * y / 1e6) * np.sin(np.pi / 10) / 1e5
    assert model.ocean.half_curl() == pytest.approx(turn, abs=1e-18)


def test_the_short_cut_within_a_uniform_grid_gives_the_fit_of_all_neighbours():
    wet = np.random.default_rng(4).random((12, 15)) > 0.05
    grid = Grid.uniform((0.0, 3000.0), (0.0, 1200.0), shape=wet.shape, wet=wet)
    along_x, along_y = gradient_operators(grid)
    u, v = np.random.default_rng(5).normal(size=(2, grid.size))
    curl = Vorticity(grid)
    assert 20 < np.diff(curl.runs).sum() < grid.size - 20
    assert curl(u, v) == pytest.approx(along_x @ v - along_y @ u, abs=1e-15)
    u[~grid.wet] = np.nan
    assert np.isfinite(curl(u, v)).all()


def test_the_curl_in_a_cell_is_that_of_the_plane_that_fits_its_wet_neighbours_best():
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    wet = np.ones(20, bool)
    wet[[7, 8, 19]] = False
    grid = Grid.curvilinear(x + rng.uniform(-0.2, 0.2, x.shape), y + 0.1 * x, wet=wet)
    u, v = rng.normal(size=(2, grid.size))
    corners = [set(face.tolist()) for face in grid.face_nodes]
    expected = np.zeros(grid.size)
    for c in np.flatnonzero(wet):
        near = [k for k in np.flatnonzero(wet) if k != c and corners[k] & corners[c]]
        away = np.column_stack([grid.x[near] - grid.x[c], grid.y[near] - grid.y[c]])
        d = np.hypot(*away.T)
        (_, u_y), (v_x, _) = (
            np.linalg.lstsq(away / d[:, None], (w[near] - w[c]) / d)[0] for w in (u, v)
        )
        expected[c] = v_x - u_y
    assert Vorticity(grid)(u, v) == pytest.approx(expected, abs=1e-12)
