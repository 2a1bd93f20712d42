#!/usr/bin/env python3
"""Reference motion for tests/reference/motion.rs, by a formulation of its own.

The plant balances momentum about the gimbal pivot. Here nothing of that is used: the vehicle is a cloud
of point masses, six for the body and six for the swinging engine (same mass, centre and second moments
as the rigid part each stands for) and one for the sloshing liquid. World accelerations of all points are
affine in (pivot acceleration, angular acceleration, slosh acceleration); Gauss's principle of least
constraint picks the one that strays least, in the mass-weighted sense, from the free motion under
gravity and applied forces. Integrated by DOP853 at a relative tolerance of 1e-13.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-motion.txt
    venv/bin/python tools/reference/make_motion_reference.py > tests/reference/motion_reference.csv

Axes: body FRD from the pivot, world NED, quaternion scalar first (NED from body).
"""

import platform

import numpy as np
import scipy
from scipy.integrate import solve_ivp

# Made-up, lopsided on purpose, of the size of the reference vehicle. Inertia about each part's own centre:
# xx, yy, zz, xy, xz, yz.
PARAMETERS = {
    "body_mass_kg": [58.9],
    "body_centre_m": [0.004, -0.006, -0.55],
    "body_inertia_kg_m2": [14.0, 15.0, 2.6, 0.20, -0.30, 0.25],
    "engine_mass_kg": [13.452],
    "engine_centre_m": [0.003, -0.002, 0.20732],
    "engine_inertia_kg_m2": [0.182, 0.190, 0.0377, 0.004, -0.003, 0.002],
    "slosh_mass_kg": [1.05],
    "slosh_station_m": [-0.77],
    "slosh_stiffness_1_s2": [150.0],
    "slosh_damping_1_s": [0.8],
    "slosh_hardening_1_m2_s2": [8000.0],
    # Gimbal angle of each axis: amplitude rad, frequency rad/s, phase rad, of a sine.
    "gimbal_x": [0.090, 6.0, 0.0],
    "gimbal_y": [0.070, 8.5, 0.7],
    # Start: velocity NED, attitude, body rate, slosh displacement and its rate.
    "velocity_ned_m_s": [2.0, -1.0, -3.0],
    "q_ned_from_body": [0.95, 0.10, -0.25, 0.15],
    "rate_body_rad_s": [0.6, -0.4, 0.9],
    "slosh_m": [0.010, -0.006],
    "slosh_velocity_m_s": [0.05, 0.12],
}
# name: thrust N, gravity m/s2
CASES = {"free": (0.0, 0.0), "powered": (700.0, 9.80665)}
END_S, EVERY_S = 5.0, 0.25


def p(name):
    values = PARAMETERS[name]
    return values[0] if len(values) == 1 else np.array(values)


def cloud(mass, centre, inertia):
    """Six points with the mass, centre and second moments of a rigid part."""
    xx, yy, zz, xy, xz, yz = inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(tensor) * np.eye(3) - tensor  # sum m r r^T
    values, axes = np.linalg.eigh(second)
    assert values.min() > 0.0
    arms = (axes * np.sqrt(3.0 * values / mass)).T
    return np.full(6, mass / 6.0), np.concatenate([centre + arms, centre - arms])


def cross_matrix(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def turn(axis, angle):
    """Rotation about a coordinate axis with its first and second time derivative, by the series
    angle = (value, rate, acceleration)."""
    value, rate, acceleration = angle
    k = cross_matrix(np.eye(3)[axis])
    r = np.eye(3) + np.sin(value) * k + (1 - np.cos(value)) * k @ k
    first, second = k @ r, k @ k @ r  # derivatives by the angle
    return r, first * rate, second * rate**2 + first * acceleration


def product(a, b):
    return a[0] @ b[0], a[1] @ b[0] + a[0] @ b[1], a[2] @ b[0] + 2 * a[1] @ b[1] + a[0] @ b[2]


def sine(name, t):
    amplitude, frequency, phase = p(name)
    x = frequency * t + phase
    return amplitude * np.sin(x), amplitude * frequency * np.cos(x), -amplitude * frequency**2 * np.sin(x)


def rotation(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


BODY = cloud(p("body_mass_kg"), p("body_centre_m"), p("body_inertia_kg_m2"))
ENGINE = cloud(p("engine_mass_kg"), p("engine_centre_m"), p("engine_inertia_kg_m2"))
MASSES = np.concatenate([BODY[0], ENGINE[0], [p("slosh_mass_kg")]])


def rate(t, state, thrust, gravity):
    velocity, q, w = state[3:6], state[6:10], state[10:13]
    s, s_dot = state[13:15], state[15:17]
    world = rotation(q / np.linalg.norm(q))
    # FRD: gimbal_x > 0 turns the engine by -gimbal_x about x, gimbal_y > 0 by -gimbal_y about y.
    engine = product(
        turn(1, [-v for v in sine("gimbal_y", t)]), turn(0, [-v for v in sine("gimbal_x", t)])
    )
    place = np.concatenate([BODY[1], ENGINE[1] @ engine[0].T, [[*s, p("slosh_station_m")]]])
    relative = np.concatenate([np.zeros((6, 3)), ENGINE[1] @ engine[1].T, [[*s_dot, 0.0]]])
    drift = np.concatenate([np.zeros((6, 3)), ENGINE[1] @ engine[2].T, np.zeros((1, 3))])

    # World acceleration of point i: jacobian_i u + bias_i, u = (pivot, angular in body axes, slosh).
    jacobian = np.zeros((13, 3, 8))
    jacobian[:, :, 0:3] = np.eye(3)
    spin = cross_matrix(w)
    for i in range(13):
        jacobian[i, :, 3:6] = -world @ cross_matrix(place[i])
    jacobian[12, :, 6:8] = world[:, 0:2]
    bias = (place @ (spin @ spin).T + 2 * relative @ spin.T + drift) @ world.T

    generalised = np.zeros(8)
    generalised[0:3] = thrust * world @ engine[0] @ np.array([0.0, 0.0, -1.0])
    generalised[6:8] = -p("slosh_mass_kg") * (
        p("slosh_stiffness_1_s2") * s + p("slosh_hardening_1_m2_s2") * s**3 + p("slosh_damping_1_s") * s_dot
    )
    free = np.array([0.0, 0.0, gravity]) - bias
    matrix = np.einsum("i,iaj,iak->jk", MASSES, jacobian, jacobian)
    right = np.einsum("i,iaj,ia->j", MASSES, jacobian, free) + generalised
    u = np.linalg.solve(matrix, right)

    qw, qv = q[0], q[1:]
    q_dot = 0.5 * np.array([-qv @ w, *(qw * w + np.cross(qv, w))])
    return np.concatenate([velocity, u[0:3], q_dot, u[3:6], s_dot, u[6:8]])


def main():
    print(f"# Made by tools/reference/make_motion_reference.py, Python {platform.python_version()}, "
          f"numpy {np.__version__}, scipy {scipy.__version__}, DOP853 rtol 1e-13.")
    print("# Point masses and Gauss's principle; gimbal motion prescribed. Lines with an equals sign are the inputs.")
    for name, values in PARAMETERS.items():
        print(f"# {name} = {' '.join(repr(float(v)) for v in values)}")
    print("case,thrust_n,gravity_m_s2,time_s,north_m,east_m,down_m,vn_m_s,ve_m_s,vd_m_s,qw,qx,qy,qz,"
          "p_rad_s,q_rad_s,r_rad_s,slosh_x_m,slosh_y_m,slosh_vx_m_s,slosh_vy_m_s")
    q = p("q_ned_from_body")
    start = np.concatenate([np.zeros(3), p("velocity_ned_m_s"), q / np.linalg.norm(q), p("rate_body_rad_s"),
                            p("slosh_m"), p("slosh_velocity_m_s")])
    times = np.arange(0.0, END_S + 1e-9, EVERY_S)
    for name, (thrust, gravity) in CASES.items():
        run = solve_ivp(rate, (0.0, END_S), start, method="DOP853", t_eval=times, rtol=1e-13, atol=1e-14,
                        max_step=0.02, args=(thrust, gravity))
        assert run.success, run.message
        for t, state in zip(run.t, run.y.T):
            q = state[6:10] / np.linalg.norm(state[6:10])
            state = np.concatenate([state[:6], q, state[10:]])
            print(f"{name},{thrust},{gravity},{t:.2f}," + ",".join(f"{v:.15g}" for v in state))


if __name__ == "__main__":
    main()
