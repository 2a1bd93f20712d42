#!/usr/bin/env python3
"""Mass, centre of mass and inertia of grain, liquid and ullage by RocketPy, for tests/reference/basilisk.rs.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-rocketpy.txt
    venv/bin/python tools/reference/make_rocketpy_points.py

writes tests/reference/rocketpy_mass_points.csv. RocketPy's hybrid motor burns a cylindrical grain outward and
drains a flat-ended tank; only the geometry is compared, so each row gives the port radius and the liquid's height that
RocketPy had, and what it made of them: mass, centre of mass above the gimbal pivot, moments about that centre.
RocketPy integrates the tank's volume over a radius function and interpolates over `discretize` points.
"""

import importlib.metadata
import platform
from pathlib import Path

import numpy as np
from rocketpy import CylindricalTank, Fluid, HybridMotor, LevelBasedTank

OUTPUT = Path(__file__).resolve().parents[2] / "tests" / "reference" / "rocketpy_mass_points.csv"
RADIUS, LENGTH, FLOOR = 0.095, 0.670, 0.200
BURN_S = 10.0
LIQUID, GAS = 834.3181387, 76.0490694

tank = LevelBasedTank(
    name="nitrous oxide",
    geometry=CylindricalTank(radius_function=RADIUS, height=LENGTH, spherical_caps=False),
    flux_time=BURN_S,
    liquid=Fluid("nitrous oxide", LIQUID),
    gas=Fluid("nitrogen", GAS),
    # RocketPy counts the height from the middle of the tank.
    liquid_height=lambda t: 0.5695 - 0.056 * t - 0.5 * LENGTH,
    discretize=400,
)
motor = HybridMotor(
    thrust_source=700.0,
    burn_time=BURN_S,
    dry_mass=0.001,
    dry_inertia=(1e-6, 1e-6, 1e-6),
    nozzle_radius=0.017,
    grain_number=1,
    grain_density=940.0,
    grain_outer_radius=0.068,
    grain_initial_inner_radius=0.025,
    grain_initial_height=0.250,
    grain_separation=0.0,
    grains_center_of_mass_position=-0.180,
    center_of_dry_mass_position=0.0,
    nozzle_position=-0.430,
)
motor.add_tank(tank, position=FLOOR + 0.5 * LENGTH)

rows = []
for t in np.linspace(0.5, 9.5, 10):
    rows.append((
        motor.solid.grain_inner_radius(t), tank.liquid_height(t) + 0.5 * LENGTH, motor.solid.propellant_mass(t), tank.liquid_mass(t),
        tank.gas_mass(t), motor.propellant_mass(t), motor.center_of_propellant_mass(t), motor.propellant_I_11(t),
        motor.propellant_I_33(t),
    ))
with open(OUTPUT, "w", newline="\n") as out:
    out.write("# Grain, liquid and ullage of the reference vehicle: masses, centre of mass, moments about it.\n")
    out.write(
        f"# RocketPy {importlib.metadata.version('rocketpy')}, numpy {np.__version__}, Python {platform.python_version()}. "
        "Made by: python tools/reference/make_rocketpy_points.py. SI units.\n"
    )
    out.write("port_radius_m,liquid_height_m,fuel_kg,liquid_kg,gas_kg,mass_kg,centre_z_m,ixx_kg_m2,izz_kg_m2\n")
    for row in rows:
        out.write(",".join(f"{x:.12g}" for x in row) + "\n")
print(OUTPUT, len(rows), "rows")
