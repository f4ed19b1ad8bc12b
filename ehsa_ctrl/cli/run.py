"""`ehsa-ctrl run`: the main job."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import InputError, SimulationError
from .options import Force, Json

if TYPE_CHECKING:
    from ..scenario.run import ScenarioResult


def command(
    scenarios: Annotated[list[str] | None, typer.Argument(help="Names or TOML files; by default all of them.")] = None,
    controller: Annotated[
        str | None, typer.Option(help="Run these instead, names or files separated by commas.")
    ] = None,
    plant: Annotated[str | None, typer.Option(help="Check on this plant instead of the scenario's.")] = None,
    design: Annotated[
        str | None, typer.Option(help="Design on this plant's linear set; by default on that of the plant checked.")
    ] = None,
    jobs: Annotated[int, typer.Option(help="Processes to use.", min=1)] = 1,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for results.json, report.html and figures.")
    ] = Path("results"),
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Design on the identified linear model, check on the nonlinear plant, judge the scenario's limits.

    Examples: ehsa-ctrl run · ehsa-ctrl run steps_spring --out results/steps ·
    ehsa-ctrl run my/scenario.toml --controller pid_position,my/pid.toml · ehsa-ctrl run --plant results/rig.toml
    """
    from ..core.catalogue import scenarios as catalogue
    from .output import prepare_folder, to_json
    from .progress import compiling

    names = scenarios or _all(catalogue.folders)
    chosen: list[str | None] = [None]
    if controller is not None:
        chosen = [name.strip() for name in controller.split(",") if name.strip()]
        if not chosen:
            raise InputError(f"--controller {controller!r}: names no controller")
    for name in names:
        catalogue.find(name)
    for kind, given in (("scenario", names), ("controller", [name for name in chosen if name])):
        stems = [Path(name).stem for name in given]
        twice = [stem for stem in stems if stems.count(stem) > 1]
        if twice:
            raise InputError(f"{kind} {twice[0]!r} is given twice; files of the result are named by it")
    prepare_folder(out, "results.json", force=force)
    todo = [(name, other) for name in names for other in chosen]
    with compiling():
        results = list(_run_all(todo, plant, design, jobs))
    failed = [result for result in results if not result.passed]
    summary = {"passed": not failed, "scenarios": [result.to_dict() for result in results]}
    (out / "results.json").write_text(to_json(summary) + "\n")
    _write_report(results, out)
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


def _one(name: str, controller: str | None, plant: str | None, design: str | None) -> ScenarioResult:
    from ..scenario.run import run

    try:
        return run(name, controller=controller, plant=plant, design=design)
    except SimulationError as error:
        raise SimulationError(f"scenario {name}: {error}") from None


def _run_all(
    todo: list[tuple[str, str | None]], plant: str | None, design: str | None, jobs: int
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
            results = (_one(name, controller, plant, design) for name, controller in todo)
        else:
            results = Parallel(n_jobs=jobs, return_as="generator")(delayed(_one)(*pair, plant, design) for pair in todo)
        for result in results:
            progress.update(task, advance=1, description=result.scenario.name)
            yield result


def _write_report(results: list[ScenarioResult], out: Path) -> None:
    import sys

    from ..report.figures import loop_figure, save
    from ..report.page import write_page

    loops = {}
    for result in results:
        save(result.plot(), out / f"{result.scenario.name}-{result.controller.name}")
        if result.loop is not None:
            loops[result.controller.name] = result.loop
    for name, loop in loops.items():
        save(loop_figure(loop), out / f"loop-{name}")
    write_page(results, out, command="ehsa-ctrl " + " ".join(sys.argv[1:]))


#: What the table on the terminal shows; the page has all metrics.
SHOWN = ("RiseTime", "SettlingTime", "Overshoot", "SteadyStateError", "MaxError", "RMSError", "Slips", "CurrentRMS")


def _print(results: list[ScenarioResult], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    for result in results:
        table = Table(box=None, pad_edge=False, title_justify="left")
        verdict = ("passed", "bold green") if result.passed else ("FAILED", "bold red")
        name = f"{result.scenario.name} with {result.controller.name}: "
        console.print(Text.assemble(name, verdict, f", {result.scenario.title}"))
        table.add_column("")
        table.add_column("linear prediction", justify="right")
        table.add_column("nonlinear plant", justify="right")
        table.add_column("unit")
        frame = result.to_pandas()
        for name in SHOWN:
            row = frame.loc[name]
            if row[["linear", "nonlinear"]].isna().all():
                continue
            table.add_row(
                name, f"{row['linear']:.4g}", f"{row['nonlinear']:.4g}", "" if row["unit"] == "1" else row["unit"]
            )
        console.print(table)
        for failure in result.failures:
            console.print(Text(f"  {failure}", "red"))
        console.print()
    passed = sum(result.passed for result in results)
    console.print(f"{passed} of {len(results)} passed; written to {out} (open {out / 'report.html'})")
