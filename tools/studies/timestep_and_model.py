#!/usr/bin/env python3
"""Study of step and model: the seed paper's scheme, the full model, and the converged solution of the same motion.

    cargo build --release -p hopbench-hil
    python3 -m venv venv && venv/bin/pip install -r tools/studies/requirements.txt
    venv/bin/python tools/studies/timestep_and_model.py            # tables on stdout, pictures in docs/studies
    venv/bin/python tools/studies/timestep_and_model.py --short    # two seconds of motion, no pictures: a smoke test

The motion is that of scenarios/open_loop_a: 8 s of free flight from full tanks with throttle steps, gimbal doublets and
roll pulses, ideal actuators. Its rows are moved to the next multiple of 0.02 s, so that no scheme sees a command
late. The full model is driven by the valve; paper mode, whose engine has other valve angles, by the thrust that the
full engine gives after each row. The longer motion is the same once more with the gimbal reversed.
"""

import argparse
import csv
import math

import numpy as np

from study import ROOT, apart, figure, fly, markdown, number, save, say, schedule

XI, G = 1.8411837813406594, 9.80665
COLUMNS = ["thrust_n", "gimbal_x_deg", "gimbal_y_deg", "rcs_roll"]
CONVERGED_S = 0.00025
PAPER = {"fidelity": "paper"}
CONSISTENT = {**PAPER, "vehicle.paper_mode.specific_impulse_efficiency": 0.8928}
DRY = {"vehicle.slosh.paper_mass_fraction": 0.0}  # no slosh force in paper mode
EULER = {"physics.integrator": "euler"}


def commands(duration_s):
    """The schedule of run a on the 0.02 s grid, as valve angles and as thrusts."""
    path = ROOT / "scenarios" / "open_loop_a.csv"
    rows = [row for row in csv.DictReader(line for line in path.open() if not line.startswith("#"))]
    at = lambda row: math.ceil(round(float(row["time_s"]) / 0.02, 6)) * 0.02
    valve = [
        [at(row), *(float(row[name]) for name in ("valve_deg", "gimbal_x_deg", "gimbal_y_deg", "rcs_roll"))]
        for row in rows
    ]
    valve += [[row[0] + 8.0, row[1], -row[2], -row[3], row[4]] for row in valve]
    valve = [row for row in valve if row[0] < duration_s]
    valve_text = schedule(valve, ["valve_deg", *COLUMNS[1:]])
    flown = fly("open_loop_a", {"duration_s": duration_s}, valve_text, 100)
    thrust = []
    for row in valve:
        n = flown["thrust_n"][np.searchsorted(flown.time, row[0] + 0.015)]
        thrust.append([row[0], round(n, 1), *row[2:]])
    return {"full": valve_text, "paper": schedule(thrust, COLUMNS)}


def run(texts, duration_s, step_s, settings, rate_hz=50):
    paper = settings.get("fidelity") == "paper"
    keys = {"duration_s": duration_s, **settings}
    if paper:
        keys["vehicle.paper_mode.step_s"] = step_s
    else:
        keys["physics.step_s"] = step_s
    return fly("open_loop_a", keys, texts["paper" if paper else "full"], rate_hz)


SCHEMES = [
    ("full, RK4", 0.001, {}),
    ("full, RK4", 0.005, {}),
    ("full, RK4", 0.01, {}),
    ("full, RK4", 0.02, {}),
    ("full, Euler", 0.001, EULER),
    ("full, Euler", 0.005, EULER),
    ("full, Euler", 0.01, EULER),
    ("full, Euler", 0.02, EULER),
    ("full, Euler, liquid frozen", 0.02, {**EULER, "physics.freeze": ["slosh"]}),
    ("full, RK4, liquid frozen", 0.001, {"physics.freeze": ["slosh"]}),
    ("paper mode", 0.02, PAPER),
    ("paper mode, no slosh force", 0.02, {**PAPER, **DRY}),
    ("paper mode, no slosh force", 0.001, {**PAPER, **DRY}),
    ("paper mode, no slosh force, efficiency in Eq 10", 0.02, {**CONSISTENT, **DRY}),
    ("paper mode, no slosh force, efficiency in Eq 10", 0.001, {**CONSISTENT, **DRY}),
]


def compare(texts, duration_s, converged):
    rows, kept = [], {}
    for name, step_s, settings in SCHEMES:
        flight = run(texts, duration_s, step_s, settings)
        d = apart(flight, converged)
        kept[name, step_s] = (flight, d)
        worst = {key: float(np.max(value)) for key, value in d.items() if key != "time"}
        lost = worst["position"] > 1e3 or not np.isfinite(worst["position"]) or flight["time_s"][-1] < duration_s - 0.03
        cells = [
            worst["position"], worst["velocity"], worst["attitude"], 1e3 * worst["mass"], 1e3 * worst["com"],
            worst["ixx"], float(np.median(d["thrust"])), worst["thrust"], 1e3 * worst["slosh"],
        ]
        rows.append([name, f"{1e3 * step_s:g}", *(number(math.inf if lost else c) for c in cells)])
        say(f"  {name}, {1e3 * step_s:g} ms: {cells[0]:.2g} m, {cells[2]:.2g} deg")
    header = ["scheme", "step ms", "position m", "velocity m/s", "attitude deg", "mass g", "COM mm", "Ixx kg m2",
              "thrust N (median)", "(greatest)", "slosh mm"]
    return markdown(header, rows), kept


def engine_table():
    """What each engine needs for a thrust: full, the paper's print, the paper with the efficiency in Eq 10."""
    rows = []
    for thrust in (250, 300, 500, 700, 1000):
        text = schedule([[0.0, thrust, 0, 0, 0]], COLUMNS)
        keys = {"duration_s": 0.04, "physics.freeze": ["slosh"]}
        flown = [fly("open_loop_a", {**keys, **extra}, text, 50) for extra in ({}, PAPER, CONSISTENT)]
        full = flown[0]
        cells = [thrust]
        for name, scale, digits in (
            ("thrust_n", 1, 1), ("oxidizer_kg_s", 1e3, 1), ("chamber_pa", 1e-5, 2), ("injector_inlet_pa", 1e-5, 2), ("valve_deg", 1, 2),
        ):
            for flight in flown:
                if name == "thrust_n" and flight is full:
                    continue
                cells.append(f"{scale * flight[name][1]:.{digits}f}")
        ratio = [flight["oxidizer_kg_s"][1] / full["oxidizer_kg_s"][1] - 1 for flight in flown[1:]]
        cells += [f"{100 * r:+.1f} %" for r in ratio]
        rows.append(cells)
    header = ["T N", "paper T N", "eff. T N"]
    for what in ("mdot_o g/s", "Pc bar", "P2 bar", "valve deg"):
        header += [f"{what} full", "paper", "paper eff."]
    return markdown([*header, "flow, paper", "flow, paper eff."], rows)


RADIUS_M, DENSITY_KG_M3 = 0.095, 834.3181387


def slosh_frequency(flight):
    h = flight["nitrous_kg"] / (DENSITY_KG_M3 * math.pi * RADIUS_M**2)
    return np.sqrt(G * XI / RADIUS_M * np.tanh(XI * h / RADIUS_M))


def sloshing_liquid():
    """Mass of the first mode, which depends on the depth, beside the paper's constant fraction of the liquid."""
    rows = []
    for nitrous_kg in (13.47, 10.0, 7.0, 5.0, 3.0):
        h = nitrous_kg / (DENSITY_KG_M3 * math.pi * RADIUS_M**2)
        share = 2 * RADIUS_M * math.tanh(XI * h / RADIUS_M) / (XI * (XI * XI - 1) * h)
        rows.append([f"{nitrous_kg:g}", f"{share * nitrous_kg:.2f}", f"{100 * share:.1f}", "7.5", f"{share / 0.075:.2f}"])
    return markdown(["N2O kg", "first mode kg", "% of the liquid", "paper: m_frac/2 %", "ratio"], rows)


def paper_hop():
    """The autopilot's hop of 50 m on the paper's plant."""
    flight = fly("hop_50m", PAPER, seed=1)
    touch = flight.report["touchdown"]
    force = np.hypot(flight["slosh_force_x_n"], flight["slosh_force_y_n"])[flight.time < touch["time_s"]]
    return f"{flight.report['outcome']}, touchdown {touch['vertical_speed_m_s']:.2f} m/s, slosh force {np.median(force):.0f} N in the median, {np.max(force):.0f} N at most"


def growth(flight, step_s, start_s, end_s):
    """Growth of the amplitude a step: the slope of the logarithm of sqrt(x^2 + (x'/w)^2)."""
    t, x = flight.time, flight["slosh_y_m"]
    omega = slosh_frequency(flight)
    size = np.hypot(x, np.gradient(x, t) / omega)
    keep = (t >= start_s) & (t <= end_s) & (size > 1e-12)
    slope = np.polyfit(t[keep], np.log(size[keep]), 1)[0]
    return math.exp(slope * step_s) - 1


def euler_limit():
    """Growth a step of Euler's oscillator in paper mode (one way), against |1 + lambda dt|."""
    text = schedule([[0.0, 700, 0.05, 0, 0], [0.2, 700, -0.05, 0, 0], [0.4, 700, 0, 0, 0]], COLUMNS)
    texts, rows, points = {"paper": text}, [], []
    for step_s in (0.001, 0.002, 0.004, 0.005, 0.008, 0.01, 0.02):
        flight = run(texts, 2.4, step_s, PAPER, rate_hz=round(1 / step_s) if 1 / step_s <= 1000 else 1000)
        omega = float(np.mean(slosh_frequency(flight)))
        theory = math.sqrt(1 - 2 * 0.03 * omega * step_s + (omega * step_s) ** 2) - 1
        measured = growth(flight, step_s, 0.8, 2.2)
        points.append((step_s, measured, theory))
        per_second = (1 + theory) ** (1 / step_s)
        rows.append([f"{1e3 * step_s:g}", f"{100 * measured:+.3f}", f"{100 * theory:+.3f}", number(per_second)])
        limit = 2 * 0.03 / omega
    say(f"limit 2 zeta/omega = {1e3 * limit:.2f} ms at {omega:.2f} rad/s")
    header = ["step ms", "growth a step, flown %", "expected %", "factor a second"]
    return markdown(header, rows), points, limit


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="two seconds, no pictures")
    short = parser.parse_args().short
    duration_s = 2.0 if short else 8.0
    say("schedule")
    texts = commands(duration_s)
    say("converged solution")
    converged = run(texts, duration_s, 0.001 if short else CONVERGED_S, {})
    say("schemes")
    table, kept = compare(texts, duration_s, converged)
    say(f"\n### {duration_s:g} s of scripted motion, greatest difference to RK4 at {1e3 * CONVERGED_S} ms\n\n{table}\n")
    if short:
        return

    say("longer")
    long_texts = commands(16.0)
    long_converged = run(long_texts, 16.0, CONVERGED_S, {})
    long_table, long_kept = compare(long_texts, 16.0, long_converged)
    say(f"\n### The same and once more with the gimbal reversed, 16 s\n\n{long_table}\n")

    say("engine")
    say(f"\n### The engine at the first step\n\n{engine_table()}\n")
    say("Euler limit")
    limit_table, points, limit = euler_limit()
    say(f"\n### Euler and the slosh mode\n\n{limit_table}\n")
    say(f"paper mode at 20 ms, hop_50m: {paper_hop()}")
    say(f"\n### The sloshing liquid\n\n{sloshing_liquid()}\n")
    say(f"N^(1-n): {3**0.45:.2f} for 3 ports, {7**0.45:.2f} for 7; sqrt(T/W) at 1.6 m/s2 upward: {math.sqrt(1 + 1.6 / G):.3f}")

    # Differences against time.
    fig, axes = figure(3, 2)
    panels = [("position", "position, m", 1), ("attitude", "attitude, deg", 1), ("mass", "mass, g", 1e3),
              ("com", "centre of mass, mm", 1e3), ("ixx", "Ixx, kg m²", 1), ("thrust", "thrust, N", 1)]
    lines = [
        ("paper mode", 0.02, "C3", "paper mode, 20 ms"),
        ("paper mode, no slosh force, efficiency in Eq 10", 0.001, "C1", "its model alone: 1 ms, efficiency in Eq 10, no slosh"),
        ("full, Euler, liquid frozen", 0.02, "C0", "full model, Euler 20 ms, liquid frozen"),
        ("full, RK4", 0.005, "C2", "full model, RK4 5 ms"),
    ]
    for axis, (key, label, scale) in zip(axes.flat, panels):
        for name, step_s, colour, legend in lines:
            flight, d = long_kept[name, step_s]
            axis.semilogy(d["time"], np.maximum(scale * d[key], 1e-12), colour, lw=1.0, label=legend)
        axis.set_ylabel(label)
        axis.set_ylim(bottom=1e-10 * (1 if scale == 1 else 10))
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncol=2)
    save(fig, "timestep_and_model")

    # The Euler limit.
    fig, (left, right) = figure(1, 2, height=3.2)
    steps = np.linspace(0.0005, 0.021, 100)
    omega = 2 * 0.03 / limit
    left.plot(1e3 * steps, 100 * (np.sqrt(1 - 0.06 * omega * steps + (omega * steps) ** 2) - 1), "k", lw=1, label="|1 + λ dt| - 1")
    left.plot([1e3 * p[0] for p in points], [100 * p[1] for p in points], "C3o", ms=4, label="flown, paper mode")
    left.axvline(1e3 * limit, color="C2", ls="--", lw=1, label=f"2ζ/ω = {1e3 * limit:.1f} ms")
    left.axhline(0, color="k", lw=0.5)
    left.set_xlabel("step, ms")
    left.set_ylabel("growth of the slosh a step, %")
    left.legend()
    for name, step_s, colour, legend in (
        ("paper mode", 0.02, "C3", "paper mode, 20 ms"),
        ("full, Euler", 0.01, "C1", "full, Euler 10 ms"),
        ("full, Euler", 0.005, "C0", "full, Euler 5 ms"),
        ("full, RK4", 0.005, "C2", "full, RK4 5 ms"),
    ):
        flight, _ = kept[name, step_s]
        right.semilogy(flight.time, 1e3 * np.hypot(flight["slosh_x_m"], flight["slosh_y_m"]) + 1e-4, colour, lw=1, label=legend)
    right.axhline(0.9 * 95, color="k", lw=0.5, ls=":")
    right.text(0.1, 0.9 * 95 * 1.15, "stop, 0.9 of the radius", fontsize=8)
    right.set_ylim(1e-3, 400)
    right.set_xlabel("time, s")
    right.set_ylabel("slosh displacement, mm")
    right.legend(loc="lower right", fontsize=8)
    save(fig, "euler_limit")


if __name__ == "__main__":
    main()
