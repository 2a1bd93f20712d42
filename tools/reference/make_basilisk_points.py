#!/usr/bin/env python3
"""A vehicle with a sloshing mass by Basilisk, for tests/reference/basilisk.rs.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-basilisk.txt
    venv/bin/python tools/reference/make_basilisk_points.py

writes tests/reference/basilisk_points.csv. Basilisk's LinearSpringMassDamper moves along one line fixed in the hub, ours
in a plane, so the motion is kept plane (translation along x and z, turning about y), where both are the same
equations. Case `free`: nothing acts. Case `pushed`: a constant force and moment fixed in the body. Case `tumbling` has no slosh and full
three-dimensional motion about unequal moments with products of inertia. RK4 of Basilisk at 0.1 ms.
"""

import importlib.metadata
import platform
from pathlib import Path

import numpy as np
from Basilisk.simulation import extForceTorque, linearSpringMassDamper, spacecraft
from Basilisk.utilities import SimulationBaseClass, macros
from Basilisk.utilities import RigidBodyKinematics as rbk

OUTPUT = Path(__file__).resolve().parents[2] / "tests" / "reference" / "basilisk_points.csv"
STEP_S, END_S, EVERY_S = 1e-4, 5.0, 0.25
HUB_KG, HUB_Z, SLOSH_KG, SLOSH_Z = 70.0, -0.40, 2.5, -0.62
HUB_INERTIA = np.array([[20.0, 0.0, 0.0], [0.0, 22.0, 0.0], [0.0, 0.0, 2.4]])
TUMBLING_INERTIA = np.array([[20.0, 0.7, -0.4], [0.7, 22.0, 0.9], [-0.4, 0.9, 6.4]])
STIFFNESS_1_S2, DAMPING_1_S = 180.0, 0.8


def run(case):
    sim = SimulationBaseClass.SimBaseClass()
    sim.CreateNewProcess("p").addTask(sim.CreateNewTask("t", macros.sec2nano(STEP_S)))
    body = spacecraft.Spacecraft()
    body.hub.mHub = HUB_KG
    body.hub.r_BcB_B = [[0.0], [0.0], [HUB_Z]]
    tumbling = case == "tumbling"
    body.hub.IHubPntBc_B = (TUMBLING_INERTIA if tumbling else HUB_INERTIA).tolist()
    body.hub.r_CN_NInit = [[0.0], [0.0], [0.0]]
    body.hub.v_CN_NInit = [[0.0], [0.0], [0.0]]
    body.hub.sigma_BNInit = [[0.0], [0.0], [0.0]]
    body.hub.omega_BN_BInit = [[0.7], [0.3], [-1.1]] if tumbling else [[0.0], [0.25], [0.0]]
    particle = None
    if not tumbling:
        particle = linearSpringMassDamper.LinearSpringMassDamper()
        particle.k = SLOSH_KG * STIFFNESS_1_S2
        particle.c = SLOSH_KG * DAMPING_1_S
        particle.r_PB_B = [[0.0], [0.0], [SLOSH_Z]]
        particle.pHat_B = [[1.0], [0.0], [0.0]]
        particle.rhoInit = 0.03
        particle.rhoDotInit = -0.1
        particle.massInit = SLOSH_KG
        body.addStateEffector(particle)
    push = extForceTorque.ExtForceTorque()
    if case == "pushed":
        push.extForce_B = [[12.0], [0.0], [-650.0]]
        push.extTorquePntB_B = [[0.0], [3.0], [0.0]]
    body.addDynamicEffector(push)
    for model in (body, push) + ((particle,) if particle else ()):
        sim.AddModelToTask("t", model)
    log = body.scStateOutMsg.recorder(macros.sec2nano(EVERY_S))
    sim.AddModelToTask("t", log)
    sim.InitializeSimulation()
    rows, start = [], None
    for i in range(round(END_S / EVERY_S) + 1):
        sim.ConfigureStopTime(macros.sec2nano(i * EVERY_S))
        sim.ExecuteSimulation()
        state = body.scStateOutMsg.read()
        r = np.array(state.r_BN_N)
        start = r if start is None else start
        v = np.array(state.v_BN_N)
        beta = rbk.MRP2EP(state.sigma_BN)
        rho = 0.0
        if particle:
            rho = body.dynManager.getStateObject(particle.nameOfRhoState).getState()[0][0]
        rows.append((case, i * EVERY_S, *(r - start), *v, *beta, *np.array(state.omega_BN_B), rho))
    return rows


with open(OUTPUT, "w", newline="\n") as out:
    out.write("# Hub and sloshing mass: place and velocity of the body-fixed origin, attitude, rate, slosh along body x.\n")
    out.write(
        f"# Basilisk (bsk) {importlib.metadata.version('bsk')}, RK4 at {STEP_S} s, numpy {np.__version__}, "
        f"Python {platform.python_version()}. Made by: python tools/reference/make_basilisk_points.py, which states the vehicle.\n"
    )
    out.write("case,time_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,qw,qx,qy,qz,wx_rad_s,wy_rad_s,wz_rad_s,slosh_m\n")
    count = 0
    for case in ("free", "pushed", "tumbling"):
        for case, *numbers in run(case):
            out.write(case + "," + ",".join(f"{x:.15g}" for x in numbers) + "\n")
            count += 1
print(OUTPUT, count, "rows")
