"""The floes as a Landlab component: the checks that Landlab makes of its own, conservation on its cells, faults."""

import doctest

import numpy as np
import pytest
import xarray as xr

pytest.importorskip("landlab", reason="the extra `landlab` is not installed")

from landlab import (
    Component,
    FramedVoronoiGrid,
    HexModelGrid,
    IcosphereGlobalGrid,
    NetworkModelGrid,
    RadialModelGrid,
    RasterModelGrid,
    VoronoiDelaunayGrid,
    registry,
)
from landlab.bmi import wrap_as_bmi
from landlab.cmd.landlab import _validate_component
from landlab.components import COMPONENTS

import coupling.landlab
from coupling.landlab import FRACTION, THICKNESS, SeaIceFloes, _of_scene, cells_of
from floebmi.boundaries import Domain
from floebmi.coast import from_polygons, on_land
from floebmi.contact import Contact, Elastic, frictional
from floebmi.errors import InputError
from floebmi.floes import FIXED, Floes
from floebmi.forces import AirDrag, Coriolis, CoriolisField, OceanDrag, Tilt
from floebmi.gridding import area_budget
from floebmi.sizes import SingleSize
from floebmi.variables import VARIABLES

U, V = (f"sea_surface_water_flowing__{a}_component_of_velocity" for a in "xy")
WIND = "sea_surface_air_flowing__x_component_of_velocity"
MASS = "sea_ice__mass-per-area_density"
ICE_U = "sea_ice_flowing__x_component_of_velocity"
STRESS = [f"sea_ice_bottom_water_flowing__{a}_z_component_of_stress" for a in "xy"]
REQUIRED = {"doc", "mapping", "dtype", "intent", "optional", "units"}


def random_places(n=150, seed=4):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 9000, n), rng.uniform(0, 8000, n)


GRIDS = {
    "raster": lambda: RasterModelGrid((9, 10), xy_spacing=(1000.0, 900.0)),
    "hex": lambda: HexModelGrid((9, 8), spacing=1000.0),
    "hex in rectangular layout": lambda: HexModelGrid((9, 9), spacing=1000.0, node_layout="rect"),
    "radial": lambda: RadialModelGrid(n_rings=5, nodes_in_first_ring=6, spacing=1000.0, xy_of_center=(4500.0, 4000.0)),
    "Voronoi": lambda: VoronoiDelaunayGrid(*random_places()),
    "far from the origin": lambda: FramedVoronoiGrid(
        (9, 9), xy_spacing=1000.0, xy_of_lower_left=(5e5, 4e6), seed=3
    ),
    "framed Voronoi": lambda: FramedVoronoiGrid((9, 9), xy_spacing=1000.0, seed=3),
}  # fmt: skip


def some_floes(center=(4500.0, 4000.0), reach=3500.0, n=40, seed=2):
    """Floes that do not overlap, some of them across the rim of the cells."""
    rng = np.random.default_rng(seed)
    kept = np.empty((0, 3))
    while len(kept) < n:
        x, y = np.array(center) + rng.uniform(-reach, reach, 2)
        r = rng.uniform(100, 400)
        if (np.hypot(kept[:, 0] - x, kept[:, 1] - y) > kept[:, 2] + r).all():
            kept = np.vstack([kept, [x, y, r]])
    return Floes(*kept.T, thickness=rng.uniform(0.5, 2.0, n))


def forced(grid, strength=1.0):
    """A sheared current and a wind, on all nodes."""
    for name in (U, V, WIND):
        if name not in grid.at_node:
            grid.add_zeros(name, at="node")
    x, y = grid.x_of_node, grid.y_of_node
    grid.at_node[U][:] = strength * (0.4 + 5e-5 * (y - y.min()))
    grid.at_node[V][:] = strength * -3e-5 * (x - x.min())
    grid.at_node[WIND][:] = strength * 8.0
    return grid


# ---- what Landlab asks of each of its components ---------------------------------------------------


def test_every_field_says_all_that_landlab_wants_and_nothing_else():
    for name, about in SeaIceFloes._info.items():
        assert set(about) == REQUIRED, name
        np.dtype(about["dtype"])
        assert about["mapping"] == "node"
        assert about["intent"] in ("in", "out")
        assert about["doc"][0].isupper()
        assert about["optional"] is False


def test_the_fields_are_those_of_the_table_and_no_two_components_tell_a_field_differently():
    assert set(SeaIceFloes._info) == {row.csdms for row in VARIABLES}
    for row in VARIABLES:  # the signs, too
        assert (row.positive or "") in SeaIceFloes._info[row.csdms]["doc"]
    for other in COMPONENTS:
        for name in set(other._info) & set(SeaIceFloes._info):
            assert other._info[name]["doc"] == SeaIceFloes._info[name]["doc"]


def test_units_are_known_to_udunits():
    import cf_units

    for name in SeaIceFloes._info:
        assert not cf_units.Unit(SeaIceFloes.var_units(name)).is_unknown()


def test_it_tells_its_name_citation_and_whether_units_matter():
    assert issubclass(SeaIceFloes, Component)
    assert SeaIceFloes.name == "SeaIceFloes"
    assert SeaIceFloes.unit_agnostic is False
    assert "10.1029/2018MS001299" in SeaIceFloes.cite_as
    assert not hasattr(SeaIceFloes, "update")  # wrap_as_bmi would call it in place of run_one_step
    for name in SeaIceFloes._info:
        assert SeaIceFloes.definitions
        assert SeaIceFloes.var_loc(name) == "node"
        SeaIceFloes.var_help(name)


def test_what_landlabs_command_validate_and_its_registry_ask_for_is_there():
    assert _validate_component(SeaIceFloes) == []
    assert isinstance(SeaIceFloes.input_var_names, tuple)
    assert isinstance(SeaIceFloes.output_var_names, tuple)
    assert SeaIceFloes.optional_var_names == ()
    assert not set(SeaIceFloes.input_var_names) & set(SeaIceFloes.output_var_names)
    SeaIceFloes(RasterModelGrid((10, 10)))
    assert "SeaIceFloes" in registry.registered
    assert "10.1029/2018MS001299" in registry.format_citation(SeaIceFloes)
    assert SeaIceFloes.__doc__.strip().splitlines()[0].endswith(".")


def test_output_fields_are_there_as_soon_as_the_component_is():
    grid = RasterModelGrid((10, 10))
    for name in SeaIceFloes.input_var_names:
        grid.add_zeros(name, at=SeaIceFloes.var_loc(name), dtype=SeaIceFloes.var_type(name))
    SeaIceFloes(grid)
    for name in SeaIceFloes.output_var_names:
        assert grid.at_node[name].dtype == SeaIceFloes.var_type(name)
        assert grid.field_units(name, at="node") == SeaIceFloes.var_units(name)


def test_it_is_made_from_a_file_of_parameters(tmp_path):
    path = tmp_path / "ice.yaml"
    path.write_text("concentration: 0.3\nsizes: [300., 400.]\nseed: 2\n")
    ice = SeaIceFloes.from_path(RasterModelGrid((9, 10), xy_spacing=1000.0), str(path))
    assert len(ice.model.floes) > 10


def test_the_examples_of_the_docstring_hold():
    done = doctest.testmod(coupling.landlab)
    assert done.attempted > 10 and not done.failed


@pytest.mark.parametrize("with_fields", [False, True])
def test_a_grid_is_enough(with_fields):
    grid = RasterModelGrid((10, 10))
    if with_fields:
        for name in SeaIceFloes.input_var_names:
            grid.add_zeros(name, at="node", dtype=SeaIceFloes.var_type(name))
    ice = SeaIceFloes(grid)
    ice.run_one_step(10.0)
    for name, about in SeaIceFloes._info.items():
        values = grid.at_node[name]
        assert values.dtype == about["dtype"] and not values.any()


# ---- conservation on Landlab's cells ----------------------------------------------------------------


@pytest.mark.parametrize("kind", GRIDS)
def test_area_mass_and_momentum_are_kept_over_the_cells_of_landlab(kind):
    grid = forced(GRIDS[kind]())
    x, y = grid.x_of_node, grid.y_of_node
    floes = some_floes((x.mean(), y.mean()))
    beyond = Domain((x.min() - 5e3, x.max() + 5e3), (y.min() - 5e3, y.max() + 5e3))
    ice = SeaIceFloes(grid, floes=floes, domain=beyond)
    area, mass = floes.area.sum(), floes.mass(934.0).sum()

    def over_cells(name):
        return grid.area_of_cell @ grid.at_node[name][grid.node_at_cell]

    moved = floes.x.copy()
    for _ in range(3):
        ice.run_one_step(120.0)
        assert floes.active.all()
        covered = over_cells(FRACTION) + over_cells("sea_ice_floe_overlap__area_fraction")
        assert abs(covered + ice.area_outside - area) <= 1e-12 * area
        assert abs(over_cells(MASS) + ice.mass_outside - mass) <= 1e-12 * mass
        line = ice.ledger[-1]
        assert line.relative <= 1e-12
        assert np.abs(line.to_host).min() > 0
        for axis in (0, 1):  # the mean stress of the step is the impulse of the step
            assert np.isclose(over_cells(STRESS[axis]) * 120.0, line.to_host[axis], rtol=1e-9)
    assert (floes.x - moved).mean() > 5.0
    rim = np.setdiff1d(np.arange(grid.number_of_nodes), grid.node_at_cell)
    for name in SeaIceFloes.output_var_names:
        assert np.isfinite(grid.at_node[name]).all()
        assert not grid.at_node[name][rim].any()
    # the wrong way fails: cells of equal area in place of the polygons
    if "Voronoi" in kind:
        even = np.full(grid.number_of_cells, grid.area_of_cell.mean())
        assert (
            abs(even @ grid.at_node[MASS][grid.node_at_cell] + ice.mass_outside - mass)
            > 1e-3 * mass
        )


def test_floes_across_the_rim_are_counted_as_outside():
    grid = RasterModelGrid((6, 6), xy_spacing=1000.0)  # cells from 500 to 4500 m
    ice = SeaIceFloes(grid, floes=Floes([500.0], [2500.0], [300.0], [2.0]))
    assert ice.area_outside == pytest.approx(0.5 * np.pi * 300.0**2, rel=1e-12)
    assert ice.mass_outside == pytest.approx(934.0 * np.pi * 300.0**2, rel=1e-12)


def test_beside_a_coast_the_mass_outside_is_that_of_the_ice_alone():
    grid = RasterModelGrid((6, 6), xy_spacing=1000.0)
    ring = [[2600.0, 2600.0], [3400.0, 2600.0], [3400.0, 3400.0], [2600.0, 3400.0]]
    ice = SeaIceFloes(
        grid,
        floes=Floes([500.0, 1500.0], 2500.0, 300.0, [2.0, 1.0]),
        coast=from_polygons([ring], 100.0),
    )
    assert ice.mass_outside == pytest.approx(934.0 * np.pi * 300.0**2, rel=1e-12)


def test_only_closed_nodes_and_the_coast_are_land():
    grid = RasterModelGrid((7, 7), xy_spacing=1000.0)
    grid.status_at_node[24] = grid.BC_NODE_IS_FIXED_VALUE  # a lake's level, say: water
    grid.status_at_node[23] = grid.BC_NODE_IS_CLOSED
    land = from_polygons([[(800.0, 800.0), (1300.0, 800.0), (1300.0, 1300.0), (800.0, 1300.0)]], 99.0)  # fmt: skip
    for coast, dry in ((None, [23]), (land, [8, 23])):
        wet = SeaIceFloes(grid, coast=coast).model.grid.wet
        assert grid.node_at_cell[~wet].tolist() == dry


def test_closed_nodes_have_no_water():
    grid = forced(RasterModelGrid((7, 7), xy_spacing=1000.0))
    grid.status_at_node[24] = grid.BC_NODE_IS_CLOSED
    grid.at_node[U][24] = np.nan  # nobody reads it
    ice = SeaIceFloes(grid, floes=Floes([3000.0, 3000.0], [3000.0, 4000.0], 400.0, 1.0))
    ice.run_one_step(60.0)
    assert grid.at_node[FRACTION][24] > 0.4
    assert grid.at_node[STRESS[0]][24] == 0.0
    assert grid.at_node[STRESS[0]][31] < 0.0  # the ice lags behind the current: it holds it back
    assert ice.ledger[-1].relative <= 1e-12


@pytest.mark.parametrize(
    "grid",
    [
        lambda: NetworkModelGrid(((0, 1, 2), (0, 0, 1)), ((0, 1), (1, 2))),
        lambda: IcosphereGlobalGrid(mesh_densification_level=1),
    ],
)
def test_networks_and_globes_are_refused(grid):
    with pytest.raises(ValueError, match="must be one of RasterModelGrid") as caught:
        SeaIceFloes(grid())
    assert "\n" not in str(caught.value)


def test_a_grid_without_cells_is_refused():
    with pytest.raises(ValueError, match="RasterModelGrid: has no cells"):
        SeaIceFloes(RasterModelGrid((2, 2)))


def test_looped_sides_are_periodic_for_floes(tmp_path):
    def looped(up=False, aside=True):
        grid = forced(RasterModelGrid((7, 12), xy_spacing=1000.0))
        grid.set_looped_boundaries(up, aside)
        return grid

    floes = Floes([10300.0], [3000.0], [400.0], 1.0, u=[0.5])
    # Coriolis does nothing here, but other tests have the machine code
    forces = [OceanDrag(), AirDrag(), Coriolis(0.0)]
    ice = SeaIceFloes(looped(), floes=floes, edges="closed", forces=forces)
    edges = ice.model.domain[2:]
    assert edges == ("periodic", "periodic", "closed", "closed")
    ice.run_one_step(600.0)
    assert ice.area_outside < 1e-6 and ice.ledger[-1].relative < 1e-12
    at_cells = ice.grid.at_node[FRACTION].reshape(7, 12)[3]
    assert at_cells[1] > 0.0  # it came in again
    assert SeaIceFloes(looped(True, False)).model.domain.period == (None, 5000.0)

    odd = RasterModelGrid((7, 12), xy_spacing=1000.0)
    odd.status_at_node[12] = odd.BC_NODE_IS_LOOPED
    wide, open_ = (
        Domain((500, east), (500, 5500), west, west)
        for east, west in ((20500, "periodic"), (10500, "closed"))
    )
    (tmp_path / "two.toml").write_text("[domain]\nx = [500, 10500]\ny = [500, 5500]\n[ocean]\n")
    for call, text in (
        (lambda: SeaIceFloes(odd), "RasterModelGrid: has looped nodes that are not two whole sides"),
        (lambda: SeaIceFloes(looped(), domain=open_), "looped along x, but domain.x = .500, 10500. is not periodic over 10000 m"),
        (lambda: SeaIceFloes(looped(), domain=wide), "looped along x, but domain.x = .500, 20500. is not"),
        (lambda: SeaIceFloes(looped(), scene=tmp_path / "two.toml"), "the grid is looped along x"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=text):
            call()


def test_nodes_on_land_beyond_a_periodic_edge_are_dry():
    grid = RasterModelGrid((7, 12), xy_spacing=1000.0)  # the cells go from 500 to 10500 m
    ring = [(9000.0, 1000.0), (11600.0, 1000.0), (11600.0, 5000.0), (9000.0, 5000.0)]
    ice = SeaIceFloes(grid, coast=from_polygons([ring], 200.0), edges="periodic")
    wet = ice.model.grid.wet.reshape(5, 10)
    assert wet[1].tolist() == [False] + [True] * 8 + [False]


# ---- fields -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ["link", "cell"])
def test_an_input_that_is_not_at_nodes_is_refused(element):
    grid = RasterModelGrid((5, 5), xy_spacing=1000.0)
    name = "sea_surface_water_flowing__x_component_of_velocity"
    grid.add_zeros(name, at=element)
    with pytest.raises(ValueError, match=f"{name}: is at {element}; must be at node"):
        SeaIceFloes(grid)


def test_a_grid_is_left_as_it_was_where_floes_are_refused():
    grid = RasterModelGrid((9, 10), xy_spacing=1000.0)
    for given, says in (
        ({"floes": Floes(3000.0, [4000.0, 4100.0], 200.0, 1.0)}, "floes overlap at the start"),
        ({"concentration": 0.5}, "sizes is missing"),
    ):
        with pytest.raises(InputError, match=says):
            SeaIceFloes(grid, **given)
    assert list(grid.at_node) == []


def test_inputs_are_looked_up_afresh_and_outputs_are_written_in_place():
    floes = some_floes()
    once, replaced = (forced(RasterModelGrid((9, 10), xy_spacing=1000.0)) for _ in "ab")
    a, b = (SeaIceFloes(grid, floes=floes.copy()) for grid in (once, replaced))
    held = {name: replaced.at_node[name] for name in SeaIceFloes.output_var_names}
    for strength in (1.0, -0.5):
        forced(once, strength)
        a.run_one_step(100.0)
        for name in (U, V, WIND):
            fresh = np.zeros(replaced.number_of_nodes)
            replaced.at_node.pop(name)
            replaced.add_field(name, fresh, at="node")
        forced(replaced, strength)
        b.run_one_step(100.0)
    for name, values in held.items():
        assert replaced.at_node[name] is values or np.shares_memory(replaced.at_node[name], values)
        np.testing.assert_array_equal(values, once.at_node[name])


def test_floes_come_from_a_concentration_from_fields_or_from_a_scene(tmp_path):
    def grid():
        return RasterModelGrid((12, 12), xy_spacing=1000.0)

    ice = SeaIceFloes(grid(), concentration=0.5, thickness=1.5, sizes=(200.0, 400.0), seed=3)
    inside = ice.model.domain.area
    assert ice.model.floes.area.sum() == pytest.approx(0.5 * inside, rel=6e-3)
    assert set(ice.model.floes.thickness) == {1.5}

    with_fields = grid()
    fraction = with_fields.add_zeros(FRACTION, at="node")
    fraction[with_fields.x_of_node > 5000.0] = 0.6
    with_fields.add_ones(THICKNESS, at="node")
    with_fields.at_node[THICKNESS] *= 0.8
    ice = SeaIceFloes(with_fields, sizes=SingleSize(150.0))
    assert ice.model.floes.x.min() > 4800.0
    assert with_fields.at_node[FRACTION] is fraction or np.shares_memory(
        with_fields.at_node[FRACTION], fraction
    )
    budget = area_budget(ice.model.grid, ice.model.coverage())
    assert budget.wet == pytest.approx(0.6 * 50e6, rel=0.02)

    (tmp_path / "two.toml").write_text(
        "contact = 'frictional'\n[domain]\nx = [500, 10500]\ny = [500, 10500]\n"
        "[floes]\narrangement = 'list'\neach = [{x = 3000, y = 3000, radius = 300, thickness = 1}]\n"
        "[ocean]\n[atmosphere]\n[tilt]\nslope = [0.0, 0.0]\n"
    )
    ice = SeaIceFloes(grid(), scene=tmp_path / "two.toml")
    assert len(ice.model.floes) == 1 and ice.model.grid.size == 100


def test_floes_from_numbers_or_fields_are_of_their_seed_and_off_the_coast():
    ring = 1e3 * np.array([[4.0, 4.0], [8.0, 4.0], [8.0, 8.0], [4.0, 8.0]])
    coast = from_polygons([ring], 100.0)
    for given in ({"concentration": 0.4}, {}):
        places = []
        for seed in (1, 2):
            grid = RasterModelGrid((12, 12), xy_spacing=1000.0)
            if not given:
                grid.add_field(FRACTION, np.full(144, 0.4), at="node")
                grid.add_ones(THICKNESS, at="node")
            ice = SeaIceFloes(grid, sizes=(250.0, 400.0), coast=coast, seed=seed, **given)
            floes = ice.model.floes
            places_of_ice = floes.x[~floes.land], floes.y[~floes.land]
            assert not on_land([ring], *places_of_ice, ice.model.domain).any()
            assert ice.model.seed == seed
            assert ice.data_record.dataset.sizes["item_id"] == (~floes.land).sum() > 20
            places.append(floes.x[:10].tolist())
        assert places[0] != places[1]


def test_laws_are_those_that_are_given_or_those_of_the_text():
    grid = RasterModelGrid((5, 5), xy_spacing=1000.0)
    model = SeaIceFloes(grid).model
    assert model.forces == (OceanDrag(), AirDrag(), CoriolisField(), Tilt())
    assert model.contact == frictional()
    soft = Contact(Elastic(1e6))
    assert SeaIceFloes(grid, contact=soft).model.contact == soft


def test_the_box_does_not_follow_cells_of_the_rim_that_reach_beyond_all_nodes():
    grid = VoronoiDelaunayGrid(*random_places())
    assert grid.y_of_corner.max() > grid.y_of_node.max() + 100.0
    domain = SeaIceFloes(grid).model.domain
    for low, high, nodes in ((*domain.x, grid.x_of_node), (*domain.y, grid.y_of_node)):
        assert nodes.min() <= low < high <= nodes.max()


def test_a_scene_keeps_what_it_says_but_for_the_cells(tmp_path):
    (tmp_path / "said.toml").write_text(
        "contact = 'frictional'\nsampling = 'centre'\nseed = 5\nthreads = 2\n"
        "[domain]\nx = [500, 10500]\ny = [500, 10500]\n"
        "[ice]\ndensity = 900\ndraft = 0.8\n[step]\nfraction = 0.2\n[ocean]\nlayer_thickness = 12\n"
        "[[floes]]\narrangement = 'list'\neach = [{x = 3000, y = 3000, radius = 300, thickness = 1}]\n"
        "[[walls]]\nedge = 'north'\nvelocity = -0.1\n"
        "[[inflow]]\nedge = 'west'\nsizes = { distribution = 'single', radius = 200 }\n"
    )
    model = _of_scene(
        tmp_path / "said.toml", cells_of(RasterModelGrid((12, 12), xy_spacing=1000.0))
    )
    assert (model.sampling, model.seed, model.threads) == ("centre", 5, 2)
    assert (model.ice_density, model.draft_fraction, model.step.fraction) == (900.0, 0.8, 0.2)
    assert model.walls[0].velocity == -0.1 and model.inflow[0].edge == "west"
    assert model.ocean.layer_thickness == 12.0 and model.grid.size == 100
    (tmp_path / "still.toml").write_text("[domain]\nx = [500, 10500]\ny = [500, 10500]\n[ocean]\n")
    still = _of_scene(tmp_path / "still.toml", model.grid)
    assert model.floes.rotation and not still.floes.rotation


@pytest.mark.parametrize(
    ("table", "name"),
    [
        ("[ocean]\nvelocity = [0.1, 0.0]", "ocean"),
        ("[ocean]\n[atmosphere]\nvelocity = [5.0, 0.0]", "atmosphere"),
        ("[ocean]\n[tilt]\nslope = [1e-6, 0.0]", "tilt"),
        ("[ocean]\n[coriolis]\nlatitude = 75\nfield = true", "coriolis"),
    ],
)
def test_a_scene_whose_fields_have_numbers_of_their_own_is_refused(tmp_path, table, name):
    path = tmp_path / "own.toml"
    path.write_text(f"[domain]\nx = [500, 10500]\ny = [500, 10500]\n{table}\n")
    with pytest.raises(InputError, match=rf"\[{name}\] has numbers of its own"):
        SeaIceFloes(RasterModelGrid((12, 12), xy_spacing=1000.0), scene=path)


def test_what_cannot_be_meant_is_refused_in_one_line(tmp_path):
    def grid(*names):
        made = RasterModelGrid((12, 12), xy_spacing=1000.0)
        for name in names:
            made.add_ones(name, at="node")
        return made

    floes, box = some_floes(n=3), Domain((0.0, 11e3), (0.0, 11e3))
    cases = [
        (lambda: SeaIceFloes(grid(), floes=floes, concentration=0.2), "floes and concentration"),
        (lambda: SeaIceFloes(grid(), concentration=0.2), "sizes is missing"),
        (lambda: SeaIceFloes(grid(FRACTION)), f"alone; floes need {FRACTION} and {THICKNESS}"),
        (lambda: SeaIceFloes(grid(), scene="two-floes", forces=[]), "forces is given beside a scene"),
        (lambda: SeaIceFloes(grid(), scene="two-floes", edges="closed"), "edges is given beside a scene"),
        (lambda: SeaIceFloes(grid(), scene="two-floes", sizes=(1.0, 2.0)), "sizes is given beside a scene"),
        (lambda: SeaIceFloes(grid(), scene="two-floes", seed=1), "seed is given beside a scene"),
        (lambda: SeaIceFloes(grid(), scene="two-floes", thickness=2.0), "thickness = 2.0 applies to floes made from a concentration"),
        (lambda: SeaIceFloes(grid(), floes=floes, sizes=(1.0, 2.0)), "sizes is given beside floes"),
        (lambda: SeaIceFloes(grid(), sizes=(1.0, 2.0)), "neither a concentration nor the fields"),
        (lambda: SeaIceFloes(grid(), floes=floes, domain=box, edges="closed"), "edges is given beside a domain"),
        (lambda: SeaIceFloes(grid(), concentration=0.2, sizes=(1.0, 2.0, 3.0)), "sizes"),
        (lambda: SeaIceFloes(grid(), concentration=0.2, sizes=("a", "b")), "must be .smallest, largest"),
        (lambda: SeaIceFloes(grid(), concentration=0.2, sizes=np.ones(3)), "must be .smallest, largest"),
        (lambda: SeaIceFloes(grid(), coast=5), "coast = 5: must be a Coast"),
        (lambda: SeaIceFloes(grid(), domain=(0.0, 11e3)), "domain = .0.0, 11000.0.: must be a Domain"),
        (lambda: SeaIceFloes(grid(), edges=np.ones(2)), "edges = array.*: allowed: closed, inactive, periodic"),
        (lambda: SeaIceFloes(grid(), concentration=0.2, sizes=np.array(5.0)), "must be .smallest, largest"),
    ]  # fmt: skip
    for call, text in cases:
        with pytest.raises(ValueError, match=text) as caught:
            call()
        assert "\n" not in str(caught.value)


def test_a_field_that_no_law_reads_is_refused_rather_than_passed_over():
    grid = forced(RasterModelGrid((9, 10), xy_spacing=1000.0))
    ice = SeaIceFloes(grid, floes=some_floes(), forces=[OceanDrag(), AirDrag()])
    grid.at_node["earth__coriolis_frequency"][:] = 1.4e-4
    with pytest.raises(InputError, match="earth__coriolis_frequency is not zero, but none"):
        ice.run_one_step(1.0)


def test_an_input_that_somebody_took_away_is_missed_in_one_line():
    grid = forced(RasterModelGrid((9, 10), xy_spacing=1000.0))
    ice = SeaIceFloes(grid, floes=some_floes())
    grid.at_node.pop(U)
    with pytest.raises(InputError, match=f"{U}: is not at the grid's nodes"):
        ice.run_one_step(1.0)


def test_an_output_that_cannot_be_written_is_refused_in_one_line():
    grid = RasterModelGrid((5, 6), xy_spacing=1000.0)
    grid.add_ones(FRACTION, at="node", dtype=int)
    grid.add_ones(THICKNESS, at="node")
    floes = Floes([2500.0], 2000.0, 500.0, 1.0)
    with pytest.raises(InputError, match=f"{FRACTION} has dtype int64: must be float"):
        SeaIceFloes(grid, floes=floes)  # its fractions would all be cut to 0
    grid.at_node.pop(FRACTION)
    ice = SeaIceFloes(grid, floes=floes)
    grid.at_node.pop(FRACTION)
    with pytest.raises(InputError, match=f"{FRACTION} is not at the grid's nodes"):
        ice.run_one_step(60.0)
    assert ice.model.time == 0.0


@pytest.mark.parametrize(
    ("name", "units"), [(U, "cm/s"), (FRACTION, "%"), (THICKNESS, "cm"), (U, "knots?"), (U, "-")]
)
def test_numbers_that_the_grid_tells_in_another_unit_are_refused(name, units):
    """Landlab keeps a unit with each field: 30 cm/s were a current of 30 m/s, and ice of 100 cm was 100 m thick."""
    grid = RasterModelGrid((9, 10), xy_spacing=1000.0)
    grid.add_zeros(name, at="node", units=units)
    with pytest.raises(InputError, match=f"{name} is in '.*'; must be in"):
        SeaIceFloes(grid, floes=some_floes(n=3))
    grid.at_node.pop(name)
    ice = SeaIceFloes(grid, floes=some_floes(n=3))
    grid.at_node.pop(name)
    grid.add_zeros(name, at="node", units=units)  # another component replaces it
    with pytest.raises(InputError, match=f"run_one_step: {name} is in"):
        ice.run_one_step(60.0)
    assert ice.model.time == 0.0


def test_units_may_be_written_in_other_words_or_not_be_told():
    grid = RasterModelGrid((9, 10), xy_spacing=1000.0, xy_axis_units="metre")
    for name, units in ((U, "m/s"), (V, "?"), (FRACTION, "-"), (STRESS[0], "N/m2")):
        grid.add_zeros(name, at="node", units=units)
    SeaIceFloes(grid, floes=some_floes(n=3)).run_one_step(60.0)


@pytest.mark.parametrize("units", ["km", ("m", "km"), "degrees_east"])
def test_a_grid_that_tells_other_axes_than_metres_is_refused(units):
    with pytest.raises(InputError, match="axis_units is '.*'; must be 'm'"):
        SeaIceFloes(RasterModelGrid((9, 10), xy_axis_units=units), floes=some_floes(n=3))


def test_floes_are_a_data_record_with_the_cell_of_each():
    grid = RasterModelGrid((6, 6), xy_spacing=1000.0)
    places = [600.0, 4100.0, 450.0], [600.0, 3900.0, 3000.0]
    # the last stands beyond all cells
    ice = SeaIceFloes(grid, floes=Floes(*places, 100.0, 1.0, motion=[0, 0, FIXED]))
    record = ice.data_record
    assert record.dataset["element_id"].values.ravel().tolist() == [0, 15, -1]
    assert record.dataset["sea_ice_floe_center__x_coordinate"].values.ravel().tolist() == [600.0, 4100.0, 450.0]  # fmt: skip
    assert record.dataset.time.values.tolist() == [0.0]
    ice.run_one_step(60.0)
    later = ice.data_record.dataset
    assert later.time.values.tolist() == [60.0] and later.attrs["time_units"] == "s"
    grouped = record.calc_aggregate_value(
        func=xr.Dataset.count, data_variable="sea_ice_floe__radius", at="cell"
    )
    assert np.nansum(grouped) == 2


# ---- under BMI --------------------------------------------------------------------------------------

CONFIG = """
sea_ice_floes:
    concentration: 0.4
    sizes: [300., 500.]
    seed: 5
clock:
    start: 0.
    stop: 3600.
    step: 100.
grid:
    RasterModelGrid:
    - [9, 10]
    - xy_spacing: [1000., 1000.]
"""


def test_under_landlabs_bmi_it_gives_the_same_numbers():
    wrapped = wrap_as_bmi(SeaIceFloes)()
    assert {U, V, WIND} <= set(wrapped.get_input_var_names())
    assert FRACTION in wrapped.get_output_var_names()
    assert wrapped.get_var_units(THICKNESS) == "m"
    wrapped.initialize(CONFIG)
    grid = forced(RasterModelGrid((9, 10), xy_spacing=1000.0))
    ice = SeaIceFloes(grid, concentration=0.4, sizes=(300.0, 500.0), seed=5)
    for name in (U, V, WIND):
        wrapped.set_value(name, grid.at_node[name])
    for _ in range(3):
        wrapped.update()
        ice.run_one_step(100.0)
    wrapped.update_until(320.0)
    ice.run_one_step(20.0)
    assert wrapped.get_current_time() == pytest.approx(320.0)
    for name in wrapped.get_output_var_names():
        if name != "boundary_condition_flag":
            values = wrapped.get_value(name, np.empty(90))
            np.testing.assert_array_equal(values, grid.at_node[name])
    wrapped.finalize()


# ---- faults -----------------------------------------------------------------------------------------


def test_a_failed_step_is_one_line_leaves_all_as_it_was_and_saves_the_state(tmp_path):
    grid = forced(RasterModelGrid((9, 10), xy_spacing=1000.0))
    ice = SeaIceFloes(grid, floes=some_floes(), rescue=tmp_path / "rescue.nc")
    ice.run_one_step(60.0)
    before = {name: grid.at_node[name].copy() for name in SeaIceFloes.output_var_names}

    def nan():
        grid.at_node[U][33] = np.nan

    def mended():
        forced(grid)

    def closed():
        grid.status_at_node[44] = grid.BC_NODE_IS_CLOSED

    def opened():
        grid.status_at_node[44] = grid.BC_NODE_IS_CORE

    close = ice._books.close

    def dies():
        def fails(*args):
            raise MemoryError("node lost\nand a long story")

        ice._books.close = fails

    def revived():
        ice._books.close = close

    for spoil, mend, dt, text in (
        (nan, mended, 60.0, f"{U}: nan at node 33 at t = 60 s: must be finite"),
        (closed, opened, 60.0, "boundary status of the grid have changed"),
        (lambda: None, lambda: None, -60.0, "dt = -60.0: must be a number of seconds"),
        (lambda: None, lambda: None, np.nan, "dt = nan: must be a number of seconds"),
        (lambda: None, lambda: None, "60", "dt = '60': must be a number of seconds"),
        (lambda: None, lambda: None, None, "dt = None: must be a number of seconds"),
        (lambda: None, lambda: None, np.ones(2), "dt = array.*: must be a number of seconds"),
        (dies, revived, 60.0, "node lost; floes at 60 s"),  # when the ice has moved
    ):
        spoil()
        with pytest.raises((InputError, RuntimeError), match=text) as caught:
            ice.run_one_step(dt)
        assert str(caught.value).endswith(
            f"floes at 60 s, their state saved in {tmp_path / 'rescue.nc'}"
        )
        assert "\n" not in str(caught.value)
        mend()
        (tmp_path / "rescue.nc").replace(tmp_path / "taken.nc")
        for name, values in before.items():
            np.testing.assert_array_equal(grid.at_node[name], values)
    ice.run_one_step(60.0)

    fresh = forced(RasterModelGrid((9, 10), xy_spacing=1000.0))
    again = SeaIceFloes(fresh, floes=some_floes())
    again.load_state(tmp_path / "taken.nc")
    for name, values in before.items():
        np.testing.assert_array_equal(fresh.at_node[name], values)
    again.run_one_step(60.0)
    for name in SeaIceFloes.output_var_names:
        np.testing.assert_array_equal(fresh.at_node[name], grid.at_node[name])


def test_each_of_two_on_a_grid_keeps_books_of_its_own_though_they_write_the_same_fields():
    grid = forced(RasterModelGrid((9, 10), xy_spacing=1000.0))
    here, there = some_floes(seed=3), some_floes(seed=5)
    one, other = SeaIceFloes(grid, floes=here), SeaIceFloes(grid, floes=there)
    for _ in range(2):
        one.run_one_step(60.0)
        other.run_one_step(30.0)
    grid.at_node[U][33] = np.nan
    with pytest.raises(InputError, match=f"{U}: nan at node 33"):
        one.run_one_step(60.0)
    forced(grid)
    one.run_one_step(60.0)
    assert max(line.relative for line in one.ledger + other.ledger) < 1e-12


def test_a_step_of_zero_changes_nothing():
    grid = forced(RasterModelGrid((9, 10), xy_spacing=1000.0))
    ice = SeaIceFloes(grid, floes=some_floes())
    ice.run_one_step(60.0)
    before = grid.at_node[ICE_U].copy()
    ice.run_one_step(0.0)
    np.testing.assert_array_equal(grid.at_node[ICE_U], before)
    assert ice.model.time == 60.0
    line = ice.ledger[-1]
    assert not line.from_host.any() and not line.to_host.any() and line.relative <= 1e-12
    assert line.turnover == ice.ledger[0].turnover > 0


def test_cells_of_a_grid_have_the_areas_that_landlab_counts():
    for make in GRIDS.values():
        grid = make()
        far = grid.x_of_node.min() > 1e5  # Landlab's own areas lose digits there
        np.testing.assert_allclose(
            cells_of(grid).area, grid.area_of_cell, rtol=1e-6 if far else 1e-12
        )
