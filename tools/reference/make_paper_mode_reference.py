#!/usr/bin/env python3
"""The seed paper's scheme, written from its equations alone, for tests/reference/paper_mode.rs.

Explicit Euler at 0.02 s in the centre of mass. Eq 4 for the port, the sweep of Eq 8 by brute force over every flow,
polynomials by numpy's least squares, Eq 15 by Brent's method on CoolProp's nitrous oxide, Eqs 12, 13 for nitrogen,
Eqs 17 to 20 for the liquid, Eqs 21, 22 about the moving centre of mass. The errata it follows are those listed in
src/propulsion/paper.rs. Angles of valve and P2 are reported, motion does not depend on them: actuators are ideal.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-open-loop.txt
    venv/bin/python tools/reference/make_paper_mode_reference.py

writes tests/reference/paper_mode.csv, the columns spelled as in `hopbench fly --csv`.
"""

import csv
import math
import platform
import tomllib
from pathlib import Path

import CoolProp
import numpy as np
import scipy
from CoolProp import AbstractState
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

ROOT = Path(__file__).resolve().parents[2]
G0 = 9.80665
SEA_LEVEL_PA = 101325.0
XI = 1.8411837813406594
DURATION_S, ROW_EVERY = 5.0, 5  # rows at 10 Hz


def table(path):
    rows = list(csv.reader(line for line in path.read_text().splitlines() if not line.startswith("#")))
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T))


def cross(a, b):
    return np.cross(a, b)


def about(r):
    """r.r E - r r^T."""
    return np.dot(r, r) * np.eye(3) - np.outer(r, r)


def rotation(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def product(a, b):
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


class Nitrous:
    def __init__(self, pressure, temperature):
        self.fluid = AbstractState("HEOS", "N2O")
        self.fluid.update(CoolProp.PT_INPUTS, pressure, temperature)
        self.p1, self.rho1, self.h1 = pressure, self.fluid.rhomass(), self.fluid.hmass()

    def state(self, inputs, a, b):
        self.fluid.update(inputs, a, b)
        return self.fluid.rhomass(), self.fluid.hmass(), self.fluid.smass()

    def line(self, p):
        return self.state(CoolProp.PQ_INPUTS, p, 0.0), self.state(CoolProp.PQ_INPUTS, p, 1.0)

    def upstream(self, p2):
        """Density, entropy, vapour pressure and quality at P2 and h1."""
        liquid, vapour = self.line(p2)
        if self.h1 > liquid[1]:
            x = (self.h1 - liquid[1]) / (vapour[1] - liquid[1])
            return 1.0 / ((1 - x) / liquid[0] + x / vapour[0]), liquid[2] + x * (vapour[2] - liquid[2]), p2, x
        self.fluid.update(CoolProp.HmassP_INPUTS, self.h1, p2)
        rho, s, t = self.fluid.rhomass(), self.fluid.smass(), self.fluid.T()
        self.fluid.update(CoolProp.QT_INPUTS, 0.0, t)
        return rho, s, min(self.fluid.p(), p2), 0.0

    def flux(self, p2, p3):
        """Dyer's flux, equilibrium part isentropic and not choked."""
        rho, s, vapour_pa, _ = self.upstream(p2)
        spi = math.sqrt(2 * rho * (p2 - p3))
        if vapour_pa <= p3:
            return spi
        liquid, vapour = self.line(p3)
        if s > liquid[2]:
            x = (s - liquid[2]) / (vapour[2] - liquid[2])
            h, v = liquid[1] + x * (vapour[1] - liquid[1]), (1 - x) / liquid[0] + x / vapour[0]
        else:
            rho3, h, _ = self.state(CoolProp.PSmass_INPUTS, p3, s)
            v = 1 / rho3
        hem = math.sqrt(max(2 * (self.h1 - h), 0.0)) / v
        kappa = math.sqrt((p2 - p3) / (vapour_pa - p3))
        return (1 - 1 / (1 + kappa)) * spi + hem / (1 + kappa)


class Vehicle:
    def __init__(self):
        folder = ROOT / "scenarios" / "vehicles"
        v = tomllib.loads((folder / "reference.toml").read_text())
        self.v = v
        self.grain, self.nozzle, self.mode = v["engine"]["grain"], v["engine"]["nozzle"], v["paper_mode"]
        self.eta_c = v["engine"]["chamber"]["c_star_efficiency"]
        self.tank, self.bottle, self.slosh = v["feed"]["tank"], v["pressurant"]["bottle"], v["slosh"]
        self.aero, self.rcs = v["aero"], v["rcs"]
        self.n2o = Nitrous(self.tank["pressure_pa"], self.tank["temperature_k"])
        n2 = AbstractState("HEOS", "Nitrogen")
        n2.update(CoolProp.PT_INPUTS, self.tank["pressure_pa"], self.tank["temperature_k"])
        self.rho_n2 = n2.rhomass()
        n2.update(CoolProp.PT_INPUTS, self.bottle["pressure_pa"], self.bottle["temperature_k"])
        self.bottle_kg = n2.rhomass() * self.bottle["volume_m3"]

        # Polynomials of O/F at the reference pressure.
        cea = table(folder / v["engine"]["map"]["file"])
        isp_vac, c_star = (PchipInterpolator(cea["OF"], cea[name]) for name in ("Isp_vac20_s", "Cstar20_m_s"))
        reference_pa = v["engine"]["map"]["reference_pressure_pa"]
        low, high = self.mode["polynomial_of_range"]
        of = np.linspace(low, high, round((high - low) / 0.25) + 1)
        isp = isp_vac(of) - SEA_LEVEL_PA * self.nozzle["expansion_ratio"] * c_star(of) / (reference_pa * G0)
        fit = np.polynomial.Polynomial.fit
        degree = self.mode["polynomial_degree"]
        self.isp, self.c_star = fit(of, isp, degree), fit(of, c_star(of), degree)
        self.of_range = (low, high)

        # Eqs 21, 22: dry parts, body FRD from structural.
        self.dry = []
        for part in v["component"]:
            x, y, z = part["position_m"]
            flip = np.diag([1.0, -1.0, -1.0])
            inertia = flip @ np.array(part["inertia_kg_m2"]) @ flip
            self.dry.append((part["mass_kg"], np.array([x, -y, -z]), inertia))

        self.flows = np.linspace(
            self.mode["oxidizer_flow_min_kg_s"], self.mode["oxidizer_flow_max_kg_s"], self.mode["sweep_points"]
        )

    def port_after(self, radius, flow, dt):
        """Eq 4."""
        g = self.grain
        n, p = g["regression_exponent"], 2 * g["regression_exponent"] + 1
        grown = g["regression_coefficient_si"] * p * (flow / (math.pi * g["port_count"])) ** n * dt
        return (grown + radius**p) ** (1 / p)

    def fuel(self, radius):
        g = self.grain
        area = math.pi * (g["outer_radius_m"] ** 2 - g["port_count"] * radius**2)
        return g["fuel_density_kg_m3"] * g["length_m"] * area

    def candidates(self, state, dt):
        """Fuel flow, thrust and chamber pressure of every flow of the sweep, Eqs 4, 6, 9, 10, 11."""
        port = self.port_after(state["port"], self.flows, dt)
        g = self.grain
        burnt = math.pi * g["port_count"] * g["fuel_density_kg_m3"] * g["length_m"] * (port**2 - state["port"] ** 2)
        fuel = burnt / dt
        of = np.clip(self.flows / fuel, *self.of_range)
        total = self.flows + fuel
        thrust = G0 * self.mode["specific_impulse_efficiency"] * self.isp(of) * total
        throat = math.pi * state["throat"] ** 2 * self.nozzle["discharge_coefficient"]
        pressure = np.maximum(total * self.c_star(of) * self.eta_c / throat, SEA_LEVEL_PA)
        return port, fuel, thrust, pressure

    def inlet(self, flow, chamber_pa):
        """Eq 15."""
        injector = self.v["feed"]["injector"]
        area = injector["discharge_coefficient"] * injector["hole_count"] * math.pi * injector["hole_diameter_m"] ** 2 / 4
        f = lambda p2: area * self.n2o.flux(p2, chamber_pa) - flow
        return brentq(f, chamber_pa * (1 + 1e-9), self.n2o.p1 - 1.0, xtol=1e-3, rtol=1e-14)

    def contents(self, s):
        """Mass, centre and inertia of everything: mass, place, inertia about its own centre."""
        t, g = self.tank, self.grain
        parts = list(self.dry)
        cylinder = lambda m, r, l, z: (m, np.array([0, 0, -z]), m * np.diag([(3 * r * r + l * l) / 12] * 2 + [r * r / 2]))
        height = s["nitrous"] / (self.n2o.rho1 * math.pi * t["radius_m"] ** 2)
        parts.append(cylinder(s["nitrous"], t["radius_m"], height, t["floor_z_m"] + height / 2))
        volume = math.pi * t["radius_m"] ** 2 * t["length_m"] - s["nitrous"] / self.n2o.rho1
        run = self.rho_n2 * volume  # Eq 13
        gas = t["length_m"] - height
        parts.append(cylinder(run, t["radius_m"], gas, t["floor_z_m"] + height + gas / 2))
        b = self.bottle
        bottle = s["nitrogen"] - run
        parts.append(cylinder(bottle, b["radius_m"], b["volume_m3"] / (math.pi * b["radius_m"] ** 2), b["centre_z_m"]))
        fuel, r, ro, l = self.fuel(s["port"]), s["port"], g["outer_radius_m"], g["length_m"]
        own = fuel * np.diag([(3 * (ro * ro + r * r) + l * l) / 12] * 2 + [(ro * ro + r * r) / 2])
        parts.append((fuel, np.array([0, 0, -(g["top_z_m"] - l / 2)]), own))
        mass = sum(m for m, _, _ in parts)
        com = sum(m * r for m, r, _ in parts) / mass
        inertia = sum(i + m * about(r - com) for m, r, i in parts)
        return mass, com, inertia, height, run, bottle


def run():
    vehicle = Vehicle()
    dt = vehicle.mode["step_s"]
    commands = table(ROOT / "tests/reference/paper_mode_commands.csv")
    t, g = vehicle.tank, vehicle.slosh
    volume = math.pi * t["radius_m"] ** 2 * t["length_m"]
    nitrous = (1 - t["ullage_fraction"]) * volume * vehicle.n2o.rho1
    s = {
        "nitrous": nitrous,
        "nitrogen": vehicle.bottle_kg + vehicle.rho_n2 * t["ullage_fraction"] * volume,
        "port": vehicle.grain["port_radius_m"],
        "throat": vehicle.nozzle["throat_diameter_m"] / 2,
        "slosh": np.zeros(2),
        "slosh_rate": np.zeros(2),
        "q": np.array([1.0, 0, 0, 0]),
        "w": np.zeros(3),
    }
    mass, com, *_ = vehicle.contents(s)
    place, velocity = np.array([0, 0, -100.0]) + com, np.zeros(3)  # of the centre of mass
    rows = []
    for k in range(round(DURATION_S / dt) + 1):
        time = k * dt
        row = np.searchsorted(commands["time_s"], time + 1e-9, side="right") - 1
        demand = commands["thrust_n"][row]
        gx, gy = np.radians([commands["gimbal_x_deg"][row], commands["gimbal_y_deg"][row]])
        roll = commands["rcs_roll"][row]

        # Sweep, chamber, port.
        port, fuel, thrust, pressure = vehicle.candidates(s, dt)
        i = int(np.argmin(np.abs(thrust - demand)))
        flow = vehicle.flows[i]

        # Mass properties and loads.
        mass, com, inertia, height, run_kg, bottle_kg = vehicle.contents(s)
        R = rotation(s["q"])
        w = s["w"]
        pivot_velocity = velocity - R @ cross(w, com)
        force = thrust[i] * np.array([math.sin(gy) * math.cos(gx), -math.sin(gx), -math.cos(gy) * math.cos(gx)])
        moment = cross(-com, force)
        centre = np.array([0, 0, -vehicle.aero["centre_of_pressure_z_m"]])
        air = R.T @ pivot_velocity + cross(w, centre)
        areas = np.array([vehicle.aero["drag_area_lateral_m2"]] * 2 + [vehicle.aero["drag_area_axial_m2"]])
        drag = -0.5 * vehicle.v["site"]["air_density_kg_m3"] * np.linalg.norm(air) * areas * air
        force = force + drag
        moment = moment + cross(centre - com, drag)
        arm = math.hypot(*vehicle.rcs["thruster"][0]["position_m"][:2])
        moment = moment + np.array([0, 0, 2 * vehicle.rcs["thrust_n"] * arm * roll])  # a couple

        # Slosh, one way: the rigid solution drives it, its force then acts on the same rigid body.
        radius, h = t["radius_m"], height
        station = np.array([0, 0, -(t["floor_z_m"] + h - 2 * radius / XI * math.tanh(XI * h / (2 * radius)))])
        omega2 = G0 * XI / radius * math.tanh(XI * h / radius)
        rigid = np.linalg.solve(inertia, moment - cross(w, inertia @ w))
        lever = station - com
        driving = force / mass + cross(rigid, lever) + cross(w, cross(w, lever))
        x, xd = s["slosh"], s["slosh_rate"]
        spring = omega2 * x + g["hardening"] * omega2 / radius**2 * x**3 + 2 * g["damping_ratio"] * math.sqrt(omega2) * xd
        m_eq = 0.5 * g["paper_mass_fraction"] * s["nitrous"]
        on_vehicle = np.append(m_eq * spring, 0.0)
        total = force + on_vehicle
        turning = np.linalg.solve(inertia, moment + cross(lever, on_vehicle) - cross(w, inertia @ w))

        # A row shows the state at its time and what the engine did in the step that ended then.
        if k == 0:
            acted = flow, fuel[i], pressure[i], thrust[i]
        if k % ROW_EVERY == 0:
            acted_flow, acted_fuel, acted_pa, acted_n = acted
            p2 = vehicle.inlet(acted_flow, acted_pa)
            pivot = place - R @ com
            area = acted_flow / (vehicle.v["feed"]["valve"]["discharge_coefficient"] * math.sqrt(2 * vehicle.n2o.rho1 * (vehicle.n2o.p1 - p2)))
            rows.append(
                {
                    "time_s": time,
                    **dict(zip(["north_m", "east_m", "down_m"], pivot)),
                    **dict(zip(["vn_m_s", "ve_m_s", "vd_m_s"], pivot_velocity)),
                    **dict(zip(["qw", "qx", "qy", "qz"], s["q"])),
                    **dict(zip(["p_rad_s", "q_rad_s", "r_rad_s"], w)),
                    "mass_kg": mass,
                    **dict(zip(["com_x_m", "com_y_m", "com_z_m"], com * [1, -1, -1])),
                    "ixx_kg_m2": inertia[0, 0],
                    "iyy_kg_m2": inertia[1, 1],
                    "izz_kg_m2": inertia[2, 2],
                    "ixz_kg_m2": inertia[0, 2],
                    "iyz_kg_m2": inertia[1, 2],
                    "nitrous_kg": s["nitrous"],
                    "fuel_kg": vehicle.fuel(s["port"]),
                    "nitrogen_bottle_kg": bottle_kg,
                    "nitrogen_ullage_kg": run_kg,
                    "port_radius_m": s["port"],
                    "throat_radius_m": s["throat"],
                    "oxidizer_kg_s": acted_flow,
                    "fuel_kg_s": acted_fuel,
                    "of_ratio": acted_flow / acted_fuel,
                    "chamber_pa": acted_pa,
                    "injector_inlet_pa": p2,
                    "valve_area_m2": area,
                    "thrust_n": acted_n,
                    "slosh_x_m": x[0],
                    "slosh_y_m": x[1],
                    "slosh_force_x_n": on_vehicle[0],
                    "slosh_force_y_n": on_vehicle[1],
                }
            )

        acted = flow, fuel[i], pressure[i], thrust[i]
        # Euler.
        place = place + velocity * dt
        velocity = velocity + (R @ total / mass + np.array([0, 0, vehicle.v["site"]["gravity_m_s2"]])) * dt
        q = s["q"] + 0.5 * product(s["q"], np.append(0.0, w)) * dt
        rcs_kg_s = abs(roll) * 2 * vehicle.rcs["thrust_n"] / (vehicle.rcs["specific_impulse_s"] * G0)  # Eq 12
        erosion = vehicle.nozzle["erosion_rate_m_s"] * (pressure[i] / vehicle.nozzle["erosion_pressure_pa"]) ** vehicle.nozzle["erosion_exponent"]
        s = {
            "nitrous": s["nitrous"] - flow * dt,
            "nitrogen": s["nitrogen"] - rcs_kg_s * dt,
            "port": port[i],
            "throat": s["throat"] + erosion * dt,
            "slosh": x + xd * dt,
            "slosh_rate": xd + (-spring - driving[:2]) * dt,
            "q": q / np.linalg.norm(q),
            "w": w + turning * dt,
        }
        wall, distance = g["stop_fraction"] * radius, np.linalg.norm(s["slosh"])
        if distance > wall:  # the liquid stops there
            outward = s["slosh"] / distance
            s["slosh"] = outward * wall
            s["slosh_rate"] = s["slosh_rate"] - outward * max(s["slosh_rate"] @ outward, 0.0)
    return rows


def main():
    rows = run()
    path = ROOT / "tests" / "reference" / "paper_mode.csv"
    with path.open("w", newline="") as file:
        file.write("# The seed paper's scheme under tests/reference/paper_mode_commands.csv.\n")
        file.write("# Made by: python tools/reference/make_paper_mode_reference.py; explicit Euler at 0.02 s.\n")
        versions = f"numpy {np.__version__}, scipy {scipy.__version__}, CoolProp {CoolProp.__version__}"
        file.write(f"# Python {platform.python_version()}, {versions}.\n")
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: f"{value:.13g}" for name, value in row.items()})


if __name__ == "__main__":
    main()
