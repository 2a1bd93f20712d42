#!/usr/bin/env python3
"""The open-loop runs a and b flown by a second implementation of the vehicle, for tests/reference/open_loop.rs.

Written from the equations alone. Fluids come from CoolProp, not from the plant's tables; mechanics are the
8 x 8 system of pivot acceleration, angular acceleration and slosh, assembled in the structural frame (origin
at the gimbal pivot, z to the nose) with a north-west-up world, and turned into FRD and NED on output only.
Flow terms of the mass properties come from complex-step derivatives, those of the swinging engine from the
second derivative of its rotation matrix. Integrated by DOP853 from one instant of the schedule or the output
to the next.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-open-loop.txt
    venv/bin/python tools/reference/make_open_loop_reference.py

writes tests/reference/open_loop_*.csv, the columns spelled as in `hopbench fly --csv`.
"""

import bisect
import csv
import math
import platform
import sys
import tomllib
from pathlib import Path

import CoolProp
import numpy as np
import scipy
from CoolProp import AbstractState
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import brentq, minimize_scalar

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ROOT / "scenarios"
OUTPUT = ROOT / "tests" / "reference"
STANDARD_GRAVITY = 9.80665  # m/s2, in specific impulse
GAS_CONSTANT = 8.314462618  # J/(mol K)
SLOSH_ROOT = 1.8411838  # first zero of the derivative of the Bessel function J1
RTOL, ATOL = 1e-11, 1e-13

VARIANTS = {  # name: (run, chamber, gimbal inertia)
    "a_quasi_steady": ("a", "quasi_steady", False),
    "a_filling": ("a", "filling", False),
    "b_quasi_steady_rigid": ("b", "quasi_steady", False),
    "b_quasi_steady_swing": ("b", "quasi_steady", True),
    "b_filling_swing": ("b", "filling", True),
}


def table(path):
    """Columns of a CSV file by name, comment lines left out."""
    rows = csv.reader(line for line in path.read_text().splitlines() if not line.startswith("#"))
    names = next(rows)
    return dict(zip(names, np.array([[float(x) for x in row] for row in rows]).T))


class Curve:
    """A piecewise cubic, evaluated in plain Python, which is fast for one point at a time."""

    def __init__(self, piecewise):
        self.knots = piecewise.x.tolist()
        self.coefficients = piecewise.c.T.tolist()

    def __call__(self, x):
        i = min(max(bisect.bisect_right(self.knots, x) - 1, 0), len(self.coefficients) - 1)
        c3, c2, c1, c0 = self.coefficients[i]
        d = x - self.knots[i]
        return ((c3 * d + c2) * d + c1) * d + c0


class Nitrous:
    """Flux of nitrous oxide from the tank through valve and injector, by Dyer, with choked HEM."""

    def __init__(self, tank_pa, tank_k):
        self.fluid = AbstractState("HEOS", "N2O")
        self.tank_pa = tank_pa
        at_tank = self.liquid(CoolProp.PT_INPUTS, tank_pa, tank_k)
        self.rho1, self.h1, self.s1 = at_tank
        self.fluid.update(CoolProp.QT_INPUTS, 0.0, tank_k)
        self.vapour_pa = self.fluid.p()
        # Saturation line: hL, hV, vL, vV, sL, sV against pressure.
        p = np.arange(2.0e5, 64.0e5 + 1.0, 1.0e4)
        sat = np.array([self.saturation_direct(x) for x in p])
        self.saturated = [Curve(CubicSpline(p, column)) for column in sat.T]
        self.flash_pa = brentq(
            lambda x: self.saturation_direct(x)[0] - self.h1, 30e5, self.vapour_pa, xtol=1e-6, rtol=1e-15
        )
        # The valve's own expansion, isentropic from the tank.
        self.valve_critical_pa, self.valve_critical_flux = self.choke(self.h1, self.s1, tank_pa)
        p = np.linspace(self.valve_critical_pa, self.vapour_pa, 400)
        self.valve_hem = Curve(CubicSpline(p, [self.hem(x, self.h1, self.s1) for x in p]))
        # State 2 (same enthalpy as the tank) and the injector's choked flux against P2: flashing, then liquid.
        self.flashing = self.branch(np.append(np.arange(self.flash_pa, 12.0e5, -1.0e4)[::-1][:-1], self.flash_pa), True)
        self.whole = self.branch(np.append(np.arange(self.flash_pa, tank_pa - 2e4, 1.0e4), tank_pa - 1e3), False)

    def liquid(self, inputs, a, b):
        """Density, enthalpy, entropy of a state that CoolProp names."""
        self.fluid.update(inputs, a, b)
        return self.fluid.rhomass(), self.fluid.hmass(), self.fluid.smass()

    def saturation_direct(self, p):
        out = []
        for quality in (0.0, 1.0):
            self.fluid.update(CoolProp.PQ_INPUTS, p, quality)
            out.append((self.fluid.hmass(), 1.0 / self.fluid.rhomass(), self.fluid.smass()))
        (hl, vl, sl), (hv, vv, sv) = out
        return hl, hv, vl, vv, sl, sv

    def saturation_temperature(self, p):
        self.fluid.update(CoolProp.PQ_INPUTS, p, 0.0)
        return self.fluid.T()

    def hem(self, p, h_up, s_up):
        """Flux of homogeneous equilibrium at pressure p on the isentrope."""
        hl, hv, vl, vv, sl, sv = (curve(p) for curve in self.saturated)
        if s_up > sl:
            x = (s_up - sl) / (sv - sl)
            h, v = hl + x * (hv - hl), vl + x * (vv - vl)
        else:
            rho, h, _ = self.liquid(CoolProp.PSmass_INPUTS, p, s_up)
            v = 1.0 / rho
        return math.sqrt(max(2.0 * (h_up - h), 0.0)) / v

    def choke(self, h_up, s_up, p_up):
        """Pressure and flux of the greatest flux on the isentrope: inside the dome, or where it enters it."""
        low, high = 2.5e5, min(p_up, 63.9e5)
        sl = self.saturated[4]
        enter = brentq(lambda p: s_up - sl(p), low, high, xtol=1e-7, rtol=1e-15) if s_up < sl(high) else high
        enter_flux = self.hem(enter, h_up, s_up) if enter < p_up else 0.0
        # Flat at its top: 1 Pa off costs nothing.
        best = minimize_scalar(
            lambda p: -self.hem(p, h_up, s_up), bounds=(low, enter), method="bounded", options={"xatol": 1.0}
        )
        return max((best.x, -best.fun), (enter, enter_flux), key=lambda pair: pair[1])

    def branch(self, p2, flashing):
        rows = []
        for p in p2:
            hl, hv, vl, vv, sl, sv = self.saturation_direct(p) if flashing else 6 * (0.0,)
            if flashing:
                x = (self.h1 - hl) / (hv - hl)
                rho, s, vapour = 1.0 / (vl + x * (vv - vl)), sl + x * (sv - sl), p
            else:
                # CoolProp's own inversion in (h, P) is good to 1e-8 only; this one goes to round-off.
                temperature = brentq(
                    lambda t: self.liquid(CoolProp.PT_INPUTS, p, t)[1] - self.h1, 270.0, 295.0, xtol=1e-11, rtol=1e-15
                ) if p > self.flash_pa else self.saturation_temperature(p)
                rho, s, x = self.fluid.rhomass(), self.fluid.smass(), 0.0
                self.fluid.update(CoolProp.QT_INPUTS, 0.0, temperature)
                vapour = self.fluid.p()
            rows.append((rho, vapour, x, *self.choke(self.h1, s, p)))
        rows = np.array(rows)
        names = ("rho", "vapour", "quality", "critical_pa", "critical_flux")
        return {name: Curve(CubicSpline(p2, column)) for name, column in zip(names, rows.T)}

    def valve_flux(self, p2):
        spi = math.sqrt(2.0 * self.rho1 * (self.tank_pa - p2))
        if p2 >= self.vapour_pa:
            return spi
        kappa = math.sqrt((self.tank_pa - p2) / (self.vapour_pa - p2))
        hem = self.valve_critical_flux if p2 <= self.valve_critical_pa else self.valve_hem(p2)
        return (kappa * spi + hem) / (1.0 + kappa)

    def injector_flux(self, p2, pc):
        """Negative when the chamber pushes back, so that the balance has one root."""
        if pc >= p2:
            return p2 - pc
        state = self.flashing if p2 < self.flash_pa else self.whole
        spi = math.sqrt(2.0 * state["rho"](p2) * (p2 - pc))
        vapour = p2 if p2 < self.flash_pa else state["vapour"](p2)
        if pc >= vapour:
            return spi
        # A back pressure above the critical one does not occur in the runs; `row` makes sure of it.
        kappa = math.sqrt((p2 - pc) / (vapour - pc))
        return (kappa * spi + state["critical_flux"](p2)) / (1.0 + kappa)

    def quality(self, p2):
        return self.flashing["quality"](p2) if p2 < self.flash_pa else 0.0


class Engine:
    """Steady feed, chamber either quasi-steady or with its gas as state; the nozzle flows full."""

    def __init__(self, vehicle, site):
        self.grain, self.chamber, self.nozzle = (vehicle["engine"][k] for k in ("grain", "chamber", "nozzle"))
        tank, feed = vehicle["feed"]["tank"], vehicle["feed"]
        self.nitrous = Nitrous(tank["pressure_pa"], tank["temperature_k"])
        area = table(SCENARIOS / "vehicles" / feed["valve"]["area_file"])
        self.root_area = PchipInterpolator(area["theta_deg"], np.sqrt(area["area_analytic_mm2"] * 1e-6))
        self.valve_cd = feed["valve"]["discharge_coefficient"]
        injector = feed["injector"]
        self.injector_cd_area = (
            injector["discharge_coefficient"] * injector["hole_count"] * math.pi / 4 * injector["hole_diameter_m"] ** 2
        )
        cea = table(SCENARIOS / "vehicles" / vehicle["engine"]["map"]["file"])
        self.map = {
            key: tuple(Curve(PchipInterpolator(cea["OF"], cea[name])) for name in names)
            for key, names in {
                "isp": ("Isp_vac20_s", "k_Isp_vac_s"),
                "cstar": ("Cstar20_m_s", "k_Cstar_m_s"),
                "tc": ("T_c20_K", "k_T_c_K"),
                "mw": ("MW20_g_mol", "k_MW_g_mol"),
            }.items()
        }
        self.gamma = Curve(PchipInterpolator(cea["OF"], cea["gamma_t20"]))
        self.map_pa = vehicle["engine"]["map"]["reference_pressure_pa"]
        self.ambient_pa = site["pressure_pa"]
        self.exit_area = math.pi / 4 * self.nozzle["throat_diameter_m"] ** 2 * self.nozzle["expansion_ratio"]
        self.exit_z = self.nozzle["exit_z_m"]

    def mapped(self, key, of, pc):
        of = min(max(of, 0.5), 15.0)
        y20, k = self.map[key]
        return y20(of) + k(of) * math.log(pc / self.map_pa)

    def valve_area(self, angle_deg):
        return float(self.root_area(angle_deg)) ** 2

    def fuel_flow(self, oxidizer, port):
        g = self.grain
        n = g["port_count"]
        rate = g["regression_coefficient_si"] * (oxidizer / (math.pi * n * port**2)) ** g["regression_exponent"]
        return 2 * math.pi * port * n * g["length_m"] * g["fuel_density_kg_m3"] * rate, rate

    def steady_chamber_pa(self, flow, of, throat):
        k = flow * self.chamber["c_star_efficiency"] / (math.pi * throat**2 * self.nozzle["discharge_coefficient"])
        pc = k * self.mapped("cstar", of, self.map_pa)
        for _ in range(50):
            new = k * self.mapped("cstar", of, pc)
            if abs(new - pc) < 1e-14 * pc:
                return new
            pc = new
        raise ArithmeticError("chamber pressure does not settle")

    def volume(self, port):
        return self.chamber["dead_volume_m3"] + self.grain["port_count"] * math.pi * port**2 * self.grain["length_m"]

    def gas_constant_temperature(self, of, pc):
        """Rg Tc of the gas, J/kg, its temperature lowered by the combustion efficiency squared."""
        eta = self.chamber["c_star_efficiency"]
        return eta**2 * GAS_CONSTANT / (self.mapped("mw", of, pc) * 1e-3) * self.mapped("tc", of, pc)

    def gas_chamber_pa(self, mass, of, port):
        pc = self.map_pa
        for _ in range(100):
            new = mass * self.gas_constant_temperature(of, pc) / self.volume(port)
            if abs(new - pc) < 1e-14 * pc:
                return new
            pc = new
        raise ArithmeticError("chamber pressure does not settle")

    def feed(self, area, chamber_pa_of_flow):
        """Oxidizer flow and P2; the chamber's pressure is a function of the flow."""

        def excess(p2):
            flow = self.valve_cd * area * self.nitrous.valve_flux(p2)
            return self.injector_cd_area * self.nitrous.injector_flux(p2, chamber_pa_of_flow(flow)) - flow

        p2 = brentq(excess, 13e5, self.nitrous.tank_pa - 2e3, xtol=1e-7, rtol=1e-15)
        return self.valve_cd * area * self.nitrous.valve_flux(p2), p2

    def operate(self, area, port, throat, gas=None):
        """The operating point: flows, pressures, thrust and the rates of the gas in the chamber."""
        if gas is None:
            def chamber_pa(oxidizer):
                fuel, _ = self.fuel_flow(oxidizer, port)
                return self.steady_chamber_pa(oxidizer + fuel, oxidizer / fuel, throat)

            oxidizer, p2 = self.feed(area, chamber_pa)
            fuel, rate = self.fuel_flow(oxidizer, port)
            of, pc, nozzle = oxidizer / fuel, chamber_pa(oxidizer), oxidizer + fuel
        else:
            of, mass = gas[0] / gas[1], gas[0] + gas[1]
            pc = self.gas_chamber_pa(mass, of, port)
            oxidizer, p2 = self.feed(area, lambda _: pc)
            fuel, rate = self.fuel_flow(oxidizer, port)
            nozzle = (
                self.nozzle["discharge_coefficient"] * pc * math.pi * throat**2
                / (self.chamber["c_star_efficiency"] * self.mapped("cstar", of, pc))
            )
        momentum = self.chamber["c_star_efficiency"] * self.nozzle["thrust_efficiency"] * STANDARD_GRAVITY
        thrust = momentum * self.mapped("isp", of, pc) * nozzle - self.ambient_pa * self.exit_area
        gas_rate = None if gas is None else (
            oxidizer - nozzle * gas[0] / mass,
            fuel - nozzle * gas[1] / mass,
        )
        return {
            "oxidizer": oxidizer, "fuel": fuel, "port_rate": rate, "of": of, "pc": pc, "p2": p2, "thrust": thrust,
            "throat_rate": self.nozzle["erosion_rate_m_s"]
            * (pc / self.nozzle["erosion_pressure_pa"]) ** self.nozzle["erosion_exponent"],
            "gas_rate": gas_rate,
        }

    def steady_gas(self, area, port, throat):
        point = self.operate(area, port, throat)
        mass = point["pc"] * self.volume(port) / self.gas_constant_temperature(point["of"], point["pc"])
        fuel = mass / (1.0 + point["of"])
        return [mass - fuel, fuel]

    def assert_valid(self, point, throat):
        """What the runs are assumed to stay inside: a full nozzle, a choked injector."""
        g = self.gamma(point["of"])
        ratio = self.exit_area / (math.pi * throat**2)

        def area_ratio(m):
            return (2 / (g + 1) * (1 + (g - 1) / 2 * m * m)) ** ((g + 1) / (2 * (g - 1))) / m

        mach = brentq(lambda m: area_ratio(m) - ratio, 1.0, 6.0)
        separation_pa = self.ambient_pa / mach * (1 + (g - 1) / 2 * mach**2) ** (g / (g - 1))
        assert point["pc"] > separation_pa, "the nozzle separates"
        state = self.nitrous.flashing if point["p2"] < self.nitrous.flash_pa else self.nitrous.whole
        assert point["pc"] < state["critical_pa"](point["p2"]), "the injector is not choked"


def cross_matrix(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def point_inertia(r):
    """Inertia of a unit mass at r."""
    return r @ r * np.eye(3) - np.outer(r, r)


def second_moment(inertia):
    """Integral of r r^T from the inertia tensor."""
    return 0.5 * np.trace(inertia) * np.eye(3) - inertia


def inertia_of(second):
    return np.trace(second) * np.eye(3) - second


def axial(matrix):
    """Sum of r x a from the sum of r a^T."""
    return np.array([matrix[1, 2] - matrix[2, 1], matrix[2, 0] - matrix[0, 2], matrix[0, 1] - matrix[1, 0]])


def turn(axis, angle, order):
    """Derivative of given order, in the angle, of the rotation about x (0) or y (1)."""
    c, s = math.cos(angle + order * math.pi / 2), math.sin(angle + order * math.pi / 2)
    one = 1.0 if order == 0 else 0.0
    if axis == 0:
        return np.array([[one, 0, 0], [0, c, -s], [0, s, c]])
    return np.array([[c, 0, s], [0, one, 0], [-s, 0, c]])


def rotation(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


class Vehicle:
    """Masses and the equations of motion, all in the structural frame."""

    def __init__(self, vehicle, engine):
        self.data, self.engine, self.site = vehicle, engine, vehicle["site"]
        self.tank = vehicle["feed"]["tank"]
        self.tank_area = math.pi * self.tank["radius_m"] ** 2
        self.liquid_density = engine.nitrous.rho1
        nitrogen = AbstractState("HEOS", "N2")

        def density(table):
            nitrogen.update(CoolProp.PT_INPUTS, table["pressure_pa"], table["temperature_k"])
            return nitrogen.rhomass()

        self.ullage_density = density(self.tank)
        bottle = vehicle["pressurant"]["bottle"]
        volume = self.tank_area * self.tank["length_m"]
        self.start_nitrous = (1 - self.tank["ullage_fraction"]) * volume * self.liquid_density
        self.start_nitrogen = (
            density(bottle) * bottle["volume_m3"] + self.tank["ullage_fraction"] * volume * self.ullage_density
        )
        self.dry, self.swinging = (self.sum_components(f) for f in (lambda c: True, lambda c: c.get("swings", False)))

    def sum_components(self, chosen):
        mass, first, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
        for c in filter(chosen, self.data["component"]):
            r = np.array(c["position_m"])
            mass += c["mass_kg"]
            first += c["mass_kg"] * r
            inertia += np.array(c["inertia_kg_m2"]) + c["mass_kg"] * point_inertia(r)
        return mass, first, inertia

    def ullage_mass(self, nitrous):
        return self.ullage_density * (self.tank_area * self.tank["length_m"] - nitrous / self.liquid_density)

    def fuel_mass(self, port):
        g = self.data["engine"]["grain"]
        area = math.pi * (g["outer_radius_m"] ** 2 - g["port_count"] * port * port)
        return g["fuel_density_kg_m3"] * g["length_m"] * area

    def grain_column(self, port):
        g = self.data["engine"]["grain"]
        mass, length = self.fuel_mass(port), g["length_m"]
        squares = g["outer_radius_m"] ** 2 + port * port
        z = g["top_z_m"] - length / 2
        return np.array([mass, mass * z, mass * (3 * squares + length**2) / 12 + mass * z * z, mass * squares / 2])

    def fluids(self, nitrous, nitrogen, port):
        """Mass, first moment z, Ixx and Izz about the pivot of everything that flows; accepts complex values."""
        t, bottle = self.tank, self.data["pressurant"]["bottle"]

        def cylinder(mass, radius, length, z, roll=1.0):
            across = mass * (3 * radius**2 + length * length) / 12 + mass * z * z
            return np.array([mass, mass * z, across, roll * mass * radius**2 / 2])

        height = nitrous / (self.liquid_density * self.tank_area)
        ullage = self.ullage_mass(nitrous)
        roll = self.data["slosh"]["roll_inertia_factor"]
        return (
            cylinder(nitrous, t["radius_m"], height, t["floor_z_m"] + height / 2, roll)
            + cylinder(ullage, t["radius_m"], t["length_m"] - height, t["floor_z_m"] + (height + t["length_m"]) / 2)
            + cylinder(
                nitrogen - ullage, bottle["radius_m"], bottle["volume_m3"] / (math.pi * bottle["radius_m"] ** 2),
                bottle["centre_z_m"],
            )
            + self.grain_column(port)
        )

    def mass_properties(self, nitrous, nitrogen, port):
        """Mass, first moment and inertia about the pivot; engine straight, liquid frozen."""
        mass, first_z, ixx, izz = self.fluids(nitrous, nitrogen, port)
        return (
            self.dry[0] + mass,
            self.dry[1] + np.array([0, 0, first_z]),
            self.dry[2] + np.diag([ixx, ixx, izz]),
        )

    def slosh_mode(self, nitrous, axial_m_s2):
        s, r = self.data["slosh"], self.tank["radius_m"]
        h = nitrous / (self.liquid_density * self.tank_area)
        tanh = math.tanh(SLOSH_ROOT * h / r)
        stiffness = axial_m_s2 * SLOSH_ROOT / r * tanh
        return {
            "mass": nitrous * 2 * r * tanh / (SLOSH_ROOT * (SLOSH_ROOT**2 - 1) * h),
            "z": self.tank["floor_z_m"] + h - 2 * r / SLOSH_ROOT * math.tanh(SLOSH_ROOT * h / (2 * r)),
            "stiffness": stiffness,
            "damping": max(2 * s["damping_ratio"] * math.sqrt(stiffness), s["minimum_damping_rate_1_s"]),
            "cubic": s["hardening"] * stiffness / r**2,
        }

    def accelerations(self, s, point, gimbal, roll, swing):
        """Specific force A of the pivot, angular acceleration and slosh acceleration from the 8 x 8 system."""
        w, rot = s["w"], rotation(s["q"])
        mass, first, inertia = self.mass_properties(s["nitrous"], s["nitrogen"], s["port"])
        (dx, dy), (dx1, dy1), (dx2, dy2) = gimbal
        engine_turn = turn(1, dy, 0) @ turn(0, dx, 0)

        # Applied forces and moments about the pivot.
        force = point["thrust"] * engine_turn[:, 2]
        aero = self.data["aero"]
        cp = np.array([0, 0, aero["centre_of_pressure_z_m"]])
        air = rot.T @ s["v"] + cross(w, cp)
        areas = np.array([aero["drag_area_lateral_m2"], aero["drag_area_lateral_m2"], aero["drag_area_axial_m2"]])
        drag = -0.5 * self.site["air_density_kg_m3"] * np.linalg.norm(air) * areas * air
        force = force + drag
        moment = cross(cp, drag)
        outflows = [(point["oxidizer"] + point["fuel"], np.array([0, 0, self.engine.exit_z]))]
        rcs, nitrogen_flow = self.data["rcs"], 0.0
        for thruster in rcs["thruster"]:
            if roll != 0 and thruster["pair"] == ("b" if roll > 0 else "a"):
                r, f = np.array(thruster["position_m"]), rcs["thrust_n"] * np.array(thruster["force_direction"])
                force, moment = force + f, moment + cross(r, f)
                flow = rcs["thrust_n"] / (rcs["specific_impulse_s"] * STANDARD_GRAVITY)
                outflows.append((flow, r))
                nitrogen_flow += flow

        # Internal flow: the rates of first moment and inertia by a complex step along the flow rates.
        step = 1e-30
        rates = self.fluids(
            s["nitrous"] - 1j * step * point["oxidizer"], s["nitrogen"] - 1j * step * nitrogen_flow,
            s["port"] + 1j * step * point["port_rate"],
        ).imag / step
        flow_p = np.array([0, 0, rates[1]]) + sum(m * r for m, r in outflows)
        flow_j = np.diag([rates[2], rates[2], rates[3]]) + sum(
            m * point_inertia(r) for m, r in outflows
        )

        # Slosh: the mode's mass is moved from the column to where it is.
        mode = self.slosh_mode(s["nitrous"], max(force[2] / mass, 0.0))
        m_s, at, rate = mode["mass"], np.array([*s["slosh"], mode["z"]]), np.array([*s["slosh_rate"], 0.0])
        assert np.hypot(*s["slosh"]) < self.data["slosh"]["stop_fraction"] * self.tank["radius_m"]
        home = np.array([0, 0, mode["z"]])
        first = first + m_s * (at - home)
        inertia = inertia + m_s * (point_inertia(at) - point_inertia(home))

        if swing:
            grain = self.grain_column(s["port"])
            first_e = self.swinging[1] + np.array([0, 0, grain[1]])
            second_e = second_moment(self.swinging[2] + np.diag([grain[2], grain[2], grain[3]]))
            y, x = [turn(1, dy, k) for k in range(3)], [turn(0, dx, k) for k in range(3)]
            turn1 = y[1] @ x[0] * dy1 + y[0] @ x[1] * dx1
            turn2 = (
                y[2] @ x[0] * dy1**2 + 2 * y[1] @ x[1] * dx1 * dy1 + y[0] @ x[2] * dx1**2
                + y[1] @ x[0] * dy2 + y[0] @ x[1] * dx2
            )
            relative = turn2 + 2 * cross_matrix(w) @ turn1
            force_e = -relative @ first_e
            moment_e = -axial(engine_turn @ second_e @ relative.T)
            first = first + (engine_turn - np.eye(3)) @ first_e
            inertia = inertia + inertia_of(engine_turn @ second_e @ engine_turn.T - second_e)
            force, moment = force + force_e, moment + moment_e

        coriolis = 2 * cross(w, rate)
        left, right = np.zeros((8, 8)), np.zeros(8)
        left[0:3, 0:3], left[0:3, 3:6] = mass * np.eye(3), -cross_matrix(first)
        left[3:6, 0:3], left[3:6, 3:6] = cross_matrix(first), inertia
        left[0:3, 6:8] = m_s * np.eye(3)[:, :2]
        left[3:6, 6:8] = m_s * cross_matrix(at)[:, :2]
        left[6:8, 0:3], left[6:8, 3:6] = m_s * np.eye(3)[:2], -m_s * cross_matrix(at)[:2]
        left[6:8, 6:8] = m_s * np.eye(2)
        right[0:3] = force - cross(w, cross(w, first)) - 2 * cross(w, flow_p) - m_s * coriolis
        right[3:6] = moment - cross(w, inertia @ w) - flow_j @ w - m_s * cross(at, coriolis)
        spring = mode["stiffness"] * s["slosh"] + mode["cubic"] * s["slosh"] ** 3 + mode["damping"] * s["slosh_rate"]
        right[6:8] = -m_s * (spring + (cross(w, cross(w, at)) + coriolis)[:2])
        solved = np.linalg.solve(left, right)
        acceleration = rot @ solved[0:3] - np.array([0, 0, self.site["gravity_m_s2"]])
        return acceleration, solved[3:6], solved[6:8], nitrogen_flow


class Flight:
    """One run: its schedule, its state vector, its integration."""

    SLICES = {"p": slice(0, 3), "v": slice(3, 6), "q": slice(6, 10), "w": slice(10, 13), "slosh": slice(13, 15),
              "slosh_rate": slice(15, 17), "nitrous": 17, "nitrogen": 18, "port": 19, "throat": 20,
              "gimbal": slice(21, 23), "gimbal_rate": slice(23, 25), "gas": slice(25, 27)}
    FLIP = np.array([1.0, -1.0, -1.0])  # structural to FRD, north-west-up to NED

    def __init__(self, run, chamber, swing, vehicle):
        self.scenario = tomllib.loads((SCENARIOS / f"open_loop_{run}.toml").read_text())
        schedule = table(SCENARIOS / self.scenario["commands"])
        self.rows = [dict(zip(schedule, values)) for values in zip(*schedule.values())]
        self.vehicle, self.filling, self.swing = vehicle, chamber == "filling", swing
        self.servo = self.scenario["actuators"].get("gimbal") == "servo"

    def row_at(self, t):
        """The row in force just after t; nothing before the first."""
        found = [row for row in self.rows if row["time_s"] <= t + 1e-9]
        return found[-1] if found else None

    def start(self):
        initial, data = self.scenario["initial"], self.vehicle.data
        y = np.zeros(27)
        at = self.SLICES
        y[at["p"]] = self.FLIP * initial["position_ned_m"]
        y[at["v"]] = self.FLIP * initial["velocity_ned_m_s"]
        q = np.array(initial["q_ned_from_body"])
        y[at["q"]] = q / np.linalg.norm(q) * [1, 1, -1, -1]
        y[at["w"]] = self.FLIP * initial["rate_body_rad_s"]
        y[at["nitrous"]] = initial.get("nitrous_kg", self.vehicle.start_nitrous)
        y[at["nitrogen"]] = initial.get("nitrogen_kg", self.vehicle.start_nitrogen)
        y[at["port"]] = initial.get("port_radius_m", data["engine"]["grain"]["port_radius_m"])
        y[at["throat"]] = initial.get("throat_radius_m", data["engine"]["nozzle"]["throat_diameter_m"] / 2)
        if self.filling:
            area = self.vehicle.engine.valve_area(self.rows[0]["valve_deg"])
            y[at["gas"]] = self.vehicle.engine.steady_gas(area, y[at["port"]], y[at["throat"]])
        return y

    def derivative(self, y, area, target, roll):
        s = {name: y[index] for name, index in self.SLICES.items()}
        rate = np.zeros(27)
        at = self.SLICES
        point = self.vehicle.engine.operate(area, s["port"], s["throat"], s["gas"] if self.filling else None)
        if self.servo:
            g = self.vehicle.data["gimbal"]
            wn = g["natural_frequency_rad_s"]
            second = wn**2 * (target - s["gimbal"]) - 2 * g["damping_ratio"] * wn * s["gimbal_rate"]
            rate[at["gimbal"]], rate[at["gimbal_rate"]] = s["gimbal_rate"], second
            gimbal = s["gimbal"], s["gimbal_rate"], second
        else:
            gimbal = target, np.zeros(2), np.zeros(2)
        a, wd, slosh, nitrogen_flow = self.vehicle.accelerations(s, point, gimbal, roll, self.swing)
        w, q = s["w"], s["q"]
        rate[at["p"]], rate[at["v"]], rate[at["w"]] = s["v"], a, wd
        rate[at["q"]] = 0.5 * np.array([
            -q[1] * w[0] - q[2] * w[1] - q[3] * w[2], q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
            q[0] * w[1] - q[1] * w[2] + q[3] * w[0], q[0] * w[2] + q[1] * w[1] - q[2] * w[0],
        ])
        rate[at["slosh"]], rate[at["slosh_rate"]] = s["slosh_rate"], slosh
        rate[at["nitrous"]], rate[at["nitrogen"]] = -point["oxidizer"], -nitrogen_flow
        rate[at["port"]], rate[at["throat"]] = point["port_rate"], point["throat_rate"]
        if self.filling:
            rate[at["gas"]] = point["gas_rate"]
        return rate

    @staticmethod
    def structural_angles(row):
        """Angles about S x, then y, of a command row; -gimbal_x and +gimbal_y."""
        return np.radians([-row["gimbal_x_deg"], row["gimbal_y_deg"]]) if row else np.zeros(2)

    def fly(self):
        end, delay = self.scenario["duration_s"], self.vehicle.data["gimbal"]["delay_s"] if self.servo else 0.0
        samples = [round(0.1 * k, 10) for k in range(round(end * 10) + 1)]
        edges = {row["time_s"] + d for row in self.rows for d in (0.0, delay) if row["time_s"] + d < end}
        instants = sorted({round(x, 10) for x in edges | set(samples)})
        y, out = self.start(), []
        for t0, t1 in zip(instants, instants[1:] + [None]):
            row = self.row_at(t0)
            area = self.vehicle.engine.valve_area(row["valve_deg"])
            # In servo runs the target lags by the delay, in ideal runs the angle is the command.
            target = self.structural_angles(self.row_at(t0 - delay))
            if t0 in samples:
                out.append(self.row(t0, y, area, target))
            if t1 is None:
                return out
            solved = solve_ivp(
                lambda _, y: self.derivative(y, area, target, row["rcs_roll"]), (t0, t1), y,
                method="DOP853", rtol=RTOL, atol=ATOL,
            )
            assert solved.success, solved.message
            y = solved.y[:, -1]

    def row(self, t, y, area, target):
        s = {name: y[index] for name, index in self.SLICES.items()}
        vehicle = self.vehicle
        point = vehicle.engine.operate(area, s["port"], s["throat"], s["gas"] if self.filling else None)
        vehicle.engine.assert_valid(point, s["throat"])
        mass, first, inertia = vehicle.mass_properties(s["nitrous"], s["nitrogen"], s["port"])
        com = first / mass
        about = inertia - mass * point_inertia(com)
        about = np.outer(self.FLIP, self.FLIP) * about
        angles = s["gimbal"] if self.servo else target
        q = s["q"] / np.linalg.norm(s["q"]) * [1, 1, -1, -1]
        ullage = vehicle.ullage_mass(s["nitrous"])
        p, v, w = (self.FLIP * s[k] for k in ("p", "v", "w"))
        return {
            "time_s": t,
            "north_m": p[0], "east_m": p[1], "down_m": p[2],
            "vn_m_s": v[0], "ve_m_s": v[1], "vd_m_s": v[2],
            "qw": q[0], "qx": q[1], "qy": q[2], "qz": q[3],
            "p_rad_s": w[0], "q_rad_s": w[1], "r_rad_s": w[2],
            "mass_kg": mass, "com_x_m": com[0], "com_y_m": com[1], "com_z_m": com[2],
            "ixx_kg_m2": about[0, 0], "iyy_kg_m2": about[1, 1], "izz_kg_m2": about[2, 2],
            "ixy_kg_m2": about[0, 1], "ixz_kg_m2": about[0, 2], "iyz_kg_m2": about[1, 2],
            "nitrous_kg": s["nitrous"], "fuel_kg": vehicle.fuel_mass(s["port"]),
            "nitrogen_bottle_kg": s["nitrogen"] - ullage, "nitrogen_ullage_kg": ullage,
            "port_radius_m": s["port"], "throat_radius_m": s["throat"],
            "oxidizer_kg_s": point["oxidizer"], "fuel_kg_s": point["fuel"],
            "chamber_pa": point["pc"], "injector_inlet_pa": point["p2"],
            "quality": vehicle.engine.nitrous.quality(point["p2"]), "thrust_n": point["thrust"],
            "gimbal_x_deg": math.degrees(-angles[0]), "gimbal_y_deg": math.degrees(angles[1]),
            "slosh_x_m": s["slosh"][0], "slosh_y_m": -s["slosh"][1],
        }


def main():
    data = tomllib.loads((SCENARIOS / "vehicles" / "reference.toml").read_text())
    vehicle = Vehicle(data, Engine(data, data["site"]))
    OUTPUT.mkdir(exist_ok=True)
    for name in sys.argv[1:] or VARIANTS:
        run, chamber, swing = VARIANTS[name]
        rows = Flight(run, chamber, swing, vehicle).fly()
        with open(OUTPUT / f"open_loop_{name}.csv", "w", newline="\n") as file:
            file.write(
                f"# Open-loop run {run}, chamber {chamber}, gimbal inertia {str(swing).lower()}.\n"
                "# Made by: python tools/reference/make_open_loop_reference.py; a second implementation of the vehicle.\n"
                f"# DOP853, rtol {RTOL}, atol {ATOL}. Python {platform.python_version()}, numpy {np.__version__},"
                f" scipy {scipy.__version__}, CoolProp {CoolProp.__version__}.\n"
            )
            file.write(",".join(rows[0]) + "\n")
            for row in rows:
                file.write(",".join(f"{x:.13g}" for x in row.values()) + "\n")
        print(name, len(rows), "rows", file=sys.stderr)


if __name__ == "__main__":
    main()
