#!/usr/bin/env python3
"""The guidance's cone programs in three solvers: Clarabel as the autopilot runs it, ECOS and QOCO.

    python3 -m venv venv && venv/bin/pip install -r tools/compare/requirements.txt
    venv/bin/python tools/compare/lcvx_solvers.py [BENCH]

BENCH is the benchmark's program; without it `cargo bench -p hopbench --bench lcvx -- --serve` is run. Its data go to all
three, which solve in turn, at a tolerance of 1e-8, on one core; ratios are medians over the pairs of one round. Each solver
keeps its own time, without Python: of the solve alone, and with set-up.
"""

import json
import os
import statistics
import subprocess
import sys

import ecos
import numpy as np
import qoco
import scipy.sparse as sp

ROUNDS, TOLERANCE = 31, 1e-8
SERVE = ["cargo", "bench", "-q", "-p", "hopbench", "--bench", "lcvx", "--", "--serve"]


def ecos_us(p):
    answer = ecos.solve(
        p["c"], p["G"], p["h"], p["dims"], p["A"], p["b"],
        verbose=False, abstol=TOLERANCE, reltol=TOLERANCE, feastol=TOLERANCE, max_iters=100,
    )
    info = answer["info"]
    # 0 optimal, 10 close to optimal.
    assert info["exitFlag"] in (0, 10), info
    solve, setup = info["timing"]["tsolve"] * 1e6, info["timing"]["tsetup"] * 1e6
    return solve + setup, solve, info["iter"], info["pcost"]


def qoco_us(p):
    solver = qoco.QOCO()
    n = len(p["c"])
    solver.setup(
        n, len(p["b"]), len(p["h"]), None, p["c"], p["A"], p["b"], p["G"], p["h"], p["dims"]["l"],
        len(p["dims"]["q"]), np.array(p["dims"]["q"], dtype=np.int32),
        verbose=False, abstol=TOLERANCE, reltol=TOLERANCE, max_iters=100,
    )
    answer = solver.solve()
    assert "SOLVED" in str(answer.status), answer.status
    solve, setup = answer.solve_time_sec * 1e6, answer.setup_time_sec * 1e6
    return solve + setup, solve, answer.iters, answer.obj


def program(line):
    raw = json.loads(line)
    shape = (len(raw["right"]), len(raw["cost"]))
    matrix = sp.csc_matrix((raw["values"], raw["rows"], raw["column_starts"]), shape=shape)
    matrix.eliminate_zeros()
    right, e = np.array(raw["right"]), raw["equalities"]
    return raw["name"], raw["nodes"], {
        "c": np.array(raw["cost"]), "A": matrix[:e].tocsc(), "b": right[:e], "G": matrix[e:].tocsc(), "h": right[e:],
        "dims": {"l": raw["inequalities"], "q": raw["cones"]},
    }


def main():
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    command = [sys.argv[1], "--serve"] if len(sys.argv) > 1 else SERVE
    served = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
    programs = [program(line) for line in iter(served.stdout.readline, "\n")]

    def clarabel_us(index):
        served.stdin.write(f"{index}\n")
        served.stdin.flush()
        whole, solve, iterations = served.stdout.readline().split()
        return float(whole), float(solve), int(iterations)

    print("| program | Clarabel solve (with set-up), us | ECOS | QOCO | solve / ECOS | / QOCO | with set-up / ECOS | / QOCO | its |")
    print("|---|---|---|---|---|---|---|---|---|")
    for index, (name, nodes, data) in enumerate(programs):
        rounds = []
        for _ in range(ROUNDS):
            rounds.append((clarabel_us(index), ecos_us(data), qoco_us(data)))
        of = lambda f: statistics.median(f(r) for r in rounds)
        cells = [f"{of(lambda r, k=k: r[k][1]):.0f} ({of(lambda r, k=k: r[k][0]):.0f})" for k in range(3)]
        ratios = [f"{of(lambda r, k=k, j=j: r[0][j] / r[k][j]):.2f}" for j in (1, 0) for k in (1, 2)]
        its = "/".join(str(rounds[0][k][2]) for k in range(3))
        print(f"| {name} {nodes} | " + " | ".join(cells + ratios + [its]) + " |", flush=True)
        _, ecos_cost, qoco_cost = rounds[0][0], rounds[0][1][3], rounds[0][2][3]
        assert abs(ecos_cost - qoco_cost) < 1e-5 * abs(ecos_cost), (ecos_cost, qoco_cost)
    served.stdin.close()
    served.wait()


if __name__ == "__main__":
    main()
