#!/usr/bin/env python3
"""Static fires at 15, 50 and 100 % of the valve's travel beside the figures published of the recordings.

    cargo build --release
    python3 -m venv venv && venv/bin/pip install -r tools/studies/requirements-static-fire.txt
    venv/bin/python tools/studies/static_fire.py

writes docs/static_fire.svg and prints the figures of docs/static_fire.md. Flies with `hopbench fly --csv`.
"""

import csv
import subprocess
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams.update({"svg.hashsalt": "hopbench", "font.family": "sans-serif", "font.size": 10})
import matplotlib.pyplot as plt  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
KILOGRAM_FORCE = 9.80665  # N; the recordings carry no unit, kgf is the only plausible one
VALVE_S = 2.5  # the valve opens, by the schedules
UNCOVERED_KG = 0.08  # the outlet begins to draw gas, by the scenarios
# Published of the recordings, in their own unit, at seconds after the rise began: rise, start of the plateau,
# end of it, spike at depletion. The times of the last two are published at 100 % only; at 50 and 15 % they
# are placed at ours.
PUBLISHED = {
    100: [(0.0, 0.0), (0.56, 142.5), (2.06, 168.0), (2.2, 194.5)],
    50: [(0.0, 0.0), (0.52, 117.0), (2.3, 139.0), (2.45, 177.7)],
    15: [(0.0, 0.0), (0.69, 70.2), (4.0, 60.0), (4.2, 68.7)],
}
COLOURS = {15: "#7a5195", 50: "#ef8a17", 100: "#005a9c"}


def fly(percent):
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "state.csv"
        scenario = ROOT / "scenarios" / f"static_fire_{percent}.toml"
        program = ROOT / "target" / "release" / "hopbench"
        subprocess.run([program, "fly", scenario, "--csv", table], check=True, stdout=subprocess.DEVNULL)
        rows = list(csv.DictReader(table.open()))
    return [float(r["time_s"]) for r in rows], [float(r["thrust_n"]) for r in rows], [float(r["oxidizer_kg_s"]) for r in rows], [
        float(r["nitrous_kg"]) for r in rows
    ]


def main():
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), sharey=True, constrained_layout=True)
    figures = {}
    for percent in (15, 50, 100):
        time, thrust, flow, nitrous = fly(percent)
        depleted = next(t for t, m in zip(time, nitrous) if m <= UNCOVERED_KG)
        plateau = [f for t, f in zip(time, thrust) if 3.7 <= t < depleted - 0.05]
        flows = [f for t, f in zip(time, flow) if 3.7 <= t < depleted - 0.05]
        start = sum(plateau[:10]) / 10
        rise = next(t for t, f in zip(time, thrust) if f >= 0.9 * start) - next(t for t, f in zip(time, thrust) if f >= 0.1 * start)
        end = plateau[-20:]
        end = sum(end) / len(end)
        after = [(t - depleted, f) for t, f in zip(time, thrust) if t > depleted - 0.05]
        spike = max(f for _, f in after) / end - 1.0
        tail = next(f for t, f in after if t >= 2.0) / end
        figures[percent] = (start, sum(plateau) / len(plateau), rise, sum(flows) / len(flows), depleted - VALVE_S, spike, tail)
        left.plot([t - VALVE_S for t in time], thrust, color=COLOURS[percent], lw=1.8, label=f"{percent} %")
        times, values = zip(*PUBLISHED[percent])
        right.plot(times, [KILOGRAM_FORCE * v for v in values], color=COLOURS[percent], lw=1.8, marker="o", ms=4, label=f"{percent} %")
    left.set(title="Hopbench", xlabel="time since the valve opens (s)", ylabel="thrust (N)", xlim=(-0.5, 8))
    right.set(title="published figures, if kgf, joined by lines", xlabel="time since the rise begins (s)", xlim=(-0.5, 8))
    for axes in (left, right):
        axes.grid(color="#dee2e7", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(title="valve", frameon=False)
    figure.savefig(ROOT / "docs" / "static_fire.svg", metadata={"Date": None})
    top = figures[100]
    print("valve  start N  ratio   mean N  ratio  rise s  flow kg/s  ratio  burn s  spike  after 2 s")
    for percent, (start, mean, rise, flow, burn, spike, tail) in figures.items():
        print(f"{percent:4d} % {start:8.1f} {start / top[0]:6.3f} {mean:8.1f} {mean / top[1]:6.3f} {rise:7.3f} {flow:10.4f} {flow / top[3]:6.3f} {burn:7.2f} {spike:+6.3f} {tail:6.3f}")


if __name__ == "__main__":
    main()
