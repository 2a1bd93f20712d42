"""What both studies share: a flight of the release program as columns, tables as Markdown, plots of one style."""

import csv
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "studies"


def program():
    """The release binary, or what HOPBENCH names."""
    path = Path(os.environ.get("HOPBENCH", ROOT / "target" / "release" / "hopbench"))
    if not path.exists():
        sys.exit(f"{path} is missing: cargo build --release -p hopbench-hil")
    return path


class Flight:
    """Columns of `fly --csv` and the report of `fly --json`."""

    def __init__(self, columns, report):
        self.columns, self.report = columns, report

    def __getitem__(self, name):
        return self.columns[name]

    @property
    def time(self):
        return self.columns["time_s"]

    def position(self):
        return np.column_stack([self[name] for name in ("north_m", "east_m", "down_m")])

    def velocity(self):
        return np.column_stack([self[name] for name in ("vn_m_s", "ve_m_s", "vd_m_s")])

    def rate(self):
        return np.column_stack([self[name] for name in ("p_rad_s", "q_rad_s", "r_rad_s")])

    def quaternion(self):
        return np.column_stack([self[name] for name in ("qw", "qx", "qy", "qz")])

    def axis(self):
        """The long axis in the world."""
        w, x, y, z = self.quaternion().T
        return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])

    def phases(self):
        """Start and end of the flight's phases (s), by name."""
        events = self.report["events"]
        start = {event["name"].removeprefix("phase:"): event["time_s"] for event in events}
        touch = start.get("touchdown", self.time[-1])
        return {
            "ascent": (start["liftoff"], start["hover"]),
            "hover": (start["hover"], start["descent"]),
            "descent": (start["descent"], touch),
        }


# What the closed-loop sections were flown with: loops whose gains do not know the model that is being changed.
CASCADED = {"mission.control": "cascaded", "mission.guidance": "ramps"}


def fly(scenario, settings=None, commands=None, rate_hz=50, seed=None):
    """Flies a scenario with values replaced. `commands` is the text of a schedule; without it the cascaded controller flies."""
    if commands is None:
        settings = CASCADED | (settings or {})
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "flight.csv"
        arguments = [program(), "fly", ROOT / "scenarios" / f"{scenario}.toml", "--json"]
        arguments += ["--csv", table, "--csv-rate", str(rate_hz)]
        for key, value in (settings or {}).items():
            arguments += ["--set", f"{key}={toml(value)}"]
        if seed is not None:
            arguments += ["--seed", str(seed)]
        if commands is not None:
            schedule = Path(folder) / "commands.csv"
            schedule.write_text(commands)
            arguments += ["--commands", schedule]
        done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
        if done.returncode not in (0, 1):
            raise RuntimeError(f"{' '.join(map(str, arguments))}\n{done.stderr}")
        with table.open() as file:
            rows = csv.reader(file)
            names = next(rows)
            values = np.array([[float(x) for x in row] for row in rows])
    return Flight(dict(zip(names, values.T)), json.loads(done.stdout))


def toml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(v)}" for key, v in value.items()) + "}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(toml(v) for v in value) + "]"
    return repr(float(value)) if isinstance(value, float) else str(value)


def schedule(rows, columns):
    """Text of a command schedule from rows of numbers."""
    lines = [",".join(["time_s", *columns])]
    lines += [",".join([f"{row[0]:.6f}", *(f"{x:.9g}" for x in row[1:])]) for row in rows]
    return "\n".join(lines) + "\n"


def apart(a, b):
    """Differences of two flights at equal times: position m, velocity m/s, attitude deg, rate deg/s, and columns."""
    common, i, j = np.intersect1d(np.round(a.time, 6), np.round(b.time, 6), return_indices=True)
    dot = np.abs(np.sum(a.quaternion()[i] * b.quaternion()[j], axis=1))
    # From the vector part: the cosine has no digits left for small angles.
    chord = np.minimum(
        np.linalg.norm(a.quaternion()[i] - b.quaternion()[j], axis=1),
        np.linalg.norm(a.quaternion()[i] + b.quaternion()[j], axis=1),
    )
    angle = np.where(dot > 0.9, 4.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)), 2.0 * np.arccos(np.minimum(dot, 1.0)))
    column = lambda name: np.abs(a[name][i] - b[name][j])
    return {
        "time": common,
        "position": np.linalg.norm(a.position()[i] - b.position()[j], axis=1),
        "velocity": np.linalg.norm(a.velocity()[i] - b.velocity()[j], axis=1),
        "attitude": np.degrees(angle),
        "tilt": np.degrees(np.arccos(np.clip(np.sum(a.axis()[i] * b.axis()[j], axis=1), -1.0, 1.0))),
        "rate": np.degrees(np.linalg.norm(a.rate()[i] - b.rate()[j], axis=1)),
        "mass": column("mass_kg"),
        "com": column("com_z_m"),
        "ixx": column("ixx_kg_m2"),
        "thrust": column("thrust_n"),
        "slosh": np.hypot(column("slosh_x_m"), column("slosh_y_m")),
    }


def number(x, digits=2):
    """A number as a table shows it: `digits` that count, powers of ten where they are needed."""
    if x is None or (isinstance(x, float) and math.isnan(x)):
        return "-"
    if x == 0:
        return "0"
    if not math.isfinite(x):
        return "diverges"
    size = math.floor(math.log10(abs(x)))
    if -3 <= size < 5:
        return f"{x:.{max(digits - 1 - size, 0)}f}"
    return f"{x:.{digits - 1}e}"


def markdown(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def say(text):
    print(text, flush=True)


def figure(rows, columns, height=2.3):
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update(
        {
            "font.size": 9,
            "axes.grid": True,
            "grid.alpha": 0.3,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "svg.hashsalt": "hopbench",
            "svg.fonttype": "none",
            "path.simplify": True,
            "path.simplify_threshold": 0.2,
            "legend.frameon": False,
        }
    )
    import matplotlib.pyplot as plt

    return plt.subplots(rows, columns, figsize=(9.0, height * rows), constrained_layout=True)


def save(figure_, name):
    PICTURES.mkdir(parents=True, exist_ok=True)
    path = PICTURES / f"{name}.svg"
    figure_.savefig(path, metadata={"Date": None})
    # Trailing blanks that matplotlib writes are no part of the picture.
    path.write_text("\n".join(line.rstrip() for line in path.read_text().splitlines()) + "\n")
    say(f"wrote {path.relative_to(ROOT)}, {path.stat().st_size // 1000} kB")
