#!/usr/bin/env python3
"""Least-fuel motions by CVXPY and ECOS, for tests/reference/lcvx.rs.

    python3 -m venv venv && venv/bin/pip install -r tools/reference/requirements-lcvx.txt
    venv/bin/python tools/reference/make_lcvx_points.py

writes, into tests/reference:
  lcvx_problems.csv      twenty problems: descents, diverts and ascents, with the fuel of the optimum
  lcvx_trajectories.csv  their motions at the nodes

The problem is written down as a model in CVXPY, which makes its own cone program of it: Acikmese and Ploen, J. Guidance
30-5, 2007, in the logarithm of mass, thrust per mass linear between nodes. Flight times lie 3 to 25 % above the least,
found by bisection here. Purely vertical flights have one fuel but many motions (thrust upright adds up to g t however it
is spread), so their motion is not compared: column `unique`.
"""

import math
import platform
import warnings
from pathlib import Path

import cvxpy as cp
import numpy as np

OUTPUT = Path(__file__).resolve().parents[2] / "tests" / "reference"
G, REST, LENGTH, NODES = 9.80665, 0.74, 10.0, 30
COLUMNS = (
    "problem,unique,flight_time_s,start_north_m,start_east_m,start_down_m,start_vn_m_s,start_ve_m_s,start_vd_m_s,mass_kg,"
    "target_north_m,target_east_m,target_down_m,target_vd_m_s,thrust_min_n,thrust_max_n,flow_s_m,dry_mass_kg,tilt_rad,"
    "speed_m_s,climb_m_s,sink_m_s,glide_rad,glide_offset_m,fuel_kg"
)


def solve(p, time, tight):
    n, h = NODES, time / (NODES - 1)
    g = np.array([0.0, 0.0, G]) / LENGTH
    r, v, u = cp.Variable((n, 3)), cp.Variable((n, 3)), cp.Variable((n, 3))
    w, sigma = cp.Variable(n), cp.Variable(n)
    start, target = p["start"] / LENGTH, p["target"] / LENGTH
    flow = p["flow"]
    fixed = [
        r[0] == start, v[0] == p["velocity"] / LENGTH, w[0] == 0.0,
        r[n - 1] == target, v[n - 1] == np.array([0.0, 0.0, p["target_vd"]]) / LENGTH, u[n - 1, :2] == 0.0,
    ]
    moving = [
        r[1:] - r[:-1] - h * v[:-1] - h * h * (u[:-1] / 3 + u[1:] / 6) == np.tile(h * h / 2 * g, (n - 1, 1)),
        v[1:] - v[:-1] - h / 2 * (u[:-1] + u[1:]) == np.tile(h * g, (n - 1, 1)),
        w[1:] - w[:-1] == -flow * LENGTH * h / 2 * (sigma[:-1] + sigma[1:]),
    ]
    t = h * np.arange(n)
    lightest = np.maximum(p["mass"] - flow * p["thrust_max"] * t, p["dry"]) / p["mass"]
    heaviest = np.maximum(p["mass"] - flow * p["thrust_min"] * t, p["dry"]) / p["mass"]
    low, high = (p[k] / (p["mass"] * lightest * LENGTH) for k in ("thrust_min", "thrust_max"))
    d = w - np.log(lightest)
    engine = [
        sigma <= cp.multiply(high, 1 - d), cp.multiply(1 / low, sigma) >= 1 - d + cp.square(d) / 2,
        cp.norm(u, axis=1) <= sigma, -u[:, 2] >= math.cos(p["tilt"]) * sigma,
        d[1:] >= 0, w[1:] <= np.log(heaviest[1:]),
    ]
    inner = slice(1, n - 1)
    limits = [
        cp.norm(v[inner], axis=1) <= p["speed"] / LENGTH,
        -v[inner, 2] <= p["climb"] / LENGTH, v[inner, 2] <= p["sink"] / LENGTH,
    ]
    if p["glide"] > 0.0:
        beside = r[inner, :2] - np.tile(target[:2], (n - 2, 1))
        height = target[2] + p["offset"] / LENGTH - r[inner, 2]
        limits.append(cp.norm(beside, axis=1) <= height / math.tan(p["glide"]))
    else:
        limits.append(r[inner, 2] <= max(start[2], target[2]))
    cost = h * (cp.sum(sigma) - (sigma[0] + sigma[n - 1]) / 2)
    problem = cp.Problem(cp.Minimize(cost), fixed + moving + engine + limits)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            problem.solve(solver=cp.ECOS, abstol=tight, reltol=tight, feastol=tight, max_iters=200)
        except cp.SolverError:
            return None
    if problem.status not in ("optimal", "optimal_inaccurate") or r.value is None:
        return None
    return p["mass"] * -math.expm1(w.value[-1]), LENGTH * r.value, LENGTH * v.value, LENGTH * u.value


def least(p):
    low, high = 2.0, 40.0
    while high - low > 0.05:
        middle = (low + high) / 2
        low, high = (low, middle) if solve(p, middle, 1e-7) else (middle, high)
    return high


def problems():
    rng = np.random.default_rng(20)
    for k in range(20):
        vertical, ascent = k in (0, 10), k >= 14 or k == 10
        p = {
            "mass": rng.uniform(70, 80), "thrust_min": rng.uniform(400, 480), "thrust_max": 945.0,
            "flow": 1.0 / (rng.uniform(195, 215) * G), "dry": 60.0, "tilt": math.radians(rng.uniform(10, 15)),
            "speed": 8.0, "climb": 6.0, "sink": 6.0,
        }
        pad, high = np.array([0.0, 0.0, -REST]), rng.uniform(25, 70)
        beside = np.zeros(2) if vertical else rng.uniform(0.1, 0.35, 2) * high * rng.choice([-1, 1], 2)
        up = np.array([*beside, -REST - high])
        if ascent:
            p |= {"start": pad, "target": up, "velocity": np.zeros(3), "target_vd": 0.0, "glide": 0.0, "offset": 0.0}
        else:
            velocity = np.zeros(3) if vertical else rng.uniform([-2, -2, 0], [2, 2, 4])
            p |= {"start": up, "target": pad, "velocity": velocity, "target_vd": 0.5}
            p |= {"glide": math.radians(45), "offset": 0.5}
        time = round(least(p) * rng.uniform(1.03, 1.25), 2)
        yield k, not vertical, time, p


def main():
    made = (
        f"# cvxpy {cp.__version__}, ECOS 2.0.14, numpy {np.__version__}, Python {platform.python_version()}. "
        "Made by: python tools/reference/make_lcvx_points.py. SI units, NED.\n"
    )
    with open(OUTPUT / "lcvx_problems.csv", "w", newline="\n") as heads, open(
        OUTPUT / "lcvx_trajectories.csv", "w", newline="\n"
    ) as motions:
        heads.write("# Least-fuel problems and the fuel of their optimum; no glide slope where glide_rad is 0.\n" + made)
        heads.write(COLUMNS + "\n")
        motions.write("# Motions of lcvx_problems.csv at 30 nodes; u is thrust per mass.\n" + made)
        motions.write("problem,north_m,east_m,down_m,vn_m_s,ve_m_s,vd_m_s,un_m_s2,ue_m_s2,ud_m_s2\n")
        for k, unique, time, p in problems():
            # The tightest accuracy that ECOS reaches.
            fuel, r, v, u = next(x for x in (solve(p, time, tol) for tol in (1e-10, 1e-9, 1e-8)) if x)
            row = [k, int(unique), time, *p["start"], *p["velocity"], p["mass"], *p["target"], p["target_vd"]]
            row += [p[key] for key in ("thrust_min", "thrust_max", "flow", "dry", "tilt", "speed", "climb", "sink")]
            heads.write(",".join(f"{x:.17g}" for x in [*row, p["glide"], p["offset"], fuel]) + "\n")
            for node in np.hstack([r, v, u]):
                motions.write(f"{k}," + ",".join(f"{x:.10g}" for x in node) + "\n")
            print(k, time, fuel)


if __name__ == "__main__":
    main()
