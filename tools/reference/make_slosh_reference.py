#!/usr/bin/env python3
"""Reference numbers of the sloshing modes for tests/reference/slosh.rs, by ways of their own.

Modes: the linear sloshing problem in an upright flat-floored cylinder, azimuthal order one, solved by Ritz's
method with polynomials. The potential is phi(r, z) cos(theta); kinetic energy of the liquid and potential energy of
the surface are quadrature sums, frequency, modal mass and station follow from the generalised eigenvectors. No
Bessel or hyperbolic function appears, nor the closed forms that the plant uses:

    omega^2 = lambda g,     m_n = rho lambda (int x psi dS)^2 / int psi^2 dS,     psi = phi at the surface,
    z_n = M/F - 1/lambda,   F and M force and moment about the floor's centre of the mode's pressure on wall and floor.

Motion: a mass on the nonlinear spring in a tank that is held still or shaken, by DOP853 at a relative tolerance of
1e-13: planar Duffing motion, motion in both axes under either hardening law, damping that grows with the amplitude.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-motion.txt
    venv/bin/python tools/reference/make_slosh_reference.py > tests/reference/slosh.csv
"""

import platform

import numpy as np
import scipy
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

RADIAL, AXIAL, POINTS = 14, 24, 60


def shapes(order, x):
    """Legendre polynomials on [0, 1] and their derivatives at x."""
    values = [legendre.Legendre.basis(k, domain=[0.0, 1.0]) for k in range(order)]
    return np.array([v(x) for v in values]), np.array([v.deriv()(x) for v in values])


def modes(h):
    """lambda R, mass share, station over R of the first two modes at a depth h, all lengths over R."""
    nodes, weights = legendre.leggauss(POINTS)
    x, w = 0.5 * (nodes + 1.0), 0.5 * weights
    pr, dpr = shapes(RADIAL, x**2)  # an odd potential: r times an even function
    f, df = x * pr, pr + 2.0 * x**2 * dpr
    pz, dpz = shapes(AXIAL, x)
    dpz = dpz / h
    # pi int (phi_r^2 + phi^2/r^2 + phi_z^2) r dr dz, the pi left out as in every surface integral.
    rr = (df * w * x) @ df.T + (f / x * w * x) @ (f / x).T
    mr = (f * w * x) @ f.T
    mz, kz = (pz * w) @ pz.T * h, (dpz * w) @ dpz.T * h
    top = shapes(AXIAL, np.array([1.0]))[0][:, 0]
    bottom = shapes(AXIAL, np.array([0.0]))[0][:, 0]
    stiffness = np.kron(rr, mz) + np.kron(mr, kz)
    surface = np.kron(mr, np.outer(top, top))
    # K phi = lambda M phi with a singular M: turned round, the largest 1/lambda are the lowest modes.
    mu, vectors = eigh(surface, stiffness)
    found = []
    for n in (1, 2):
        lam, phi = 1.0 / mu[-n], vectors[:, -n].reshape(RADIAL, AXIAL)
        psi = (phi @ top) @ f
        moment = np.sum(psi * x**2 * w)
        mass = lam * moment**2 / np.sum(psi**2 * x * w) / h  # over rho pi R^2 h
        edge = shapes(RADIAL, np.array([1.0]))[0][:, 0]
        wall = (edge @ phi) @ pz
        floor = (phi @ bottom) @ f
        force = np.sum(wall * w) * h
        turn = np.sum(wall * x * h * w) * h + np.sum(floor * x**2 * w)
        found.append((lam, mass, turn / force - 1.0 / lam))
    return found


def motion(law, k, cubic, damping, baffle, start, drive, times):
    """x, y, x', y' at the times."""

    def rate(t, s):
        p, v = s[:2], s[2:]
        cube = p**3 if law == "per_axis" else p * (p @ p)
        c = damping + baffle * np.sqrt(np.sqrt(k * (p @ p) + v @ v))
        pull = np.array([drive[0] * np.cos(drive[1] * t), 0.0])
        return np.concatenate([v, -k * p - cubic * cube - c * v - pull])

    solution = solve_ivp(rate, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-13, atol=1e-16)
    assert solution.success
    return solution.y.T


print(f"# made by tools/reference/make_slosh_reference.py, python {platform.python_version()},")
print(f"# numpy {np.__version__}, scipy {scipy.__version__}; Ritz {RADIAL} x {AXIAL} polynomials; DOP853 at 1e-13")
print("# mode,number,depth over R,omega^2 R/g,share of the liquid,station above the floor over R")
for h in (0.1, 0.3, 0.7, 1.5, 2.5, 4.5):
    for n, (lam, mass, station) in enumerate(modes(h), 1):
        print(f"mode,{n},{h},{lam:.15g},{mass:.15g},{station:.15g}")

CASES = [
    ("planar", "per_axis", 190.0, 1.05e4, 0.0, 0.0, [0.06, 0.0, 0.0, 0.0], (0.0, 0.0)),
    ("both_axes", "per_axis", 190.0, 1.05e4, 0.8, 0.0, [0.05, 0.01, 0.0, 0.4], (0.0, 0.0)),
    ("rotary", "radial", 190.0, 1.05e4, 0.0, 0.0, [0.05, 0.01, 0.0, 0.4], (0.0, 0.0)),
    ("baffle", "radial", 190.0, 1.05e4, 0.4, 0.9, [0.05, 0.01, 0.0, 0.4], (0.0, 0.0)),
    ("driven", "radial", 190.0, 1.05e4, 0.1, 0.0, [-0.085, 0.001, 0.0, 0.0], (0.6, 15.5)),
]
print("# motion,case,law,stiffness 1/s2,cubic 1/(m2 s2),damping 1/s,baffle,drive m/s2,drive rad/s,time s,x,y m,x',y' m/s")
for name, law, k, cubic, damping, baffle, start, drive in CASES:
    times = np.linspace(0.0, 10.0, 11)
    for t, row in zip(times, motion(law, k, cubic, damping, baffle, start, drive, times)):
        numbers = ",".join(f"{v:.15g}" for v in row)
        print(f"motion,{name},{law},{k},{cubic},{damping},{baffle},{drive[0]},{drive[1]},{t:g},{numbers}")
