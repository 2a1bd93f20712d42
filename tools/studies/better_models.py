#!/usr/bin/env python3
"""What each better model of the vehicle file is worth on the reference vehicle: one at a time, then all together.

    cargo build --release -p hopbench-hil
    python3 -m venv venv && venv/bin/pip install -r tools/studies/requirements.txt
    venv/bin/python tools/studies/better_models.py    # two tables on stdout, a minute

The hop of 50 m, seed 1, flown by the autopilot; and the thrust after a throttle step from 300 to 700 N in free flight with
the valve's servo. Two-phase depletion shows in the static fires, not in a hop.
"""

import numpy as np

from study import fly, markdown, number, say, schedule

CHAMBER = "vehicle.engine.chamber.model"
LINE = {"length_m": 0.5, "area_m2": 1.267e-4, "static_head": True, "drop_m": 0.1}
MODELS = {
    "reference": {},
    "second slosh mode": {"vehicle.slosh.second_mode": True},
    "rotary coupling": {"vehicle.slosh.hardening_law": "radial"},
    "baffle, 0.403": {"vehicle.slosh.baffle_damping_ratio": 0.403},
    "liquid that hardly rolls, 0.05": {"vehicle.slosh.roll_inertia_factor": 0.05},
    "two-phase manifold": {"vehicle.feed.manifold.model": "implicit"},
    "feed line 0.5 m, with head": {"vehicle.feed.line": LINE},
    "choked single phase": {"vehicle.feed.valve.single_phase": "choked", "vehicle.feed.injector.single_phase": "choked"},
    "fuel-flow lag 0.1 s": {"vehicle.engine.grain.fuel_flow_lag_s": 0.1},
    "chamber filling": {CHAMBER: "filling"},
    "bottle with wall heat": {"vehicle.pressurant.bottle.model": "energy_balance"},
    "ullage energy, stratified": {"vehicle.feed.tank.ullage.model": "energy_balance"},
    "ullage with vapour": {
        "vehicle.feed.tank.ullage.model": "energy_balance",
        "vehicle.feed.tank.ullage.vapor_conductance_kg_s_pa": 1e-8,
        "vehicle.feed.tank.ullage.vapor_saturation": 1.0,
    },
    "regulator droop 33 bar s/kg": {"vehicle.pressurant.regulator.droop_pa_s_kg": 3.3e6},
    "regulator lock-up 0.4 bar": {"vehicle.pressurant.regulator.lockup_pa": 0.4e5},
    "gimbal friction 2 mrad": {"vehicle.gimbal.friction_rad": 2e-3},
    "gimbal backlash 2 mrad": {"vehicle.gimbal.backlash_rad": 2e-3},
    "valve friction 5 mrad": {"vehicle.feed.valve.friction_rad": 5e-3},
    "static friction 1.4 of sliding": {"vehicle.landing_gear.static_friction_ratio": 1.4},
    "wind 4 m/s, logarithmic, and turbulence": {
        "wind.mean_speed_m_s": 4.0, "wind.profile": "logarithmic", "wind.turbulence": {"wind_at_20_ft_m_s": 6.0},
    },
}
TOGETHER = [
    "second slosh mode", "rotary coupling", "liquid that hardly rolls, 0.05", "two-phase manifold", "feed line 0.5 m, with head",
    "choked single phase", "fuel-flow lag 0.1 s", "chamber filling", "bottle with wall heat", "ullage with vapour", "regulator droop 33 bar s/kg",
    "regulator lock-up 0.4 bar", "gimbal friction 2 mrad", "gimbal backlash 2 mrad", "static friction 1.4 of sliding",
]


def hop(settings):
    flight = fly("hop_50m", settings, seed=1)
    report = flight.report
    touch = report["touchdown"]
    until = flight.time < (touch["time_s"] if touch else np.inf)
    tilt = np.degrees(np.arccos(np.clip(flight.axis()[until, 2], -1.0, 1.0)))
    slosh = 1e3 * np.hypot(flight["slosh_x_m"], flight["slosh_y_m"])[until]
    armed = until & (flight.time > 1.0)
    tank = 1e-5 * flight["tank_pa"][armed]
    return [
        report["outcome"], number(tilt.max()), number(slosh.max()), number(1e3 * report["hover"]["altitude_rms_m"]),
        number(touch["vertical_speed_m_s"], 3), number(report["propellant"]["nitrous_used_kg"], 4),
        number(report["propellant"]["fuel_used_kg"], 4), number(1e-5 * flight["bottle_pa"][-1], 4), f"{tank.min():.2f} to {tank.max():.2f}",
    ]


def throttle_step(settings):
    """Times from the command to 10 and 90 % of the thrust's rise (ms)."""
    replaced = {key: value for key, value in settings.items() if key != CHAMBER}
    replaced |= {"model.chamber": settings.get(CHAMBER, "quasi_steady"), "actuators.ideal": False, "duration_s": 2.5}
    start_s = 1.0
    commands = schedule([[0.0, 300.0], [start_s, 700.0]], ["thrust_n"])
    flight = fly("open_loop_a", replaced, commands, rate_hz=1000)
    thrust, after = flight["thrust_n"], flight.time >= start_s
    low, high = thrust[np.searchsorted(flight.time, start_s)], np.mean(thrust[-50:])
    at = lambda share: 1e3 * (flight.time[after][np.argmax(thrust[after] > low + share * (high - low))] - start_s)
    return [number(at(0.9) - at(0.1), 3), number(at(0.9), 3)]


def main():
    models = dict(MODELS)
    models["all together"] = {key: value for name in TOGETHER for key, value in MODELS[name].items()}
    hops, steps = [], []
    for name, settings in models.items():
        say(f"  {name}")
        hops.append([name, *hop(settings)])
        if not settings or any(key.split(".")[1] in ("feed", "engine", "pressurant") for key in settings if key.startswith("vehicle.")):
            steps.append([name, *throttle_step(settings)])
    say(markdown(
        ["model", "outcome", "tilt deg", "slosh mm", "hover rms mm", "touchdown m/s", "N2O kg", "fuel kg", "bottle bar", "tank bar"], hops
    ))
    say("")
    say(markdown(["model", "thrust 10-90 % ms", "at 90 % ms"], steps))


if __name__ == "__main__":
    main()
