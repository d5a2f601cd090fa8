"""The README's script and commands are true."""

import os
import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_readmes_script_runs_and_conserves(tmp_path):
    script = re.search(r"```python\n(.*?)```", README.read_text(), re.S).group(1)
    assert len(script.splitlines()) <= 20
    check = (
        "\nassert model.ledger.balance('momentum_x').relative < 1e-12"
        "\nassert 0.5 < float(ice.sea_ice_area_fraction[-1].mean()) < 0.7"
    )
    prelude = "import matplotlib\nmatplotlib.use('Agg')\n"
    done = subprocess.run(
        [sys.executable, "-c", prelude + script + check],
        cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(README.parent)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "residual" in done.stdout
    assert {path.name for path in tmp_path.glob("*.nc")} >= {"ice.nc", "floes.nc"}


def test_the_files_that_the_readme_points_to_exist():
    for target in re.findall(r"\]\(([^)#:]+)\)", README.read_text()):
        assert (README.parent / target).exists(), target
