"""How long does a sample of the MPC take, beside do-mpc and cvxpy, and how fast do closed loops run?

    python benchmarks/mpc.py [--horizon 20] [--samples 750] [--slow 40] [--json FILE]

The shipped MPC follows jumps of +-20 mm on the nonlinear plant with the bench's sensors. Every contender then gets the
same samples: the package's law by each of its solvers (estimate, problem and solution), cvxpy with the problem stated
once and its parameters changed (OSQP, warm), and do-mpc (discrete model, IPOPT, warm), whose soft limits have a share
of their own each sample. The slow ones see some samples only, spread over the run; contenders take turns sample by
sample, so that all share the machine's moods; for the deadline the package's own law then runs alone, as it would on
a rig. Wall time counts what other programs do to a sample, CPU time does not.
do-mpc comes with the extra `bench` and is left out where it is absent.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import ehsa_ctrl
from ehsa_ctrl.design.laws.mpc import Mpc
from ehsa_ctrl.design.laws.mpc_problem import MpcProblem, ahead
from ehsa_ctrl.design.laws.mpc_reference import MpcStatement
from ehsa_ctrl.design.qp import QP_SOLVERS
from ehsa_ctrl.simulation.closed_loop import run_closed_loop
from ehsa_ctrl.simulation.sensors import Sensors

#: Samples from jump to jump of the reference.
PERIOD = 150
#: A solver of a problem: its parameters (see MpcProblem.parameters) -> the current of this sample [A].
Solve = Callable[[np.ndarray], float]


def jumps(samples: int) -> np.ndarray:
    """Reference (samples, 3): +-20 mm in turn."""
    reference = np.zeros((samples, 3))
    reference[:, 0] = np.where(np.arange(samples) // PERIOD % 2 == 0, 0.02, -0.02)
    return reference


def parameters(law: Mpc, memory: np.ndarray, before: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """What this sample's problem depended on, from the law's memory after it and before it."""
    z = np.array([memory[law.traces[f"estimate_{name}"]] for name in (*law.model.states, *law.model.disturbances)])
    scale = np.r_[law.model.scale, law.model.disturbance_scale]
    given = law.traces["limit_passed"] + 1
    motion = np.empty((law.horizon + 1, 3))
    ahead(*reference, law.model.sample_time, motion)
    return np.r_[z / scale, motion.ravel(), before[2], 0.0, before[given]]


def by_cvxpy(problem: MpcProblem) -> Solve:
    """The problem stated in cvxpy, solved by OSQP from the last solution."""
    statement = MpcStatement(problem)
    return lambda p: float(statement.solve(p, "OSQP", warm_start=True, eps_abs=1e-5, eps_rel=1e-5, max_iter=20000)[0])


def by_do_mpc(problem: MpcProblem) -> Solve:
    """The same cost and limits in do-mpc; the current before is a state, for the limit of its rate."""
    warnings.simplefilter("ignore")  # of features that are not installed, and of its library's coming changes
    import casadi
    import do_mpc

    model, target, N = problem.model, problem.target, problem.horizon
    n = len(model.A)
    described = do_mpc.model.Model("discrete")
    xi, mu = described.set_variable("_x", "xi", (n, 1)), described.set_variable("_u", "mu", (1, 1))
    known, before = described.set_variable("_tvp", "known", (1, 1)), described.set_variable("_x", "before", (1, 1))
    rest = described.set_variable("_tvp", "rest", (max(len(problem.limits.soft), 1), 1))
    described.set_rhs("xi", casadi.DM(model.A) @ xi + casadi.DM(model.B) @ mu)
    described.set_rhs("before", mu + known)
    described.setup()
    mpc = do_mpc.controller.MPC(described)
    mpc.settings.n_horizon, mpc.settings.t_step, mpc.settings.store_full_solution = N, model.sample_time, False
    mpc.settings.supress_ipopt_output()
    P = casadi.DM(problem.regulator.P[:n, :n])
    mpc.set_objective(lterm=xi.T @ casadi.DM(problem.cost.Q) @ xi + problem.cost.R * mu**2, mterm=xi.T @ P @ xi)
    mpc.set_rterm(mu=problem.cost.R_rate)
    for sign in (1.0, -1.0):
        mpc.set_nl_cons(f"current{sign}", sign * (mu + known), ub=problem.current_limit)
        if problem.limits.current_rate is not None:
            change = problem.limits.current_rate * model.sample_time
            mpc.set_nl_cons(f"rate{sign}", sign * (mu + known - before), ub=change)
    for k, (signal, limit) in enumerate(problem.limits.soft.items()):
        seen = casadi.DM(model.row(signal) / limit).T @ xi + rest[k]
        for sign in (1.0, -1.0):
            mpc.set_nl_cons(
                f"{signal}{sign}", sign * seen, ub=1.0, soft_constraint=True, penalty_term_cons=problem.penalty
            )
    changing, w = mpc.get_tvp_template(), np.zeros((N + 1, len(target.S)))

    def along(now: float) -> Any:
        """Gamma w and the targets' shares of the limits along the horizon."""
        for i in range(N + 1):
            changing["_tvp", i, "known"] = target.Gamma @ w[i]
            shares = [model.row(s) @ target.Pi @ w[i] / limit for s, limit in problem.limits.soft.items()]
            changing["_tvp", i, "rest"] = np.array(shares or [0.0])
        return changing

    mpc.set_tvp_fun(along)
    mpc.setup()
    d, started = model.E.shape[1], False

    def solve(p: np.ndarray) -> float:
        nonlocal started
        w[:] = np.hstack([p[n + d : -3].reshape(-1, 3), np.tile(p[n : n + d], (N + 1, 1))])
        first = np.r_[p[:n] - target.Pi @ w[0], p[-1]].reshape(-1, 1)
        if not started:
            mpc.x0 = first
            mpc.set_initial_guess()
            started = True
        return float(mpc.make_step(first)[0, 0] + target.Gamma @ w[0])

    return solve


def timed(solve: Callable[[], float]) -> tuple[float, float, float]:
    """Current, wall and CPU seconds of a call."""
    wall, cpu = time.perf_counter(), time.thread_time()
    current = solve()
    return current, time.perf_counter() - wall, time.thread_time() - cpu


def alone(law: Mpc, measured: np.ndarray, reference: np.ndarray) -> list[tuple[float, float, float, float]]:
    """The law on a run, nothing between its samples: current, wall and CPU seconds, sample."""
    memory, settings, rows = law.initial_memory(), law.settings(), []
    for k, (planned, seen) in enumerate(zip(reference, measured, strict=True)):
        rows.append((*timed(lambda: law.function(planned, seen, memory, settings, 0.0, 0.0)), float(k)))  # noqa: B023
    return rows


def compare(law: Mpc, samples: int, slow_samples: int) -> dict[str, dict[str, float]]:
    """Figures of every contender on the same run."""
    plant = ehsa_ctrl.load_plant("ehsa")
    linear = ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))
    controller = replace(ehsa_ctrl.load_controller("mpc_position", linear), law=law, trajectory=None)
    reference = jumps(samples)
    loop = run_closed_loop(plant, controller, reference, sensors=Sensors.of(plant, seed=1))
    laws = {name: replace(law, solver=name) for name in QP_SOLVERS}
    memories = {name: each.initial_memory() for name, each in laws.items()}
    slow: dict[str, Solve] = {"cvxpy, OSQP": by_cvxpy(law.problem)}
    try:
        slow["do-mpc"] = by_do_mpc(law.problem)
    except ImportError:
        Console(stderr=True).print("do-mpc is not installed (extra `bench`): left out")
    found: dict[str, list[tuple[float, float, float, float]]] = {name: [] for name in (*laws, *slow)}
    every = max(samples // slow_samples, 1)
    for k in range(samples):
        before = memories["daqp"].copy()
        row = reference[k], loop.measured[k]
        for name in np.roll(list(laws), k):
            each = laws[name]
            if name != "daqp":
                # The other solvers take the run's states, not those of a run of their own.
                behind = each.feedback.initial_memory().size
                memories[name][:behind] = before[:behind]
                memories[name][each.traces["limit_passed"] + 1] = before[each.traces["limit_passed"] + 1]
            answer = timed(lambda: each.function(*row, memories[name], each.settings(), 0.0, 0.0))  # noqa: B023
            found[name].append((*answer, k))
        if k % every == 0 and k > 0:
            p = parameters(law, memories["daqp"], before, reference[k])
            for name, solve in slow.items():
                found[name].append((*timed(lambda: solve(p)), k))  # noqa: B023
    exact = {k: current for current, _, _, k in found["daqp"]}
    found["daqp alone"] = alone(law, loop.measured, reference)
    figures = {}
    for name, rows in found.items():
        current, wall, cpu, at = np.array(rows[5:]).T
        error = np.array(
            [
                abs(min(max(u, -law.problem.current_limit), law.problem.current_limit) - exact[int(k)])
                for u, k in zip(current, at, strict=True)
            ]
        )
        figures[name] = {
            "samples": len(current),
            "wall p50 us": 1e6 * float(np.percentile(wall, 50)),
            "wall p99 us": 1e6 * float(np.percentile(wall, 99)),
            "wall max us": 1e6 * float(np.max(wall)),
            "cpu p50 us": 1e6 * float(np.percentile(cpu, 50)),
            "cpu p99 us": 1e6 * float(np.percentile(cpu, 99)),
            "off by (limit = 1)": float(np.max(error)) / law.problem.current_limit,
        }
    return figures


def real_time(name: str, samples: int = 2500) -> float:
    """Times faster than real time that a controller of the catalogue runs on the nonlinear plant, best of three."""
    plant = ehsa_ctrl.load_plant("ehsa")
    linear = ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))
    controller = ehsa_ctrl.load_controller(name, linear)
    sensors, reference = Sensors.of(plant, seed=1), jumps(samples)
    run_closed_loop(plant, controller, reference, sensors=sensors)
    best = np.inf
    for _ in range(3):
        start = time.perf_counter()
        run_closed_loop(plant, controller, reference, sensors=sensors)
        best = min(best, time.perf_counter() - start)
    return samples * controller.sample_time / best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--horizon", type=int, default=20)
    parser.add_argument("--samples", type=int, default=750)
    parser.add_argument("--slow", type=int, default=40, help="samples that cvxpy and do-mpc get")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    linear = ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))
    law: Any = ehsa_ctrl.load_controller("mpc_position", linear).law
    law = replace(law, problem=replace(law.problem, horizon=chosen.horizon))
    figures = compare(law, chosen.samples, chosen.slow)
    table = Table(title=f"one sample of a position MPC, horizon {chosen.horizon}, at 250 Hz")
    table.add_column("contender")
    for column in figures["daqp"]:
        table.add_column(column, justify="right")
    table.add_column("cpu / daqp's", justify="right")
    for name, row in figures.items():
        ratio = row["cpu p50 us"] / figures["daqp"]["cpu p50 us"]
        table.add_row(name, *(f"{value:.3g}" for value in row.values()), f"{ratio:.3g}")
    console = Console(width=140)
    console.print(table)
    speeds = {name: real_time(name) for name in ("lqr_position", "lqi_position", "mpc_position")}
    for name, speed in speeds.items():
        console.print(f"closed loop with {name}: {speed:.0f} times faster than real time")
    if chosen.json:
        chosen.json.write_text(json.dumps({"sample": figures, "real_time": speeds}, indent=1))


if __name__ == "__main__":
    main()
