#!/usr/bin/env python3
"""Study of the couplings: what moves the mass properties, and which coupling matters when, by how much.

    cargo build --release -p hopbench-hil
    python3 -m venv venv && venv/bin/pip install -r tools/studies/requirements.txt
    venv/bin/python tools/studies/couplings.py            # tables on stdout, pictures in docs/studies
    venv/bin/python tools/studies/couplings.py --short    # one flight and one level, no pictures: a smoke test

Sensitivity: free flight under schedules (scenarios/open_loop_a without its own). Open loop: the hop of 50 m is flown by
the autopilot once, with a sidestep of 12 m north and 8 m west; each phase is then flown again from its first state under
the commands as the actuators realised them, with one coupling held at its value at the start of the phase. Closed loop: the
autopilot flies the same hop with gusts, one coupling held at its value on the pad, and with its own knowledge of
the mass properties held instead.
"""

import argparse
import math

import numpy as np

from study import apart, figure, fly, markdown, number, save, say, schedule

COLUMNS = ["thrust_n", "gimbal_x_deg", "gimbal_y_deg", "rcs_roll"]
COUPLINGS = ["com", "inertia", "port", "nitrogen", "slosh", "throat"]
NAMES = {
    "com": "centre of mass", "inertia": "inertia", "port": "port growth", "nitrogen": "nitrogen to the run tank",
    "slosh": "slosh", "throat": "throat wear", "all": "all six", "told": "controller told lift-off values",
}
SIDESTEP = {"mission.target_north_east_m": [12.0, -8.0]}


# ------------------------------------------------------------------------------------------------ sensitivity


def level_flight(thrust_n, duration_s, extra=None):
    """Constant thrust, level."""
    return fly("open_loop_a", {"duration_s": duration_s, **(extra or {})}, schedule([[0.0, thrust_n, 0, 0, 0]], COLUMNS))


def change(flight, name, scale=1.0):
    return scale * (flight[name][-1] - flight[name][0])


def flow_levels(levels):
    rows, flights = [], []
    for thrust in levels:
        flight = level_flight(float(thrust), 10.0)
        flights.append((thrust, flight))
        used = flight["nitrous_kg"][0] - flight["nitrous_kg"][-1]
        rows.append([
            thrust, number(1e3 * np.mean(flight["oxidizer_kg_s"]), 3), number(change(flight, "mass_kg") / 10, 3),
            number(change(flight, "com_z_m", 1e3) / 10, 3), number(change(flight, "com_z_m", 1e3) / used, 3),
            number(change(flight, "ixx_kg_m2") / 10, 3), number(change(flight, "izz_kg_m2", 1e3) / 10, 3),
            number(100 * change(flight, "fuel_kg") / change(flight, "mass_kg"), 3),
        ])
        say(f"  {thrust} N")
    header = ["thrust N", "oxidiser g/s", "mass kg/s", "COM mm/s", "COM mm per kg N2O", "Ixx kg m2/s", "Izz g m2/s", "fuel, % of the mass lost"]
    return markdown(header, rows), flights


# The same mean thrust of 700 N in 10 s: seconds and newtons.
SHAPES = {
    "constant": [(0, 700)],
    "step up": [(0, 400), (5, 1000)],
    "step down": [(0, 1000), (5, 400)],
    "square, 1 Hz": [(0.5 * k, 1000 if k % 2 == 0 else 400) for k in range(20)],
    "ramp up": [(0.1 * k, 400 + 6 * (k + 0.5)) for k in range(100)],
    "ramp down": [(0.1 * k, 1000 - 6 * (k + 0.5)) for k in range(100)],
}


def throttle_shapes():
    """The same mean thrust of 700 N in 10 s, in six shapes."""
    rows, base = [], None
    for name, points in SHAPES.items():
        text = schedule([[t, n, 0, 0, 0] for t, n in points], COLUMNS)
        flight = fly("open_loop_a", {"duration_s": 10.0}, text)
        end = {key: flight[key][-1] for key in ("mass_kg", "com_z_m", "ixx_kg_m2", "port_radius_m", "fuel_kg", "nitrous_kg")}
        base = base or end
        rows.append([
            name, number(change(flight, "mass_kg"), 4), number(1e3 * (end["mass_kg"] - base["mass_kg"])),
            number(1e3 * (end["nitrous_kg"] - base["nitrous_kg"])), number(1e3 * (end["fuel_kg"] - base["fuel_kg"])),
            number(1e3 * (end["com_z_m"] - base["com_z_m"])), number(1e3 * (end["ixx_kg_m2"] - base["ixx_kg_m2"])),
        ])
    header = ["shape", "mass lost kg", "mass g", "N2O g", "fuel g", "COM mm", "Ixx g m2"]
    return markdown(header, rows)


def sine(frequency_hz, angle_deg, duration_s, nitrous_kg=None, extra=None):
    """A gimbal cosine, so that the body swings about a mean of nothing. Rows every 2 ms."""
    times = np.arange(0, duration_s, 0.002)
    rows = [[t, 700, angle_deg * math.cos(2 * math.pi * frequency_hz * t), 0, 0] for t in times]
    keys = {"duration_s": duration_s, **(extra or {})}
    if nitrous_kg is not None:
        keys["initial.nitrous_kg"] = nitrous_kg
    return fly("open_loop_a", keys, schedule(rows, COLUMNS), 200)


def step(angle_deg, nitrous_kg=None, extra=None):
    """A lateral step: the gimbal out for 0.3 s and back, at 700 N."""
    rows = [[0.0, 700, 0, 0, 0], [0.2, 700, angle_deg, 0, 0], [0.5, 700, 0, 0, 0]]
    keys = {"duration_s": 3.0, **(extra or {})}
    if nitrous_kg is not None:
        keys["initial.nitrous_kg"] = nitrous_kg
    return fly("open_loop_a", keys, schedule(rows, COLUMNS), 200)


ONE_WAY = {"vehicle.slosh.model": "one_way_paper"}


def lateral_acceleration(flight):
    """Greatest lateral acceleration of the pivot across the flight path (m/s²), as the schedule makes it."""
    t = flight.time
    return np.max(np.abs(np.gradient(flight["ve_m_s"], t)[2:-2]))


def sloshing_mass(flight):
    """Mass of the first mode (kg)."""
    r, xi = 0.095, 1.8411837813406594
    h = flight["nitrous_kg"] / (834.3181387 * math.pi * r * r)
    return flight["nitrous_kg"] * 2 * r * np.tanh(xi * h / r) / (xi * (xi * xi - 1) * h)


SIDE_N, SIDE_S = 12.0, 0.3  # the standard push aside: 1 deg of gimbal at 700 N


NO_AIR = {"vehicle.aero.drag_area_axial_m2": 0.0, "vehicle.aero.drag_area_lateral_m2": 0.0}


def pushed(thrust, start_s, duration_s, extra):
    """Flight under a thrust of (s, N) pairs with the standard push at `start_s`, the same force at any thrust; without air,
    which would push the longer the faster the flight."""
    times = sorted({round(float(t), 6) for t, _ in thrust} | {round(t, 6) for t in (start_s, start_s + SIDE_S)})
    rows = []
    for t in times:
        now = [n for at, n in thrust if at <= t + 1e-6][-1]
        side = SIDE_N if start_s <= t + 1e-6 < start_s + SIDE_S else 0.0
        rows.append([t, now, math.degrees(math.asin(side / now)), 0, 0])
    return fly("open_loop_a", {"duration_s": duration_s, **NO_AIR, **extra}, schedule(rows, COLUMNS), 200)


def slosh_levels(levels):
    """The standard push from full tanks, and on what 10 s of each thrust leave."""
    rows = []
    for thrust, before in levels:
        cells = [thrust]
        for nitrous in (before["nitrous_kg"][0], before["nitrous_kg"][-1]):
            keys = {"initial.nitrous_kg": float(nitrous)}
            two, one = (pushed([(0, thrust)], 0.1, 2.5, {**keys, **extra}) for extra in ({}, ONE_WAY))
            if len(cells) == 1:
                cells += [number(1e3 * two["oxidizer_kg_s"][10], 3), number(thrust / two["mass_kg"][10], 3)]
            cells += [number(nitrous, 3), number(1e3 * np.max(np.abs(two["slosh_y_m"])))]
            cells += [number(np.max(np.abs(flight["slosh_force_y_n"]))) for flight in (two, one)]
        rows.append(cells)
    after = ["N2O kg", "slosh mm", "force N", "one-way N"]
    return markdown(["thrust N", "oxidiser g/s", "axial m/s2", *after, *(f"{name}, after 10 s" for name in after)], rows)


def slosh_shapes():
    """The standard push at 5 s, as the shapes step, and what is left of it 3 to 5 s later."""
    # Twice the frequency of the liquid at 700 N: it swings out under one thrust and back under the other.
    shapes = {**SHAPES, "square, 4.4 Hz": [(k / 8.8, 1000 if k % 2 == 0 else 400) for k in range(88)]}
    rows = []
    for name, thrust in shapes.items():
        cells = []
        for extra in ({}, ONE_WAY):
            flight = pushed(thrust, 5.0, 10.0, extra)
            for start, end in ((5.0, 6.0), (8.0, 10.0)):
                inside = (flight.time >= start) & (flight.time <= end)
                cells += [1e3 * np.max(np.abs(flight["slosh_y_m"][inside])), np.max(np.abs(flight["slosh_force_y_n"][inside]))]
        rows.append([name, *(number(x) for x in cells)])
        say(f"  {name}")
    header = ["slosh mm, 5 to 6 s", "force N", "slosh mm, 8 to 10 s", "force N"]
    return markdown(["shape", *header, *(f"one-way {name}" for name in header)], rows)


def slosh_response(frequencies):
    rows, curves = [], {}
    for label, extra in (("two-way", {}), ("one-way, as the paper", ONE_WAY)):
        curve = []
        for f in frequencies:
            flight = sine(f, 0.3, 6.0, extra=extra)
            half = flight.time > 3.0
            curve.append((f, 1e3 * np.max(np.abs(flight["slosh_y_m"][half])), np.max(np.abs(flight["slosh_force_y_n"][half]))))
        curves[label] = curve
        say(f"  {label}")
    for (f, x2, f2), (_, x1, f1) in zip(*curves.values()):
        rows.append([f"{f:g}", number(x2), number(f2), number(x1), number(f1)])
    header = ["gimbal sine, Hz", "slosh mm", "force N", "slosh mm, one-way", "force N, one-way"]
    return markdown(header, rows), curves


def slosh_steps():
    rows = []
    for nitrous in (13.47, 7.0, 3.0):
        for angle in (0.5, 1.0, 2.0):
            two, one, frozen = (
                step(angle, nitrous, extra) for extra in ({}, ONE_WAY, {"physics.freeze": ["slosh"]})
            )
            com = sloshing_mass(two) * np.abs(two["slosh_y_m"]) / two["mass_kg"]
            rows.append([
                f"{nitrous:g}", f"{angle:g}", number(lateral_acceleration(frozen)), number(1e3 * np.max(np.abs(two["slosh_y_m"]))),
                number(np.max(np.abs(two["slosh_force_y_n"]))), number(np.max(np.abs(one["slosh_force_y_n"]))),
                number(1e3 * np.max(com)), number(np.max(apart(two, frozen)["attitude"])),
            ])
    header = ["N2O kg", "gimbal deg", "a m/s2", "slosh mm", "force N", "force N, one-way", "COM aside mm", "attitude, slosh against frozen, deg"]
    return markdown(header, rows)


# ------------------------------------------------------------------------------------------------ open loop


def replay(flight, start_s, end_s, freeze):
    """From the state at `start_s`, under the actuators' motion as it was."""
    i = int(np.searchsorted(flight.time, start_s - 1e-6))
    j = int(np.searchsorted(flight.time, end_s - 1e-6))
    at = lambda *names: [float(flight[name][i]) for name in names]
    keys = {
        "duration_s": round(float(flight.time[j] - flight.time[i]), 3),
        "initial.position_ned_m": at("north_m", "east_m", "down_m"),
        "initial.velocity_ned_m_s": at("vn_m_s", "ve_m_s", "vd_m_s"),
        "initial.q_ned_from_body": at("qw", "qx", "qy", "qz"),
        "initial.rate_body_rad_s": at("p_rad_s", "q_rad_s", "r_rad_s"),
        "initial.nitrous_kg": at("nitrous_kg")[0],
        "initial.nitrogen_kg": sum(at("nitrogen_bottle_kg", "nitrogen_ullage_kg")),
        "initial.port_radius_m": at("port_radius_m")[0],
        "initial.throat_radius_m": at("throat_radius_m")[0],
        "physics.freeze": freeze,
    }
    span = slice(i, j)
    columns = [flight[name][span] for name in ("valve_deg", "gimbal_x_deg", "gimbal_y_deg", "rcs_roll")]
    rows = np.column_stack([flight.time[span] - flight.time[i], *columns])
    return fly("open_loop_a", keys, schedule(rows, ["valve_deg", *COLUMNS[1:]]), 50)


def open_loop(phases):
    flight = fly("hop_50m", SIDESTEP, rate_hz=1000)
    sections, results = [], {}
    for phase in phases:
        start, end = flight.phases()[phase]
        end = min(end, start + 10.0)
        base = replay(flight, start, end, [])
        rows = []
        for coupling in [*COUPLINGS, "all"]:
            held = replay(flight, start, end, COUPLINGS if coupling == "all" else [coupling])
            d = apart(held, base)
            last = [float(d[key][-1]) for key in ("position", "velocity", "attitude", "rate")]
            rows.append((coupling, *last))
            results[phase, coupling] = last
        say(f"  {phase}: {end - start:.1f} s")
        rows.sort(key=lambda row: -row[1] if row[0] != "all" else math.inf)
        table = markdown(
            ["held", "position m", "velocity m/s", "attitude deg", "rate deg/s"],
            [[NAMES[row[0]], *(number(x) for x in row[1:])] for row in rows],
        )
        sections.append(f"**{phase}**, {end - start:.1f} s\n\n{table}")
    return "\n\n".join(sections), results, evolution(flight)


def evolution(flight):
    """Mass properties of the hop at the ends of its phases, and what moves the centre of mass."""
    phases = flight.phases()
    marks = {"lift-off": phases["ascent"][0], "hover": phases["hover"][0], "descent": phases["descent"][0], "touchdown": phases["descent"][1]}
    rows, start = [], None
    floor, length, bottle, grain, capacity = 0.200, 0.670, 1.080, -0.180, 0.670 * math.pi * 0.095**2 * 834.3181387
    for name, time in marks.items():
        i = int(np.searchsorted(flight.time, time - 1e-6))
        at = lambda key: float(flight[key][i])
        height = length * at("nitrous_kg") / capacity
        # First moments of the parts that move.
        parts = [
            at("nitrous_kg") * (floor + height / 2), at("fuel_kg") * grain,
            at("nitrogen_ullage_kg") * (floor + (length + height) / 2) + at("nitrogen_bottle_kg") * bottle,
        ]
        masses = [at("nitrous_kg"), at("fuel_kg"), at("nitrogen_ullage_kg") + at("nitrogen_bottle_kg")]
        now = (parts, masses, at("mass_kg"), at("com_z_m"))
        start = start or now
        # What each part's loss does to the centre: its change of moment about the centre at lift-off, over the mass.
        shares = [
            1e3 * ((p - p0) - (m - m0) * start[3]) / now[2] for p, p0, m, m0 in zip(parts, start[0], masses, start[1])
        ]
        rows.append([
            name, number(time - marks["lift-off"], 3), number(at("mass_kg"), 4), number(1e3 * at("com_z_m"), 4), number(at("ixx_kg_m2"), 4),
            number(at("izz_kg_m2"), 4), number(1e3 * at("port_radius_m"), 3), *(f"{x:+.1f}" for x in shares),
        ])
    header = ["at", "s", "mass kg", "COM mm", "Ixx kg m2", "Izz kg m2", "port mm", "COM by N2O mm", "by fuel mm", "by nitrogen mm"]
    return markdown(header, rows)


# ------------------------------------------------------------------------------------------------ closed loop


CASES = {
    **{coupling: {"physics.freeze": [coupling]} for coupling in COUPLINGS},
    "all": {"physics.freeze": COUPLINGS},
    "told": {"mission.mass_knowledge": "liftoff"},
}


def closed_loop(seeds, cases):
    differences = {case: {phase: [] for phase in ("ascent", "hover", "descent")} for case in cases}
    figures = {case: [] for case in ["live", *cases]}
    for seed in seeds:
        base = fly("wind_gust", SIDESTEP, rate_hz=50, seed=seed)
        phases = base.phases()
        flights = {"live": base}
        for case, keys in cases.items():
            flights[case] = fly("wind_gust", {**SIDESTEP, **keys}, rate_hz=50, seed=seed)
        for case, flight in flights.items():
            report = flight.report
            touchdown, hover = report["touchdown"] or {}, report["hover"] or {}
            figures[case].append([
                report["outcome"] == "landed" and report["expect"]["passed"],
                hover.get("altitude_rms_m", math.nan), hover.get("lateral_rms_m", math.nan),
                touchdown.get("vertical_speed_m_s", math.nan), touchdown.get("lateral_speed_m_s", math.nan),
                touchdown.get("tilt_deg", math.nan), touchdown.get("control_error_m") or math.nan,
                report["propellant"]["nitrous_used_kg"],
            ])
            if case == "live":
                continue
            d = apart(flight, base)
            for phase, (start, end) in phases.items():
                inside = (d["time"] >= start) & (d["time"] <= end)
                gimbal = np.hypot(*(
                    np.interp(d["time"], flight.time, flight[name]) - np.interp(d["time"], base.time, base[name])
                    for name in ("gimbal_x_deg", "gimbal_y_deg")
                ))
                differences[case][phase].append([
                    *(np.sqrt(np.mean(d[key][inside] ** 2)) for key in ("position", "tilt", "thrust")),
                    np.sqrt(np.mean(gimbal[inside] ** 2)),
                ])
        say(f"  seed {seed}")
    mean = {case: {phase: np.mean(v, axis=0) for phase, v in by.items()} for case, by in differences.items()}
    order = sorted(cases, key=lambda case: -mean[case]["descent"][0])
    header = ["held"]
    for phase in ("ascent", "hover", "descent"):
        header += [f"{phase}: position m", "tilt deg", "thrust N", "gimbal deg"]
    first = markdown(header, [
        [NAMES[case], *(number(x) for phase in ("ascent", "hover", "descent") for x in mean[case][phase])] for case in order
    ])
    second = markdown(
        ["held", "passed", "hover height rms m", "hover sideways rms m", "touchdown m/s", "sideways m/s", "tilt deg", "control error m", "N2O used kg"],
        [
            [NAMES.get(case, "nothing"), f"{int(sum(f[0] for f in figures[case]))} of {len(seeds)}",
             *(number(x, 3) for x in np.mean([f[1:] for f in figures[case]], axis=0))]
            for case in figures
        ],
    )
    return first, second, mean


# ------------------------------------------------------------------------------------------------ the study


def bars(axis, values, title, label):
    """Horizontal bars, the greatest on top."""
    names = sorted(values, key=lambda case: values[case])
    axis.barh([NAMES[case] for case in names], [max(values[case], 1e-7) for case in names], color="C0", height=0.6)
    axis.set_xscale("log")
    axis.set_xlim(1e-4, 2.0)
    axis.set_xticks([1e-4, 1e-3, 1e-2, 1e-1, 1.0])
    axis.minorticks_off()
    axis.set_title(title, fontsize=9)
    axis.set_xlabel(label)
    axis.tick_params(axis="y", labelsize=7)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="one flight and one level, no pictures")
    parser.add_argument("--seeds", type=int, default=3, help="flights of each case in closed loop")
    arguments = parser.parse_args()
    short = arguments.short

    say("oxidiser flow")
    table, levels = flow_levels([700] if short else [300, 500, 700, 900, 1050])
    say(f"\n### Oxidiser flow: rates of the mass properties, mean of 10 s\n\n{table}\n")
    say("open loop")
    table, results, evolved = open_loop(["hover"] if short else ["ascent", "hover", "descent"])
    say(f"\n### The hop: mass properties at the ends of its phases\n\n{evolved}\n")
    say(f"\n### Open loop: difference at the end of the phase\n\n{table}\n")
    if short:
        return

    say(f"\n### Throttle shape: 700 N on average, end of 10 s against constant\n\n{throttle_shapes()}\n")
    say("slosh")
    frequencies = [0.5, 1.0, 1.5, 1.8, 2.0, 2.1, 2.2, 2.4, 2.7, 3.0, 4.0]
    table, curves = slosh_response(frequencies)
    say(f"\n### Lateral sine: gimbal of 0.3 deg at 700 N, 3 to 6 s\n\n{table}\n")
    say(f"\n### Lateral step: gimbal out for 0.3 s at 700 N\n\n{slosh_steps()}\n")
    say(f"\n### A push of {SIDE_N:g} N for {SIDE_S:g} s: slosh force against oxidiser flow\n\n{slosh_levels(levels)}\n")
    say(f"\n### The same push at 5 s: slosh force against throttle shape\n\n{slosh_shapes()}\n")
    say("closed loop")
    first, second, mean = closed_loop(range(1, arguments.seeds + 1), CASES)
    say(f"\n### Closed loop: rms difference to the flight with nothing held, same seed, mean of {arguments.seeds}\n\n{first}\n")
    say(f"\n### Closed loop: figures of the flights, mean of {arguments.seeds}\n\n{second}\n")

    # Mass properties against oxidiser flow.
    fig, axes = figure(2, 2)
    for axis, name, label, scale in zip(
        axes.flat, ("mass_kg", "com_z_m", "ixx_kg_m2", "izz_kg_m2"),
        ("mass, kg", "centre of mass, mm up", "Ixx, kg m²", "Izz, kg m²"), (1, 1e3, 1, 1),
    ):
        for thrust, flight in levels:
            axis.plot(flight.time, scale * flight[name], lw=1, label=f"{thrust} N")
        axis.set_ylabel(label)
        axis.set_xlabel("time, s")
    axes[0, 0].legend(fontsize=8, ncol=2)
    save(fig, "oxidizer_flow")

    fig, (left, right) = figure(1, 2, height=3.0)
    for (label, curve), colour in zip(curves.items(), ("C0", "C3")):
        f, x, n = zip(*curve)
        left.plot(f, x, colour, marker="o", ms=3, lw=1, label=label)
        right.plot(f, n, colour, marker="o", ms=3, lw=1, label=label)
    left.set_ylabel("slosh displacement, mm")
    right.set_ylabel("slosh force on the vehicle, N")
    for axis in (left, right):
        axis.set_xlabel("gimbal sine of 0.3 deg at 700 N, Hz")
        axis.legend(fontsize=8)
    save(fig, "slosh_response")

    fig, axes = figure(2, 3, height=2.4)
    for column, phase in enumerate(("ascent", "hover", "descent")):
        bars(axes[0, column], {c: results[phase, c][0] for c in COUPLINGS}, f"{phase}, open loop", "position after 10 s, m")
        bars(axes[1, column], {c: mean[c][phase][0] for c in [*COUPLINGS, "told"]}, f"{phase}, closed loop", "position, rms m")
    save(fig, "ranking")


if __name__ == "__main__":
    main()
