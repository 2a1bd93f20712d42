#!/usr/bin/env python3
"""Predictive control: our solver beside PIQP, HPIPM and Clarabel on the same programs, in turn, in one run.

    python3 -m venv venv && venv/bin/pip install -r tools/compare/requirements-mpc.txt
    cargo build --release -p hopbench --bench mpc
    venv/bin/python tools/compare/mpc_solvers.py target/release/deps/mpc-HASH

The benchmark serves the three hundred programs of `tests/fixture/gusts.rs`, one at a time, and solves each; then PIQP
and HPIPM solve it here, so that all of them share whatever the machine is doing. Times are each solver's least of
REPETITIONS: ours and Clarabel around the call, PIQP and HPIPM as their libraries report it. The reference of the first
input is PIQP at 1e-9. HPIPM is the one inside the wheel of CasADi, called through it.
"""

import json
import subprocess
import sys
import time

import casadi as ca
import numpy as np
import piqp
import scipy.sparse as sp

NX, NU, REPETITIONS = 13, 4, 5
TILT = [6, 7]


def dense(program):
    """Stages in the form of HPIPM: state [x; v], input [u; s], rows of change and tilt between limits."""
    n = len(program["stages"])
    stages = []
    for k, s in enumerate(program["stages"]):
        a, b, c = np.array(s["a"]), np.array(s["b"]), np.array(s["c"])
        q, r, w = np.array(s["q"]), np.array(s["r"]), np.array(s["s"])
        x, u = np.array(s["x"]), np.array(s["u"])
        after = program["stages"][k + 1] if k + 1 < n else program
        low, high = np.array(after["tilt_min"]), np.array(after["tilt_max"])
        big_a = np.zeros((NX + NU, NX + NU))
        big_a[:NX, :NX] = a
        big_b = np.zeros((NX + NU, NU + 2))
        big_b[:NX, :NU] = b
        big_b[NX:, :NU] = np.eye(NU)
        # Rows: change, x - s <= high, x + s >= low with x of the next stage.
        rows_x = np.zeros((NU + 4, NX + NU))
        rows_u = np.zeros((NU + 4, NU + 2))
        rows_x[:NU, NX:] = -np.eye(NU)
        rows_u[:NU, :NU] = np.eye(NU)
        rows_x[NU : NU + 2, :NX] = rows_x[NU + 2 :, :NX] = a[TILT]
        rows_u[NU : NU + 2, :NU] = rows_u[NU + 2 :, :NU] = b[TILT]
        rows_u[NU : NU + 2, NU:] = -np.eye(2)
        rows_u[NU + 2 :, NU:] = np.eye(2)
        change = np.array(s["change"])
        rows_low = np.concatenate([-change, [-np.inf] * 2, low - c[TILT]])
        rows_high = np.concatenate([change, high - c[TILT], [np.inf] * 2])
        hess = np.zeros((NX + 2 * NU + 2,) * 2)
        hess[:NX, :NX] = np.diag(q if k else 0 * q)
        hess[NX : NX + NU, NX : NX + NU] = np.diag(w)
        i = NX + NU
        hess[i : i + NU, i : i + NU] = np.diag(r + w)
        hess[NX : NX + NU, i : i + NU] = hess[i : i + NU, NX : NX + NU] = -np.diag(w)
        hess[i + NU :, i + NU :] = program["l2"] * np.eye(2)
        lin = np.concatenate([-q * x if k else 0 * q, np.zeros(NU), -r * u, [program["l1"]] * 2])
        low_u = np.concatenate([s["min"], [0.0] * 2])
        high_u = np.concatenate([s["max"], [np.inf] * 2])
        stages.append(
            dict(a=big_a, b=big_b, c=np.concatenate([c, np.zeros(NU)]), rows_x=rows_x, rows_u=rows_u,
                 rows_low=rows_low, rows_high=rows_high, hess=hess, lin=lin, low=low_u, high=high_u)
        )
    p = np.block([[np.array(program["pxx"]), np.array(program["pxu"])],
                  [np.array(program["pxu"]).T, np.array(program["puu"])]])
    end = np.concatenate([program["xn"], program["un"]])
    start = np.concatenate([program["x0"], program["previous"]])
    return stages, p, -p @ end, start


def assemble(program):
    """One sparse program in the order of CasADi's HPIPM interface: [z0 w0 z1 w1 ... zN], [gap0 rows0 gap1 ...]."""
    stages, p, p_lin, start = dense(program)
    n, nz, nw, ng = len(stages), NX + NU, NU + 2, NU + 4
    size = n * (nz + nw) + nz
    hess = sp.block_diag([s["hess"] for s in stages] + [p], format="csc")
    lin = np.concatenate([s["lin"] for s in stages] + [p_lin])
    rows = sp.lil_matrix((n * (nz + ng), size))
    low, high = np.full(rows.shape[0], -np.inf), np.full(rows.shape[0], np.inf)
    low_z, high_z = np.full(size, -np.inf), np.full(size, np.inf)
    low_z[:nz] = high_z[:nz] = start
    for k, s in enumerate(stages):
        at, row = k * (nz + nw), k * (nz + ng)
        rows[row : row + nz, at : at + nz] = s["a"]
        rows[row : row + nz, at + nz : at + nz + nw] = s["b"]
        rows[row : row + nz, at + nz + nw : at + 2 * nz + nw] = -np.eye(nz)
        low[row : row + nz] = high[row : row + nz] = -s["c"]
        g = slice(row + nz, row + nz + ng)
        rows[g, at : at + nz] = s["rows_x"]
        rows[g, at + nz : at + nz + nw] = s["rows_u"]
        low[g], high[g] = s["rows_low"], s["rows_high"]
        w = slice(at + nz, at + nz + nw)
        low_z[w], high_z[w] = s["low"], s["high"]
    return hess, lin, rows.tocsc(), low, high, low_z, high_z


def structure(n):
    """Sparsity with every block full, as HPIPM takes them."""
    nz, nw, ng = NX + NU, NU + 2, NU + 4
    hess = ca.diagcat(*([ca.DM.ones(nz + nw, nz + nw)] * n + [ca.DM.ones(nz, nz)])).sparsity()
    mask = np.zeros((n * (nz + ng), n * (nz + nw) + nz))
    for k in range(n):
        at, row = k * (nz + nw), k * (nz + ng)
        mask[row : row + nz + ng, at : at + nz + nw] = 1
        mask[row : row + nz, at + nz + nw : at + 2 * nz + nw] = np.eye(nz)
    return hess, ca.DM(sp.csc_matrix(mask)).sparsity()


class Hpipm:
    def __init__(self, n):
        self.h, self.a = structure(n)
        nz, nw, ng = NX + NU, NU + 2, NU + 4
        tol = {f"res_{kind}_max": 1e-6 for kind in "gbdm"}
        options = {"N": n, "nx": [nz] * (n + 1), "nu": [nw] * n + [0], "ng": [ng] * n + [0],
                   "hpipm": {"mode": "speed_abs", "iter_max": 50, **tol}, "error_on_fail": False}
        self.solver = ca.conic("hpipm", "hpipm", {"h": self.h, "a": self.a}, options)

    def data(self, program):
        hess, lin, rows, low, high, low_z, high_z = program
        return dict(h=ca.project(ca.DM(hess), self.h), g=lin, a=ca.project(ca.DM(rows), self.a),
                    lba=low, uba=high, lbx=low_z, ubx=high_z)

    def solve(self, data):
        start = time.perf_counter()
        out = self.solver(**data)
        wall = time.perf_counter() - start
        stats = self.solver.stats()
        inner = next((stats[k] for k in ("t_proc_solver",) if k in stats), None)
        return np.array(out["x"]).ravel(), (inner if inner is not None else wall) * 1e6, stats


def sparse(tolerance):
    solver = piqp.SparseSolver()
    s = solver.settings
    s.eps_abs, s.eps_rel, s.verbose, s.compute_timings = tolerance, 0.0, False, True
    s.check_duality_gap = True
    s.eps_duality_gap_abs, s.eps_duality_gap_rel = tolerance, 0.0
    return solver


class Piqp:
    """Sparse, structural zeros dropped. Solve time alone: an update would keep the set-up."""

    def __init__(self, tolerance):
        self.tolerance = tolerance

    def solve(self, program):
        hess, lin, rows, low, high, low_z, high_z = program
        equal = low == high
        solver = sparse(self.tolerance)
        csr = rows.tocsr()
        a, g = csr[equal].tocsc(), csr[~equal].tocsc()
        for m in (a, g, hess):
            m.eliminate_zeros()
        solver.setup(hess, lin, a, low[equal], g, low[~equal], high[~equal], low_z, high_z)
        best = np.inf
        for _ in range(REPETITIONS if self.tolerance > 1e-8 else 1):
            solver.solve()
            best = min(best, solver.result.info.solve_time)
        return solver.result.x.copy(), best * 1e6, solver.result.info.status


def main():
    for n in (20, 30):
        bench = subprocess.Popen([sys.argv[1], "--serve", str(n)], stdin=subprocess.PIPE,
                                 stdout=subprocess.PIPE, text=True)

        def ask(number):
            bench.stdin.write(f"{number}\n")
            bench.stdin.flush()
            return json.loads(bench.stdout.readline())

        hpipm, fast, tight = Hpipm(n), Piqp(1e-6), Piqp(1e-9)
        times = {name: [] for name in ("ours", "hpipm", "piqp", "clarabel")}
        errors = {name: [] for name in times}
        first = slice(NX + NU, NX + 2 * NU)
        for number in range(0, 300, int(sys.argv[2]) if len(sys.argv) > 2 else 1):
            served = ask(number)
            program = assemble(served)
            data = hpipm.data(program)
            exact, _, status = tight.solve(program)
            ours = [served["ours_us"]]
            clarabel = [served["clarabel_us"]]
            hp = []
            for _ in range(REPETITIONS):
                x, took, stats = hpipm.solve(data)
                hp.append(took)
            for _ in range(REPETITIONS - 1):
                again = ask(number)
                ours.append(again["ours_us"])
                clarabel.append(again["clarabel_us"])
            y, took, _ = fast.solve(program)
            for name, value in (("ours", min(ours)), ("hpipm", min(hp)), ("piqp", took), ("clarabel", min(clarabel))):
                times[name].append(value)
            for name, u in (("ours", served["first"]), ("clarabel", served["clarabel_first"]),
                            ("hpipm", x[first]), ("piqp", y[first])):
                errors[name].append(np.abs(np.array(u) - exact[first]).max())
            if number == 0:
                print("statistics of HPIPM:", {k: v for k, v in stats.items() if "t_" in k or "iter" in k})
        bench.stdin.write("end\n")
        bench.stdin.close()
        bench.wait()
        print(f"\n| {n} stages | p50 us | p99 us | u0 error p50 | u0 error max |\n|---|---|---|---|---|")
        for name in times:
            t, e = np.array(times[name]), np.array(errors[name])
            print(f"| {name} | {np.percentile(t, 50):.0f} | {np.percentile(t, 99):.0f} "
                  f"| {np.percentile(e, 50):.0e} | {e.max():.0e} |")


if __name__ == "__main__":
    main()
