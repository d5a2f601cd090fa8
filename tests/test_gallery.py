"""Each script of the gallery is short, runs, draws, and measures what it did before.

The number is `measured`, the pictures are the matplotlib figures that the script leaves behind.
"""

import re
import runpy
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

GALLERY = Path(__file__).parents[1] / "examples" / "gallery"
LONGEST = 40  # lines

# (what it measured, relative tolerance): tight where theory gives the number, wider where a pack is chaotic
# and another processor may round otherwise
QUICK = {
    "two_floes": (0.448, 1e-2),  # °/s
    "size_distribution": (-1.8, 3e-2),  # the law's exponent
}
LONG = {
    "hexagonal_pack": (20.0, 1e-3),  # kPa, the wall's
    "principal_stress": (20.0, 5e-2),  # kPa, the wall's
    "shear": (0.31, 0.15),
    "strait": ({"friction 0.3": 27.6, "bonds of 400 kPa": 0.0}, 0.5),  # Mt, mean of eight that differ by 14
    "labrador_sea": (7.68, 2e-2),  # cm/s
    "drift_29_days": (0.58, 0.5),  # km, of a track of 440 km
    "accuracy_cost": (0.068, 0.3),
    "landlab_eddy": (0.6 * 19**2, 2e-3),  # km²: all the ice that was asked for
    "nares_strait": ({"friction 0.1": 690.0, "bonds of 200 kPa": 0.0}, 0.15),  # km² on the second day
    "barents_miz": (  # km along y
        {"the start": -1235, "wind off the ice": -1239, "wind towards the ice": -1176}, 5e-3,
    ),
    "veros_box": (-4.2, 0.1),  # cm/s
}  # fmt: skip
HOSTS = {"landlab_eddy": "landlab", "veros_box": "veros"}
BARENTS = "arctic20_ocean_ice_20160201-05.nc"


def check(name, expected, tolerance):
    script = GALLERY / f"{name}.py"
    assert len(script.read_text(encoding="utf-8").splitlines()) <= LONGEST
    left = runpy.run_path(str(script))
    assert left["measured"] == pytest.approx(expected, rel=tolerance)
    figures = [one for one in left.values() if isinstance(one, Figure)]
    assert figures
    for figure in figures:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        assert np.ptp(np.asarray(canvas.buffer_rgba())[:, :, :3]) > 100
        for axes in figure.axes:
            for line in axes.lines:  # C0, C1 … would be the reader's colours, not floebmi's
                assert not re.match(r"C\d", str(line.get_color()))
            if axes.get_xlabel():
                assert "[" in axes.get_xlabel() and "[" in axes.get_ylabel()


def test_every_script_of_the_gallery_has_its_number():
    assert {path.stem for path in GALLERY.glob("*.py")} == {*QUICK, *LONG, "ledger"}


@pytest.mark.parametrize("name", QUICK)
def test_a_quick_script_of_the_gallery_gives_its_number(name):
    check(name, *QUICK[name])


def test_a_script_that_reads_a_file_says_which_if_it_gets_none(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["barents_miz"])
    with pytest.raises(SystemExit, match=f"^give it {BARENTS}$"):
        runpy.run_path(str(GALLERY / "barents_miz.py"))


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:ice not placed", "ignore:.*set to the bound")
@pytest.mark.parametrize("name", LONG)
def test_a_script_of_the_gallery_gives_its_number(name, monkeypatch):
    if name in HOSTS and find_spec(HOSTS[name]) is None:
        pytest.skip(f"needs {HOSTS[name]}")
    if name == "barents_miz":
        path = GALLERY.parents[2] / "shared" / "data" / BARENTS
        if not path.exists():
            pytest.skip(f"needs {path.name}")
        monkeypatch.setattr(sys, "argv", [name, str(path)])
    check(name, *LONG[name])


@pytest.mark.long
def test_the_ledger_of_the_gallery_leaves_little_energy_unexplained():
    assert runpy.run_path(str(GALLERY / "ledger.py"))["measured"] < 2e-4
