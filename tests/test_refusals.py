"""What cannot be right is refused by InputError, in one line, whatever kind of thing it is."""

import pickle
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import floebmi as fb
from coupling.driver import couple
from coupling.regrid import Regrid, checksum
from coupling.slab import TwoSlabOcean
from coupling.vectors import Staggered, turn
from floebmi import ensemble, output, paraview, plot, restarts, sizes, tradeoff
from floebmi.bmi_buffers import numbers_of
from floebmi.coast import from_geojson, from_land_fraction, from_polygons
from floebmi.errors import InputError, warn
from floebmi.experiments import campaign
from floebmi.experiments.parameters import Strait
from floebmi.projection import centred_projection, to_plane

BOX = fb.Domain((0.0, 2000.0), (0.0, 1000.0))
GRID = fb.Grid.uniform(BOX.x, BOX.y, spacing=500.0)
SQUARE = [(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)]
NO_NUMBERS = {
    "an object": object(),
    "a table": {"a": 1},
    "a function": len,
    "unlike rows": [[1.0], [2.0, 3.0]],
    "too large": 10**400,
    "a text": "abc",
}
ASKED = {
    "Floes": lambda value: fb.Floes(x=value, y=0.0, radius=10.0, thickness=1.0),
    "Grid.uniform x": lambda value: fb.Grid.uniform(x=value, y=(0.0, 1.0), spacing=1.0),
    "Grid.uniform spacing": lambda value: fb.Grid.uniform((0.0, 1.0), (0.0, 1.0), spacing=value),
    "Grid.uniform shape": lambda value: fb.Grid.uniform((0.0, 1.0), (0.0, 1.0), shape=value),
    "Grid.uniform wet": lambda value: fb.Grid.uniform((0, 1), (0, 1), shape=(1, 2), wet=value),
    "Grid.rectilinear": lambda value: fb.Grid.rectilinear(value, [0.0, 1.0]),
    "Grid.curvilinear": lambda value: fb.Grid.curvilinear(value, value),
    "Grid.unstructured": lambda value: fb.Grid.unstructured(value, value, [[0, 1, 2]]),
    "Domain": lambda value: fb.Model(BOX._replace(x=value), fb.Floes([], [], [], [])),
    "Elastic": lambda value: fb.Model(
        BOX, fb.Floes([], [], [], []), contact=fb.Contact(fb.Elastic(value))
    ),
    "Histogram": lambda value: fb.scatter(BOX, fb.Histogram(value, (1,)), count=1),
    "PowerLaw": lambda value: fb.scatter(BOX, fb.PowerLaw(value, 60.0), count=1),
    "scatter thickness": lambda value: fb.scatter(
        BOX, fb.SingleSize(50.0), count=1, thickness=value
    ),
    "scatter land": lambda value: fb.scatter(BOX, fb.SingleSize(50.0), count=1, land=value),
    "from_field": lambda value: fb.from_field(GRID, value, 1.0, fb.SingleSize(50.0)),
    "from_field max_concentration": lambda value: fb.from_field(
        GRID, 0.3, 1.0, fb.SingleSize(50.0), max_concentration=value
    ),
    "from_field grid": lambda value: fb.from_field(value, 0.3, 1.0, fb.SingleSize(50.0)),
    "from_polygons": lambda value: from_polygons(value, radius=5.0),
    "from_polygons radius": lambda value: from_polygons([SQUARE], radius=value),
    "from_land_fraction": lambda value: from_land_fraction(value, [0.0, 1.0], np.eye(2), 0.1),
    "to_plane": lambda value: to_plane("EPSG:3413", value, 70.0),
    "centred_projection": lambda value: centred_projection(value, 70.0),
    "Regrid source_area": lambda value: Regrid(GRID, GRID, source_area=value),
    "Regrid.state": lambda value: Regrid(GRID, GRID).state(value),
    "Regrid.state empty": lambda value: Regrid(GRID, GRID).state(np.ones(8), empty=value),
    "turn": lambda value: turn(value, value, 0.0),
    "concatenate": lambda value: fb.Floes.concatenate([value]),
    "rotation": lambda value: fb.Floes(0.0, 0.0, 1.0, 1.0, rotation=value),
}


@pytest.mark.parametrize("value", NO_NUMBERS.values(), ids=NO_NUMBERS)
@pytest.mark.parametrize("ask", ASKED.values(), ids=ASKED)
def test_what_is_no_number_is_refused_wherever_one_is_asked_for(ask, value):
    with pytest.raises(InputError) as error:
        ask(value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    "value",
    [np.eye(2), pd.Series([1.0, 2.0]), xr.DataArray([1.0, 2.0]), "two\nlines"],
    ids=["array", "series", "data array", "text"],
)
def test_a_refusal_is_one_line_though_what_it_shows_takes_several(value):
    with pytest.raises(InputError) as error:
        fb.scatter(BOX, fb.SingleSize(50.0), concentration=value)
    assert len(str(error.value).splitlines()) == 1
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)


@pytest.mark.parametrize("number", [Fraction(1, 2), np.longdouble(0.5), 10**30])
def test_laws_take_the_numbers_that_their_kernels_take(number):
    with pytest.raises(InputError, match="must be a finite number"):
        fb.Model(BOX, fb.Floes([], [], [], []), contact=fb.frictional(friction=number))


def test_a_column_of_a_table_gives_the_ends_of_a_grid():
    table = pd.DataFrame({"x": [0.0, 40.0], "y": [0.0, 20.0]}, index=[7, 8])
    grid = fb.Grid.uniform(table.x, table.y, spacing=xr.DataArray(10.0))
    assert grid.shape == (2, 4)
    assert fb.Grid.uniform(table.x, table.y, shape=pd.Series([2, 4], index=[7, 8])).shape == (2, 4)


def test_floes_of_a_generator_are_all_taken():
    groups = [fb.Floes(x, 0.0, 1.0, 1.0, rotation=x > 5.0) for x in (0.0, 10.0)]
    floes = fb.Floes.concatenate(group for group in groups)
    assert floes.x.tolist() == [0.0, 10.0]
    assert floes.rotation


def test_a_coast_is_not_taken_for_its_floes():
    coast = from_polygons([SQUARE], radius=5.0)
    with pytest.raises(InputError, match="must be of the kind Floes"):
        fb.Floes.concatenate([fb.Floes(0.0, 0.0, 1.0, 1.0), coast])


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e12])
def test_land_at_places_that_are_none_is_refused(bad):
    with pytest.raises(InputError, match=r"x\[1\]"):
        from_land_fraction([0.0, bad], [0.0, 1.0], np.eye(2), radius=0.1)


def test_places_of_land_under_a_mask_are_none():
    x = np.ma.masked_array([0.0, 1.0], [False, True])
    with pytest.raises(InputError, match=r"x\[1\]"):
        from_land_fraction(x, [0.0, 1.0], np.eye(2), radius=0.1)


@pytest.mark.parametrize("value", [None, "here", [1.0], {"a": 1}, np.eye(2), 3.0])
def test_a_model_says_in_one_line_what_is_no_grid_and_no_state(value):
    model = fb.Model(BOX, fb.Floes(500.0, 500.0, 100.0, 1.0))
    with pytest.raises(InputError, match="must be a Grid"):
        model.weights(value)
    if value is not None:  # the exchange grid
        with pytest.raises(InputError, match="must be a Grid"):
            model.coverage(value)
    with pytest.raises(InputError):
        model.restore(value)


def test_a_floe_alone_goes_on_for_as_long_as_one_wants():
    model = fb.Model(BOX, fb.Floes(500.0, 500.0, 100.0, 1.0), forces=[fb.OceanDrag()])
    model.advance(1e300)
    assert model.time == 1e300


@pytest.mark.parametrize(
    "times", [{"duration": 5e-324}, {"duration": 10.0, "exchange": 5e-324}], ids=str
)
def test_a_run_of_no_time_is_refused(times):
    with pytest.raises(InputError):
        fb.run(fb.Model(BOX, fb.Floes(500.0, 500.0, 100.0, 1.0)), **times)


@pytest.mark.parametrize("span", [[[0.0], [1.0, 2.0]], "01", 5.0, (0.0, None)])
def test_an_inflow_is_open_between_two_numbers(span):
    with pytest.raises(InputError, match="span"):
        fb.Model(
            BOX,
            fb.Floes(500.0, 500.0, 100.0, 1.0),
            contact=fb.Contact(),
            inflow=fb.Inflow("west", fb.SingleSize(50.0), span=span),
        )


# ---- paths, words and lists of another kind -----------------------------------------------------


def a_model():
    return fb.Model(BOX, fb.Floes(500.0, 500.0, 10.0, 1.0))


NO_PATHS = {
    "an array": np.array(["a", "b"]),
    "a number": 3,
    "bytes": b"a.nc",
    "a list": [["a.nc"]],
    "a generator": (x for x in "a"),
    "a NUL": "a\0b",
}
PATHS = {
    "read_floes": fb.read_floes,
    "read_scene": fb.read_scene,
    "read_scalar": lambda path: fb.read_scalar([path], "thickness", GRID),
    "from_geojson": lambda path: from_geojson(path, 5.0),
    "sizes of a file": sizes.from_file,
    "run gridded": lambda path: fb.run(a_model(), 1.0, gridded=path),
    "run trajectories": lambda path: fb.run(a_model(), 1.0, trajectories=path),
    "run restart": lambda path: fb.run(a_model(), 1.0, restart=path),
    "GriddedWriter": lambda path: output.GriddedWriter(path, a_model()),
    "save_restart": lambda path: restarts.save_restart(path, {}),
    "load_restart": restarts.load_restart,
    "frame": plot.frame,
    "page": lambda path: plot.page("floes.nc", path),
    "export": lambda path: paraview.export("floes.nc", path),
    "ensemble": lambda path: ensemble.run(len, {}, {}, (1,), path),
    "tradeoff": lambda path: tradeoff.tradeoff("two-floes", to=path),
    "campaign": lambda path: campaign.run(Strait, {}, (1,), path),
    "Regrid.to_netcdf": lambda path: Regrid(GRID, GRID).to_netcdf(path),
    "Regrid.from_netcdf": lambda path: Regrid.from_netcdf(path, GRID, GRID),
    "FloeBmi": lambda path: fb.FloeBmi().initialize(path),
    "TwoSlabOcean": lambda path: TwoSlabOcean().initialize(path),
}


@pytest.mark.parametrize("value", NO_PATHS.values(), ids=NO_PATHS)
@pytest.mark.parametrize("ask", PATHS.values(), ids=PATHS)
def test_what_is_no_path_is_refused_in_one_line(ask, value):
    with pytest.raises(InputError, match="must be") as caught:
        ask(value)
    assert "\n" not in str(caught.value)


NO_WORDS = {
    "an array": np.array(["a", "b"]),
    "a table": {"a": 1},
    "a list": ["a"],
    "nothing": 0,
    "bytes": b"a",
}
WORDS = {
    "Domain": lambda word: fb.Model(BOX._replace(west=word), fb.Floes([], [], [], [])),
    "Wall": lambda word: fb.Model(
        BOX, fb.Floes([], [], [], []), fb.frictional(), walls=[fb.Wall(word)]
    ),
    "sampling": lambda word: fb.Model(BOX, fb.Floes([], [], [], []), sampling=word),
    "scheme": lambda word: fb.Model(BOX, fb.Floes([], [], [], []), step=fb.Step(word)),
    "lattice": lambda word: fb.regular(BOX, 10.0, 30.0, lattice=word),
    "quantity": lambda word: fb.read_scalar("a.nc", word, GRID),
    "kind": lambda word: fb.VelocityFile("a.nc", GRID, kind=word),
    "projection": lambda word: to_plane(word, 0.0, 70.0),
    "surface": lambda word: Regrid(GRID, GRID, surface=word),
    "normalisation": lambda word: Regrid(GRID, GRID).flux(np.ones(8), word),
    "Staggered": lambda word: Staggered(GRID, word),
    "of": lambda word: tradeoff.tradeoff("two-floes", of=word),
    "calendar": lambda word: output.GriddedWriter("a.nc", a_model(), calendar=word),
    "names": lambda word: output.GriddedWriter("a.nc", a_model(), names=[word]),
    "changing": lambda word: output.TrajectoryWriter("a.nc", a_model(), changing=[word]),
    "variable": lambda word: TwoSlabOcean().get_var_units(word),
}


@pytest.mark.parametrize("value", NO_WORDS.values(), ids=NO_WORDS)
@pytest.mark.parametrize("ask", WORDS.values(), ids=WORDS)
def test_what_is_no_word_is_refused_in_one_line(ask, value):
    with pytest.raises(InputError) as caught:
        ask(value)
    assert "\n" not in str(caught.value)


FLOES, SIZE = fb.Floes(500.0, 500.0, 10.0, 1.0), fb.SingleSize(50.0)
ENSEMBLE = ensemble.Ensemble({}, {}, (1,), {(0, 0): {"a": np.ones(2)}}, [])
WATER = xr.Dataset(
    {"siconc": (("y", "x"), np.zeros((2, 2)))}, {"x": [0.0, 2000.0], "y": [0.0, 1000.0]}
)


def land(**other):
    given = {"x": [0.0, 1.0], "y": [0.0, 1.0], "fraction": np.eye(2), "radius": 0.1}
    return from_land_fraction(**given | other)


def scalar(**other):
    return fb.read_scalar(WATER, "area_fraction", GRID, **other)


@pytest.mark.parametrize(
    "ask, said",
    [
        (lambda: fb.run(a_model(), 1.0, overwrite="no"), "overwrite = 'no': must be True or False"),
        (lambda: fb.run(a_model(), 1.0, attributes=[1], gridded="a.nc"), "attributes = .*a dict"),
        (lambda: output.GriddedWriter("a.nc", 3), "model = 3: must be a Model"),
        (lambda: output.GriddedWriter("a.nc", a_model(), names=5), "names = 5: must be a list"),
        (lambda: output.GriddedWriter("a.nc", a_model(), names="thickness"), "must be a list"),
        (lambda: output.TrajectoryWriter("a.nc", a_model(), changing=None), "must be a list"),
        (lambda: restarts.save_restart("a.nc", [1]), "state = .*: must be a dict"),
        (
            lambda: restarts.save_restart("a.nc", {}, "words"),
            "attributes = 'words': must be a dict",
        ),
        (
            lambda: couple(None, None, every=1.0, until=1.0, host_units=[1]),
            "host_units = .*: must be a dict",
        ),
        (
            lambda: couple(None, None, every=1.0, until=1.0, rescue=3),
            "rescue = 3: must be the path",
        ),
        (lambda: ensemble.run(len, None, {}, (1,), "e"), "parameters = None: must be a dict"),
        (lambda: ensemble.run(len, {}, [1], (1,), "e"), "sweep = .*: must be a dict"),
        (lambda: ensemble.run("len", {}, {}, (1,), "e"), "member = 'len': must be a function"),
        (lambda: ensemble.run(len, {}, {}, (1,), "e", on=3), "on = 3: must be an executor"),
        (lambda: ensemble.gather({}, {}), "done = .*: must be what `run` returns"),
        (lambda: numbers_of("u", [1, [2, 3]], 2), "u: .*: must be numbers, in rows of one length"),
        (lambda: TwoSlabOcean().get_grid_rank(np.array([0, 1])), "unknown; allowed: 0, 1"),
        (lambda: a_model().step_by("two"), "step_by: steps = 'two': must be a number, at least 0"),
        (lambda: a_model().step_by(-1), "steps = -1: must be a number, at least 0"),
        (
            lambda: fb.Model(
                BOX,
                fb.Floes([], [], [], []),
                fb.frictional(),
                inflow=[fb.Inflow("north", fb.SingleSize(9.0), 1.0, (x for x in (0.0, -1.0)))],
            ),
            "inflow.velocity = .*: must be two numbers",
        ),
        (lambda: fb.Floes.concatenate(5), "groups = 5: must be a list of Floes"),
        (lambda: FLOES.mass(None), "density = None: must be greater than 0"),
        (lambda: FLOES.moment_of_inertia(np.nan), "density = nan: must be greater than 0"),
        (lambda: FLOES.allow_own("colour"), "name = 'colour': allowed: friction"),
        (lambda: FLOES.same(3), "floes = 3: must be of the kind Floes"),
        (lambda: FLOES.go_back([1.0]), "floes = .*: must be of the kind Floes"),
        (
            lambda: fb.Model(BOX, FLOES, inflow=[fb.Inflow("west", SIZE, span=np.array(3.0))]),
            "inflow.span = .*: must be two numbers",
        ),
        (lambda: fb.Model(BOX._replace(x=b"ab"), FLOES), "domain.x = b'ab': must be two numbers"),
        (lambda: fb.Grid.uniform(b"ab", (0.0, 1.0), spacing=1.0), "x = b'ab': must be two numbers"),
        (lambda: BOX.position("up"), "edge = 'up': allowed: east, north, south, west"),
        (lambda: BOX.brought_back("a", 0.0), "must be real numbers"),
        (lambda: fb.scatter(BOX, SIZE, count=1, land=fb.Coast(3, [])), "floes = 3: must be of the"),
        (lambda: land(threshold=None), "threshold = None; must be between 0 and 1"),
        (lambda: land(period=5.0), "period = 5.0: must be two lengths, or None"),
        (lambda: land(period=(None, np.nan)), "period = nan m; must be greater than 0"),
        (lambda: land(x=[1.0, 1.0]), "neighbouring cells have the same centre"),
        (lambda: a_model().ledger.balance(np.eye(2)), "balance of .*: allowed: energy"),
        (lambda: setattr(a_model(), "time", None), "model.time = None: must be a finite number"),
        (lambda: setattr(a_model(), "time", np.nan), "model.time = nan: must be a finite number"),
        (lambda: a_model().bulk_range(0.3), "drag = 0.3: must be an OceanDrag or an AirDrag"),
        (lambda: a_model().bulk_range(fb.AirDrag("a")), "AirDrag.density = 'a': must be"),
        (lambda: a_model().seconds_per_step(0), "steps = 0: must be a whole number, at least 1"),
        (lambda: a_model().seconds_per_step(3, "drag"), "without = 'drag': allowed: contacts"),
        (lambda: a_model().ice_fields(5), "out = 5: must be a dict"),
        (lambda: a_model().ice_fields({"thickness": np.ones(9)}), "an array of 1 float64"),
        (lambda: plot.ledger("floes.nc", title=5), "title = 5: must be a text"),
        (lambda: plot.page("floes.nc", color=None), "color = None: must be speed or"),
        (lambda: plot.animate("floes.nc", to="a.gif", progress=1), "progress = 1: must be a fun"),
        (lambda: plot.field("ice.nc", np.ones(3)), "variable .*: unknown"),
        (lambda: output.GriddedWriter("a.nc", a_model(), names=[[1], [2, 3]]), "no such field"),
        (lambda: restarts.save_restart("a.nc", {"a": [[1], [2, 3]]}), "a: cannot be saved"),
        (lambda: restarts.save_restart("a.nc", {}, {"a": None}), "'a' = None: must be a text or a"),
        (
            lambda: fb.run(a_model(), 1.0, gridded="a.nc", attributes={"a": True}),
            "'a' = True: must",
        ),
        (lambda: ensemble.run(len, {}, {}, (1,), "e", progress=[]), "progress = .*: must be True"),
        (lambda: ensemble.gather(ENSEMBLE, None), "outputs = None: must be a dict"),
        (lambda: ensemble.gather(ENSEMBLE, {"a": 1}), "outputs.'a'. = 1: must be .dims, units, lo"),
        (lambda: ensemble.gather(ENSEMBLE, {}, units={"a": "m"}), "units.'a'. = 'm': must be .uni"),
        (lambda: ensemble.save({}, "a.nc"), "data = {}: must be what `gather` returns"),
        (lambda: fb.read_scalar("a.nc", "thickness", 3), "grid = 3: must be a Grid"),
        (lambda: scalar(outside="none"), "outside = 'none': must be a number, or None"),
        (lambda: scalar(units=np.ones(2)), "units = .*: must be a text"),
        (lambda: scalar(variable=["a"]), "variable = .*: must be a text"),
        (lambda: scalar(mask=np.ones(2)), "mask = .*: must be a text"),
        (lambda: fb.VelocityFile("a.nc", GRID, variables=5), "variables = 5: must be two names"),
        (
            lambda: fb.VelocityFile(WATER, GRID, variables=([1], [2])),
            "variables = .*: must be a te",
        ),
        (lambda: fb.VelocityFile("a.nc", GRID, units=5), "units = 5: must be a text"),
        (lambda: checksum(3), "grid = 3: must be a Grid"),
    ],
)
def test_other_odd_arguments_are_refused_in_one_line(ask, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=said) as caught:
        ask()
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())


def test_a_warning_names_the_users_line_even_of_code_without_a_module_name():
    with pytest.warns(UserWarning, match="told") as told:
        exec("warn('told')", {"warn": warn})
    assert told[0].filename == "<string>"
