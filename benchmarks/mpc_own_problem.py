"""The shipped MPC stated in cvxpy, by each solver that a problem of the user's may have, beside the shipped one.

    python benchmarks/mpc_own_problem.py [--samples 750]

Steps of +-20 mm on the linear model without a planned motion, so that current, its rate and the speed reach their
limits. Prints the table of docs/how-to/own-controller.md: the largest difference of the current, and the median time of
a sample as a multiple of the shipped one's. The runs alternate, so that all see the same machine load. Code by
cvxpygen comes with the extra `cvxpygen`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cvxpy as cp
import numpy as np

import ehsa_ctrl as e
from ehsa_ctrl.design.state_space.mpc import Mpc
from ehsa_ctrl.design.state_space.mpc_compiled import has_cvxpygen

#: Samples between two steps of the reference, and runs of each solver.
PERIOD, RUNS = 150, 3


def restated(law: Mpc, *, cone: bool = False) -> Callable[[Any], Any]:
    """The shipped problem; with a cone that no plan leaves, if asked."""
    limits, penalty = law.problem.limits, law.problem.penalty

    def state(m: Any) -> Any:
        slack = cp.Variable(3, nonneg=True)
        rules = [
            cp.abs(m.speed) / limits.speed <= 1 + slack[0],
            cp.abs(m.pressure) / limits.pressure <= 1 + slack[1],
            cp.abs(m.position) / limits.stroke <= 1 + slack[2],
            *([cp.norm(m.current) <= 1e3] if cone else []),
        ]
        return m.cost + penalty * (cp.sum(slack) + 0.5 * cp.sum_squares(slack)), rules

    return state


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--samples", type=int, default=750)
    samples = parser.parse_args().samples
    linear = e.load_plant("ehsa", model="linear")
    model = e.three_state(linear)

    def mpc(**options: Any) -> Any:
        return replace(e.load_controller("mpc_position", model, **options), trajectory=None)

    shipped = mpc()
    state, with_cone = restated(shipped.law), restated(shipped.law, cone=True)
    laws = {
        "shipped": shipped,
        "own, daqp": mpc(problem=state, compiled=False),
        "own, osqp": mpc(problem=state, compiled=False, solver={"name": "osqp"}),
        **({"own, osqp compiled by cvxpygen": mpc(problem=state, compiled=True)} if has_cvxpygen() else {}),
        "own with a cone, clarabel": mpc(problem=with_cone),
    }
    reference = np.where(np.arange(samples) // PERIOD % 2 == 0, 0.02, -0.02)
    runs = {name: [] for name in laws}
    for _ in range(RUNS):
        for name, law in laws.items():
            runs[name].append(e.run_closed_loop(linear, law, reference))
    first = runs["shipped"][0]
    usual = min(np.median(run["solver_time"]) for run in runs["shipped"])
    print("| problem, solver | largest difference of the current | time | unsolved |\n|---|---|---|---|")
    for name, found in runs.items():
        off = np.max(np.abs(found[0]["asked"] - first["asked"]))
        ratio = min(np.median(run["solver_time"]) for run in found) / usual
        print(f"| {name} | {off:.1g} A | {ratio:.3g} | {np.count_nonzero(found[0]['solver_reason'])} |")


if __name__ == "__main__":
    main()
