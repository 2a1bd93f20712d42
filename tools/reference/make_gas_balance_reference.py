"""Makes tests/reference/gas_balance.csv: bottle blow-down and regulated drains with vapour, by CoolProp and SciPy.

    python3 -m venv .venv && .venv/bin/pip install -r tools/reference/requirements-gas-balance.txt
    .venv/bin/python tools/reference/make_gas_balance_reference.py

Run from the repository root. Another formulation than the library's: the states are masses and internal
energies, temperatures and pressures are found from them by CoolProp's own equations of state at every call, and
DOP853 integrates with a relative tolerance of 1e-9. The regulator holds its outlet by its law
P' = (P1 - P)/tau, solved for the flow with the numerical derivative of the pressure.
"""

import sys
from pathlib import Path

import CoolProp
import CoolProp.CoolProp as cp
import numpy as np
import scipy
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

cp.set_reference_state("N2O", "NBP")
N2 = CoolProp.AbstractState("HEOS", "Nitrogen")
VAPOUR = CoolProp.AbstractState("HEOS", "N2O")
LINE = CoolProp.AbstractState("HEOS", "N2O")

BOTTLE_M3, TANK_M3 = 9e-3, np.pi * 0.095**2 * 0.67
LIQUID_KG_M3, R_N2O = 834.3181387, 188.91031699869131
G_WALL, C_WALL, G_ULLAGE, C_SHELL = 6.0, 4700.0, 10.0, 7400.0
SET_PA, TAU, SHORTEST = 65e5, 0.02, 0.02


def gas(state, density, temperature):
    state.update(CoolProp.DmassT_INPUTS, max(density, 1e-9), temperature)
    return state.p(), state.umass(), state.hmass()


def line(temperature):
    LINE.update(CoolProp.QT_INPUTS, 1.0, temperature)
    pressure, h_vapour = LINE.p(), LINE.hmass()
    LINE.update(CoolProp.QT_INPUTS, 0.0, temperature)
    return pressure, h_vapour, LINE.umass()


def temperature_of(energy, low, high):
    return brentq(lambda t: energy(t), low, high, xtol=1e-11)


def bottle_of(mass, energy):
    t = temperature_of(lambda t: mass * gas(N2, mass / BOTTLE_M3, t)[1] - energy, 135.0, 400.0)
    return (t, *gas(N2, mass / BOTTLE_M3, t))


def bottle_blow_down(conductance, flow, times):
    """A flow at constant rate out of the bottle."""
    n2 = N2
    n2.update(CoolProp.PT_INPUTS, 300e5, 290.0)
    start = [n2.rhomass() * BOTTLE_M3, n2.rhomass() * BOTTLE_M3 * n2.umass(), 290.0]

    def rate(_, y):
        t, _, _, h = bottle_of(y[0], y[1])
        heat = conductance * (y[2] - t)
        return [-flow, -flow * h + heat, -heat / C_WALL]

    run = solve_ivp(rate, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-9, atol=1e-9)
    return [[m, *bottle_of(m, u)[:2], wall] for m, u, wall in run.y.T]


def drain(conductance, saturation, flow, times):
    """Liquid out of a regulated tank at constant rate, bottle and ullage with their balances."""
    N2.update(CoolProp.PT_INPUTS, 300e5, 290.0)
    bottle_kg, bottle_j = N2.rhomass() * BOTTLE_M3, N2.rhomass() * BOTTLE_M3 * N2.umass()
    ullage = 0.15 * TANK_M3
    vapour_pa = saturation * line(290.0)[0]
    vapour_density = brentq(lambda d: gas(VAPOUR, d, 290.0)[0] - vapour_pa, 0.0, 0.995 * 150.0) if saturation else 0.0
    N2.update(CoolProp.PT_INPUTS, SET_PA - vapour_pa, 290.0)
    tank_kg, tank_u = N2.rhomass() * ullage, N2.umass()
    vapour_kg = vapour_density * ullage
    ullage_j = tank_kg * tank_u + vapour_kg * gas(VAPOUR, vapour_density, 290.0)[1]
    liquid_kg = 0.85 * TANK_M3 * LIQUID_KG_M3
    liquid_j = liquid_kg * line(290.0)[2] + C_SHELL * 290.0
    start = np.array([bottle_kg, bottle_j, 290.0, tank_kg, vapour_kg, ullage_j, liquid_kg, liquid_j])

    def look(y):
        volume = TANK_M3 - y[6] / LIQUID_KG_M3
        rho_n, rho_v = y[3] / volume, y[4] / volume
        t = temperature_of(
            lambda t: y[3] * gas(N2, rho_n, t)[1] + y[4] * gas(VAPOUR, rho_v, t)[1] - y[5], 200.0, 400.0)
        p_n, p_v = gas(N2, rho_n, t)[0], gas(VAPOUR, rho_v, t)[0]
        t_l = temperature_of(lambda t: y[6] * line(t)[2] + C_SHELL * t - y[7], 220.0, 300.0)
        return volume, t, p_n, p_v, t_l

    def rate(_, y):
        volume, t, p_n, p_v, t_l = look(y)
        pressure = p_n + p_v
        t_b, p_b, _, h_b = bottle_of(y[0], y[1])
        p_sat, h_vapour, u_liquid = line(t_l)
        g = min(conductance, volume / (R_N2O * t * SHORTEST))
        evaporation = g * (p_sat - p_v)
        heat_b, heat_u = G_WALL * (y[2] - t_b), G_ULLAGE * (t_l - t)
        room = (flow + evaporation) / LIQUID_KG_M3

        def rates(n):
            return np.array([
                -n, -n * h_b + heat_b, -heat_b / C_WALL,
                n, evaporation, n * h_b + evaporation * h_vapour - pressure * room + heat_u,
                -flow - evaporation,
                -flow * (u_liquid + pressure / LIQUID_KG_M3) - evaporation * h_vapour + pressure * room - heat_u,
            ])

        def pressure_rate(n, step=1e-4):
            ahead, behind = look(y + step * rates(n)), look(y - step * rates(n))
            return (ahead[2] + ahead[3] - behind[2] - behind[3]) / (2.0 * step)

        without = pressure_rate(0.0)
        per_kg = (pressure_rate(0.1) - without) / 0.1
        return rates(max(((SET_PA - pressure) / TAU - without) / per_kg, 0.0))

    run = solve_ivp(rate, (0.0, times[-1]), start, "RK45", t_eval=times, rtol=1e-7, atol=1e-6, max_step=0.2)
    rows = []
    for y in run.y.T:
        _, t, p_n, p_v, t_l = look(y)
        t_b, p_b = bottle_of(y[0], y[1])[:2]
        rows.append([y[0], t_b, p_b, y[2], y[3], y[4], t, p_n + p_v, y[6], t_l])
    return rows


def main():
    lines = [
        "# Nitrogen bottle emptied at a constant rate, and a regulated tank drained at a constant rate.",
        f"# Source: CoolProp {CoolProp.__version__} HEOS, SciPy {scipy.__version__}. Made by: python tools/reference/make_gas_balance_reference.py",
        "# bottle: a wall conductance (W/K), b flow (kg/s), time, then bottle kg, K, Pa, wall K.",
        "# drain: a vapour conductance (kg/(s Pa)), b saturation at the start, time, then bottle kg, K, Pa, wall K, tank",
        "# nitrogen kg, vapour kg, ullage K, tank Pa, liquid kg, liquid K. Liquid leaves at 0.4 kg/s. SI units.",
        "kind,a,b,time_s,bottle_kg,bottle_k,bottle_pa,wall_k,tank_kg,vapor_kg,ullage_k,tank_pa,liquid_kg,liquid_k",
    ]
    for conductance in (0.0, 6.0, 100.0):
        times = [5.0, 15.0, 32.141]
        for time, row in zip(times, bottle_blow_down(conductance, 0.03, times)):
            lines.append(",".join(["bottle", f"{conductance:g}", "0.03", f"{time:g}", *(f"{v:.10g}" for v in row), *[""] * 6]))
    for conductance, saturation in ((0.0, 0.0), (1e-9, 0.9), (1.0, 0.9)):
        times = [2.0, 10.0, 25.0]
        for time, row in zip(times, drain(conductance, saturation, 0.4, times)):
            lines.append(",".join(["drain", f"{conductance:g}", f"{saturation:g}", f"{time:g}", *(f"{v:.10g}" for v in row)]))
        print(lines[-1], file=sys.stderr)
    Path("tests/reference/gas_balance.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
