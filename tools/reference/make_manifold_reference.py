#!/usr/bin/env python3
"""Lag and response of the manifold between valve and injector, for tests/reference/manifold.rs.

Fluids by CoolProp (derivatives of density at constant enthalpy too), chamber and nozzle by the second
implementation in make_open_loop_reference.py, integration by SciPy's Radau. Port 35 mm, throat 10 mm.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-open-loop.txt
    venv/bin/python tools/reference/make_manifold_reference.py

writes tests/reference/feed_lag.csv and feed_response.csv.
"""

import math
import platform
import tomllib

import CoolProp
import numpy as np
import scipy
from make_open_loop_reference import OUTPUT, SCENARIOS, Engine
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

PORT, THROAT, VOLUME = 0.035, 0.010, 2.5e-5
LINE_LENGTH, LINE_AREA = 0.5, 1.267e-4
RTOL, ATOL = 1e-10, 1e-12
HEAD = (
    f"# tools/reference/make_manifold_reference.py: Python {platform.python_version()}, CoolProp {CoolProp.__version__}, "
    f"SciPy {scipy.__version__}, NumPy {np.__version__}\n"
)

vehicle = tomllib.loads((SCENARIOS / "vehicles" / "reference.toml").read_text())
engine = Engine(vehicle, {"pressure_pa": 101325.0})
nitrous = engine.nitrous


def density_slope(p2):
    """(drho/dP)_h at the tank's enthalpy."""
    fluid = nitrous.fluid
    if p2 < nitrous.flash_pa:
        fluid.update(CoolProp.HmassP_INPUTS, nitrous.h1, p2)
        return fluid.first_two_phase_deriv(CoolProp.iDmass, CoolProp.iP, CoolProp.iHmass)
    # CoolProp refuses single-phase states within 1e-6 of saturation: its densities, splined over 10 kPa.
    density = nitrous.whole["rho"]
    return (density(p2 + 50.0) - density(p2 - 50.0)) / 100.0


def chamber_pa(oxidizer):
    fuel, _ = engine.fuel_flow(oxidizer, PORT)
    return engine.steady_chamber_pa(oxidizer + fuel, oxidizer / fuel, THROAT)


def injected(p2):
    """Flow through the injector into the pressure that it makes."""
    f = lambda flow: engine.injector_cd_area * nitrous.injector_flux(p2, chamber_pa(flow)) - flow
    return brentq(f, 1e-3, 1.0, xtol=1e-14, rtol=1e-15)


def steady(angle):
    point = engine.operate(engine.valve_area(angle), PORT, THROAT)
    return point["p2"], point["oxidizer"]


def lag(angle):
    """V (drho/dP)_h / (slope of the injector - slope of the valve), chamber pressure held."""
    p2, flow = steady(angle)
    pc, area, h = chamber_pa(flow), engine.valve_cd * engine.valve_area(angle), 50.0
    slope = lambda f: (f(p2 + h) - f(p2 - h)) / (2 * h)
    injector = engine.injector_cd_area * slope(lambda p: nitrous.injector_flux(p, pc))
    return p2, VOLUME * density_slope(p2) / (injector - area * slope(nitrous.valve_flux))


def smooth(x):
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10 - 15 * x + 6 * x * x)


def angle_at(t):
    """Degrees: 15 to 22 while it boils, up to 30 through the flash point, back to 18; the test has the same."""
    return 15 + 7 * smooth((t - 0.05) / 0.15) + 8 * smooth((t - 0.5) / 0.15) - 12 * smooth((t - 0.8) / 0.15)


def thrust(flow):
    fuel, _ = engine.fuel_flow(flow, PORT)
    pc, of = chamber_pa(flow), flow / fuel
    momentum = engine.chamber["c_star_efficiency"] * engine.nozzle["thrust_efficiency"] * 9.80665
    return momentum * engine.mapped("isp", of, pc) * (flow + fuel) - engine.ambient_pa * engine.exit_area


def valve_flow(t, p2):
    return engine.valve_cd * engine.valve_area(angle_at(t)) * nitrous.valve_flux(p2)


def manifold(t, y):
    p2 = y[0] * 1e5
    return [(valve_flow(t, p2) - injected(p2)) / (VOLUME * density_slope(p2)) * 1e-5]


def line_and_manifold(t, y):
    p2, flow = y[0] * 1e5, y[1]
    push = (nitrous.tank_pa - p2) * (1.0 - (flow / valve_flow(t, p2)) ** 2)
    return [(flow - injected(p2)) / (VOLUME * density_slope(p2)) * 1e-5, push * LINE_AREA / LINE_LENGTH]


def response(f, start):
    """Radau from one edge of the schedule, and of the fluid, to the next."""
    times = np.arange(0, 241) * 0.005
    rows, y, t = [start], start, 0.0
    crossing = lambda t, y: y[0] * 1e5 - nitrous.flash_pa
    crossing.terminal = True
    for end in times[1:]:
        while t < end:
            s = solve_ivp(f, (t, end), y, method="Radau", rtol=RTOL, atol=ATOL, events=crossing, max_step=0.005)
            t, y = s.t[-1], s.y[:, -1]
            if s.status == 1:
                # A hair beyond the kink, so that it is not found again.
                y[0] += math.copysign(1e-9, f(t, y)[0])
        rows.append(list(y))
    return times, np.array(rows)


if __name__ == "__main__":
    with open(OUTPUT / "feed_lag.csv", "w") as out:
        out.write(HEAD + "valve_deg,p2_pa,lag_s\n")
        for angle in (15, 17, 19, 20, 22, 24, 25, 26, 26.3, 26.6, 27, 28, 30, 35, 40, 50, 60, 70, 78.8):
            p2, tau = lag(angle)
            print(angle, p2, tau * 1e3)
            out.write(f"{angle},{p2:.9g},{tau:.9g}\n")
    p2, flow = steady(angle_at(0.0))
    times, alone = response(manifold, [p2 * 1e-5])
    _, both = response(line_and_manifold, [p2 * 1e-5, flow])
    with open(OUTPUT / "feed_response.csv", "w") as out:
        out.write(HEAD + "time_s,valve_deg,p2_pa,oxidizer_kg_s,thrust_n,with_line_p2_pa,with_line_oxidizer_kg_s,line_kg_s\n")
        for t, (a,), (b, w) in zip(times, alone, both):
            flow, other = injected(a * 1e5), injected(b * 1e5)
            out.write(
                f"{t:.3f},{angle_at(t):.9f},{a*1e5:.10g},{flow:.10g},{thrust(flow):.10g},{b*1e5:.10g},{other:.10g},{w:.10g}\n"
            )
