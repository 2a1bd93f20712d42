#!/usr/bin/env python3
"""Points of the propulsion map by NASA's own CEA, for tests/reference/combustion.rs.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-cea.txt
    venv/bin/python tools/reference/make_propulsion_map_points.py

writes tests/reference/propulsion_map_points.csv: equilibrium (shifting) expansion from an infinite-area
combustor to an area ratio of 3, ideal, no efficiency applied.

Reactants, as the map of the reference vehicle states them. Fuel: 80 % by mass paraffin C32H66 (-938.1 kJ/mol),
20 % ABS C3.85H4.85N0.43 (+62.63 kJ/mol), at 298.15 K. Oxidiser: liquid nitrous oxide at 290 K and 65 bar,
69.826 kJ/mol: 81.600 kJ/mol of the ideal gas at 298.15 K and the real-fluid departure of Lemmon and Span's equation.
A second set of rows (state `gas`) takes the oxidiser as ideal gas at 298.15 K, to show what the oxidiser's state is worth.
"""

import platform
from pathlib import Path

import cea
import numpy as np

OUTPUT = Path(__file__).resolve().parents[2] / "tests" / "reference" / "propulsion_map_points.csv"
AREA_RATIO = 3.0
G0 = 9.80665  # m/s2
ATOM = {"C": 12.011, "H": 1.008, "N": 14.007, "O": 15.999}
# Between the map's own grid lines (0.25 in O/F) and on some of them.
OF = [0.6, 1.0, 1.4, 1.9, 2.3, 2.6, 3.1, 3.5, 3.9, 4.4, 4.9, 5.25, 5.6, 6.1, 6.6, 7.1, 7.9, 8.6, 9.4, 9.9, 11.5, 14.0]
PC_BAR = [7.5, 10.0, 14.0, 20.0, 28.0, 40.0]


def reactant(name, formula, kj_mol, kelvin):
    weight = sum(ATOM[e] * n for e, n in formula.items())
    return cea.Reactant(
        name, formula=formula, molecular_weight=weight, enthalpy=kj_mol, enthalpy_units="kJ/mol", temperature=kelvin
    )


def solver_of(oxidiser_kj_mol, oxidiser_k):
    reactants = [
        reactant("paraffin", {"C": 32.0, "H": 66.0}, -938.1, 298.15),
        reactant("ABS", {"C": 3.85, "H": 4.85, "N": 0.43}, 62.63, 298.15),
        reactant("nitrous oxide", {"N": 2.0, "O": 1.0}, oxidiser_kj_mol, oxidiser_k),
    ]
    mixture = cea.Mixture(reactants)
    products = cea.Mixture(reactants, products_from_reactants=True)
    return mixture, cea.RocketSolver(products, reactants=mixture), np.array([298.15, 298.15, oxidiser_k])


def main():
    rows, failed = [], []
    for state, kj_mol, kelvin in (("liquid", 69.826, 290.0), ("gas", 81.600, 298.15)):
        mixture, solver, temperatures = solver_of(kj_mol, kelvin)
        for of in OF if state == "liquid" else [3.5, 5.25, 7.1]:
            weights = mixture.of_ratio_to_weights(np.array([0.0, 0.0, 1.0]), np.array([0.8, 0.2, 0.0]), of)
            hc = mixture.calc_property(cea.ENTHALPY, weights, temperatures) / cea.R
            for pc in PC_BAR if state == "liquid" else [20.0]:
                solution = cea.RocketSolution(solver)
                solver.solve(solution, weights, pc, [2.5], supar=[AREA_RATIO], hc=hc, iac=True)
                # Chamber, throat, the pressure ratio of 2.5 that the solver asks for, and the exit.
                if not solution.converged or not abs(solution.ae_at[3] - AREA_RATIO) < 1e-4:
                    failed.append((of, pc))
                    continue
                rows.append(
                    (state, of, pc, solution.Isp_vacuum[3] / G0, solution.c_star[3], solution.T[0], solution.MW[0],
                     solution.M[0], solution.gamma_s[1])
                )
    with open(OUTPUT, "w", newline="\n") as out:
        out.write("# Combustion of nitrous oxide with paraffin and ABS, equilibrium, area ratio 3, ideal.\n")
        out.write(f"# NASA CEA, Python package cea {cea.__version__} (numpy {np.__version__}, Python {platform.python_version()}).\n")
        out.write("# Made by: python tools/reference/make_propulsion_map_points.py, which states the reactants.\n")
        out.write(f"# CEA found no expansion at (O/F, bar): {failed}.\n" if failed else "")
        out.write("oxidizer_state,of_ratio,chamber_bar,isp_vac_s,c_star_m_s,t_c_k,mw_g_mol,m_1n_g_mol,gamma_t\n")
        for state, *numbers in rows:
            out.write(state + "," + ",".join(f"{x:.9g}" for x in numbers) + "\n")
    print(OUTPUT, len(rows), "rows")


if __name__ == "__main__":
    main()
