#!/usr/bin/env python3
"""The propulsion map of the GT lander from NASA's own equilibrium code, for `engine.map.file`.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-propulsion-map.txt
    venv/bin/python tools/reference/make_propulsion_map.py

writes scenarios/vehicles/gt_lander_map.csv: Y(OF, Pc) = Y20(OF) + kY(OF) ln(Pc/20 bar), a least-squares line in
ln Pc at each mixture ratio, and prints how far it is from the published polynomials of the same engine.

Published of the engine: the reactants (paraffin C73H124, -444600 cal/mol; ABS C3.85H4.85N0.43, +14969 cal/mol;
90/10 by mass, with N2O, all at 298.15 K), the expansion ratio 5.483, and two polynomials in O/F alone, Isp and
C* in m/s. The published enthalpy of N2O is that of the gas. The tank gives liquid: its enthalpy here is that
of the gas at 298.15 K plus the departure of the real fluid at the tank's 294.26 K and 65 bar (Lemmon and Span's
equation of state through CoolProp).
"""

import platform
from importlib.metadata import version
from pathlib import Path

import cea
import CoolProp
import numpy as np
from CoolProp.CoolProp import PropsSI

OUTPUT = Path(__file__).resolve().parents[2] / "scenarios" / "vehicles" / "gt_lander_map.csv"

GRAVITY = 9.80665  # m/s2
MOLAR_MASS_N2O = 44.0128e-3  # kg/mol
ENTHALPY_GAS = 81600.0  # J/mol, formation at 298.15 K, CEA's thermo.inp
TANK_K, TANK_PA = 294.26, 65e5
EXPANSION_RATIO = 5.483
# Richer than 1.5 the exit is below the range of CEA's gas data at the higher pressures.
MIXTURE_RATIOS = np.concatenate([np.arange(1.5, 12.0, 0.25), np.arange(12.0, 15.01, 0.5)])
PRESSURES_BAR = np.array([5.0, 7.5, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0])

# Published polynomials in O/F, powers 0 to 6, both m/s.
PUBLISHED_ISP = [1040.6, 595.11, -250.95, 60.909, -7.3421, 0.4167, -0.009]
PUBLISHED_C_STAR = [693.7, 383.09, -159.09, 38.88, -4.7368, 0.2715, -0.0059]


def liquid_departure():
    """Enthalpy of liquid N2O in the tank less that of the ideal gas at 298.15 K, J/mol."""
    liquid = PropsSI("Hmolar", "T", TANK_K, "P", TANK_PA, "N2O")
    # At 1 Pa the gas is ideal.
    gas = PropsSI("Hmolar", "T", 298.15, "P", 1.0, "N2O")
    return liquid - gas


def solver(enthalpy_n2o):
    """NASA's rocket solver for the blend; returns a function (OF, Pc in bar) -> quantities."""
    def reactant(name, formula, mass, enthalpy, unit):
        return cea.Reactant(
            name=name, formula=formula, molecular_weight=mass, enthalpy=enthalpy, enthalpy_units=unit, temperature=298.15
        )

    c, h, n, o = 12.0107, 1.00794, 14.0067, 15.9994
    names = [
        reactant("paraffin", {"C": 73.0, "H": 124.0}, 73 * c + 124 * h, -444600.0, "cal/mol"),
        reactant("ABS", {"C": 3.85, "H": 4.85, "N": 0.43}, 3.85 * c + 4.85 * h + 0.43 * n, 14969.0, "cal/mol"),
        reactant("N2O_tank", {"N": 2.0, "O": 1.0}, 2 * n + o, enthalpy_n2o, "J/mol"),
    ]
    mixture = cea.Mixture(names)
    rocket = cea.RocketSolver(cea.Mixture(names, products_from_reactants=True), reactants=mixture)
    fuel, oxidant = np.array([0.9, 0.1, 0.0]), np.array([0.0, 0.0, 1.0])
    temperature = np.full(3, 298.15)

    def at(of_ratio, pressure_bar):
        weights = mixture.of_ratio_to_weights(oxidant, fuel, of_ratio)
        enthalpy = mixture.calc_property(cea.ENTHALPY, weights, temperature) / cea.R
        solution = cea.RocketSolution(rocket)
        rocket.solve(solution, weights, pressure_bar, [2.0], supar=[EXPANSION_RATIO], hc=enthalpy, iac=True)
        # Stations: chamber, throat, the pressure ratio that the solver asks for, exit.
        return {
            "isp_vac": solution.Isp_vacuum[-1] / GRAVITY,  # m/s -> s
            "c_star": solution.c_star[-1],
            "temperature": solution.T[0],
            "molar_mass": solution.MW[0],
            "gamma": solution.gamma_s[1],
        }

    return at


def lines(at):
    """Value at 20 bar and slope in ln Pc of each quantity, at each mixture ratio, and the worst residual."""
    logs = np.log(PRESSURES_BAR / 20.0)
    rows, worst = [], {"isp_vac": 0.0, "c_star": 0.0}
    for of_ratio in MIXTURE_RATIOS:
        points = [at(of_ratio, p) for p in PRESSURES_BAR]
        row = [of_ratio]
        for quantity in ("isp_vac", "c_star", "temperature", "molar_mass", "gamma"):
            values = np.array([point[quantity] for point in points])
            slope, value = np.polyfit(logs, values, 1)
            if quantity == "gamma":
                row.append(values[PRESSURES_BAR == 20.0][0])
                continue
            row += [value, slope]
            if quantity in worst and 2.5 <= of_ratio <= 10.0:
                worst[quantity] = max(worst[quantity], np.max(np.abs(value + slope * logs - values) / values))
        rows.append(row)
    return rows, worst


def main():
    cea.set_log_level(cea.LOG_NONE)
    departure = liquid_departure()
    liquid, gas = solver(ENTHALPY_GAS + departure), solver(ENTHALPY_GAS)
    rows, worst = lines(liquid)
    head = [
        f"Propulsion map of the GT lander. NASA CEA, package cea {version('cea')}, CoolProp {CoolProp.__version__}, Python {platform.python_version()};"
        " made by tools/reference/make_propulsion_map.py.",
        "Shifting equilibrium, infinite-area combustor. Fuel: 90 % by mass paraffin C73H124 (-444.6 kcal/mol),"
        " 10 % ABS C3.85H4.85N0.43 (+14.969 kcal/mol), as published for the engine.",
        f"Oxidiser: liquid N2O at {TANK_K} K, {TANK_PA * 1e-5:.0f} bar: {(ENTHALPY_GAS + departure) * 1e-3:.3f} kJ/mol"
        f" (gas {ENTHALPY_GAS * 1e-3:.3f}, departure {departure * 1e-3:.3f}). Vacuum impulse at area ratio {EXPANSION_RATIO}.",
        "Y(OF,Pc) = Y20(OF) + kY(OF) ln(Pc/20 bar), least squares over 5 to 50 bar. Worst residual for 2.5 <= OF <= 10:"
        f" Isp_vac {100 * worst['isp_vac']:.2f} %, C* {100 * worst['c_star']:.2f} %. Ideal values: no efficiency.",
    ]
    names = "OF,Isp_vac20_s,k_Isp_vac_s,Cstar20_m_s,k_Cstar_m_s,T_c20_K,k_T_c_K,MW20_g_mol,k_MW_g_mol,gamma_t20"
    with OUTPUT.open("w", newline="\n") as file:
        file.write("".join(f"# {line}\n" for line in head) + names + "\n")
        for row in rows:
            file.write(",".join(f"{value:.7g}" for value in row) + "\n")

    print(f"liquid departure {departure * 1e-3:.3f} kJ/mol")
    print("published polynomials against this map at the published model's chamber pressure;"
          " Isp: ideal at sea level, area ratio 5.483")
    print(f"{'OF':>6} {'Pc bar':>7} {'C* pub':>8} {'C* CEA':>8} {'ratio':>6} {'gas N2O':>8} {'Isp pub':>8} {'Isp CEA':>8} {'ratio':>6}")
    for of_ratio, pressure in [(5.163, 10.76), (5.656, 14.37), (6.064, 17.93), (6.424, 21.51), (6.746, 25.08),
                               (7.040, 28.62), (7.318, 32.22), (7.576, 35.77)]:
        here, with_gas = liquid(of_ratio, pressure), gas(of_ratio, pressure)
        sea_level = here["isp_vac"] * GRAVITY - 101325.0 * EXPANSION_RATIO * here["c_star"] / (pressure * 1e5)
        isp = np.polyval(PUBLISHED_ISP[::-1], of_ratio)
        c_star = np.polyval(PUBLISHED_C_STAR[::-1], of_ratio)
        print(f"{of_ratio:6.3f} {pressure:7.2f} {c_star:8.1f} {here['c_star']:8.1f} {c_star / here['c_star']:6.3f}"
              f" {with_gas['c_star'] / here['c_star']:8.4f} {isp:8.1f} {sea_level:8.1f} {isp / sea_level:6.3f}")


if __name__ == "__main__":
    main()
