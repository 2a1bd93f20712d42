#!/usr/bin/env python3
"""Static fires at 15, 50 and 100 % of the valve's travel beside the figures published of the recordings.

    cargo build --release -p hopbench-hil
    python3 -m venv venv && venv/bin/pip install -r tools/studies/requirements.txt
    venv/bin/python tools/studies/static_fire.py

writes docs/static_fire.svg and prints the figures of docs/static_fire.md. The same figures are held by
static_fires_have_the_shape_that_is_written_down in tests/reference_vehicles.rs.
"""

import argparse

import matplotlib
import numpy as np

from study import ROOT, fly, markdown, say, schedule

matplotlib.use("svg")
matplotlib.rcParams.update({"svg.hashsalt": "hopbench", "font.family": "sans-serif", "font.size": 10})
import matplotlib.pyplot as plt  # noqa: E402

KILOGRAM_FORCE = 9.80665  # N; the recordings carry no unit, kgf is the only plausible one
VALVE_S = 2.5  # the valve opens, by the schedules
# Published of the recordings, in their own unit, at seconds after the rise began: rise, start of the plateau,
# end of it, spike at depletion. The times of the last two are published at 100 % only; at 50 and 15 % they
# are placed at ours.
PUBLISHED = {
    100: [(0.0, 0.0), (0.56, 142.5), (2.06, 168.0), (2.2, 194.5)],
    50: [(0.0, 0.0), (0.52, 117.0), (2.3, 139.0), (2.45, 177.7)],
    15: [(0.0, 0.0), (0.69, 70.2), (4.0, 60.0), (4.2, 68.7)],
}
COLOURS = {15: "#7a5195", 50: "#ef8a17", 100: "#005a9c"}


NO_FIRE = [[0.0, 0.0, 0], [VALVE_S, 90.0, 0], [VALVE_S + 10.0, 0.0, 0]]


def figures_of(flight):
    """The recording's measures (the test has the same): plateau from 1.2 s after the valve to the liquid's end."""
    time, thrust = flight.time, flight["thrust_n"]
    depleted = next(event["time_s"] for event in flight.report["events"] if event["name"] == "nitrous_depleted")
    mean = lambda column, start, end: float(np.mean(column[(time >= start - 1e-9) & (time < end - 1e-9)]))
    start, end = mean(thrust, 3.7, 3.8), mean(thrust, depleted - 0.25, depleted - 0.05)
    first = lambda share: time[np.argmax(thrust >= share * start)]
    return {
        "start": start, "end": end,
        "mean": mean(thrust, 3.7, depleted - 0.05), "flow": mean(flight["oxidizer_kg_s"], 3.7, depleted - 0.05),
        "rise": first(0.9) - first(0.1), "burn": depleted - VALVE_S,
        "spike": np.max(thrust[time > depleted - 0.05]) / end - 1.0,
        "tail": mean(thrust, depleted + 2.0, depleted + 2.1) / end,
        # The schedule shuts the valve 10 s after it opened at 100 and 50 %.
        "of": mean(flight["oxidizer_kg_s"], 3.7, 3.8) / mean(flight["fuel_kg_s"], 3.7, 3.8) if "fuel_kg_s" in flight.columns else 0.0,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="one fire, no picture: a smoke test")
    short = parser.parse_args().short

    fires = {percent: fly(f"static_fire_{percent}", rate_hz=1000) for percent in ([100] if short else [15, 50, 100])}
    found = {percent: figures_of(flight) for percent, flight in fires.items()}
    top = found[100]
    rows = [
        [f"{percent}", f"{f['start']:.1f}", f"{f['start'] / top['start']:.3f}", f"{f['mean']:.1f}", f"{f['mean'] / top['mean']:.3f}",
         f"{f['flow']:.4f}", f"{f['flow'] / top['flow']:.3f}", f"{f['rise']:.3f}", f"{100 * (f['end'] / f['start'] - 1):+.1f}",
         f"{f['burn']:.2f}", f"{100 * f['spike']:+.1f}", f"{100 * f['tail']:.1f}"]
        for percent, f in found.items()
    ]
    header = ["valve %", "start N", "ratio", "mean N", "ratio", "flow kg/s", "ratio", "rise s", "over the plateau %", "burn s", "spike %",
              "2 s later, % of the plateau's end"]
    say(markdown(header, rows))

    cold = fly("static_fire_100", {"duration_s": 3.8}, schedule(NO_FIRE, ["valve_deg", "igniter"]), 1000)
    say(f"\nnot lit at 100 %: {cold['thrust_n'][-1]:.1f} N, {cold['thrust_n'][-1] / top['start']:.3f} of lit, {cold['oxidizer_kg_s'][-1]:.3f} kg/s")
    if short:
        return
    at_once = [figures_of(fly(f"static_fire_{p}", {"vehicle.engine.ignition.igniter_delay_s": 0.0}, rate_hz=1000))["rise"] for p in fires]
    say("rise with a flame as soon as oxidiser flows: " + ", ".join(f"{rise:.2f} s" for rise in at_once))

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), sharey=True, constrained_layout=True)
    for percent, flight in fires.items():
        left.plot(flight.time[::10] - VALVE_S, flight["thrust_n"][::10], color=COLOURS[percent], lw=1.8, label=f"{percent} %")
        times, values = zip(*PUBLISHED[percent])
        right.plot(times, [KILOGRAM_FORCE * v for v in values], color=COLOURS[percent], lw=1.8, marker="o", ms=4, label=f"{percent} %")
    left.set(title="Hopbench", xlabel="time since the valve opens (s)", ylabel="thrust (N)", xlim=(-0.5, 8))
    right.set(title="published figures, if kgf, joined by lines", xlabel="time since the rise begins (s)", xlim=(-0.5, 8))
    for axes in (left, right):
        axes.grid(color="#dee2e7", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(title="valve", frameon=False)
    figure.savefig(ROOT / "docs" / "static_fire.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
