"""Scene files: from text to checked tables, and from tables to a model."""

import errno
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from floebmi import InputError, cgrid, forcing, places, read_scene, remap
from floebmi.contact import Coulomb, Damsgaard2018Coulomb
from floebmi.dynamics import Step
from floebmi.floes import DRIVEN, FIXED
from floebmi.forces import DRAG_PRESETS, AirDrag, GeostrophicTilt, OceanDrag
from floebmi.packing import IceNotPlaced, scatter
from floebmi.scene import Scene, copy_scene
from floebmi.scene_keys import Sea
from floebmi.scene_physics import FluidTable
from floebmi.scenes import packaged
from floebmi.sizes import UniformSize
from floebmi.tables import keys

TWO = """
title = "two floes"
contact = "frictional"
[domain]
x = [0, 100]
y = [0, 100]
[floes]
arrangement = "list"
each = [{x = 10, y = 50, radius = 10, u = 1}, {x = 50, y = 50, radius = 10, thickness = 2}]
[time]
duration = 10
"""


@pytest.fixture
def write(tmp_path):
    def write(text, name="scene.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.fixture
def two(write):
    return write(TWO)


def refused(path, *overrides):
    with pytest.raises(InputError) as error:
        read_scene(path, overrides).build()
    text = str(error.value)
    assert "\n" not in text
    return text


# ---- errors -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("domain.x=[0,1,2]", "must be a list of 2 entries"),
        ("domain.x=[0]", "must be a list of 2 entries"),
        ("domain.x=[0,true]", "must be a number"),
        ("domian.x=3", "did you mean 'domain'?"),
        ("domain.z=3", "unknown key; allowed: east, edges, north"),
        ("domain.edges=peri", "allowed: closed, inactive, periodic"),
        ("floes.each.1.radius=-3", "must be greater than 0"),
        ("floes.each.1.radius=\"10\"", "must be a number"),
        ("floes.each.1.radius=true", "must be a number"),
        ("floes.each.3.radius=3", "must be 1 to 2"),
        ("floes.each.2.radus=3", "did you mean 'radius'?"),
        ("floes.arrangement=heap", "allowed: field, file, list, regular, scatter"),
        ("contact=frictonal", "did you mean 'frictional'?"),
        ("contact.frction=0.5", "did you mean 'friction'?"),
        ("step.fraction=2", "must be at most 1"),
        ("step.scheme=verlett", "did you mean 'verlet'?"),
        ("time.duration=3 days", "must be a number"),
        ("time.duration=inf", "must be a finite number"),
        ("time.duration=0", "must be greater than 0"),
        ("time.calendar=noleep", "did you mean 'noleap'?"),
        ("seed=1.5", "must be a whole number"),
        ("title=3", "must be text in quotes"),
        ("ocean.drag=damsgard2018", "did you mean 'damsgaard2018'?"),
        ("ocean.drag.density=-1", "must be greater than 0"),
        ("ocean.drag.densty=1", "did you mean 'density'?"),
        ("grid.spacing=[1,2,3]", "must be a number, or a list of 2 entries"),
        ("grid.spacing=[1]", "must be a number, or a list of 2 entries"),
        ("grid.shape=[1]", "must be a list of 2 entries"),
        ("grid.kind=round", "allowed: curvilinear, rectilinear, uniform_rectilinear"),
        ("walls=[{edge=\"nort\"}]", "did you mean 'north'?"),
        ("coriolis.latitude=91", "must be at most 90"),
        ("output=3", "must be a table of keys"),
        ("floes=[{size=3}]", ": size = 3: must be a table of keys"),
        ("walls=[{edge=\"north\", mass=-1}]", ": mass = -1: must be greater than 0"),
        ("contact={bonds={healing={}}}", ": bonds.healing.rate is missing: rate λ at which the strength grows"),
    ],
)  # fmt: skip
def test_a_wrong_override_is_refused_in_one_line_that_names_it_and_what_is_right(
    two, override, said
):
    text = refused(two, override)
    assert text.startswith(f"--set {override}: ")
    assert said in text


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (("contact=none", "contact.friction=1"), "contact.friction=1: contact is 'none', not a table"),
        (("contact=frictional", "contact.strength=1"), "contact.strength=1: unknown key"),
        (("seed=1", "seed=-1"), "seed=-1: must be"),
        (("floes.each.1.radius=-1", "floes.each.2.radius=3"), "floes.each.1.radius=-1: must be"),
        (("floes.each.1.radius=3", "floes.1.each.2.radius=-3"), "floes.1.each.2.radius=-3: must be"),
    ],
)  # fmt: skip
def test_of_several_overrides_the_one_that_is_wrong_is_named(two, overrides, said):
    assert refused(two, *overrides).startswith(f"--set {said}")


@pytest.mark.parametrize("override", ["a", "=3", "a..b=3", "time.duration=[1", 'title="x'])
def test_an_override_that_is_no_assignment_is_refused(two, override):
    assert refused(two, override).startswith(f"--set {override}: ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[floes]\nradus = 3", '[floes] radus = 3: unknown key; allowed: arrangement'),
        (
            '[coast]\nradius = 1\ngeojson = "a\\nb"',
            '[coast] geojson = "a\\nb": must be the path of a file, without control characters',
        ),
        ("[floes.size]\nradius_min = 1", "[floes.size] distribution is missing; allowed: file, "),
        (
            '[floes.size]\ndistribution = "power_law"\nradius_min = -1\nradius_max = 2',
            "[floes.size] radius_min = -1: must be greater than 0",
        ),
        (
            '[[floes]]\narrangement="list"\neach=[]\n[[floes]]\nsize={distribution="powerlaw"}',
            '[floes number 2.size] distribution = "powerlaw": ',
        ),
        ("[coast]\nradius = 3", "[coast] give either file or geojson"),
        ("[time]\nduration = nan", "[time] duration = NaN: must be a finite number"),
        ("[time]\nstart = '20160228'", "[time] start = '20160228': not a date of the calendar 'standard'"),
        ("[[walls]]\nposition = 3", "[walls] edge is missing"),
        ("x = ", "not valid TOML: Invalid value (at line 4, column 5)"),
        ("[time]\n[time]", "not valid TOML: Cannot declare"),
        ('[floes]\narrangement="list"\neach=[{x=1,y=1}]', "[floes.each] radius is missing: radius of the floe [m]"),
        ("[ocean]\nvelocity = [1, 2]\nfile = 'a'", "[ocean] velocity and file exclude each other"),
        ("[ocean]\nvelocity = [0, -2000]", "[ocean] velocity = [0.0, -2000.0]: must be below 1000 m/s"),
        ("[ocean]\nvariables = ['uo', 'vo']", "[ocean] variables applies to a file"),
        ("[ocean]\nfile = 'no.nc'", "no.nc"),
        ("[coriolis]", "[coriolis] give either parameter or latitude"),
        ("[contact]\nmodel = 'frictional'\nfriction = -1", "[contact] friction = -1: must be at least 0"),
        ("[contact]\nmodel = 'cohesive'\nrestitution = 2", "[contact] restitution = 2: must be at most 1"),
        ("[floes]\nsize = 5", "[floes] size = 5: must be a table of keys"),
        ("[tilt]\nslope = [1]", "[tilt] slope = [1]: must be a list of 2 entries"),
        ("[ice]\ndraft = 'hydrostatic'", "[ice] draft = 'hydrostatic': needs [ocean]"),
        (
            "[ice]\ndraft = 'hydrostatic'\ndensity = 1100\n[ocean]\n[grid]\nspacing = 1",
            "[ice] density = 1100: sinks in water of [ocean] drag, of density 1000",
        ),
        ("[ice]\ndraft = 2", "[ice] draft = 2: "),
        ("[tilt]\ngeostrophic = true", "[tilt] geostrophic: needs [ocean], and [coriolis]"),
        ("[output]\ngridded = true", "[output] gridded = true: needs a [grid]"),
        (
            "[output]\npicture = true\ntrajectories = false",
            "[output] picture = true: needs trajectories = true",
        ),
        ("[grid]\nspacing = 0.3", "[grid] grid: spacing along x = 0.3 does not divide"),
        ("[grid]\nkind = 'curvilinear'\nfile = 'no.nc'", "[grid] file = "),
        ("[coast]\ngeojson = 'no.json'\nradius = 1", "no.json"),
        ('[floes]\narrangement = "file"\nfile = "no.csv"', "no.csv"),
        ('[floes]\nsize={distribution="single",radius=0.1}', "give either concentration or count"),
        ('[floes]\narrangement="regular"\nradius=0.1', "give either concentration or spacing"),
    ],
)  # fmt: skip
def test_a_wrong_scene_is_refused_in_one_line_with_file_table_and_key(write, text, said):
    path = write(f"[domain]\nx = [0, 1]\ny = [0, 1]\n{text}\n")
    found = refused(path)
    assert found.startswith(f"{path}: ")
    assert found.count(str(path)) == 1
    assert said in found


def test_a_domain_without_extent_is_refused_with_its_table(write):
    path = write("[domain]\nx = [1, 0]\ny = [0, 1]\n")
    assert f"{path}: [domain]" in refused(path)


def test_the_first_error_is_shown_and_the_others_are_counted(write):
    path = write("[domain]\nx = [0, 1]\n[time]\nduration = -1\nlength = 3\n")
    text = refused(path)
    assert "[time] length = 3: unknown key" in text
    assert text.endswith("(and 2 more)")


def test_an_unknown_scene_is_refused_with_near_names(tmp_path):
    assert "did you mean 'two-floes'" in refused("two-flos")
    assert refused(tmp_path / "no.toml").endswith("no such file")
    assert "folder" in refused(tmp_path.rename(tmp_path.with_suffix(".toml")))


def test_text_that_is_not_a_scene_is_refused(write, tmp_path):
    assert "must be tables" in refused(write("- a\n- b\n", "list.yaml"))
    assert "not valid YAML" in refused(write("a: [1\n", "bad.yaml"))
    assert "line 3" in refused(write("a: 1\nb: 1\na: 2\n", "twice.yaml"))
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "UTF-8" in refused(binary)
    assert "must end in" in refused(write(TWO, "scene.txt"))


def test_a_scene_without_duration_says_how_to_give_one(write):
    scene = read_scene(write("[domain]\nx = [0, 1]\ny = [0, 1]\n"))
    with pytest.raises(InputError, match="--duration"):
        scene.schedule()
    assert scene.schedule(40.0).every == 2.0


def test_an_exchange_interval_that_does_not_divide_the_frames_is_refused(two):
    scene = read_scene(two, ["time.exchange=3", "output.every=10"])
    with pytest.raises(InputError, match="must divide the time between frames, 10 s; 2.5 would"):
        scene.schedule()


# ---- what is read -----------------------------------------------------------------------------


def test_toml_and_yaml_say_the_same(write, two):
    yaml = write(
        "title: two floes\ncontact: frictional\ndomain: {x: [0, 1e2], y: [0, 100]}\n"
        "floes:\n  arrangement: list\n  each:\n"
        "    - {x: 10, y: 50, radius: 1e1, u: 1}\n"
        "    - {x: 50, y: 50, radius: 10, thickness: 2}\n"
        "time: {duration: 10}\n",
        "scene.yaml",
    )
    assert read_scene(yaml).model_dump() == read_scene(two).model_dump()


def test_overrides_reach_tables_lists_and_words(two):
    changed = read_scene(
        two, ["floes.each.2.radius=5", "contact.friction=0.5", "title=some words", "seed=3"]
    )
    assert changed.floes[0].each[1].radius == 5
    assert changed.contact_law().friction == Coulomb(0.5)
    assert (changed.title, changed.seed) == ("some words", 3)
    assert "# --set contact.friction=0.5" in changed.text
    assert read_scene(two, ["floes.1.each.2.radius=5"]).floes == changed.floes


def test_contact_in_parts_holds_only_the_parts_that_are_listed(two):
    law = read_scene(two, ["contact={bonds = {tensile_strength = 1e5}}"]).contact_law()
    assert law.bonds.tensile_strength == 1e5
    assert law.friction is None
    assert law.dashpot is None
    assert read_scene(two, ["contact=none"]).contact_law() is None
    with pytest.raises(InputError, match="must be a number"):  # in the model "frictional" it is one
        read_scene(two, ["contact.friction.coefficient=0.1"])


def test_the_preset_gives_the_papers_scheme_and_lever_arms_unless_the_scene_says_otherwise(two):
    scene = read_scene(two, ["preset=damsgaard2018"])
    assert scene.step_law() == Step(scheme="taylor3", epsilon=0.07)
    assert scene.contact_law().friction == Damsgaard2018Coulomb()
    scene = read_scene(two, ["preset=damsgaard2018", "step.scheme=taylor2", "step.epsilon=0.05"])
    assert scene.step_law() == Step(scheme="taylor2", epsilon=0.05)
    scene = read_scene(
        two, ["preset=damsgaard2018", 'contact={friction = {law = "coulomb"}}', "step.length=0.1"]
    )
    assert scene.contact_law().friction == Coulomb()
    assert scene.step_law() == Step(scheme="taylor3", length=0.1)


@pytest.mark.parametrize("other", ["length=0.1", "epsilon=0.05"])
def test_a_fraction_of_the_limit_beside_another_step_is_refused(two, other):
    for more in ([], ["preset=damsgaard2018"]):
        scene = read_scene(two, ["step.fraction=0.3", f"step.{other}", *more])
        said = rf"{other.split('=')[0]} = {other.split('=')[1]} exclude each other"
        with pytest.raises(InputError, match=rf"\[step\] fraction = 0.3 and {said}"):
            scene.build()


@pytest.mark.long
def test_only_the_forces_that_are_listed_are_in_the_model(two):
    assert read_scene(two).build().model.forces == ()
    model = read_scene(
        two,
        ["ocean.drag=constant-cd", "atmosphere.drag.horizontal=1e-3", "coriolis.latitude=90",
         "body_force.x=0.1", "grid.spacing=10", "tilt.slope=[1e-6,0]"],
    ).build().model  # fmt: skip
    ocean, air, coriolis, tilt, body = model.forces
    assert ocean == DRAG_PRESETS["constant-cd"][0]
    assert air == AirDrag(horizontal=1e-3)
    assert coriolis.parameter == pytest.approx(1.4584e-4, rel=1e-4)
    assert (tilt.gravity, body.x) == (9.81, 0.1)
    assert model.ocean.tilt_x[0] == 1e-6


def test_the_slope_can_be_in_balance_with_the_current(two):
    listed = [
        "ocean.velocity=[0.1,0]",
        "coriolis.latitude=-75",
        "tilt.geostrophic=true",
        "grid.spacing=10",
    ]
    forces = read_scene(two, listed).forces()
    assert forces[-1] == GeostrophicTilt(forces[-2].parameter)
    for wrong in ("tilt.slope=[1e-6,0]", "tilt.gravity=9.8"):
        with pytest.raises(InputError, match="takes the place of slope and gravity"):
            read_scene(two, [*listed, wrong])
    for wrong in (listed[1:], [listed[0], *listed[2:]], [*listed, "coriolis.field=true"]):
        with pytest.raises(
            InputError, match=r"toml: \[tilt\] geostrophic: needs \[ocean\], and \[coriolis\]"
        ):
            read_scene(two, wrong).build()


def test_draft_can_be_hydrostatic(two):
    model = read_scene(two, ["ice.draft=hydrostatic", "ocean.drag=constant-cd"]).build().model
    assert model.draft_fraction == pytest.approx(934 / 1026)
    assert isinstance(model.forces[0], OceanDrag)


def test_floes_are_free_fixed_driven_or_held_along_an_axis(two):
    floes = read_scene(
        two, ['floes.each.1.motion="driven"', 'floes.each.2.motion="fixed"']
    ).build().model.floes  # fmt: skip
    assert list(floes.motion) == [DRIVEN, FIXED]
    floes = read_scene(two, ['floes.each.1.motion=["y", "rotation"]']).build().model.floes
    assert floes.motion[0] == 6
    assert "stands still" in refused(two, "floes.each.1.motion=fixed")


def test_groups_of_floes_lie_in_their_regions_and_repeat_with_the_seed(write):
    path = write(
        """
seed = 5
[domain]
x = [0, 1000]
y = [0, 1000]
[[floes]]
arrangement = "regular"
radius = 10
spacing = 25
y = [0, 100]
thickness = 2
[[floes]]
size = { distribution = "uniform", radius_min = 5, radius_max = 20 }
concentration = 0.5
y = [200, 1000]
velocity = [0.5, 0]
"""
    )
    floes = read_scene(path).build().model.floes
    lattice = floes.thickness == 2
    assert 100 < lattice.sum() < len(floes)
    assert floes.y[lattice].max() <= 90
    assert (floes.y - floes.radius)[~lattice].min() >= 200
    assert set(floes.u[~lattice]) == {0.5}
    again = read_scene(path).build().model.floes
    other = read_scene(path, ["seed=6"]).build().model.floes
    np.testing.assert_array_equal(floes.x, again.x)
    assert len(other) != len(floes) or not np.array_equal(floes.x, other.x)


def test_no_group_of_a_seed_has_the_floes_of_another_group_or_seed(write):
    group = 'size = { distribution = "uniform", radius_min = 5, radius_max = 20 }\ncount = 20\n'
    path = write(
        "[domain]\nx = [0, 1000]\ny = [0, 1000]\n"
        + "".join(f"[[floes]]\n{group}x = [{100 * k}, {100 * (k + 1)}]\n" for k in range(3))
    )
    drawn = []
    for seed in range(3):
        floes = read_scene(path, [f"seed={seed}"]).build().model.floes
        drawn += [tuple(np.sort(floes.radius[floes.x // 100 == k])) for k in range(3)]
    assert all(len(radii) == 20 for radii in drawn) and len(set(drawn)) == 9


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("domain.x=[0, 1e300]", "[domain] domain.x = (0.0, 1e+300): must be within 1e+09 m"),
        ("domain.y=[-1e10, 9]", "[domain] domain.y = (-10000000000.0, 9.0): must be within 1e+09"),
        ("grid={shape=[2,2], x=[0, 1e300]}", "grid: x = (0.0, 1e+300): must be within 1e+09 m"),
        (
            "grid={kind='rectilinear', x_edges=[0, 1e300], y_edges=[0, 1]}",
            "[grid] grid: x_edges[1] = 1e+300: must be within 1e+09 m",
        ),
    ],
)
def test_a_domain_and_a_grid_lie_within_what_numbers_tell_apart(two, change, said):
    assert said in refused(two, change)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "floes.size={distribution='uniform', radius_min=9, radius_max=5}",
            "[floes] radius_max = 5 m",
        ),
        (
            "floes.size={distribution='histogram', edges=[1, 2], counts=[0]}",
            "[floes] counts[0] = 0; at",
        ),
        ("floes.x=[90, 10]", "[floes] x = [90.0, 10.0]: the second must be larger"),
        ("floes.x=[0, 7]", "[floes] x from 0 to 7 m: must be at least 10 m long, 2 radii of the"),
        (
            "inflow={edge='west', velocity=[1, 0], sizes={distribution='uniform', radius_min=9, radius_max=5}}",
            "toml: inflow.sizes.radius_max = 5 m; must be at least radius_min, 9 m",
        ),
        (
            "contact={model='cohesive', restitution=1e-9}",
            "coefficient of restitution = 1e-09: too small",
        ),
        ("domain.north=closed", "toml: walls and closed edges need a contact law: give contact"),
    ],
)
def test_an_error_of_what_a_scene_makes_names_keys_of_the_scene(write, change, said):
    floes = '[floes]\nsize = { distribution = "single", radius = 5 }\ncount = 3\n'
    assert said in refused(write("[domain]\nx = [0, 100]\ny = [0, 100]\n" + floes), change)


@pytest.mark.parametrize(
    "change",
    ["body_force=[0, 1e-3]", "walls=[['north', 100]]"]
    + [f"contact={{model='parts', {part}}}" for part in (
        "elastic=[1e7]", "elastic=[]", "bonds=[1e5]", "dashpot=[0.3]", "failure=[1e6]")],
)  # fmt: skip
def test_a_list_in_the_place_of_a_table_is_refused(two, change):
    """It was taken in the order of the keys, which nothing tells."""
    text = refused(two, change)
    assert text.startswith(f"--set {change}: ") and text.endswith("must be a table of keys")


def test_the_first_group_draws_from_the_seed_itself(write):
    path = write(
        "seed = 4\n[domain]\nx = [0, 1000]\ny = [0, 1000]\n"
        '[floes]\nsize = { distribution = "uniform", radius_min = 5, radius_max = 20 }\ncount = 20\n'
    )
    built = read_scene(path).build().model
    alone = scatter(built.domain, UniformSize(5.0, 20.0), count=20, seed=4)
    np.testing.assert_array_equal(built.floes.x, alone.x)


def test_floes_of_the_labrador_sea_have_the_area_of_its_file_and_two_per_cent_less_volume():
    """As docs/howto/floes-and-coast.md and `from_field` say."""
    scene = read_scene("labrador-sea")
    with pytest.warns(IceNotPlaced, match="max_concentration"):
        model = scene.build().model
    wet, size = model.grid.wet, model.grid.area
    sea = Sea(
        model.domain, model.grid, None, scene.file.parent, scene.domain.projection,
        scene.time.start, scene.time.calendar,
    )  # fmt: skip
    fraction, thickness = (np.nan_to_num(field) for field in scene.floes[0].ice(sea))
    area = np.where(wet, np.minimum(fraction, 0.85), 0.0) * size
    ice = model.floes.active & ~model.floes.land
    placed, volume = model.floes.area[ice], model.floes.area[ice] * model.floes.thickness[ice]
    assert placed.sum() == pytest.approx(area.sum(), rel=1e-3)
    assert volume.sum() / (area * thickness).sum() == pytest.approx(0.98, abs=0.005)
    there = model.fields()["area_fraction"] * size
    for cells, least, most in (
        (wet & (fraction > 0.05) & (fraction < 0.7), 1.1, 1.35),
        (wet & (fraction > 0.7), 0.93, 0.97),
    ):
        assert least < there[cells].sum() / area[cells].sum() < most


def test_free_floes_beyond_an_edge_are_refused_with_their_place(write):
    write("x,y,radius\n50,50,5\n50,350,5\n", "floes.csv")
    text = """
contact = "frictional"
[domain]
x = [0, 100]
y = [0, 100]
edges = "EDGE"
[floes]
arrangement = "file"
file = "floes.csv"
thickness = 1
"""
    for edge in ("closed", "inactive"):
        with pytest.raises(InputError, match=r"\[floes\] 1 of 2 floes lie outside .* y = 350 m"):
            read_scene(write(text.replace("EDGE", edge))).build()
        held = read_scene(write(text.replace("EDGE", edge)), ["floes.motion=fixed"])
        assert len(held.build().model.floes) == 2
    write("x,y,radius\n50,50,5\n50,330,5\n", "floes.csv")
    assert len(read_scene(write(text.replace("EDGE", "periodic"))).build().model.floes) == 2


def test_sizes_and_floes_come_from_files_beside_the_scene(write):
    write("radius\n5\n6\n7\n", "sizes.csv")
    write("x,y,radius,thickness\n50,50,5,1\n", "floes.csv")
    path = write(
        """
[domain]
x = [0, 500]
y = [0, 500]
[[floes]]
size = { distribution = "file", file = "sizes.csv" }
count = 20
y = [100, 500]
[[floes]]
arrangement = "file"
file = "floes.csv"
"""
    )
    scene = read_scene(path)
    assert scene.paths() == ["sizes.csv", "floes.csv"]
    floes = scene.build().model.floes
    assert len(floes) == 21
    assert (floes.radius[:20] >= 5).all()
    assert (floes.radius[:20] <= 7).all()
    assert floes.x[20] == 50


def test_a_scene_with_a_projection_takes_floes_from_a_table_in_its_plane(write, tmp_path):
    (tmp_path / "floes.csv").write_text("x,y,radius,thickness\n10,20,3,2\n")
    path = write(
        """
        [domain]
        x = [0, 100]
        y = [0, 100]
        projection = "EPSG:3413"
        [floes]
        arrangement = "file"
        file = "floes.csv"
        """
    )
    assert read_scene(path).build().model.floes.x.tolist() == [10.0]


def test_a_byte_order_mark_is_no_key(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(TWO, encoding="utf-8-sig")
    assert read_scene(path).title == "two floes"


def test_a_coast_makes_cells_dry_and_keeps_floes_off_the_land(write):
    ring = [[-100, -100], [400, -100], [400, 1100], [-100, 1100], [-100, -100]]
    write(json.dumps({"type": "Polygon", "coordinates": [ring]}), "land.geojson")
    path = write(
        """
[domain]
x = [0, 1000]
y = [0, 1000]
[grid]
spacing = 100
[coast]
geojson = "land.geojson"
radius = 20
[floes]
size = { distribution = "single", radius = 20 }
concentration = 0.3
"""
    )
    built = read_scene(path).build()
    model = built.model
    assert model.grid.wet.reshape(10, 10)[0].tolist() == [False] * 4 + [True] * 6
    ice = model.floes.motion == 0
    assert (model.floes.x - model.floes.radius)[ice].min() > 399
    assert len(built.land) == 1


@pytest.fixture
def over_a_seam(write):
    """Writes a scene of a square kilometre, periodic along x, with land over its seam from y = low to high [m]."""

    def make(low, high, rest):
        ring = [[800, low], [1200, low], [1200, high], [800, high], [800, low]]
        write(json.dumps({"type": "Polygon", "coordinates": [ring]}), "land.geojson")
        return write(
            """
[domain]
x = [0, 1000]
y = [0, 1000]
west = "periodic"
east = "periodic"
[coast]
geojson = "land.geojson"
radius = 20
"""
            + rest
        )

    return make


def test_land_over_a_periodic_seam_makes_cells_on_both_sides_dry_and_closes_both_to_an_inflow(
    over_a_seam,
):
    path = over_a_seam(
        0,
        1000,
        """
[grid]
x = [-500, 500]
shape = [10, 10]
[inflow]
edge = "south"
sizes = { distribution = "single", radius = 20 }
span = [100, 700]
""",
    )
    assert "land lies along the edge south between 100 and 200 m" in refused(path)
    wet = read_scene(path, ["inflow.span=[200, 800]"]).build().model.grid.wet.reshape(10, 10)
    assert wet[0].tolist() == [True] * 3 + [False] * 4 + [True] * 3


@pytest.mark.parametrize("west, east", [(0, 500), (900, 1900)])
def test_floes_in_part_of_a_periodic_domain_keep_clear_of_land_beyond_its_seam(
    over_a_seam, west, east
):
    path = over_a_seam(
        200,
        800,
        """
[floes]
x = [0, 1]
size = { distribution = "single", radius = 20 }
concentration = 0.5
""",
    )
    floes = read_scene(path, [f"floes.x=[{west}, {east}]"]).build().model.floes
    ice = floes.motion == 0
    beside = (floes.x % 1000)[ice & (abs(floes.y - 500) < 300)]
    assert beside.min() >= 220.0 and beside.max() <= 780.0
    wet = (east - west) * 1000 - (200 if west == 0 else 400) * 600
    assert floes.area[ice].sum() == pytest.approx(0.5 * wet, rel=0.005)


def test_a_land_fraction_on_a_grid_round_the_period_goes_on_at_the_other_side(write):
    xr = pytest.importorskip("xarray")
    land = np.zeros((10, 10))
    land[:, :2] = 1.0
    x = 50 + 100.0 * np.arange(10)
    data = xr.Dataset({"land": (("y", "x"), land)}, {"x": ("x", x), "y": ("y", x)})
    data.land.attrs = {"standard_name": "land_area_fraction", "units": "1"}
    for name in "xy":
        data[name].attrs = {"standard_name": f"projection_{name}_coordinate", "units": "m"}
    path = write(
        """
[domain]
x = [0, 1000]
y = [0, 1000]
west = "periodic"
east = "periodic"
[grid]
spacing = 100
[coast]
file = "land.nc"
radius = 60
"""
    )
    data.to_netcdf(path.parent / "land.nc")
    wet = read_scene(path).build().model.grid.wet.reshape(10, 10)
    assert wet[0].tolist() == [False] * 2 + [True] * 8


def test_land_goes_on_across_a_seam_that_is_not_straight(write):
    xr = pytest.importorskip("xarray")
    x, y = np.arange(-295.0, 1300, 10), np.arange(5.0, 1000, 10)
    land = np.tile(
        (x % 1000 < 200.0) * 1.0, (len(y), 1)
    )  # a bar from the seam on, water west of it
    data = xr.Dataset({"land": (("y", "x"), land)}, {"x": ("x", x), "y": ("y", y)})
    data.land.attrs = {"standard_name": "land_area_fraction", "units": "1"}
    for name in "xy":
        data[name].attrs = {"standard_name": f"projection_{name}_coordinate", "units": "m"}
    corner_x, corner_y = np.meshgrid(np.linspace(0, 1000, 21), np.linspace(0, 1000, 21))
    corner_x = corner_x + 150 * np.sin(np.pi * corner_y / 500)
    path = write(
        """
contact = "frictional"
[domain]
x = [0, 1000]
y = [0, 1000]
edges = "periodic"
[grid]
kind = "curvilinear"
file = "cells.nc"
[coast]
file = "land.nc"
radius = 20
"""
    )
    data.to_netcdf(path.parent / "land.nc")
    corners = {"x_corners": (("y", "x"), corner_x), "y_corners": (("y", "x"), corner_y)}
    xr.Dataset(corners).to_netcdf(path.parent / "cells.nc")
    model = read_scene(path).build().model
    along = model.grid.x % 1000.0
    assert not model.grid.wet[(along > 30) & (along < 170)].any()
    assert model.grid.wet[(along > 230) & (along < 970)].all()
    for shore in (0.0, 200.0):  # each is lined all along
        off = np.abs((model.floes.x - shore + 500) % 1000 - 500)
        assert np.diff(np.sort(model.floes.y[off < 60])).max() < 60


@pytest.mark.parametrize("west", [-100, 0])  # beyond the edge, and up to it
def test_floes_do_not_come_in_over_land(write, west):
    ring = [[west, 300], [400, 300], [400, 700], [west, 700], [west, 300]]
    write(json.dumps({"type": "Polygon", "coordinates": [ring]}), "land.geojson")
    path = write(
        """
contact = "frictional"
[domain]
x = [0, 1000]
y = [0, 1000]
[coast]
geojson = "land.geojson"
radius = 20
[inflow]
edge = "west"
sizes = { distribution = "single", radius = 20 }
velocity = [0.1, 0]
"""
    )
    said = "[inflow] land lies along the edge west between 300 and 700 m; give open water as span"
    assert said in refused(path)
    model = read_scene(path, ["inflow.span=[0, 300]"]).build().model
    model.advance(600.0)
    assert len(model.floes) > (model.floes.motion != 0).sum()  # some came in


# ---- gridded files ----------------------------------------------------------------------------

PLANE = "+proj=stere +lat_0=90 +lat_ts=70 +lon_0=-45 +datum=WGS84"


@pytest.fixture
def sea(tmp_path):
    """A file of 11 × 11 points, 10 km apart, whose longitudes and latitudes lie 8 km east of its x, y.

    The current is x/1 Mm; ice lies where x > 0, twice as thick on the second day, land where y > 45 km.
    """
    import xarray as xr

    from floebmi.projection import to_lonlat

    x = np.arange(-50e3, 51e3, 10e3)
    x2, y2 = np.meshgrid(x, x)
    lon, lat = to_lonlat(PLANE, x2 + 8e3, y2)
    days = np.array(["2016-02-01", "2016-02-03"], "datetime64[ns]")

    def mapped(values, name, units="1", **more):
        attrs = {"standard_name": name, "units": units, "grid_mapping": "crs", **more}
        return ("time", "y", "x")[3 - np.ndim(values) :], values, attrs

    ice = (x2 > 0) * 0.6
    data = xr.Dataset(
        {
            "u": mapped(np.stack(2 * [x2 / 1e6]), "sea_water_x_velocity", "m s-1"),
            "v": mapped(np.stack(2 * [0 * x2]), "sea_water_y_velocity", "m s-1"),
            "aice": mapped(np.stack(2 * [ice]), "sea_ice_area_fraction"),
            "hice": mapped(
                np.stack([ice, 2 * ice]) / 0.6,
                "sea_ice_thickness",
                "m",
                long_name="actual thickness",
            ),
            "land": mapped((y2 > 45e3) * 1.0, "land_area_fraction"),
            "crs": ((), 0, {"grid_mapping_name": "polar_stereographic", "proj4": PLANE}),
            "lon": (("y", "x"), lon, {"units": "degrees_east"}),
            "lat": (("y", "x"), lat, {"units": "degrees_north"}),
        },
        {
            "time": days,
            "y": ("y", x, {"units": "m", "standard_name": "projection_y_coordinate"}),
            "x": ("x", x, {"units": "m", "standard_name": "projection_x_coordinate"}),
        },
    )
    data.to_netcdf(tmp_path / "sea.nc")
    return f"""
[domain]
x = [-40e3, 40e3]
y = [-40e3, 40e3]
projection = "{PLANE}"
[grid]
spacing = 5e3
"""


ICE = """
[floes]
arrangement = "field"
file = "sea.nc"
size = { distribution = "single", radius = 1e3 }
"""


def test_of_two_positions_in_a_file_each_table_takes_the_one_that_the_scene_says(write, sea):
    ocean = "[ocean]\nfile = 'sea.nc'\n"
    coast = "[coast]\nfile = 'sea.nc'\nradius = 1e3\n"
    u, west = {}, {}
    for position in ("mapping", "lonlat"):
        word = f"position = '{position}'\n"
        built = read_scene(write(sea + ocean + word + ICE + word + coast + word)).build()
        ocean_of = built.model.ocean
        built.ocean.fill(0.0, ocean_of.u, ocean_of.v)
        u[position] = ocean_of.u.copy()
        floes = built.model.floes
        west[position] = floes.x[floes.motion == 0].min()
    x = built.model.grid.x
    np.testing.assert_allclose(u["mapping"], x / 1e6, atol=1e-12)
    inner = x - 8e3 > -50e3
    np.testing.assert_allclose(u["lonlat"][inner], (x[inner] - 8e3) / 1e6, atol=1e-8)
    assert 4e3 < west["lonlat"] - west["mapping"] < 12e3
    with pytest.warns(UserWarning, match=r"disagree by 8\.\d km"):
        read_scene(write(sea + ocean)).build()


def test_the_ice_is_that_of_the_start_or_of_its_own_date(write, sea):
    def thickness(more):
        mapping = "position = 'mapping'\n"
        floes = read_scene(write(sea + ICE + mapping + more)).build().model.floes
        return floes.thickness.max()

    assert thickness("") == pytest.approx(1.0)
    assert thickness("[time]\nstart = '2016-02-02'\n") == pytest.approx(1.5)
    later = "time = '2016-02-03'\n[time]\nstart = '2016-02-01'\n"
    assert thickness(later) == pytest.approx(2.0)
    text = refused(write(sea + ICE + "position = 'mapping'\n[time]\nstart = '2017-02-03'\n"))
    assert "[floes] sea.nc: aice: time = '2017-02-03': the file has 2016-02-01" in text
    text = refused(write(sea + ICE + "position = 'mapping'\ntime = 'soon'\n"))
    assert "[floes] time = 'soon': not a date of the calendar 'standard'" in text


def test_without_a_start_two_dated_files_must_begin_at_one_date(write, sea, tmp_path):
    import xarray as xr

    with xr.open_dataset(tmp_path / "sea.nc") as data:
        wind = data.rename(u="x_wind", v="y_wind").load()
    for name in ("x_wind", "y_wind"):
        wind[name].attrs["standard_name"] = name
    wind.to_netcdf(tmp_path / "same.nc")
    wind["time"] = wind.time - np.timedelta64(1, "D")
    wind.to_netcdf(tmp_path / "earlier.nc")
    wind.isel(time=[0]).to_netcdf(tmp_path / "always.nc")
    place = "position = 'mapping'\n"
    text = sea + f"[ocean]\nfile = 'sea.nc'\n{place}[atmosphere]\nfile = '%s.nc'\n{place}"
    said = refused(write(text % "earlier"))
    assert "[time] start is missing: the records of [ocean] begin at 2016-02-01, those of" in said
    for fine in ("same", "always"):
        read_scene(write(text % fine)).build()
    built = read_scene(write(text % "earlier"), ["time.start=2016-02-01"]).build()
    assert built.ocean.span == (0.0, 172800.0)
    assert built.atmosphere.span == (-86400.0, 86400.0)
    drift = sea + ICE + place + f"[atmosphere]\nfile = '%s.nc'\n{place}"
    said = refused(write(drift % "earlier"))
    assert "[floes] time is missing: the records of sea.nc begin at 2016-02-01, time 0 is" in said
    for fine in ("same", "always"):
        read_scene(write(drift % fine)).build()
    for told in ("floes.time=2016-02-02", "time.start=2016-02-01"):
        read_scene(write(drift % "earlier"), [told]).build()


def test_a_thickness_without_units_has_those_of_the_scene(write, sea, tmp_path):
    import xarray as xr

    with xr.open_dataset(tmp_path / "sea.nc") as data:
        data.load()
    del data.hice.attrs["units"]
    data.to_netcdf(tmp_path / "bare.nc")
    ice = sea + ICE.replace("sea.nc", "bare.nc") + "position = 'mapping'\n"
    assert "it has no units; must be a length: m, km, cm (say which with units)" in refused(
        write(ice)
    )
    floes = read_scene(write(ice + "units = 'cm'\n")).build().model.floes
    assert floes.thickness.max() == pytest.approx(0.01)
    text = refused(write(ice + "units = 'cm'\nthickness = 1.5\n"))
    assert "units applies to a thickness in the file, not to thickness = 1.5 of all floes" in text
    data.aice.attrs["units"] = "tenths"
    data.to_netcdf(tmp_path / "odd.nc")
    text = refused(write(ice.replace("bare.nc", "odd.nc")))
    assert "units = 'tenths'; must be a fraction: 1 or % (put right its attribute units)" in text


def test_a_field_without_ice_and_a_file_without_floes_are_told(write, sea, tmp_path):
    import xarray as xr

    (tmp_path / "none.csv").write_text("x,y,radius,thickness\n")
    with pytest.warns(UserWarning, match="none.csv: there are no floes in it") as told:
        read_scene(
            write("[domain]\nx=[0,9]\ny=[0,9]\n[floes]\narrangement='file'\nfile='none.csv'\n")
        ).build()
    assert told[0].filename == __file__
    with xr.open_dataset(tmp_path / "sea.nc") as data:
        data.load()
    data.aice[:] = 0.0
    data.to_netcdf(tmp_path / "open.nc")
    ice = ICE.replace("sea.nc", "open.nc") + "position = 'mapping'\n"
    with pytest.warns(UserWarning, match="open.nc: there is no ice in the wet cells"):
        built = read_scene(write(sea + ice)).build()
    assert not len(built.model.floes)


def test_what_lies_outside_a_file_is_an_error_or_what_the_scene_says(write, sea):
    wide = sea.replace("y = [-40e3, 40e3]", "y = [-80e3, 80e3]")
    ice, coast = (
        ICE + "position = 'mapping'\n",
        "[coast]\nfile = 'sea.nc'\nradius = 1e3\nposition = 'mapping'\n",
    )
    water = "outside = 'open water'\nmask = 'none'\n"
    assert "lie outside the file" in refused(write(wide + ice))
    assert "lie outside the file" in refused(write(wide + coast))
    floes = read_scene(write(wide + ice + water)).build().model.floes
    assert len(floes) and np.abs(floes.y).max() < 60e3
    for word, wet in (("land", False), ("water", True)):
        model = read_scene(write(wide + coast + f"outside = '{word}'\n")).build().model
        assert (model.grid.wet[np.abs(model.grid.y) > 60e3] == wet).all()
    text = refused(write(wide + coast + "outside = 'sea'\n"))
    assert '[coast] outside = "sea": allowed: error, land, water' in text or "water" in text


def test_keys_about_a_file_of_land_do_not_stand_beside_polygons(write):
    path = write(
        "[domain]\nx = [0, 1]\ny = [0, 1]\n[coast]\ngeojson = 'a'\nradius = 1\nposition = 'lonlat'\n"
    )
    assert "[coast] position applies to file, not to geojson" in refused(path)


@pytest.mark.parametrize("axes", [("time",), ("time", "lat", "lon")])
def test_a_series_at_one_point_holds_in_the_whole_box(write, tmp_path, axes):
    import xarray as xr

    shape = (3, 1, 1)[: len(axes)]
    east, north = (
        (
            axes,
            np.array(values).reshape(shape),
            {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"},
        )
        for values, way in (([0.1, 0.3, 0.3], "eastward"), ([0.0, 0.2, 0.2], "northward"))
    )
    place = {"lon": 45.0, "lat": 80.0}
    units = {"lon": "degrees_east", "lat": "degrees_north"}
    rows = axes[1:] or (None, None)
    coords = {
        name: ((name,), [place[name]], {"units": units[name]}) if name in rows
        else ((), place[name], {"units": units[name]})
        for name in place
    }  # fmt: skip
    hours = np.array(["2000-01-01T00", "2000-01-01T01", "2000-01-01T02"], "datetime64[ns]")
    xr.Dataset({"u": east, "v": north}, {"time": hours, **coords}).to_netcdf(tmp_path / "point.nc")
    box = "[domain]\nx = [0, 1e3]\ny = [0, 1e3]\nedges = 'periodic'\n{}\n[grid]\nspacing = 500\n[ocean]\nfile = 'point.nc'\n"
    for plane, u, v in (("", 0.2, 0.1), (f"projection = '{PLANE}'", -0.1, 0.2)):
        built = read_scene(write(box.format(plane))).build()
        ocean = built.model.ocean
        built.ocean.fill(1800.0, ocean.u, ocean.v)
        np.testing.assert_allclose(ocean.u, u, atol=1e-8)
        np.testing.assert_allclose(ocean.v, v, atol=1e-8)
        assert "one point at lon 45, lat 80, the same everywhere" in repr(built.ocean)
    with pytest.raises(InputError, match=r"t = 7201 s \(2000-01-01T02:00:01\) is outside"):
        built.ocean.fill(7201.0, ocean.u, ocean.v)


def test_grids_of_every_kind_can_be_asked_for(write, tmp_path):
    from netCDF4 import Dataset

    y, x = np.meshgrid(np.linspace(0, 100, 4), np.linspace(0, 100, 6), indexing="ij")
    with Dataset(tmp_path / "grid.nc", "w") as data:
        for name, size in (("j", 4), ("i", 6), ("node", 4), ("face", 1), ("corner", 4)):
            data.createDimension(name, size)
        for name, values, dims in (
            ("x_corners", x, ("j", "i")), ("y_corners", y, ("j", "i")),
            ("node_x", [0, 100, 100, 0], ("node",)), ("node_y", [0, 0, 100, 100], ("node",)),
        ):  # fmt: skip
            data.createVariable(name, "f8", dims)[:] = values
        data.createVariable("face_nodes", "i4", ("face", "corner"))[:] = [[0, 1, 2, 3]]
    scene = write(TWO)
    for change, kind, size in (
        (["grid.spacing=[10,20]"], "uniform_rectilinear", 50),
        (["grid.shape=[2,5]"], "uniform_rectilinear", 10),
        (["grid={kind='rectilinear',x_edges=[0,10,100],y_edges=[0,100]}"], "rectilinear", 2),
        (["grid={kind='curvilinear',file='grid.nc'}"], "curvilinear", 15),
        (["grid={kind='unstructured',file='grid.nc'}"], "unstructured", 1),
    ):
        grid = read_scene(scene, change).build().model.grid
        assert (grid.kind, grid.size) == (kind, size)
    assert "give either spacing or shape" in refused(scene, "grid.x=[0,100]")
    assert "no variable 'x_corners'" in refused(
        scene, "grid={kind='curvilinear',file='other.nc'}"
    ) or "no such file" in refused(scene, "grid={kind='curvilinear',file='other.nc'}")


def test_wind_can_have_a_grid_of_its_own(two):
    model = read_scene(
        two, ["grid.spacing=10", "ocean.velocity=[1,0]", "atmosphere.grid.spacing=50"]
    ).build().model  # fmt: skip
    assert (model.ocean.grid.size, model.atmosphere.grid.size) == (100, 4)


# ---- the package's own scenes, and the reference ---------------------------------------------


@pytest.mark.parametrize("name", packaged())
def test_a_packaged_scene_is_read_without_complaint_and_its_files_are_there(name):
    scene = read_scene(name)
    assert scene.title
    assert scene.schedule().duration > 0
    for path in scene.paths():
        assert (scene.file.parent / path).exists()


@pytest.mark.parametrize("name", packaged())
def test_a_copied_scene_has_its_data_beside_it(name, tmp_path):
    files = copy_scene(name, tmp_path / "mine.toml")
    copied = read_scene(tmp_path / "mine.toml")
    assert copied.model_dump() == read_scene(name).model_dump()
    assert all((tmp_path / path).exists() for path in copied.paths())
    assert copy_scene(name, tmp_path / "mine.toml") == files  # the same again is no loss
    (tmp_path / "mine.toml").write_text("edited")
    with pytest.raises(InputError, match="exists already"):
        copy_scene(name, tmp_path / "mine.toml")
    copy_scene(name, tmp_path / "mine.toml", force=True)
    assert read_scene(tmp_path / "mine.toml").model_dump() == copied.model_dump()


def test_a_scene_that_the_disk_has_no_room_for_leaves_the_earlier_one(tmp_path, monkeypatch):
    def torn(old, new):
        Path(new).write_bytes(b"torn")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (tmp_path / "mine.toml").write_text("edited")
    monkeypatch.setattr(shutil, "copyfile", torn)
    with pytest.raises(InputError, match="mine.toml: cannot be written .No space left on device"):
        copy_scene("two-floes", tmp_path / "mine.toml", force=True)
    assert (tmp_path / "mine.toml").read_text() == "edited"
    assert os.listdir(tmp_path) == ["mine.toml"]


def test_every_key_of_a_scene_is_described():
    rows = list(keys(Scene))
    assert len(rows) > 100
    assert [f"{table}.{key}" for table, key, _, text in rows if not text] == []


def test_the_keys_of_each_kind_of_table_begin_with_the_word_that_picks_it():
    rows = list(keys(Scene))
    kinds = [k for k, row in enumerate(rows) if row[:3] == ("floes", "arrangement", '= "regular"')]
    assert len(kinds) == 1
    assert [rows[kinds[0] - 1][0], rows[kinds[0] + 1][:2]] == ["floes.size", ("floes", "velocity")]
    assert ("grid", "kind", '= "curvilinear"') in [row[:3] for row in rows]


def test_a_scene_tells_the_thickness_of_the_hosts_layer():
    model = read_scene("periodic-box", ["ocean.layer_thickness=5"]).build().model
    assert model.ocean.layer_thickness == 5.0
    assert read_scene("periodic-box").build().model.ocean.layer_thickness is None
    with pytest.raises(InputError, match="layer_thickness=0: must be greater than 0"):
        read_scene("periodic-box", ["ocean.layer_thickness=0"])


@pytest.mark.parametrize("scene", [None, {}, 1, b"two-floes"])
def test_a_scene_of_a_wrong_kind_is_refused_in_one_line(scene):
    with pytest.raises(InputError, match="^scene = .*: must be the path of a file"):
        read_scene(scene)


@pytest.mark.parametrize("overrides", [3, [3], "seed=3", {"seed": 3}])
def test_overrides_of_a_wrong_kind_are_refused_in_one_line(overrides):
    with pytest.raises(InputError, match="^overrides = .*: must be a list of texts"):
        read_scene("two-floes", overrides)


def test_the_words_that_a_scene_allows_for_a_file_are_those_of_its_readers():
    words = {
        "position": places.Position, "fill_land": remap.FillLand, "vectors": forcing.Vectors,
        "stagger": cgrid.Stagger,
    }  # fmt: skip
    for key, allowed in words.items():
        assert FluidTable.model_fields[key].annotation == allowed
