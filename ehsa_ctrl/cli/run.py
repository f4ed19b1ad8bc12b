"""`ehsa-ctrl run`: the main job."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import InputError, SimulationError
from .complete import plants, several_controllers, symbols
from .complete import scenarios as scenario_names
from .options import Force, Json, read_pairs

if TYPE_CHECKING:
    from rich.table import Table

    from ..core.result_folder import ResultFolder
    from ..scenario.result import ScenarioResult

#: How the name of a figure of an old baseline ends.
OLD = "-old-baseline"


def command(
    scenarios: Annotated[
        list[str] | None,
        typer.Argument(help="Names or TOML files; by default all of them.", autocompletion=scenario_names),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(help="Run these instead, names or files separated by commas.", autocompletion=several_controllers),
    ] = None,
    plant: Annotated[
        str | None, typer.Option(help="Check on this plant instead of the scenario's.", autocompletion=plants)
    ] = None,
    design: Annotated[
        str | None,
        typer.Option(
            help="Design on this plant's linear set; by default on that of the plant checked.", autocompletion=plants
        ),
    ] = None,
    settings: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Believe another value of the plant that is checked on, in this run: K_T=1.1, load.stiffness=50e3. "
            "A load acts in the linear prediction too; the design stays on the linear set as its file has it. "
            "Repeatable.",
            autocompletion=symbols,
        ),
    ] = [],  # noqa: B006 - typer reads the default, nobody changes it
    jobs: Annotated[int, typer.Option(help="Processes to use.", min=1)] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for results.json, report.html, time series and figures; by default results, or results-2 and "
            "so on where there is a result already.",
        ),
    ] = None,
    as_json: Json = False,
    force: Force = False,
    update_baselines: Annotated[
        bool, typer.Option("--update-baselines", help="Record runs that have no baseline or have left it.")
    ] = False,
    reason: Annotated[str, typer.Option(help="Why the baselines change; asked for on a terminal.")] = "",
    assumed: Annotated[
        bool | None,
        typer.Option(
            "--assumed/--no-assumed",
            help="Also run with each assumed parameter at both ends of its believed range, for the page. By default "
            "where that is quick: with a compiled controller.",
        ),
    ] = None,
) -> None:
    """Design on the identified linear model, check on the nonlinear plant, judge the scenario's limits and baseline.

    Examples: ehsa-ctrl run · ehsa-ctrl run steps_spring --out results/steps ·
    ehsa-ctrl run my/scenario.toml --controller pid_position,my/pid.toml · ehsa-ctrl run --plant results/rig.toml ·
    ehsa-ctrl run steps_spring --set K_T=1.05 --set load.stiffness=80e3 ·
    ehsa-ctrl run --update-baselines --reason "softer spring in the rig"
    """
    from ..core.catalogue import scenarios as catalogue
    from ..core.result_folder import ResultFolder
    from .output import rests_on, to_json, warn
    from .progress import compiling

    if update_baselines and (plant or design or settings):
        raise InputError(
            "--update-baselines records the scenario's own plant; leave --plant and --design out, and --set"
        )
    if update_baselines and not reason.strip() and not sys.stdin.isatty():
        raise InputError("--update-baselines changes what counts as right: say why with --reason TEXT")

    changes = read_pairs(settings)
    names = scenarios or _all(catalogue.folders)
    chosen: list[str | None] = [None]
    if controller is not None:
        chosen = [name.strip() for name in controller.split(",") if name.strip()]
        if not chosen:
            raise InputError(f"--controller {controller!r}: names no controller")
    for name in names:
        catalogue.find(name)
    for kind, given in (("scenario", names), ("controller", [name for name in chosen if name])):
        words = [Path(name).stem for name in given]
        twice = [word for word in words if words.count(word) > 1]
        if twice:
            raise InputError(f"{kind} {twice[0]!r} is given twice; files of the result are named by it")
    out = out or _next_results(force)
    pairs = [_pair(name, other) for name in names for other in chosen]
    stems = ["-".join(pair) for pair in pairs]
    place = ResultFolder(out, "run", force).check(
        "results.json", "report.html", *(f"{stem}.csv" for stem in stems),
        figures=[*stems, *(f"loop-{name}" for _, name in pairs)],
    )  # fmt: skip
    if update_baselines:
        _old_baselines(out).check(figures=[f"{stem}{OLD}" for stem in stems])
    todo = [(name, other) for name in names for other in chosen]
    try:
        with compiling():
            results = list(_run_all(todo, plant, design, jobs, assumed, changes))
    except KeyboardInterrupt:
        raise KeyboardInterrupt("results are written when all scenarios are done; nothing is kept") from None
    for sentence in dict.fromkeys(sentence for result in results for sentence in result.plant.implausible):
        warn(sentence)
    if update_baselines:
        results = _update(results, reason, out, quiet=as_json)
    failed = [result for result in results if not result.passed]
    with place.draft() as draft:
        summary = {
            "passed": not failed,
            "scenarios": [result.to_dict() for result in results],
            "files": _write_files(results, draft),
            "rests_on": rests_on(
                [run.trajectory.plant for result in results for run in (result.nonlinear, result.linear)],
                [file for result in results for file in result.files],
            ),
        }
        (draft / "results.json").write_text(to_json(summary) + "\n")
    if as_json:
        print(to_json(summary))
    else:
        _print(results, out)
    if failed:
        raise typer.Exit(1)


def _all(folders: tuple[Path, ...]) -> list[str]:
    """Every scenario of the user's own folder if there is one, else of the shipped one."""
    names = sorted(path.stem for path in folders[0].glob("*.toml"))
    if not names:
        raise InputError(f"{folders[0]}: holds no scenario; add a TOML file or name one")
    return names


def _one(
    name: str,
    controller: str | None,
    plant: str | None,
    design: str | None,
    assumed: bool | None,
    settings: dict[str, str],
) -> ScenarioResult:
    from ..scenario.run import run

    try:
        return run(name, controller=controller, plant=plant, design=design, assumed=assumed, settings=settings)
    except SimulationError as error:
        raise SimulationError(f"scenario {name}: {error}") from None


def _run_all(
    todo: list[tuple[str, str | None]],
    plant: str | None,
    design: str | None,
    jobs: int,
    assumed: bool | None,
    settings: dict[str, str],
) -> Iterator[ScenarioResult]:
    """Run every pair of scenario and controller, with a bar on standard error where that is a terminal."""
    from joblib import Parallel, delayed
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("scenarios", total=len(todo))
        if jobs == 1 or len(todo) == 1:
            results = (_one(name, controller, plant, design, assumed, settings) for name, controller in todo)
        else:
            results = Parallel(n_jobs=jobs, return_as="generator")(
                delayed(_one)(*pair, plant, design, assumed, settings) for pair in todo
            )
        for result in results:
            progress.update(task, advance=1, description=result.scenario.name)
            yield result


def _next_results(force: bool) -> Path:
    """The folder for who names none: nothing that is there is replaced unasked, and nobody is refused."""
    folder, number = Path("results"), 1
    while not force and (folder / "results.json").exists():
        number += 1
        folder = Path(f"results-{number}")
    return folder


def _stem(result: ScenarioResult) -> str:
    """How the files of a run are called."""
    return f"{result.scenario.name}-{result.controller.name}"


def _pair(scenario: str, controller: str | None) -> tuple[str, str]:
    """The names of scenario and controller before the run."""
    from ..scenario.definition import load_scenario

    loaded = load_scenario(scenario)
    return loaded.name, Path(controller or loaded.definition.controller).stem


def _old_baselines(out: Path) -> ResultFolder:
    """Figures of baselines that are about to change; they are looked at before the result is written."""
    from ..core.result_folder import ResultFolder

    return ResultFolder(out, "baselines", force=True, keep=True)


def _update(results: list[ScenarioResult], reason: str, out: Path, *, quiet: bool) -> list[ScenarioResult]:
    """Show what has changed, ask why unless that was said, and record it."""
    from ..report.figures import save
    from ..scenario.baseline import baseline_changes, update_baseline

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


def _write_files(results: list[ScenarioResult], folder: Path) -> list[str]:
    """Time series, figures and page; returns the names of the files."""
    from ..report.figures import loop_figure, save
    from ..report.page import write_page
    from .output import command_line

    drawings = []
    for result in results:
        name = _stem(result)
        result.time_series().to_csv(folder / f"{name}.csv", index=False, float_format="%.9g")
        _, drawn = save(result.plot(), folder / name)
        drawings.append(drawn.read_text(encoding="utf-8"))
        if result.baseline is not None and result.baseline.differences(result):
            save(result.plot_baseline(), folder / f"{name}-baseline")
    for name, loop in {result.controller.name: result.loop for result in results}.items():
        if loop is not None:
            save(loop_figure(loop), folder / f"loop-{name}")
    drawn_of = sorted(path.name for path in folder.iterdir())
    write_page(results, folder, command=command_line(), drawings=drawings)
    return ["report.html", *drawn_of]


#: What the table on the terminal shows; the page has all metrics.
SHOWN = (
    "RiseTime", "SettlingTime", "SettlingRatio", "Overshoot", "SteadyStateError", "MaxError", "RMSError",
    "HuntingAmplitude", "Slips", "SaturationShare", "CurrentRMS", "Energy", "StopTime", "TravelAfterStop",
)  # fmt: skip
VERDICTS = {"pass": ("passed", "bold green"), "fail": ("FAILED", "bold red"), "untested": ("untested", "bold yellow")}


def _print(results: list[ScenarioResult], out: Path) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console()
    groups: dict[str, list[ScenarioResult]] = {}
    for result in results:
        groups.setdefault(f"{result.scenario.path or result.scenario.name}", []).append(result)
    for group in groups.values():
        for result in group:
            name = f"{result.scenario.name} with {result.controller.name}: "
            console.print(Text.assemble(name, VERDICTS[result.verdict], f", {result.scenario.title}"))
            for failure in result.failures:
                console.print(Text(f"  {failure}", "red"))
        console.print(_alone(group[0]) if len(group) == 1 else _beside(group))
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
    """All runs with their verdicts, a line each: what the tables above come to."""
    from rich.table import Table
    from rich.text import Text

    from ..scenario.result import first_reasons

    table = Table(box=None, pad_edge=False)
    for heading in ("scenario", "controller", "verdict", "why"):
        table.add_column(heading)
    for result in results:
        verdict = Text(*VERDICTS[result.verdict])
        table.add_row(result.scenario.name, result.controller.name, verdict, first_reasons(result.failures))
    return table


def _alone(result: ScenarioResult) -> Table:
    """One controller: linear prediction, nonlinear outcome and their gap."""
    table = _table("linear prediction", "nonlinear plant", "gap")
    frame = result.table()
    for name in SHOWN:
        cells = list(frame.loc[name, ["linear", "nonlinear", "gap"]])
        if set(cells) != {"-"}:
            table.add_row(name, *cells, _unit(frame.loc[name, "unit"]))
    return table


def _beside(results: list[ScenarioResult]) -> Table:
    """Several controllers on one scenario: what each did on the nonlinear plant."""
    table = _table(*(result.controller.name for result in results))
    frames = [result.table() for result in results]
    for name in SHOWN:
        cells = [frame.loc[name, "nonlinear"] for frame in frames]
        if set(cells) != {"-"}:
            table.add_row(name, *cells, _unit(frames[0].loc[name, "unit"]))
    return table


def _table(*columns: str) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for column in columns:
        table.add_column(column, justify="right", overflow="fold")
    table.add_column("unit")
    return table


def _unit(text: str) -> str:
    return "" if text == "1" else text
