"""Fixtures and the one condition of all tests: the program is there."""

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from hopbench_bench import Bench, hopbench_binary  # noqa: E402


def pytest_configure(config):
    config.addinivalue_line("markers", "long: evidence that takes longer than CI has; `cargo xtask long` runs it")
    config.addinivalue_line("markers", "alone: holds a peer to the clock, or the machine's network; runs after the others, one at a time")
    try:
        binary = hopbench_binary()
    except FileNotFoundError as missing:
        pytest.exit(str(missing), returncode=2)
    if not os.access(binary, os.X_OK):
        pytest.exit(f"{binary} is not executable", returncode=2)


@pytest.fixture
def bench():
    """Makes benches that end with the test: `bench("hover_5m", fc="serial")`."""
    started = []

    def start(*arguments, **options):
        run = Bench(*arguments, **options)
        started.append(run)
        return run.__enter__()

    yield start
    for run in started:
        run.close()
