"""The studies in tools/studies run from the command line, in their short form."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hopbench_bench import hopbench_binary

STUDIES = Path(__file__).parents[2] / "tools" / "studies"


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """An interpreter with what the studies need, apart from that of the tests."""
    venv = tmp_path_factory.mktemp("studies") / "venv"
    subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    program = venv / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    requirements = STUDIES / "requirements.txt"
    subprocess.run([program, "-m", "pip", "install", "--quiet", "--requirement", requirements], check=True)
    return program


@pytest.mark.long
@pytest.mark.parametrize(
    "study, shown",
    [("timestep_and_model.py", "| paper mode | 20 |"), ("couplings.py", "**hover**"), ("static_fire.py", "| 100 | ")],
)
def test_a_study_runs_in_its_short_form(python, study, shown):
    environment = {**os.environ, "HOPBENCH": str(hopbench_binary())}
    done = subprocess.run(
        [python, STUDIES / study, "--short"], capture_output=True, text=True, env=environment, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert shown in done.stdout
