"""Makes the fluid tables of src/fluid/data and the off-grid points that test them.

    python3 -m venv .venv && .venv/bin/pip install -r tools/reference/requirements.txt
    .venv/bin/python tools/reference/make_fluid_tables.py

Run from the repository root. Every table stands on a uniform grid of a variable in which the
property is smooth, so that the reader needs no search and a cubic loses nothing that matters.
"""

import math
from pathlib import Path

import CoolProp
import CoolProp.CoolProp as cp

DATA = Path("src/fluid/data")
POINTS = Path("tests/reference")
COMMAND = "python tools/reference/make_fluid_tables.py"
N2O_EOS = "Lemmon and Span (2006), short Helmholtz equation of state"
N2_EOS = "Span, Lemmon, Jacobsen, Wagner and Yokozeki (2000), reference Helmholtz equation of state"

cp.set_reference_state("N2O", "NBP")
n2o = CoolProp.AbstractState("HEOS", "N2O")
n2 = CoolProp.AbstractState("HEOS", "Nitrogen")
T_CRITICAL = n2o.T_critical()
P_CRITICAL = n2o.p_critical()
R_N2 = n2.gas_constant() / n2.molar_mass()
P_NORMAL = 101325.0


def header(what, eos, *more):
    lines = [what, f"Source: CoolProp {CoolProp.__version__} HEOS, {eos}. Made by: {COMMAND}", *more]
    return "".join(f"# {line}\n" for line in lines)


def write(path, head, columns, rows):
    with open(path, "w", newline="\n") as out:
        out.write(head + ",".join(columns) + "\n")
        for row in rows:
            out.write(",".join(v if isinstance(v, str) else f"{v:.12g}" for v in row) + "\n")
    print(path, len(rows), "rows")


def saturation_at(pressure):
    n2o.update(CoolProp.PQ_INPUTS, pressure, 0.0)
    liquid = (n2o.hmass(), n2o.rhomass(), n2o.smass())
    temperature = n2o.T()
    n2o.update(CoolProp.PQ_INPUTS, pressure, 1.0)
    vapour = (n2o.hmass(), n2o.rhomass(), n2o.smass())
    return [pressure, temperature, liquid[0], vapour[0], liquid[1], vapour[1], liquid[2], vapour[2]]


def psat(temperature):
    n2o.update(CoolProp.QT_INPUTS, 0.0, temperature)
    return n2o.p()


def liquid_at(pressure, temperature, on_saturation_line):
    if on_saturation_line:
        n2o.update(CoolProp.QT_INPUTS, 0.0, temperature)
    else:
        n2o.specify_phase(CoolProp.iphase_liquid)
        n2o.update(CoolProp.PT_INPUTS, pressure, temperature)
        n2o.unspecify_phase()
    return [n2o.rhomass(), n2o.hmass(), n2o.smass()]


def nitrogen_at(pressure, temperature):
    n2.update(CoolProp.PT_INPUTS, pressure, temperature)
    z = pressure / (n2.rhomass() * R_N2 * temperature)
    return [z, n2.hmass(), n2.smass() + R_N2 * math.log(pressure / P_NORMAL)]


def saturation_table():
    x_low, x_high, count = 0.05, math.sqrt(math.log(P_CRITICAL / 0.88e5)), 257
    rows = []
    for i in range(count):
        x = x_low + (x_high - x_low) * i / (count - 1)
        rows.append([x] + saturation_at(P_CRITICAL * math.exp(-x * x)))
    head = header(
        "Nitrous oxide, saturation line.", N2O_EOS,
        f"Critical point: {T_CRITICAL!r} K, {P_CRITICAL!r} Pa. Rows uniform in x = sqrt(ln(P_critical/P)), in which every",
        "property is smooth up to the critical point. Enthalpy and entropy zero at saturated liquid at the normal boiling point.",
    )
    columns = "x,P_Pa,T_K,hL_J_kg,hV_J_kg,rhoL_kg_m3,rhoV_kg_m3,sL_J_kgK,sV_J_kgK".split(",")
    write(DATA / "n2o_saturation.csv", head, columns, rows)


def liquid_table():
    p_top = 85e5
    theta_low, theta_high = math.sqrt(1 - 307.5 / T_CRITICAL), math.sqrt(1 - 183.0 / T_CRITICAL)
    thetas, xis = 81, 13
    rows = []
    for i in range(thetas):
        theta = theta_low + (theta_high - theta_low) * i / (thetas - 1)
        temperature = T_CRITICAL * (1 - theta * theta)
        bottom = psat(temperature)
        for j in range(xis):
            xi = j / (xis - 1)
            pressure = bottom + xi * (p_top - bottom)
            rows.append([theta, xi, pressure, temperature] + liquid_at(pressure, temperature, j == 0))
    head = header(
        "Nitrous oxide, compressed liquid from the saturation line to 85 bar.", N2O_EOS,
        f"Critical point: {T_CRITICAL!r} K, {P_CRITICAL!r} Pa. Uniform grid, xi fastest: theta = sqrt(1 - T/T_critical),",
        "xi = (P - Psat(T))/(85 bar - Psat(T)), so that the grid ends on the saturation line. Reference state as in n2o_saturation.csv.",
    )
    write(DATA / "n2o_liquid.csv", head, "theta,xi,P_Pa,T_K,rho_kg_m3,h_J_kg,s_J_kgK".split(","), rows)


def nitrogen_table():
    rows = []
    for temperature in range(160, 341, 5):
        for bar in range(0, 361, 5):
            # The limit of zero pressure: Z, h and s + R ln P are finite there; 1 Pa is 1e-8 away from it.
            z, h, s = nitrogen_at(max(bar * 1e5, 1.0), float(temperature))
            rows.append([float(temperature), bar * 1e5, z, h, s])
    head = header(
        "Nitrogen gas, 0 to 360 bar, 160 to 340 K, uniform grid, pressure fastest.", N2_EOS,
        f"Z = P/(rho R T) with R = {R_N2!r} J/(kg K). Entropy column: s + R ln(P/101325 Pa), finite at zero pressure.",
    )
    write(DATA / "n2.csv", head, "T_K,P_Pa,Z,h_J_kg,s_plus_R_lnP_J_kgK".split(","), rows)


def gas_table(fluid, path, what, eos, temperatures, densities):
    """Z and u over temperature and density, every state taken as one gas phase, also where it would condense."""
    r = fluid.gas_constant() / fluid.molar_mass()
    fluid.specify_phase(CoolProp.iphase_gas)
    rows = []
    for temperature in temperatures:
        for density in densities:
            # The limit of zero density: 1e-6 kg/m3 is 1e-8 away from it.
            fluid.update(CoolProp.DmassT_INPUTS, max(density, 1e-6), temperature)
            z = fluid.p() / (fluid.rhomass() * r * temperature)
            rows.append([temperature, density, z, fluid.umass()])
    fluid.unspecify_phase()
    head = header(
        what, eos,
        f"Z = P/(rho R T) with R = {r!r} J/(kg K). Uniform grid, density fastest; where the fluid would condense, the",
        "equation of state of the single phase, so that the table is smooth. Reference state as in the other tables.",
    )
    write(DATA / path, head, "T_K,rho_kg_m3,Z,u_J_kg".split(","), rows)


def gas_tables():
    gas_table(
        n2, "n2_gas.csv", "Nitrogen gas over density, 0 to 500 kg/m3, 130 to 430 K.", N2_EOS,
        [130.0 + 5.0 * i for i in range(61)], [10.0 * i for i in range(51)],
    )
    gas_table(
        n2o, "n2o_gas.csv", "Nitrous oxide vapour over density, 0 to 300 kg/m3, 180 to 430 K.", N2O_EOS,
        [180.0 + 5.0 * i for i in range(51)], [7.5 * i for i in range(41)],
    )


def reference_points():
    """Points between the grid lines, on sequences that no grid line follows."""
    golden = 0.6180339887498949
    rows = []
    for i in range(1, 60):
        u, v = (i * golden) % 1.0, (i * golden * golden * 1.7) % 1.0
        pressure = 0.9e5 * (71.5 / 0.9) ** u
        rows.append(["saturation", pressure] + saturation_at(pressure)[1:])
        temperature = 200.0 + 106.0 * u
        pressure = psat(temperature) + v * (82e5 - psat(temperature))
        rows.append(["liquid", pressure, temperature] + liquid_at(pressure, temperature, False) + [""] * 3)
        temperature, pressure = 170.0 + 165.0 * u, 1e5 + 345e5 * v
        n2.update(CoolProp.PT_INPUTS, pressure, temperature)
        rows.append(["nitrogen", pressure, temperature, n2.rhomass(), n2.hmass(), n2.smass(), n2.umass(), "", ""])
    head = header(
        "Points between the grid lines of the fluid tables.", f"{N2O_EOS}; {N2_EOS}",
        "saturation: P, T, hL, hV, rhoL, rhoV, sL, sV. liquid: P, T, rho, h, s. nitrogen: P, T, rho, h, s, u. SI units.",
    )
    write(POINTS / "fluid_points.csv", head, "kind,P_Pa,T_K,a,b,c,d,e,f".split(","), rows)


if __name__ == "__main__":
    saturation_table()
    liquid_table()
    nitrogen_table()
    gas_tables()
    reference_points()
