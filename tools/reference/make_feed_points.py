#!/usr/bin/env python3
"""Two-phase flux of nitrous oxide through valve and injector, and nitrogen in bottle and tank, straight from
CoolProp, for tests/reference/feed.rs.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-open-loop.txt
    venv/bin/python tools/reference/make_feed_points.py

writes tests/reference/feed_points.csv and tests/reference/pressurant_points.csv. No tables and no interpolation:
every property is one call of the equation of state.

State 1 is the liquid in the tank; a tank below its vapour pressure holds saturated liquid. State 2 has the enthalpy
of state 1 (the valve throttles). Through either orifice:
  G_SPI = sqrt(2 rho (P - Pd)); G_HEM(P') = rho(P', s) sqrt(2 (h - h(P', s))) on the isentrope, taken at the pressure
  of its maximum where Pd is below that; kappa = sqrt((P - Pd)/(Pv - Pd)), infinite from Pd = Pv on;
  G = kappa/(1 + kappa) G_SPI + 1/(1 + kappa) G_HEM.
"""

import math
import platform
from pathlib import Path

import CoolProp
import scipy
from CoolProp import AbstractState
from scipy.optimize import brentq, minimize_scalar

OUTPUT = Path(__file__).resolve().parents[2] / "tests" / "reference"
TANKS = [(65e5, 290.0), (65e5, 283.0), (65e5, 298.0), (55e5, 290.0), (48e5, 290.0), (40e5, 290.0), (75e5, 270.0)]
FLOOR_PA = 1.2e5

n2o = AbstractState("HEOS", "N2O")
n2 = AbstractState("HEOS", "Nitrogen")


def call(fluid, inputs, a, b):
    fluid.update(inputs, a, b)
    return fluid.rhomass(), fluid.hmass(), fluid.smass()


def saturated(p):
    return call(n2o, CoolProp.PQ_INPUTS, p, 0.0), call(n2o, CoolProp.PQ_INPUTS, p, 1.0)


def mixed(p, which, value):
    """Quality, density, enthalpy, entropy at a pressure where property `which` (1 h, 2 s) has a value."""
    liquid, vapour = saturated(p)
    x = (value - liquid[which]) / (vapour[which] - liquid[which])
    volume = (1.0 - x) / liquid[0] + x / vapour[0]
    return (x, 1.0 / volume, *((1.0 - x) * liquid[i] + x * vapour[i] for i in (1, 2)))


def boiling_pressure(which, value, low, high):
    """Pressure at which saturated liquid has this enthalpy or entropy."""
    return brentq(lambda p: saturated(p)[0][which] - value, low, high, xtol=1e-4, rtol=1e-15)


class Upstream:
    def __init__(self, p, rho, h, s, vapour_pa):
        self.p, self.rho, self.h, self.s, self.vapour_pa = p, rho, h, s, vapour_pa
        if vapour_pa >= p:
            self.onset_pa = p
        else:
            self.onset_pa = boiling_pressure(2, s, 1.0e5, vapour_pa)
        low = math.log(1.01e5)
        best = minimize_scalar(
            lambda x: -self.equilibrium(math.exp(x)), bounds=(low, math.log(self.onset_pa)), method="bounded",
            options={"xatol": 1e-9},
        )
        at_onset = self.equilibrium(self.onset_pa) if self.onset_pa < p else 0.0
        self.critical_pa, self.critical_flux = max(
            (math.exp(best.x), -best.fun), (self.onset_pa, at_onset), key=lambda pair: pair[1]
        )

    def equilibrium(self, p):
        if p >= self.onset_pa:
            rho, h, _ = call(n2o, CoolProp.PSmass_INPUTS, p, self.s)
        else:
            _, rho, h, _ = mixed(p, 2, self.s)
        return rho * math.sqrt(2.0 * max(self.h - h, 0.0))

    def flux(self, downstream_pa):
        if downstream_pa >= self.p:
            return 0.0, 0.0, 0.0
        drop = self.p - downstream_pa
        spi = math.sqrt(2.0 * self.rho * drop)
        if downstream_pa >= self.vapour_pa:
            return spi, spi, 0.0
        hem = self.critical_flux if downstream_pa <= self.critical_pa else self.equilibrium(downstream_pa)
        weight = 1.0 / (1.0 + math.sqrt(drop / (self.vapour_pa - downstream_pa)))
        return (1.0 - weight) * spi + weight * hem, spi, hem


def feed_rows():
    for tank_pa, tank_k in TANKS:
        n2o.update(CoolProp.QT_INPUTS, 0.0, tank_k)
        vapour = n2o.p()
        if vapour >= tank_pa:
            (rho, h, s), _ = saturated(tank_pa)
            vapour = tank_pa
        else:
            rho, h, s = call(n2o, CoolProp.PT_INPUTS, tank_pa, tank_k)
        tank = Upstream(tank_pa, rho, h, s, vapour)
        flash = tank_pa if vapour >= tank_pa else boiling_pressure(1, h, 5e5, vapour)
        shares = [0.10, 0.16, 0.24, 0.33, 0.42, 0.51, 0.60, 0.68, 0.76, 0.84, 0.91, 0.96, 0.985, 0.999]
        pressures = [share * tank_pa for share in shares]
        # Close to either side of the flash point and of the vapour pressure.
        pressures += [p for edge in (flash, vapour) for p in (0.9995 * edge, 1.0005 * edge) if p < 0.9999 * tank_pa]
        for p2 in sorted(set(pressures)):
            if p2 < flash:
                quality, rho2, _, s2 = mixed(p2, 1, h)
                inlet = Upstream(p2, rho2, h, s2, p2)
            else:
                quality = 0.0
                rho2, _, s2 = call(n2o, CoolProp.HmassP_INPUTS, h, p2)
                t2 = n2o.T()
                n2o.update(CoolProp.QT_INPUTS, 0.0, t2)
                inlet = Upstream(p2, rho2, h, s2, min(n2o.p(), p2))
            valve, valve_spi, valve_hem = tank.flux(p2)
            for share in (0.12, 0.35, 0.55, 0.75, 0.9, 0.97):
                chamber = max(share * p2, FLOOR_PA)
                flux, spi, hem = inlet.flux(chamber)
                yield (tank_pa, tank_k, rho, vapour, flash, tank.critical_pa, p2, quality, rho2, inlet.vapour_pa,
                       valve_spi, valve_hem, valve, inlet.critical_pa, chamber, spi, hem, flux)


def pressurant_rows():
    """Eq 13 with a regulator: total mass, ullage -> where the nitrogen is; 290 K, 9 litres, 65 bar set, 15 bar drop."""
    kelvin, bottle_m3, set_pa, drop_pa = 290.0, 9e-3, 65e5, 15e5

    def density(p):
        return call(n2, CoolProp.PT_INPUTS, p, kelvin)[0]

    def pressure(rho):
        n2.update(CoolProp.DmassT_INPUTS, rho, kelvin)
        return n2.p()

    for total in (2.9717, 2.6, 2.2, 1.9, 1.6, 1.3, 1.0, 0.7, 0.4, 0.2):
        for ullage in (0.00285, 0.006, 0.010, 0.0155):
            tank_pa = set_pa
            tank_kg = ullage * density(tank_pa)
            bottle_kg = total - tank_kg
            regulated = bottle_kg > 0.0 and pressure(bottle_kg / bottle_m3) >= set_pa + drop_pa
            if not regulated:
                tank_pa = brentq(
                    lambda p: ullage * density(p) + bottle_m3 * density(p + drop_pa) - total, 1.01325e5, set_pa,
                    xtol=1e-6, rtol=1e-15,
                ) if ullage * density(1.01325e5) + bottle_m3 * density(1.01325e5 + drop_pa) < total else None
                if tank_pa is None:
                    continue
                tank_kg = ullage * density(tank_pa)
                bottle_kg = total - tank_kg
            yield total, ullage, tank_pa, pressure(bottle_kg / bottle_m3), tank_kg, bottle_kg, float(regulated)


def write(name, what, columns, rows):
    rows = list(rows)
    with open(OUTPUT / name, "w", newline="\n") as out:
        out.write(f"# {what}\n")
        out.write(
            f"# CoolProp {CoolProp.__version__} HEOS (Lemmon and Span 2006; Span et al. 2000), scipy {scipy.__version__}, "
            f"Python {platform.python_version()}. Made by: python tools/reference/make_feed_points.py. SI units.\n"
        )
        out.write(columns + "\n")
        for row in rows:
            out.write(",".join(f"{x:.12g}" for x in row) + "\n")
    print(name, len(rows), "rows")


write(
    "feed_points.csv",
    "Dyer flux of nitrous oxide with choked equilibrium term, tank to injector inlet (P2) to chamber.",
    "tank_pa,tank_k,tank_density,tank_vapor_pa,flash_pa,valve_critical_pa,inlet_pa,quality,inlet_density,"
    "inlet_vapor_pa,valve_spi,valve_hem,valve_flux,injector_critical_pa,chamber_pa,injector_spi,injector_hem,"
    "injector_flux",
    feed_rows(),
)
write(
    "pressurant_points.csv",
    "Nitrogen in a 9 litre bottle and above the liquid, 290 K, 65 bar set, 15 bar least drop: regulated and blowing down.",
    "total_kg,ullage_m3,tank_pa,bottle_pa,tank_kg,bottle_kg,regulated",
    pressurant_rows(),
)
