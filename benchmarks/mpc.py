"""Time per sample of the MPC with several embedded solvers, and speed of closed loops.

    python benchmarks/mpc.py [--horizon 20] [--samples 750] [--json FILE]

The shipped MPC follows jumps of +-20 mm on the nonlinear plant with the bench's sensors. Every solver then gets the
same quadratic programs, condensed, each from its own last solution: DAQP and OSQP as the package runs them, OSQP with
a coarser tolerance, PIQP (dense) and qpOASES (in CasADi). They alternate program by program, so that all see the same
machine load; for the deadline the package's own law (estimate, program and solution) then runs alone, as on a rig.
Wall time includes other processes, CPU time does not. PIQP and CasADi come with the extra `bench`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import ehsa_ctrl
from ehsa_ctrl.design.qp import QP_SOLVERS, QpSolver
from ehsa_ctrl.design.qp.osqp import Osqp
from ehsa_ctrl.design.state_space.mpc import Mpc
from ehsa_ctrl.design.state_space.mpc_problem import Condensed, condense, motion_ahead
from ehsa_ctrl.simulation.closed_loop import run_closed_loop
from ehsa_ctrl.simulation.sensors import Sensors

#: Samples between two steps of the reference.
PERIOD = 150
#: f, lower and upper bounds of a program -> its solution.
Solve = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def jumps(samples: int) -> np.ndarray:
    """Reference (samples, 3): +-20 mm in turn."""
    reference = np.zeros((samples, 3))
    reference[:, 0] = np.where(np.arange(samples) // PERIOD % 2 == 0, 0.02, -0.02)
    return reference


def parameters(law: Mpc, memory: np.ndarray, before: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Data of this sample's problem, from the law's memory after and before it; the last entry is 1."""
    z = np.array([memory[law.traces[f"estimate_{name}"]] for name in (*law.model.states, *law.model.disturbances)])
    scale = np.r_[law.model.scale, law.model.disturbance_scale]
    given = law.traces["limit_passed"] + 1
    motion = np.empty(3 * (law.horizon + 1))
    motion_ahead(reference, law.model.sample_time, law.horizon, motion)
    return np.r_[z / scale, motion, before[2], 0.0, before[given], 1.0]


def of_the_package(solver: QpSolver, n: int, m: int) -> Solve:
    """One of the package's solvers, started from its last solution."""
    x, y = np.zeros(n), np.zeros(n + m)

    def solve(f: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        nonlocal x, y
        found = solver.solve(f, lower, upper, x, y)
        x, y = found.x, found.y
        return x

    return solve


def by_piqp(program: Condensed) -> Solve:
    """PIQP's dense interior-point method; it has no warm start."""
    import piqp

    solver, n = piqp.DenseSolver(), len(program.H)
    H, G = np.asfortranarray(program.H), np.asfortranarray(program.G)
    solver.settings.verbose = False
    one = np.ones(len(program.lower))
    solver.setup(H, np.zeros(n), None, None, G, -one[n:], one[n:], -one[:n], one[:n])

    def solve(f: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        solver.update(c=f, h_l=lower[n:], h_u=upper[n:], x_l=lower[:n], x_u=upper[:n])
        solver.solve()
        return np.array(solver.result.x)

    return solve


def by_qpoases(program: Condensed) -> Solve:
    """qpOASES of CasADi, started from its last solution."""
    import casadi as ca

    n, m = len(program.H), len(program.G)
    shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    solver = ca.conic("qp", "qpoases", shapes, {"printLevel": "none"})
    last: dict[str, Any] = {}

    def solve(f: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        found = solver(
            h=program.H, a=program.G, g=f, lbx=lower[:n], ubx=upper[:n], lba=lower[n:], uba=upper[n:], **last
        )
        last.update(x0=found["x"], lam_x0=found["lam_x"], lam_a0=found["lam_a"])
        return np.asarray(found["x"]).ravel()

    return solve


def contenders(program: Condensed, iterations: int) -> dict[str, Solve]:
    """All solvers of this program; those not installed are omitted."""
    n, m = len(program.H), len(program.G)
    found = {
        f"{name}, as shipped": of_the_package(kind.make(program.H, program.G, iterations, None), n, m)
        for name, kind in QP_SOLVERS.items()
    }
    found["osqp, tolerance 1e-3"] = of_the_package(Osqp(program.H, program.G, iterations, None, tolerance=1e-3), n, m)
    for name, make in {"piqp, dense": by_piqp, "qpoases, in casadi": by_qpoases}.items():
        try:
            found[name] = make(program)
        except ImportError as missing:
            Console(stderr=True).print(f"{name}: left out, {missing}; pip install -e '.[bench]'")
    return found


def timed(solve: Callable[[], Any]) -> tuple[Any, float, float]:
    """Result of a call, its wall and CPU seconds."""
    wall, cpu = time.perf_counter(), time.thread_time()
    found = solve()
    return found, time.perf_counter() - wall, time.thread_time() - cpu


def programs(law: Mpc, loop: Any, reference: np.ndarray, program: Condensed) -> list[tuple[np.ndarray, ...]]:
    """(f, lower, upper) of every sample of a run."""
    memory, found = law.initial_memory(), []
    for planned, seen in zip(reference, loop.measured, strict=True):
        before = memory.copy()
        law.function(planned, seen, memory, law.settings(), 0.0, 0.0)
        p = parameters(law, memory, before, planned)
        shift = program.T @ p
        found.append((program.F @ p, program.lower + shift, program.upper + shift))
    return found


def figures(rows: list[tuple[float, float]], errors: list[float], limit: float) -> dict[str, float]:
    """Percentiles in us, and the largest error of the current that is applied, over its limit."""
    wall, cpu = 1e6 * np.array(rows[5:]).T
    return {
        "wall p50 us": float(np.percentile(wall, 50)),
        "wall p99 us": float(np.percentile(wall, 99)),
        "wall max us": float(wall.max()),
        "cpu p50 us": float(np.percentile(cpu, 50)),
        "cpu p99 us": float(np.percentile(cpu, 99)),
        "off by (limit = 1)": max(errors, default=0.0) / limit,
    }


def compare(law: Mpc, samples: int) -> dict[str, dict[str, float]]:
    """Statistics of every solver on the same run."""
    plant = ehsa_ctrl.load_plant("ehsa")
    linear = ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))
    controller = replace(ehsa_ctrl.load_controller("mpc_position", linear), law=law, trajectory=None)
    reference, program = jumps(samples), condense(law.problem)
    loop = run_closed_loop(plant, controller, reference, sensors=Sensors.of(plant, seed=1))
    solvers = contenders(program, law.iteration_limit)
    rows: dict[str, list[tuple[float, float]]] = {name: [] for name in solvers}
    errors: dict[str, list[float]] = {name: [] for name in solvers}
    exact = next(iter(solvers))
    for k, each in enumerate(programs(law, loop, reference, program)):
        first: dict[str, float] = {}
        for name in np.roll(list(solvers), k).tolist():
            x, *seconds = timed(lambda: solvers[name](*each))  # noqa: B023
            first[name] = float(x[0])
            rows[name].append(tuple(seconds))
        for name, value in first.items():
            errors[name].append(abs(value - first[exact]))
    found = {name: figures(rows[name], errors[name], law.problem.current_limit) for name in solvers}
    memory = law.initial_memory()
    whole = [
        timed(lambda: law.function(planned, seen, memory, law.settings(), 0.0, 0.0))[1:]  # noqa: B023
        for planned, seen in zip(reference, loop.measured, strict=True)
    ]
    found["the package's whole sample"] = figures(whole, [], law.problem.current_limit)
    return found


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
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    linear = ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))
    law: Any = ehsa_ctrl.load_controller("mpc_position", linear).law
    law = replace(law, problem=replace(law.problem, horizon=chosen.horizon))
    found = compare(law, chosen.samples)
    first = next(iter(found))
    table = Table(title=f"one sample of a position MPC, horizon {chosen.horizon}, at 250 Hz")
    table.add_column("solver")
    for column in found[first]:
        table.add_column(column, justify="right")
    table.add_column("cpu / daqp's", justify="right")
    for name, row in found.items():
        share = row["cpu p50 us"] / found[first]["cpu p50 us"]
        table.add_row(name, *(f"{value:.3g}" for value in row.values()), f"{share:.3g}")
    console = Console(width=140)
    console.print(table)
    speeds = {name: real_time(name) for name in ("lqr_position", "lqi_position", "mpc_position")}
    for name, speed in speeds.items():
        console.print(f"closed loop with {name}: {speed:.0f} times faster than real time")
    if chosen.json:
        chosen.json.write_text(json.dumps({"sample": found, "real_time": speeds}, indent=1))


if __name__ == "__main__":
    main()
