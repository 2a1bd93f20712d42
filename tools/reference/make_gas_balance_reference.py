"""Makes tests/reference/gas_balance.csv: a bottle that empties, drains of a tank, a regulator, by CoolProp and SciPy.

    python3 -m venv .venv && .venv/bin/pip install -r tools/reference/requirements-gas-balance.txt
    .venv/bin/python tools/reference/make_gas_balance_reference.py

Run from the repository root. Another formulation than the library's: the states are masses and internal
energies, temperatures and pressures are found from them by CoolProp's own equations of state at every call, and
DOP853 integrates with a relative tolerance of 1e-9. The regulator's law is the library's, P' = (P1 - P)/tau, solved
for the flow with the numerical derivative of the pressures; so is the blow-down at a constant drop below the bottle.
Nothing limits the evaporation here. Liquid that boils stays within one BOILING_S of its vapour pressure, twenty
times nearer than the library's.
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
SET_PA, DROP_PA, TAU, BOILING_S = 65e5, 15e5, 0.02, 0.001
LOCKUP_KG_S = 2e-3


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


def drain(conductance, saturation, flow, times, bottle_pa=300e5, droop=0.0, lockup=0.0):
    """Liquid out of a tank at constant rate, bottle and ullage with their balances."""
    N2.update(CoolProp.PT_INPUTS, bottle_pa, 290.0)
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
        boiling = volume / (R_N2O * t * BOILING_S) * max(p_sat - pressure, 0.0)
        evaporation = conductance * (p_sat - p_v) + boiling
        heat_b, heat_u = G_WALL * (y[2] - t_b), G_ULLAGE * (t_l - t)
        room = (flow + evaporation) / LIQUID_KG_M3

        def rates(n):
            return np.array([
                -n, -n * h_b + heat_b, -heat_b / C_WALL,
                n, evaporation, n * h_b + evaporation * h_vapour - pressure * room + heat_u,
                -flow - evaporation,
                -flow * (u_liquid + pressure / LIQUID_KG_M3) - evaporation * h_vapour + pressure * room - heat_u,
            ])

        def pressure_rates(n, step=1e-4):
            ahead, behind = y + step * rates(n), y - step * rates(n)
            (_, _, n_1, v_1, _), (_, _, n_0, v_0, _) = look(ahead), look(behind)
            bottle = bottle_of(ahead[0], ahead[1])[1] - bottle_of(behind[0], behind[1])[1]
            return np.array([n_1 + v_1 - n_0 - v_0, bottle]) / (2.0 * step)

        tank_0, bottle_0 = pressure_rates(0.0)
        tank_per_kg, bottle_per_kg = (pressure_rates(0.1) - [tank_0, bottle_0]) / 0.1

        # TAU P' = P1(n) - P with P1 = set - droop n, and the lock-up that LOCKUP_KG_S uses up.
        def toward(outlet, fall):
            return ((outlet - pressure) / TAU - tank_0) / (tank_per_kg + fall / TAU)

        n = toward(SET_PA, droop)
        if lockup and n < LOCKUP_KG_S:
            n = toward(SET_PA + lockup, droop + lockup / LOCKUP_KG_S)
        # Not nearer to the bottle than the drop: TAU (P - P_b)' = P_b - drop - P.
        blow_down = ((p_b - DROP_PA - pressure) / TAU + bottle_0 - tank_0) / (tank_per_kg - bottle_per_kg)
        return rates(max(min(n, blow_down), 0.0))

    run = solve_ivp(rate, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.2)
    rows = []
    for y in run.y.T:
        _, t, p_n, p_v, t_l = look(y)
        t_b, p_b = bottle_of(y[0], y[1])[:2]
        rows.append([y[0], t_b, p_b, y[2], y[3], y[4], t, p_n + p_v, y[6], t_l])
    return rows


def main():
    lines = [
        "# Nitrogen bottle emptied at a constant rate, and a tank drained at a constant rate, regulated or not.",
        f"# Source: CoolProp {CoolProp.__version__} HEOS, SciPy {scipy.__version__}. Made by: python tools/reference/make_gas_balance_reference.py",
        "# bottle: a wall conductance (W/K), b flow (kg/s), time, then bottle kg, K, Pa, wall K.",
        "# drain: a vapour conductance (kg/(s Pa)), b saturation at the start, time, then bottle kg, K, Pa, wall K, tank",
        "# nitrogen kg, vapour kg, ullage K, tank Pa, liquid kg, liquid K. Liquid leaves at 0.4 kg/s. SI units.",
        "# droop, lockup: the same with 3.3e6 Pa s/kg of droop and 0.4e5 Pa of lock-up, lockup without liquid leaving.",
        "# blow_down: bottle at 120e5 Pa; the liquid boils before the last row.",
        "kind,a,b,time_s,bottle_kg,bottle_k,bottle_pa,wall_k,tank_kg,vapor_kg,ullage_k,tank_pa,liquid_kg,liquid_k",
    ]
    for conductance in (0.0, 6.0, 100.0):
        times = [5.0, 15.0, 32.141]
        for time, row in zip(times, bottle_blow_down(conductance, 0.03, times)):
            lines.append(",".join(["bottle", f"{conductance:g}", "0.03", f"{time:g}", *(f"{v:.10g}" for v in row), *[""] * 6]))
    # Conductance, saturation, then what is not as on the pad: stratified, slow, near equilibrium.
    drains = [
        ("drain", (0.0, 0.0), {}, (2.0, 10.0, 25.0)),
        ("drain", (1e-9, 0.9), {}, (2.0, 10.0, 25.0)),
        ("drain", (1e-6, 0.9), {}, (2.0, 10.0, 25.0)),
        ("droop", (0.0, 0.0), {"droop": 3.3e6, "lockup": 0.4e5}, (2.0, 10.0)),
        ("lockup", (0.0, 0.0), {"droop": 3.3e6, "lockup": 0.4e5, "flow": 0.0}, (1.0, 5.0)),
        ("blow_down", (0.0, 0.0), {"bottle_pa": 120e5}, (2.0, 10.0, 20.0)),
    ]
    for kind, (conductance, saturation), other, times in drains:
        for time, row in zip(times, drain(conductance, saturation, times=times, **{"flow": 0.4, **other})):
            values = ",".join(f"{v:.10g}" for v in row)
            lines.append(f"{kind},{conductance:g},{saturation:g},{time:g},{values}")
        print(lines[-1], file=sys.stderr)
    Path("tests/reference/gas_balance.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
