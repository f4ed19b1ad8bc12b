"""Speed and accuracy of the simulation engine compared with its peers, in one run.

    python benchmarks/engine.py [--quick] [--json FILE]

Times are CPU times per simulated second and depend on the machine; their ratios do so much less. Errors are relative to
an event-driven DOP853 solution with rtol 1e-12 that shares no code with the package.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from c_engine import FLAGS, c_run, counts
from engine_cases import DT, START, Array, Case, cases, worst_error
from jacobian import jacobian_rows
from peers import (
    E1,
    E3,
    TIGHT,
    by_diffrax,
    casadi_cvodes,
    mujoco_tendon,
    python_control,
    scipy_event_driven,
    scipy_lsoda,
    time_stepping,
)
from reference import Solution, event_driven
from rich.console import Console
from rich.table import Table
from timing import Row, Run, Timing, measure, ratio

from ehsa_ctrl.plant.structure import NONLINEAR
from ehsa_ctrl.simulation.engine import run_open_loop
from ehsa_ctrl.simulation.plant_code import plant_code

TOLERANCES = (1e-4, 1e-6, 1e-8)


# The package's part, in three functions.


def parameter_rows(case: Case, runs: int = 1) -> Array:
    """Parameter vectors (runs, n) of the engine; parameters missing in the case are 0, their neutral value."""
    return np.tile([case.values.get(name, 0.0) for name in NONLINEAR.equations.parameter_names], (runs, 1))


def ours(case: Case, tol: float) -> Run:
    """One run of the compiled engine; buffers are allocated once, as for the C engine."""
    return ours_batch(case, tol, parameter_rows(case), 1)


def ours_batch(case: Case, tol: float, parameters: Array, threads: int) -> Run:
    """Runs with varied parameters; the function returns the states of the first run."""
    code = plant_code(NONLINEAR.equations)
    runs, n = len(parameters), case.current.size
    current, force = np.ascontiguousarray(case.current), np.zeros(n)
    y, mode, carry = np.empty((runs, 5)), np.empty((runs, 2)), np.empty((runs, 11))
    states, modes, cell = np.empty((runs, n, 5)), np.empty((runs, n, 2), np.int8), np.empty((runs, n))
    extremes, status = np.empty((runs, 2, 5)), np.zeros(runs, np.int64)

    def part(rows: slice) -> None:
        y[rows], mode[rows], carry[rows], extremes[rows] = START, 0.0, 0.0, START
        carry[rows, 0], carry[rows, 1] = DT, np.nan
        run_open_loop(
            code, parameters[rows], y[rows], mode[rows], carry[rows], current, force, case.first_order, DT, tol,
            states[rows], modes[rows], cell[rows], extremes[rows], status=status[rows],
        )  # fmt: skip

    edges = np.linspace(0, runs, min(runs, 8 * threads) + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(edges)]
    pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def run() -> Array:
        if pool is None:
            part(slice(0, runs))
        else:
            list(pool.map(part, parts))
        if status.any():
            raise RuntimeError(f"the engine did not finish: status {status[status != 0][0]}")
        first: Array = states[0]
        return first

    return run


# The peers.


def contenders() -> list[Row]:
    """All rows of the table. `ours` also runs on the short records, for comparison with peers that only run those."""
    rows = [Row(f"ours {tol:.0e}", partial(ours, tol=tol)) for tol in TOLERANCES]
    for tol in TOLERANCES:
        rows += [
            Row(f"C engine {flags} {tol:.0e}", partial(c_run, tol=tol, flags=flags), shown=tol == 1e-6)
            for flags in FLAGS
        ]
    rows += [Row(f"ours {tol:.0e}, short", partial(ours, tol=tol), short=True, shown=False) for tol in TOLERANCES]
    rows += [Row(peer, prepare, peer=True) for peer, prepare in PEERS.items()]
    lsoda: dict[str, Any] = {"solve_ivp_method": "LSODA", "solve_ivp_kwargs": TIGHT}
    rows += [
        Row("scipy event-driven DOP853 1e-6", scipy_event_driven, slow=True),
        Row("scipy LSODA 1e-6, E3", scipy_lsoda, slow=True),
        Row("python-control LSODA 1e-6, E3", partial(python_control, widths=E3, **lsoda), slow=True),
        Row("python-control default RK45, E1", partial(python_control, widths=E1), slow=True),
    ]
    return rows


#: Compiled peers; the first one is the usual choice for speed.
PEERS = {
    "CasADi CVODES 1e-6, E3": casadi_cvodes,
    "diffrax Kvaerno3 1e-6, E3": partial(by_diffrax, solver="Kvaerno3", widths=E3),
    "diffrax Tsit5 1e-6, E1": partial(by_diffrax, solver="Tsit5", widths=E1),
    "time stepping, 16 a sample": time_stepping,
    "MuJoCo, smaller model, 0.1 ms": mujoco_tendon,
}

# Output.

Timings = dict[tuple[str, str], Timing]


def table(rows: list[Row], timings: Timings, records: dict[str, Case], short: dict[str, float]) -> Table:
    result = Table(title="CPU ms per simulated second (worst error of the five states)")
    result.add_column("method")
    result.add_column("record [s]")
    for case in records.values():
        result.add_column(f"{case.name}: {case.title}", justify="right")
    for row in rows:
        if not row.shown:
            continue
        cells = []
        for name in records:
            timing = timings[row.label, name]
            digits = 0 if timing.median >= 100 else 1 if timing.median >= 10 else 3
            cells.append("failed" if timing.failure else f"{timing.median:.{digits}f} ({timing.error:.1e})")
        lengths = "/".join(f"{timings[row.label, name].duration:g}" for name in records)
        result.add_row(row.label, f"first {lengths}" if row.slow or row.peer else lengths, *cells)
    return result


def ratio_lines(timings: Timings, names: list[str]) -> dict[str, Any]:
    """ours / C with the fastest of its flags: median of interleaved rounds, 5 and 95 %."""
    return {
        tol: {
            name: ratio(timings[f"ours {tol}", name], [timings[f"C engine {flags} {tol}", name] for flags in FLAGS])
            for name in names
        }
        for tol in (f"{tol:.0e}" for tol in TOLERANCES)
    }


def factor_lines(timings: Timings, names: list[str], peer: str) -> dict[str, Any]:
    """Speed-up of ours on the same short record, at the coarsest tolerance that is at least as accurate.

    Median of the rounds, 5 and 95 %.
    """
    result = {}
    for name in names:
        other = timings[peer, name]
        mine = [timings[f"ours {tol:.0e}, short", name] for tol in TOLERANCES]
        equal = [timing for timing in mine if timing.error <= other.error]
        if equal and not other.failure:
            best = min(equal, key=lambda timing: timing.median)
            median, low, high = ratio(other, [best])
            result[name] = {
                "factor": median, "low": low, "high": high, "error": best.error, "their_error": other.error,
            }  # fmt: skip
    return result


def batch_rates(case: Case, runs: int, rounds: int) -> dict[str, dict[str, float]]:
    """Runs per second of wall time on 1 and 2 threads: the values of table 2 and K_T, each varied +-20 %.

    `cores` is how many the threads were granted: on a busy machine two threads do not get two.
    """
    names = ("J_M", "A_FM", "B_FM", "C_FM", "V_10", "V_20", "K_L", "M", "A_FR", "B_FR", "C_FR", "K_T")
    parameters = parameter_rows(case, runs)
    columns = [NONLINEAR.equations.parameter_names.index(name) for name in names]
    parameters[:, columns] *= np.random.default_rng(1).uniform(0.8, 1.2, (runs, len(names)))
    batches = {threads: ours_batch(case, 1e-4, parameters, threads) for threads in (1, 2)}
    walls: dict[int, list[float]] = {threads: [] for threads in batches}
    cores: dict[int, list[float]] = {threads: [] for threads in batches}
    for _ in range(rounds):
        for threads, batch in batches.items():
            cpu, wall = time.process_time(), time.perf_counter()
            batch()
            cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
            walls[threads].append(wall)
            cores[threads].append(cpu / wall)
    return {
        f"{threads} thread{'s' * (threads > 1)}": {
            "median": runs / float(np.median(walls[threads])),
            "best": runs / min(walls[threads]),
            "cores": float(np.median(cores[threads])),
        }
        for threads in batches
    }


def references(records: dict[str, Case], quick: bool, console: Console) -> dict[str, Array]:
    """Reference states by DOP853; Radau verifies them on cases where it does not take minutes."""
    solutions: dict[str, Solution] = {}
    for name, case in records.items():
        solution = solutions[name] = event_driven(case)
        text = f"reference {name}: {solution.event_times.size} events"
        if not quick and name in ("a", "b", "d"):
            check = event_driven(case, "Radau", 1e-10)
            times = solution.event_times, check.event_times
            apart = float(np.abs(times[0] - times[1]).max()) if times[0].size == times[1].size else float("nan")
            off = worst_error(check.states, solution.states)
            text += f"; Radau 1e-10 differs by {off:.1e}, the instants by {apart:.1e} s"
        console.print(text)
    return {name: solution.states for name, solution in solutions.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer rounds, half a second for the slow peers, no Radau")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to a file")
    arguments = parser.parse_args()
    quick = arguments.quick
    console = Console()
    console = Console(width=max(console.width, 140), soft_wrap=True)

    records = cases()
    names = list(records)
    short = dict.fromkeys(names, 0.5) if quick else {"a": 2.0, "b": 2.0, "c": 1.0, "d": 2.0}
    exact = references(records, quick, console)
    rows = contenders()
    with console.status("") as status:
        timings = measure(
            rows, records, exact, short, rounds=7 if quick else 41, slow_rounds=1 if quick else 3, say=status.update
        )
        batch = batch_rates(records["b"], 100 if quick else 1000, 3 if quick else 9)
        jacobian = jacobian_rows(records["c"], 3 if quick else 11)
    console.print(table(rows, timings, records, short))
    for (label, name), timing in timings.items():
        if timing.failure:
            console.print(f"{label} failed on {name}: {timing.failure[:200]}")

    ratios = ratio_lines(timings, names)
    for tol, by_name in ratios.items():
        cells = "  ".join(
            f"{name} {median:.2f} ({low:.2f} to {high:.2f})" for name, (median, low, high) in by_name.items()
        )
        console.print(f"ours / C engine, fastest flags, at {tol}, median over rounds (5 to 95 %): {cells}")
    factors = {row.label: factor_lines(timings, names, row.label) for row in rows if row.slow or row.label in PEERS}
    for label, by_name in factors.items():
        cells = "  ".join(
            f"{name} {found['factor']:.3g}x, {found['low']:.3g} to {found['high']:.3g} "
            f"({found['error']:.1e} against {found['their_error']:.1e})"
            for name, found in by_name.items()
        )
        console.print(f"faster than {label}, at no larger error: {cells}")
    for threads, rate in batch.items():
        console.print(
            f"batch of b, 4 s, 1e-4, {threads}: {rate['median']:.0f} runs/s, best {rate['best']:.0f}; "
            f"on {rate['cores']:.2f} cores"
        )
    for found in jacobian:
        console.print(
            f"Jacobian of c, 12 parameters, 10 s, {found.method}: {found.milliseconds:.1f} ms, error {found.error:.1e}"
        )
    work = {name: {f"{tol:.0e}": counts(case, tol) for tol in TOLERANCES} for name, case in records.items()}
    for name, case in records.items():
        count = work[name]["1e-06"]
        per_second = "  ".join(f"{what} {number / case.duration:.0f}" for what, number in count.items())
        console.print(f"work of the C engine on {name} at 1e-06, per simulated second: {per_second}")

    if arguments.json:
        packages = ("numpy", "scipy", "numba", "control", "casadi", "diffrax", "jax", "mujoco")
        figures = {
            "python": platform.python_version(),
            "machine": platform.machine(),
            "versions": {package: version(package) for package in packages if find_spec(package)},
            "rows": [
                {
                    "method": label, "test": name, "seconds": timing.duration, "failure": timing.failure,
                    "ms_median": timing.median, "ms_minimum": timing.minimum, "worst_error": timing.error,
                }
                for (label, name), timing in timings.items()
            ],
            "ratio_to_c": ratios, "factors": factors, "batch_runs_per_second": batch,
            "jacobian": [vars(found) for found in jacobian], "work": work,
        }  # fmt: skip
        # NaN is no JSON; a peer that failed has no figures.
        text = json.dumps(figures, indent=1, default=float).replace("NaN", "null")
        arguments.json.write_text(text + "\n")


if __name__ == "__main__":
    main()
