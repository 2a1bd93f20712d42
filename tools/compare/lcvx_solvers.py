#!/usr/bin/env python3
"""The guidance's cone programs in three solvers: Clarabel as the autopilot runs it, ECOS and QOCO.

    python3 -m venv venv && venv/bin/pip install -r tools/compare/requirements.txt
    venv/bin/python tools/compare/lcvx_solvers.py [BENCH]

BENCH is the benchmark's program; without it `cargo bench -p hopbench --bench lcvx -- --serve` is run. Its data go to all
three, which solve in turn, at a tolerance of 1e-8. Each solver keeps its own time, without Python: the least of all rounds of the
solve alone, in brackets with set-up. Ratios are of those least times of the solve, in brackets the median over the rounds.
"""

import json
import statistics
import subprocess
import sys

import ecos
import numpy as np
import qoco
import scipy.sparse as sp

ROUNDS, TOLERANCE = 51, 1e-8
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
        n, len(p["h"]), len(p["b"]), None, p["c"], p["A"], p["b"], p["G"], p["h"], p["dims"]["l"],
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
    command = [sys.argv[1], "--serve"] if len(sys.argv) > 1 else SERVE
    served = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
    programs = [program(line) for line in iter(served.stdout.readline, "\n")]

    def clarabel_us(index):
        served.stdin.write(f"{index}\n")
        served.stdin.flush()
        whole, solve, iterations = served.stdout.readline().split()
        return float(whole), float(solve), int(iterations)

    print("| program | Clarabel us | ECOS us | QOCO us | of ECOS | of QOCO | iterations |")
    print("|---|---|---|---|---|---|---|")
    for index, (name, nodes, data) in enumerate(programs):
        rounds = [(clarabel_us(index), ecos_us(data), qoco_us(data)) for _ in range(ROUNDS)]
        least = [[min(r[k][j] for r in rounds) for k in range(3)] for j in (1, 0)]
        pairs = [statistics.median(r[0][1] / r[k][1] for r in rounds) for k in (1, 2)]
        cells = [f"{least[0][k]:.0f} ({least[1][k]:.0f})" for k in range(3)]
        cells += [f"{least[0][0] / least[0][k]:.2f} ({pairs[k - 1]:.2f})" for k in (1, 2)]
        its = "/".join(str(rounds[0][k][2]) for k in range(3))
        print(f"| {name}, {nodes} nodes | " + " | ".join([*cells, its]) + " |", flush=True)
        _, ecos_cost, qoco_cost = rounds[0][0], rounds[0][1][3], rounds[0][2][3]
        assert abs(ecos_cost - qoco_cost) < 1e-5 * abs(ecos_cost), (ecos_cost, qoco_cost)
    served.stdin.close()
    served.wait()


if __name__ == "__main__":
    main()
