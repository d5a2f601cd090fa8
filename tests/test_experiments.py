"""The paper's experiments: what is set up, what counts as a jam, what the command leaves."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from floebmi.cli import floebmi
from floebmi.errors import InputError
from floebmi.experiments import campaign, figures, laws, shear, strait
from floebmi.experiments.parameters import Shear, Strait, make, rows, table
from floebmi.grid import Grid

SMALL_SHEAR = {
    "floes": 60, "height": 150.0, "radius_min": 5.0, "radius_max": 8.0, "held": 16.0, "settling": 60.0,
    "consolidation": 40.0, "duration": 60.0, "wall_damping": 1.0,
}  # fmt: skip
SMALL_STRAIT = {"funnel": 8e3, "width": 4e3, "hours": 3.0}


@pytest.fixture
def cli(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda line: CliRunner().invoke(floebmi, ["experiment", *line.split()])


@pytest.fixture(scope="module")
def sheared():
    # long enough, and looked at often enough, for a mean: over a minute the wall met 10 to 40 kPa, by seed and processor
    return shear.member(SMALL_SHEAR | {"duration": 600.0, "interval": 0.5}, 1)


# ---- the table --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Shear, Strait])
def test_each_parameter_has_a_meaning_and_says_where_it_comes_from(kind):
    for name, _, row in rows(kind):
        assert row.meaning and row.source, name
        assert row.source.split(":")[0].split(",")[0] in ("stated", "chosen", "reference code") or (
            "the paper" in row.source
        ), name


def test_the_docs_show_the_table_as_it_is():
    text = (Path(__file__).parents[1] / "docs/experiments.md").read_text()
    for kind in (Shear, Strait):
        assert table(kind) in text


def test_the_help_tells_what_is_run_without_options(cli):
    told = " ".join(cli("shear --help").stdout.split())
    assert "stress N of the wall on top [Pa]; 5000,10000,20000,40000,80000." in told
    assert "(shear: 3, strait: 20)" in told


def test_no_friction_and_no_strength_leave_rotation_and_bonds_out():
    model = strait.build(make(Strait, {"friction": 0.0}), 1)
    assert {"friction", "rotation", "bonds", "dashpots"} <= set(model.absent())
    assert model.floes.angle is None
    both = laws.contact(make(Strait, {"tensile_strength": 2e5}))
    assert both.friction is not None and both.bonds is not None


def test_the_preset_of_the_paper_takes_its_scheme_and_lever_arms():
    p = make(Strait, {"preset": "damsgaard2018"})
    assert laws.step(p).scheme == "taylor3" and laws.step(p).epsilon == 0.07
    assert type(laws.contact(p).friction).__name__ == "Damsgaard2018Coulomb"
    assert laws.drag(p) == laws.drag(make(Strait, {}))
    assert laws.drag(p) != laws.drag(make(Strait, {"preset": "granular.jl-0.3.2"}))


@pytest.mark.parametrize(
    "values, words",
    [
        ({"friction": -1.0}, "at least 0"),
        ({"widht": 1.0}, "did you mean 'width'"),
        ({"preset": "paper"}, "allowed: constant-cd"),
        ({"spread": 3.0}, "would not be positive"),
        ({"width": float("nan")}, "finite"),
    ],
)
def test_what_cannot_be_right_is_refused(values, words):
    with pytest.raises(InputError, match=words):
        make(Strait, values)


# ---- shear ------------------------------------------------------------------------------------


def test_the_pack_bears_a_shear_stress_and_moves_less_towards_the_floes_that_stand(sheared):
    profile = sheared["displacement"]
    seen = profile[np.isfinite(profile)]
    assert seen[0] == 0.0
    assert seen[-1] == pytest.approx(
        1.0, rel=1e-6
    )  # driven floes move with the speed that they are given
    lower, upper = np.array_split(seen, 2)
    assert lower.mean() < 0.6 * upper.mean()
    assert 0 < sheared["shear_stress"] < 20e3
    assert sheared["normal_stress_met"] == pytest.approx(20e3, rel=0.2)  # 18 to 21 kPa of six seeds


def test_the_inertia_number_is_of_the_height_between_the_held_floes_and_the_mean_diameter(sheared):
    height = sheared["wall_position"][480:].mean() - 2 * 16.0  # of 1200, the last 0.6
    assert sheared["shear_rate"] == pytest.approx(1.0 / height)
    low, high = 5.0, 8.0  # radii by r^-1.8
    radius = (high**0.2 - low**0.2) / 0.2 / ((low**-0.8 - high**-0.8) / 0.8)
    number = 2 * radius / height * np.sqrt(934.0 / 20e3)
    assert sheared["inertia_number"] == pytest.approx(number, rel=0.05)  # of 60 floes
    blocks = sheared["shear_stress_in_time"][480:].reshape(10, 72).mean(axis=1)
    error = np.sqrt(((blocks - blocks.mean()) ** 2).sum() / 9 / 10)
    assert sheared["shear_stress"] == pytest.approx(blocks.mean())
    assert sheared["shear_stress_error"] == pytest.approx(error)


def test_the_force_on_the_driven_floes_is_what_the_ledger_books_for_held_ones():
    """The pack between gains what the driven floes and those that stand give to it."""
    p = make(Shear, SMALL_SHEAR)
    cell = shear.consolidate(p, 1)
    model, dt, steps = cell.model, 0.05, 40
    model.advance(dt)
    booked = model.ledger.accounts["held floes and coast"][1]
    standing = shear.Cell(model, cell.standing, cell.driven, cell.length)
    total = 0.0
    for _ in range(steps):
        total -= dt * (shear.force_on(cell) + shear.force_on(standing))
        model.advance(dt)
    given = model.ledger.accounts["held floes and coast"][1] - booked
    assert given == pytest.approx(total, rel=0.1)


def test_the_books_of_the_shear_close(sheared):
    assert sheared["relative_residual"][:3].max() < 1e-10
    assert sheared["relative_residual"][3] < 1e-3
    ledger = sheared["ledger"]
    assert ledger[0] + ledger[1:-2].sum(axis=0) + ledger[-1] == pytest.approx(ledger[-2], rel=1e-9)


def test_too_few_floes_for_the_height_are_refused():
    with pytest.raises(InputError, match="more floes, or less height"):
        shear.member({"floes": 10}, 1)


# ---- strait -----------------------------------------------------------------------------------


def test_the_current_carries_the_same_water_through_each_section():
    p = make(Strait, {})
    domain = strait.geometry(p).domain
    grid = Grid.uniform(domain.x, domain.y, shape=(21, 42))
    u, v = (c.reshape(21, 42) for c in strait.current(p, grid))
    dx, dy = (domain.x[1] - domain.x[0]) / 42, (domain.y[1] - domain.y[0]) / 21
    through = v.sum(axis=1) * dx
    assert through == pytest.approx(np.full(21, -p.current * p.width / 1.5))
    assert np.abs(u).max() > 0 and 0.85 * p.current < np.hypot(u, v).max() <= p.current
    assert np.abs(u.sum() * dy) < 1e-6  # symmetric


def test_walls_bound_the_funnel_and_no_floe_starts_beyond_them():
    p = make(Strait, {})
    shape, coast = strait.geometry(p), strait.walls(p)
    f = coast.floes
    line = np.linspace(0, shape.domain.y[1] + 2e3, 400)
    edge = shape.half_width(line)
    gap = np.hypot(f.x[:, None] - edge, f.y[:, None] - line).min(axis=1)
    east = f.x > 0
    assert gap[east].max() == pytest.approx(
        p.wall_radius, rel=0.15
    )  # they touch the line from behind
    ice = strait.build(p, 1).floes
    moving = ~ice.land
    assert (np.abs(ice.x[moving]) < shape.half_width(ice.y[moving])).all()


def test_a_cohesive_strait_jams_and_its_transport_stays():
    r = strait.member({**SMALL_STRAIT, "friction": 0.0, "tensile_strength": 2e6, "hours": 6.0}, 1)
    assert (
        0 < r["flow_start"] <= r["jam_time"] == r["watched_until"] - 300.0
    )  # seen one exchange later
    after = r["transport"][r["time"] >= r["jam_time"]]
    assert len(after) > 3 and np.ptp(after) == 0.0 and after[0] > 0
    assert r["relative_residual"][0] < 1e-12


def test_a_strait_that_no_floe_can_enter_is_not_called_jammed():
    r = strait.member({**SMALL_STRAIT, "width": 900.0, "friction": 0.0}, 1)
    assert np.isnan(r["jam_time"]) and np.isnan(r["flow_start"])
    assert r["transport"].max() == 0.0
    assert r["watched_until"] == 2 * 3600.0  # it ran to its end all the same


# ---- the command ------------------------------------------------------------------------------


def test_the_command_sweeps_fits_and_goes_on_where_it_was(cli, tmp_path):
    line = (
        "strait --friction 0 --tensile-strength 0,2e6 --width 4000 --funnel 8000 --hours 3 --seeds 2 "
        "--jobs 1 --save s.nc"
    )
    done = cli(line)
    assert done.exit_code == 0, done.output
    assert "of 2 jammed" in done.output and "ledger, largest residual" in done.output
    with xr.open_dataset("s.nc") as data:
        assert data.jam_time.dims == ("tensile_strength", "seed")
        assert data.transport.dims == ("tensile_strength", "seed", "time")
        assert data.jam_time.attrs["units"] == "s" and data.transport.attrs["units"] == "kg"
        assert data.jamming_timescale_bounds.dims == ("tensile_strength", "bound")
        assert data.attrs["width"] == 4000.0 and data.attrs["friction"] == 0.0
        first = data.load()
    stamps = {path: path.stat().st_mtime_ns for path in Path("s.nc.members").glob("*.npz")}
    assert len(stamps) == 4
    again = cli(line.replace("--seeds 2", "--seeds 3"))
    assert again.exit_code == 0, again.output
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in stamps.items())
    with xr.open_dataset("s.nc") as data:
        assert data.sizes["seed"] == 3
        assert data.jam_time.sel(seed=[1, 2]).identical(first.jam_time)
    other = cli(line.replace("--hours 3", "--hours 2"))
    assert other.exit_code == 2 and "hours = 3.0 there, 2.0 here" in other.output


@pytest.mark.parametrize(
    "line, words",
    [
        ("strait --friction x", "must be a number"),
        ("strait --friction -1", "Strait.friction = -1.0: must be at least 0"),
        ("strait --width 5000,5000", "each value once"),
        ("shear --duration 10,20", "Shear.duration = (10.0, 20.0): must be one value"),
        ("strait --hours 2,3", "Strait.hours = (2.0, 3.0): must be one value"),
        ("strait --seeds 0", "--seeds"),
        ("strait --preset papr", "allowed"),
        ("shear --figure 7", "floebmi experiment strait"),
        ("strait --figure 7 --save seven.nc", "a figure is a .png"),
        ("strait --save no/where.nc", "there is no folder"),
        ("strait --figure 2 --width 5000,6000", "give one value"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(cli, line, words):
    done = cli(line)
    assert done.exit_code == 2, done.output
    said = [text for text in done.output.splitlines() if text]
    assert len(said) == 1 and words in said[0], done.output


def test_an_existing_file_of_something_else_is_left_alone(cli, tmp_path):
    Path("s.nc").write_text("precious")
    done = cli("strait --hours 2 --save s.nc")
    assert done.exit_code == 2 and "exists already" in done.output
    assert Path("s.nc").read_text() == "precious"


def test_shear_saves_stress_against_normal_stress_with_the_fit(cli):
    small = " ".join(f"--{k.replace('_', '-')} {v:g}" for k, v in SMALL_SHEAR.items())
    done = cli(f"shear {small} --duration 20 --normal-stress 1e4,4e4 --seeds 2 --jobs 1 --quiet")
    assert done.exit_code == 0 and done.output == ""
    with xr.open_dataset("shear.nc") as data:
        assert data.shear_stress.dims == ("normal_stress", "seed")
        assert data.shear_stress.attrs["units"] == "Pa"
        low, high = data.bulk_friction_bounds.values
        assert low < float(data.bulk_friction) < high
        assert set(data.bulk_cohesion_bounds.coords["bound"].values) == {"low", "high"}
        assert (data.inertia_number > 0).all()
        for draw in (figures._stresses, figures._profiles):
            draw({"frictional": data}).savefig("figure.png")


def test_a_figure_is_drawn_from_the_members_of_its_sweep(cli, monkeypatch):
    monkeypatch.setitem(figures.SWEEPS, 7, figures.SWEEPS[7]._replace(values=(0.0, 2e6)))
    done = cli(
        "strait --figure 7 --width 4000 --funnel 8000 --hours 3 --seeds 2 --jobs 1 --save f7.png"
    )
    assert done.exit_code == 0, done.output
    assert Path("f7.png").stat().st_size > 20e3
    with xr.open_dataset("figure-7-cohesive.nc") as data:
        assert data.tensile_strength.values.tolist() == [0.0, 2e6]


# ---- the example ------------------------------------------------------------------------------


def paper():
    path = Path(__file__).parents[1] / "examples" / "paper.py"
    spec = importlib.util.spec_from_file_location("paper", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def drawn(pictures):
    return all(path.stat().st_size > 15e3 for path in pictures)


def test_the_example_draws_the_set_ups(tmp_path):
    assert drawn(paper().main(tmp_path, seeds=1, jobs=1, numbers=(1, 2), quick=True))


@pytest.mark.long
def test_the_example_draws_all_figures(tmp_path):
    assert drawn(paper().main(tmp_path, seeds=2, jobs=1, quick=True))


@pytest.mark.long
def test_a_frictional_pack_has_the_strength_that_the_paper_reports(tmp_path):
    values = {"normal_stress": (10e3, 40e3, 80e3)}
    made = campaign.run(Shear, values, (1, 2), tmp_path / "shear.nc")
    assert 0.2 < float(made.data.bulk_friction) < 0.3
    assert (made.data.inertia_number < 1.2e-2).all()


@pytest.mark.long
def test_without_friction_and_strength_no_strait_jams_and_a_strong_one_always_does(tmp_path):
    values = {"friction": (0.0,), "tensile_strength": (0.0, 400e3)}
    made = campaign.run(Strait, values, range(1, 11), tmp_path / "strait.nc")
    through = made.data.transport.isel(time=-1) > 0  # strong ice may bridge it before a floe is out
    flows = through & made.data.jam_time.isnull()
    assert flows.sum("seed").values.tolist() == [10, 0]
    assert float(made.data.jam_time.max()) < 8 * 3600.0
