"""Parameter recovery and interval coverage of the identification, over many bench logs of a known plant.

    python benchmarks/identification.py [--seeds 200] [--kind noise [--amplitude 3]] [--jobs 2] [--cache FILE]
        [--json FILE] [--no-peer]

Every log has 20 s at 250 Hz with the bench's noise on all channels. Each search starts with every free parameter of the
nonlinear plant 30 % too large or too small. Results are appended to a file and reused until the package changes. Ctrl-C
stops and prints the results so far. At the end, SciPy's least_squares identifies some of the logs with the package's
engine; the time with python-control is extrapolated.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from identification_statistics import Summary, summary
from least_squares import Peer, Plain, peer, plain_runs
from recovery import Case, recover_all
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

#: Kind of log -> amplitude [A], and share of the seeds.
KINDS = {"noise": (3.0, 1.0), "steps": (1.5, 0.3), "multisine": (2.0, 0.3)}
DURATION = 20.0  # s
CACHE = Path(__file__).parent / "results" / "identification.jsonl"
#: Seeds of each kind that SciPy identifies too.
PLAIN = 5


def parameter_table(kind: str, amplitude: float, found: Summary) -> Table:
    result = Table(title=f"{kind}, peak {amplitude:g} A, {DURATION:g} s: {found.runs} logs")
    result.add_column("parameter")
    columns = (
        "identifiable %", "near %", "covered % (95 % interval)", "median sd %", "rms error %", "mean error %",
        "rms error / sd",
    )  # fmt: skip
    for column in columns:
        result.add_column(column, justify="right")
    for p in found.parameters:
        interval = f"{100 * p.covered.value:.1f} ({100 * p.covered.lower:.0f} to {100 * p.covered.upper:.0f})"
        result.add_row(
            p.name, f"{100 * p.identifiable:.0f}", f"{100 * p.near.value:.1f}", interval, f"{p.sd:.3g}", f"{p.rms:.3g}",
            f"{p.bias:+.2g}", f"{p.z:.2f}",
        )  # fmt: skip
    return result


def lines(found: Summary) -> list[str]:
    """Text printed with the table."""
    worst = max(found.held_out, key=lambda key: found.held_out[key][0])
    lost = "  ".join(
        f"{kind} {channel} {most:.3f} ({median:.4f})" for (kind, channel), (most, median) in found.held_out.items()
    )
    least, middle, most = found.reduced_cost
    good = found.runs - len(found.failures)
    return [
        f"identifiable parameters within max(3 %, 2 sd) of the truth: {found.near}",
        f"truth within the 95 % interval, all parameters: {found.covered}",
        f"the same without {found.unsettled} logs on which no two starts agree: {found.covered_settled}",
        f"held-out fit, percentage points below that of the true parameters, worst (median): {lost}",
        f"worst: {found.held_out[worst][0]:.3f} points of {worst[1]} on {worst[0]}",
        f"reduced cost {least:.3f} to {most:.3f}, median {middle:.3f}; {found.explained} of {good} at the noise level; "
        f"{found.one_start} with one start; {found.sd_from_residuals} with sd scaled by the residuals",
        f"seconds per identification, median and maximum: wall {found.wall[0]:.1f} and {found.wall[1]:.1f}, "
        f"CPU {found.cpu[0]:.1f} and {found.cpu[1]:.1f}",
        *(f"failed: {failure}" for failure in found.failures[:5]),
    ]


def plain_table(runs: Sequence[Plain]) -> Table:
    result = Table(title="scipy.optimize.least_squares on free runs of the package's engine, scipy's defaults")
    for column in ("log", "from"):
        result.add_column(column)
    columns = (
        "reduced cost", "within 3 % [%]", "covered [%]", "worst parameter, error [%]", "evaluations + Jacobians",
        "runs", "wall [s]",
    )  # fmt: skip
    for column in columns:
        result.add_column(column, justify="right")
    for run in runs:
        work = f"{run.evaluations} + {run.jacobians}{'' if run.ended else ', not converged'}"
        result.add_row(
            f"{run.case.kind} {run.case.seed}", "truth" if run.from_truth else "30 % off", f"{run.reduced_cost:.3f}",
            f"{100 * run.near:.0f}", f"{100 * run.covered:.0f}", f"{run.worst[1]} {run.worst[0]:+.1f}", work,
            f"{run.simulations}", f"{run.seconds:.1f}",
        )  # fmt: skip
    return result


def peer_lines(found: Peer, runs: Sequence[Plain]) -> list[str]:
    """Measured and extrapolated cost of the same search with python-control."""
    searches = [run for run in runs if not run.from_truth]
    evaluations = float(np.median([run.evaluations for run in searches]))
    jacobians = float(np.median([run.jacobians for run in searches]))
    hours = DURATION * (evaluations * found.run + jacobians * found.jacobian) / 3600.0
    first_run, first_jacobian = found.measured
    return [
        f"python-control, LSODA 1e-6, measured, CPU s per simulated second: a run {found.run:.2f} (first {first_run:g} "
        f"s, error {found.error:.1e}), a Jacobian by differences {found.jacobian:.1f} (first {first_jacobian:g} s)",
        f"extrapolated to {DURATION:g} s: a run {DURATION * found.run:.0f} s, a Jacobian "
        f"{DURATION * found.jacobian / 60:.0f} min, the whole search {hours:.1f} h: {evaluations:g} evaluations and "
        f"{jacobians:g} Jacobians, the median of the searches above that start 30 % off",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200, help="number of noise logs; the other kinds get 30 %% of it")
    parser.add_argument("--kind", choices=list(KINDS), help="only this kind of log, with all seeds")
    parser.add_argument("--amplitude", type=float, help="amplitude of --kind [A]")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--cache", type=Path, default=CACHE, help="file of results, one per line")
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--no-peer", action="store_true", help="leave out scipy and python-control")
    arguments = parser.parse_args()
    if arguments.amplitude is not None and arguments.kind is None:
        parser.error("--amplitude needs --kind")
    if arguments.seeds < 1 or arguments.jobs < 1:
        parser.error("--seeds and --jobs must be 1 or more")
    console = Console()
    console = Console(width=max(console.width, 120), soft_wrap=True)

    if arguments.kind:
        amplitude = KINDS[arguments.kind][0] if arguments.amplitude is None else arguments.amplitude
        plan = {arguments.kind: (amplitude, arguments.seeds)}
    else:
        plan = {kind: (amplitude, max(round(part * arguments.seeds), 1)) for kind, (amplitude, part) in KINDS.items()}
    cases = [Case(kind, amplitude, DURATION, k) for kind, (amplitude, seeds) in plan.items() for k in range(seeds)]
    results: dict[Case, dict[str, Any]] = {}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    interrupted = False
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("identifying", total=len(cases))
        try:
            for case, result in recover_all(cases, arguments.cache, arguments.jobs):
                results[case] = result
                progress.update(task, advance=1, description=f"identifying, {case.kind}")
        except KeyboardInterrupt:
            interrupted = True
            console.print(f"interrupted; {len(results)} of {len(cases)} are kept in {arguments.cache}")

    figures: dict[str, Any] = {"identification": {}}
    for kind, (amplitude, _) in plan.items():
        # In the order of the seeds.
        of_kind = [results[case] for case in cases if case.kind == kind and case in results]
        if any("failure" not in result for result in of_kind):
            found = summary(of_kind)
            console.print(parameter_table(kind, amplitude, found))
            console.print("\n".join(lines(found)) + "\n")
            figures["identification"][kind] = found.to_dict()
    if not interrupted and not arguments.no_peer:
        with console.status("scipy's least_squares"):
            runs = plain_runs(
                {kind: amplitude for kind, (amplitude, _) in plan.items()}, DURATION, PLAIN, arguments.jobs
            )
        console.print(plain_table(runs))
        with console.status("python-control"):
            other = peer(next(iter(cases)))
        console.print("\n".join(peer_lines(other, runs)))
        figures["least_squares"] = [asdict(run) for run in runs]
        figures["python_control"] = asdict(other)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1).replace("NaN", "null") + "\n")


if __name__ == "__main__":
    main()
