#!/usr/bin/env python3
"""Problems of one equation each, solved by SciPy, for tests/reference/scipy.rs.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-motion.txt
    venv/bin/python tools/reference/make_scipy_points.py

writes, into tests/reference:
  regression_points.csv  dR/dt = a G^n under a throttled flow, 1, 3 and 7 ports (Eqs 1 to 6)
  nozzle_points.csv      flow -> chamber pressure, thrust, from a whisper to full flow (Eqs 9 to 11)
  filling_points.csv     two masses of gas in the chamber under a throttled flow
  slosh_points.csv       the mode's frequency, mass and station (Eqs 17, 18), and Duffing's oscillator driven (Eq 19)
  tumbling_points.csv    torque-free motion of a body with three unequal moments

Ordinary differential equations by DOP853 (rtol 1e-12); the tumbling body by Jacobi's elliptic functions. The
vehicle's numbers are written out here, not read from the vehicle file, but for the two tables.
"""

import csv
import math
import platform
from pathlib import Path

import numpy as np
import scipy
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk, jnp_zeros

ROOT = Path(__file__).resolve().parents[2]
OUTPUT = ROOT / "tests" / "reference"
G0, RU, PA = 9.80665, 8.314462618, 101325.0
A, N, RHO_F, RO, LENGTH = 1.05e-4, 0.55, 940.0, 0.068, 0.250
ETA_C, ETA_F, CD, EPS0, R_T0, DEAD_M3 = 0.93, 0.96, 0.98, 3.0, 0.0098, 3.0e-4
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-16}


def write(name, what, columns, rows):
    rows = list(rows)
    with open(OUTPUT / name, "w", newline="\n") as out:
        out.write(f"# {what}\n")
        out.write(
            f"# scipy {scipy.__version__}, numpy {np.__version__}, Python {platform.python_version()}. "
            "Made by: python tools/reference/make_scipy_points.py. SI units.\n"
        )
        out.write(columns + "\n")
        for row in rows:
            out.write(",".join(f"{x:.15g}" for x in row) + "\n")
    print(name, len(rows), "rows")


# ------------------------------------------------------------------------------------------ regression


def throttled(t):
    """Oxidiser flow (kg/s) of a flight that throttles; smooth, so that no step needs to meet a corner."""
    return 0.30 + 0.12 * math.sin(0.9 * t) + 0.05 * math.sin(4.1 * t + 0.6)


def regression():
    for ports, ri in ((1, 0.025), (3, 0.011), (7, 0.006)):
        rate = lambda t, y: [A * (throttled(t) / (math.pi * ports * y[0] ** 2)) ** N]
        end = 20.0 if ports == 1 else 4.0
        times = np.linspace(0.0, end, 11)
        solution = solve_ivp(rate, (0.0, end), [ri], t_eval=times, **TIGHT)
        for t, r in zip(times, solution.y[0]):
            o = throttled(t)
            # Fuel flow from the burning surface itself, not from Eq 5.
            surface = 2.0 * math.pi * r * ports * LENGTH
            fuel_flow = RHO_F * surface * A * (o / (ports * math.pi * r * r)) ** N
            left = RHO_F * LENGTH * (math.pi * RO**2 - ports * math.pi * r * r)
            yield ports, t, o, r, fuel_flow, left


# -------------------------------------------------------------------------------------- map and nozzle

with open(ROOT / "scenarios/vehicles/cea_reference_fit.csv") as file:
    lines = list(csv.reader(line for line in file if not line.startswith("#")))
COLUMNS = dict(zip(lines[0], np.array([[float(x) for x in line] for line in lines[1:]]).T))
CURVES = {k: PchipInterpolator(COLUMNS["OF"], v) for k, v in COLUMNS.items() if k != "OF"}


def product(name, of, pc):
    of = min(max(of, 0.5), 15.0)
    value = float(CURVES[f"{name}20" + UNITS[name]](of))
    slope = "k_" + name + UNITS[name]
    return value + float(CURVES[slope](of)) * math.log(pc / 20e5) if slope in CURVES else value


UNITS = {"Isp_vac": "_s", "Cstar": "_m_s", "T_c": "_K", "MW": "_g_mol", "gamma_t": ""}


def pi(g, m):
    return (1.0 + 0.5 * (g - 1.0) * m * m) ** (-g / (g - 1.0))


def area(g, m):
    return (2.0 / (g + 1.0) * (1.0 + 0.5 * (g - 1.0) * m * m)) ** ((g + 1.0) / (2.0 * (g - 1.0))) / m


def tau(g, m):
    return g * m * m if m < 1.0 else area(g, m) * ((1.0 + g * m * m) / m - 1.0)


def root(f, low, high):
    return brentq(f, low, high, xtol=1e-15, rtol=4 * np.finfo(float).eps)


def chamber_pressure(flow, of, at):
    """(11R), and (11S) where the throat is not choked."""
    g = product("gamma_t", of, PA)
    choked = lambda pc: pc - flow * product("Cstar", of, pc) * ETA_C / (at * CD)
    pc = root(choked, 10.0, 1e8)
    if pc >= PA / pi(g, 1.0):
        return pc

    def excess(m):
        p = PA / pi(g, m)
        return p - flow * product("Cstar", of, p) * ETA_C * area(g, m) / (at * CD)

    return PA / pi(g, root(excess, 1e-9, 1.0))


def thrust(pc, of, at):
    """(10R) and (10S); the state 3 full, 2 separated, 1 unchoked."""
    g, ae = product("gamma_t", of, pc), EPS0 * math.pi * R_T0**2
    full = lambda p: ETA_F * CD * p * at * G0 * product("Isp_vac", of, p) / product("Cstar", of, p) - PA * ae
    me = root(lambda m: area(g, m) - ae / at, 1.0, 30.0)
    onset = PA / (me * pi(g, me))
    if pc >= onset:
        return full(pc), 3
    if pc >= PA / pi(g, 1.0):
        return full(onset) * tau(g, root(lambda m: PA / (m * pi(g, m)) - pc, 1.0, me)) / tau(g, me), 2
    return full(onset) * tau(g, root(lambda m: PA / pi(g, m) - pc, 0.0, 1.0)) / tau(g, me), 1


def nozzle():
    for port, throat in ((0.025, 0.0098), (0.035, 0.0100), (0.055, 0.0103)):
        at = math.pi * throat**2
        flows = np.geomspace(0.0006, 0.52, 40)
        for o in flows:
            fuel = RHO_F * 2.0 * math.pi * port * LENGTH * A * (o / (math.pi * port**2)) ** N
            pc = chamber_pressure(o + fuel, o / fuel, at)
            f, state = thrust(pc, o / fuel, at)
            yield port, throat, o, fuel, pc, f, state


# -------------------------------------------------------------------------------------- filling chamber


def filling():
    port, throat = 0.035, 0.0100
    at, volume = math.pi * throat**2, DEAD_M3 + math.pi * port**2 * LENGTH

    def held(gas_o, gas_f):
        of = gas_o / gas_f
        pc = root(
            lambda p: p - (gas_o + gas_f) * ETA_C**2 * RU / (1e-3 * product("MW", of, p)) * product("T_c", of, p) / volume,
            10.0, 1e8,
        )
        if pc <= PA:
            return pc, 0.0
        g = product("gamma_t", of, pc)
        flow = CD * pc * at / (ETA_C * product("Cstar", of, pc))
        if pc < PA / pi(g, 1.0):
            flow /= area(g, root(lambda m: PA / pi(g, m) - pc, 1e-9, 1.0))
        return pc, flow

    def rate(t, y):
        o = throttled(t)
        fuel = RHO_F * 2.0 * math.pi * port * LENGTH * A * (o / (math.pi * port**2)) ** N
        _, out = held(*y)
        return [o - out * y[0] / (y[0] + y[1]), fuel - out * y[1] / (y[0] + y[1])]

    start = [1.0e-3, 0.4e-3]
    times = np.linspace(0.0, 0.5, 26)
    solution = solve_ivp(rate, (0.0, 0.5), start, t_eval=times, method="DOP853", rtol=1e-11, atol=1e-16)
    for t, gas_o, gas_f in zip(times, *solution.y):
        pc, flow = held(gas_o, gas_f)
        yield t, gas_o, gas_f, pc, flow


# ------------------------------------------------------------------------------------------------ slosh


def slosh():
    """kind 0: mass, g_eff -> omega, m_s, station; kind 1: time, x, v of the driven oscillator."""
    xi, radius, rho, floor = float(jnp_zeros(1, 1)[0]), 0.095, 834.3181387, 0.2
    for mass in (0.02, 0.5, 2.0, 5.0, 9.0, 13.4717):
        for g in (0.5, 3.7, 9.80665, 14.0):
            h = mass / (rho * math.pi * radius**2)
            omega = math.sqrt(g * xi / radius * math.tanh(xi * h / radius))
            m_s = mass * 2.0 * radius * math.tanh(xi * h / radius) / (xi * (xi * xi - 1.0) * h)
            z = floor + h - 2.0 * radius / xi * math.tanh(xi * h / (2.0 * radius))
            yield 0, mass, g, omega, m_s, z
    mass, g = 9.0, 9.80665
    h = mass / (rho * math.pi * radius**2)
    omega = math.sqrt(g * xi / radius * math.tanh(xi * h / radius))
    zeta, hardening = 0.03, 0.5

    def drive(t):
        return 1.2 * math.sin(9.0 * t) + 0.4 * math.cos(17.0 * t)

    def rate(t, y):
        x, v = y
        spring = omega**2 * x + hardening * omega**2 / radius**2 * x**3
        return [v, -drive(t) - spring - 2.0 * zeta * omega * v]

    times = np.linspace(0.0, 8.0, 33)
    solution = solve_ivp(rate, (0.0, 8.0), [0.02, 0.0], t_eval=times, **TIGHT)
    for t, x, v in zip(times, *solution.y):
        yield 1, t, drive(t), x, v, 0.0


# --------------------------------------------------------------------------------------------- tumbling


def tumbling():
    """Rates of a free body with moments 12, 21, 26 kg m2 by Jacobi's elliptic functions (Landau and Lifshitz,
    Mechanics, par. 37), started on the second axis' zero; and the same body turned into a frame where the tensor is full."""
    i1, i2, i3 = 12.0, 21.0, 26.0
    w1, w3 = 0.9, 2.1
    energy2 = i1 * w1**2 + i3 * w3**2
    momentum2 = (i1 * w1) ** 2 + (i3 * w3) ** 2
    assert momentum2 > energy2 * i2
    k = math.sqrt((i3 - i2) * (momentum2 - energy2 * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (energy2 * i3 - momentum2) / ((i3 - i2) * (momentum2 - energy2 * i1))
    a1 = math.sqrt((energy2 * i3 - momentum2) / (i1 * (i3 - i1)))
    a2 = math.sqrt((energy2 * i3 - momentum2) / (i2 * (i3 - i2)))
    a3 = math.sqrt((momentum2 - energy2 * i1) / (i3 * (i3 - i1)))
    # Also by DOP853, so that a slip in the formula would show.
    times = np.linspace(0.0, 12.0, 25)
    rate = lambda t, w: [(i2 - i3) / i1 * w[1] * w[2], (i3 - i1) / i2 * w[2] * w[0], (i1 - i2) / i3 * w[0] * w[1]]
    numeric = solve_ivp(rate, (0.0, 12.0), [w1, 0.0, w3], t_eval=times, **TIGHT).y
    for i, t in enumerate(times):
        sn, cn, dn, _ = ellipj(k * t, m)
        w = (a1 * cn, a2 * sn, a3 * dn)
        assert np.allclose(w, numeric[:, i], rtol=0, atol=2e-11), (t, w, numeric[:, i])
        yield (t, *w)
    print("period", 4.0 * ellipk(m) / k, "s")


write("regression_points.csv", "Regression under a throttled flow 0.30 + 0.12 sin(0.9 t) + 0.05 sin(4.1 t + 0.6) kg/s.",
      "ports,time_s,oxidizer_kg_s,port_radius_m,fuel_kg_s,fuel_left_kg", regression())
write("nozzle_points.csv", "Chamber pressure and thrust against oxidiser flow; state 3 full, 2 separated, 1 unchoked.",
      "port_radius_m,throat_radius_m,oxidizer_kg_s,fuel_kg_s,chamber_pa,thrust_n,state", nozzle())
write("filling_points.csv", "Filling chamber, R 35 mm, throat 10 mm, flow as in regression_points.csv, from 1.0 g and 0.4 g.",
      "time_s,chamber_oxidizer_kg,chamber_fuel_kg,chamber_pa,nozzle_kg_s", filling())
write("slosh_points.csv", "kind 0: liquid kg, g_eff m/s2, omega rad/s, slosh kg, station m. kind 1: time s, drive m/s2, x m, v m/s.",
      "kind,a,b,c,d,e", slosh())
write("tumbling_points.csv", "Body rates of a free body, principal moments 12, 21, 26 kg m2, from (0.9, 0, 2.1) rad/s.",
      "time_s,w1_rad_s,w2_rad_s,w3_rad_s", tumbling())
