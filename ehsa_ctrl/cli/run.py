"""`ehsa-ctrl run`: design for the scenarios, check on the nonlinear plant against limits and baselines."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError, SimulationError
from .complete import scenarios as scenario_names
from .options import Force, Json, RunOptions, read_pairs
from .output import OutputOptions, bare_table, provenance, warn_once

if TYPE_CHECKING:
    from rich.table import Table

    from ..core.result_folder import ResultFolder
    from ..scenario.result import ScenarioResult

#: Suffix of the figure that compares a run with the baseline it is about to replace.
OLD = "-old-baseline"
#: Verdict -> (word, style) on the terminal.
VERDICTS = {"pass": ("passed", "bold green"), "fail": ("FAILED", "bold red"), "untested": ("untested", "bold yellow")}


def command(
    run: RunOptions,
    scenarios: Annotated[
        list[str] | None,
        typer.Argument(help="Names or TOML files; by default all scenarios.", autocompletion=scenario_names),
    ] = None,
    jobs: Annotated[int, typer.Option(help="Number of parallel processes.", min=1)] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for results.json, report.html, time series and figures; by default the first of results, "
            "results-2 ... that holds no result.",
        ),
    ] = None,
    as_json: Json = False,
    force: Force = False,
    update_baselines: Annotated[
        bool, typer.Option("--update-baselines", help="Record a new baseline for runs that have none or deviate.")
    ] = False,
    reason: Annotated[str, typer.Option(help="Why the baselines change; a terminal prompts for it.")] = "",
    replay: Annotated[
        str | None,
        typer.Option(
            metavar="FILE[:RUN]",
            help="Repeat the worst run, or the one of this number, of the .jsonl that montecarlo wrote.",
        ),
    ] = None,
    assumed: Annotated[
        bool | None,
        typer.Option(
            "--assumed/--no-assumed",
            help="Also run with each assumed parameter at both ends of its plausible range, for report.html. By "
            "default only with a compiled controller, which makes it quick.",
        ),
    ] = None,
) -> None:
    """Design on the linear model, check on the nonlinear plant against the scenario's limits and baseline.

    Examples: ehsa-ctrl run · ehsa-ctrl run steps_spring --out results/steps ·
    ehsa-ctrl run my/scenario.toml --controller pid_position,my/pid.toml · ehsa-ctrl run --plant results/rig.toml ·
    ehsa-ctrl run steps_spring --set K_T=1.05 --set load.stiffness=80e3 ·
    ehsa-ctrl run spread_steps --replay results/montecarlo/spread_steps.jsonl ·
    ehsa-ctrl run --update-baselines --reason "softer spring in the rig"
    """
    from ..core.catalogue import scenarios as catalogue
    from ..scenario.replay import read_draw
    from .progress import compiling

    if update_baselines and (run.plant or run.design or run.settings or replay):
        raise InputError(
            "--update-baselines records runs of the scenario's own plant; leave out --plant, --design and --set, "
            "and --replay"
        )
    if update_baselines and not reason.strip() and not sys.stdin.isatty():
        raise InputError("--update-baselines replaces the runs that later ones must match; say why with --reason TEXT")
    if replay and len(scenarios or ()) != 1:
        raise InputError("--replay repeats a run of one scenario; name this scenario alone")
    draw = read_draw(replay) if replay else None
    pairs = read_pairs(run.settings)
    chosen = run.controllers()
    names = scenarios or _all(catalogue.folders, run.plant, chosen)
    for name in names:
        catalogue.find(name)
    for kind, given in (("scenario", names), ("controller", [name for name in chosen if name])):
        words = [Path(name).stem for name in given]
        twice = [word for word in words if words.count(word) > 1]
        if twice:
            raise InputError(f"{kind} {twice[0]!r} is given twice, and result files are named after it; give it once")
    out = out or _next_results(force)
    todo = [(name, other) for name in names for other in chosen]
    stems = [_names_of(*pair) for pair in todo]
    runs = ["-".join(pair) for pair in stems]
    output = OutputOptions(as_json, out, force)
    output.check(
        "run", "results.json", "report.html", *(f"{stem}.csv" for stem in runs),
        figures=[*runs, *(f"loop-{name}" for _, name in stems)],
    )  # fmt: skip
    if update_baselines:
        _old_baselines(out).check(figures=[f"{stem}{OLD}" for stem in runs])
    options = {"plant": run.plant, "design": run.design, "assumed": assumed, "settings": pairs, "draw": draw}
    try:
        with compiling():
            results = list(_run_all(todo, jobs, options))
    except KeyboardInterrupt:
        raise KeyboardInterrupt("nothing is kept: results are written when all scenarios are done") from None
    warn_once(sentence for result in results for sentence in result.warnings)
    if update_baselines:
        results = _update(results, reason, out, quiet=as_json)
    failed = [result for result in results if not result.passed]
    summary: dict[str, Any] = {
        "passed": not failed,
        "scenarios": [result.to_dict() for result in results],
        "files": [],
        "rests_on": provenance(
            [each.trajectory.plant for result in results for each in (result.nonlinear, result.linear)],
            [file for result in results for file in result.files],
        ),
    }

    def write_files(draft: Path) -> None:
        summary["files"] = _write_files(results, summary["scenarios"], draft)

    print_result = partial(_print, results, out)
    output.deliver("run", "results.json", summary, print_result, files=write_files, then=None)
    if failed:
        raise typer.Exit(1)


def _all(folders: tuple[Path, ...], plant: str | None, controllers: list[str | None]) -> list[str]:
    """Names of all scenarios in the user's folder if there is one, else of the shipped ones, as far as their drive is
    that of a plant and controllers that were given."""
    from ..scenario.prepare import with_drive_of

    names = sorted(path.stem for path in folders[0].glob("*.toml"))
    if not names:
        raise InputError(f"{folders[0]}: contains no scenario; add a TOML file, or name a scenario")
    given = [name for name in controllers if name]
    fitting = with_drive_of(names, plant, given) if plant or given else names
    if not fitting:
        raise InputError(f"{folders[0]}: no scenario has a plant with the drive of what was given; name a scenario")
    return fitting


def _names_of(scenario: str, controller: str | None) -> tuple[str, str]:
    """Names of scenario and controller, known before the run."""
    from ..scenario.definition import load_scenario

    loaded = load_scenario(scenario)
    return loaded.name, Path(controller or loaded.definition.controller).stem


def _run_one(name: str, controller: str | None, options: Mapping[str, Any]) -> ScenarioResult:
    from ..scenario.run import run_one

    try:
        return run_one(name, controller, **options)
    except SimulationError as error:
        raise SimulationError(f"scenario {name}: {error}") from None


def _run_all(todo: list[tuple[str, str | None]], jobs: int, options: Mapping[str, Any]) -> Iterator[ScenarioResult]:
    """Run each pair of scenario and controller, with a progress bar on standard error if that is a terminal."""
    from joblib import Parallel, delayed
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("scenarios", total=len(todo))
        # With one job joblib runs in this process, one after the other.
        jobs = min(jobs, len(todo))
        results = Parallel(n_jobs=jobs, return_as="generator")(delayed(_run_one)(*pair, options) for pair in todo)
        for result in results:
            progress.update(task, advance=1, description=result.scenario.name)
            yield result


def _next_results(force: bool) -> Path:
    """The default folder: results, or the first of results-2, results-3 ... without a result."""
    folder, number = Path("results"), 1
    while not force and (folder / "results.json").exists():
        number += 1
        folder = Path(f"results-{number}")
    return folder


def _stem(result: ScenarioResult) -> str:
    """Name of a run's files, without ending."""
    return f"{result.scenario.name}-{result.controller.name}"


def _old_baselines(out: Path) -> ResultFolder:
    """Folder for the figures of baselines that are about to change; they are written before the result."""
    from ..core.result_folder import ResultFolder

    return ResultFolder(out, "baselines", force=True, keep=True)


def _update(results: list[ScenarioResult], reason: str, out: Path, *, quiet: bool) -> list[ScenarioResult]:
    """Print the changes, prompt for a reason unless one is given, and record the new baselines."""
    from ..report.figures import save
    from ..scenario.baseline_file import baseline_changes, update_baseline

    changed = [(result, baseline_changes(result)) for result in results]
    for result, lines in changed:
        if lines and not quiet:
            print("\n  ".join([f"{result.scenario.name} with {result.controller.name}:", *lines]))
            if result.baseline is not None:
                name = f"{_stem(result)}{OLD}"
                with _old_baselines(out).draft() as draft:
                    save(result.plot_baseline(), draft / name)
                print(f"  figure: {out / name}.png")
    if not any(lines for _, lines in changed):
        return results
    reason = reason.strip() or typer.prompt("Why do the baselines change?")
    return [update_baseline(result, reason)[0] for result in results]


def _write_files(results: list[ScenarioResult], described: list[dict[str, Any]], folder: Path) -> list[str]:
    """Write time series and figures; return the names of all files. described: `to_dict` of the results."""
    from ..report.result_figures import run_figures, save_all
    from ..report.result_tables import run_tables, save_tables

    save_tables(run_tables(results, described), folder)
    save_all(run_figures(results, described), folder)
    return ["report.html", *sorted(path.name for path in folder.iterdir())]


def _print(results: list[ScenarioResult], out: Path) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console()
    groups: dict[str, list[ScenarioResult]] = {}
    for result in results:
        groups.setdefault(f"{result.scenario.path or result.scenario.name}", []).append(result)
    for group in groups.values():
        for result in group:
            name = f"{result.scenario.name} with {result.controller.name}{result.of_draw}: "
            console.print(Text.assemble(name, VERDICTS[result.verdict], f", {result.scenario.title}"))
            for failure in result.failures:
                console.print(Text(f"  {failure}", "red"))
            if result.solver_words:
                console.print(f"  {result.solver_words}", highlight=False)
        console.print(_metrics(group))
        console.print()
    if len(results) > 1:
        console.print(_summary(results))
    counts = {word: sum(result.verdict == word for result in results) for word in VERDICTS}
    failed = f", {counts['fail']} failed" if counts["fail"] and len(results) > 1 else ""
    untested = f", {counts['untested']} untested" if counts["untested"] else ""
    series = f"{_stem(results[0])}.csv" if len(results) == 1 else "SCENARIO-CONTROLLER.csv"
    where = f"written to {out} (open {out / 'report.html'}; time series: {series})"
    passed = f"{counts['pass']} of {len(results)} passed{failed}{untested}"
    console.print(f"{passed}; {where}", markup=False, soft_wrap=True)


def _summary(results: list[ScenarioResult]) -> Table:
    """Table of all runs with their verdicts."""
    from rich.text import Text

    from ..scenario.result import first_reasons

    table = bare_table("scenario", "controller", "verdict", "why")
    for result in results:
        verdict = Text(*VERDICTS[result.verdict])
        table.add_row(result.scenario.name, result.controller.name, verdict, first_reasons(result.failures))
    return table


def _metrics(results: list[ScenarioResult]) -> Table:
    """Table of metrics. One controller: linear prediction, nonlinear result, gap. Several: their nonlinear results."""
    from ..report.closed_loop import CLOSED_LOOP
    from ..scenario.metrics import METRICS

    frames = [result.table() for result in results]
    if len(results) == 1:
        headings, columns = ["linear prediction", "nonlinear plant", "gap"], ["linear", "nonlinear", "gap"]
    else:
        headings, columns = [result.controller.name for result in results], ["nonlinear"]
    table = bare_table("", *headings, "unit", right=len(headings))
    for name in CLOSED_LOOP:
        cells = [frame.loc[name, column] for frame in frames for column in columns]
        # The position's metrics are shown as undefined; a run without a force target does not mention forces.
        if set(cells) != {"-"} and not (METRICS[name].requires == "force" and set(cells) == {"not defined"}):
            unit = frames[0].loc[name, "unit"]
            table.add_row(name, *cells, "" if unit == "1" else unit)
    return table
