"""`ehsa-ctrl diagnose`: where a log and the simulation differ, which effect causes it, how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .complete import controllers, models, plants, scenarios
from .options import (
    Align,
    First,
    Force,
    Json,
    Last,
    Out,
    Resample,
    Rest,
    Settings,
    Zero,
    read_pairs,
    read_preparation,
)

if TYPE_CHECKING:
    from ..core.log import Log
    from ..diagnosis.changed import Change
    from ..diagnosis.diagnosis import Diagnosis
    from ..diagnosis.next_experiment import Experiment
    from ..identification.preparation import Preparation
    from ..plant.plant import Plant
    from .closed_loop import Closed


def command(
    logs: Annotated[list[Path], typer.Argument(help="Measured logs: CSV, Parquet or MAT.")],
    plant: Annotated[
        str, typer.Option("--plant", help="Name of a plant, or the path of its TOML.", autocompletion=plants)
    ],
    model: Annotated[
        str, typer.Option(help="linear or nonlinear: which of its models is believed.", autocompletion=models)
    ] = "nonlinear",
    validate: Annotated[
        Path | None, typer.Option(help="A second log to hold out; else the last third of the log is.")
    ] = None,
    before: Annotated[
        Path | None, typer.Option(help="An earlier log of the same rig: say what changed since then.")
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(help="Run this scenario on the believed and on the improved plant.", autocompletion=scenarios),
    ] = None,
    controller: Annotated[
        str | None, typer.Option(help="With this one instead of the scenario's own.", autocompletion=controllers)
    ] = None,
    replay: Annotated[
        bool, typer.Option("--replay", help="The log was recorded under that loop: state the closed-loop gap.")
    ] = False,
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    threshold: Annotated[float, typer.Option(help="A gap of a signal from which on it matters.")] = 0.03,
    start: First = None,
    stop: Last = None,
    zero: Zero = "",
    rest: Rest = "",
    resample: Resample = None,
    align: Align = "",
    jobs: Annotated[int | None, typer.Option(help="Cores or workers to use; all by default.")] = None,
    backend: Annotated[
        str, typer.Option(help="For several logs: loky or threading on this machine; dask or ray on a cluster.")
    ] = "loky",
    address: Annotated[
        str | None, typer.Option(help="Of the cluster's scheduler; without one a cluster is started here.")
    ] = None,
    unchecked: Annotated[bool, typer.Option("--unchecked", help="Go on with a log that looks plainly wrong.")] = False,
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Say where the gap between a log and the believed plant lies, which effect causes it, and how far it shrinks.

    Several logs get a folder each and a summary; interrupt that and call it again: it goes on where it was.

    --from and --to are for the log, or each of several; a log of --validate or --before is used whole. A channel whose
    zero or delay is put right beforehand can't be found to have a wrong one.

    Examples: ehsa-ctrl diagnose log.csv --plant ehsa --out results/diagnosis · ehsa-ctrl diagnose log.csv --plant
    my/rig.toml --validate other.csv --set load.stiffness=50e3 --threshold 0.05 · ehsa-ctrl diagnose logs/*.csv --plant
    ehsa --out results/logs · ehsa-ctrl diagnose rig.csv --plant my/rig.toml --from 2 --to 26 --resample 250 --zero
    p1,p2 · ehsa-ctrl diagnose today.csv --before last_year.csv --plant ehsa · ehsa-ctrl diagnose
    log.csv --plant ehsa --scenario steps_spring --controller pid_position --replay --set load.stiffness=50e3
    """
    from ..core.errors import InputError
    from ..core.result_folder import ResultFolder
    from ..plant.load import load_plant, models_of
    from .output import to_json, warn_implausible
    from .prepared import sentences

    if model not in ("linear", "nonlinear"):
        raise InputError(f"--model {model!r}: expected linear or nonlinear")
    one_alone = {"--validate": validate, "--before": before, "--scenario": scenario}
    for option, given in one_alone.items():
        if given is not None and len(logs) > 1:
            raise InputError(f"{option} goes with one log, not with {len(logs)}; diagnose them one by one")
    if validate is not None and before is not None:
        raise InputError("--validate and --before don't go together: the last third of each log is held out")
    for option, asked in (("--replay", replay), ("--controller", controller is not None)):
        if asked and scenario is None:
            raise InputError(f"{option} needs a scenario; name it with --scenario")
    if replay and (start is not None or stop is not None):
        raise InputError("--replay holds the log against the scenario from its first second; leave --from and --to out")
    preparation = read_preparation(start, stop, zero, rest, resample, align)
    nominal = load_plant(plant, model=model, settings=read_pairs(settings))  # type: ignore[arg-type]
    warn_implausible([nominal])
    if len(logs) > 1:
        from .diagnose_batch import diagnose_batch

        diagnose_batch(
            nominal, logs, preparation, threshold=threshold, jobs=-1 if jobs is None else jobs, backend=backend,
            address=address, check=not unchecked, out=out, force=force, as_json=as_json, write=_write,
        )  # fmt: skip
        return
    place = None
    if out is not None:
        place = ResultFolder(out, "diagnose", force).check(
            *names_of(nominal, before is not None, scenario is not None),
            figures=[*FIGURES, *(["closed_loop"] if scenario is not None else [])],
        )
    found, change, closed, steps = _found(
        nominal, logs[0], validate, before, scenario, controller, preparation, replay=replay, threshold=threshold,
        jobs=jobs, check=not unchecked,
    )  # fmt: skip
    if place is not None:
        with place.draft() as draft:
            _write(draft, found, change, closed, (logs[0], validate, before), steps)
    if as_json:
        more = {"closed_loop": closed.to_dict()} if closed is not None else {}
        print(to_json({**(found if change is None else change).to_dict(), **more, "preparation": steps}))
        return
    for sentence in sentences(steps, read=False):
        print(sentence)
    print(found if change is None else change)
    if closed is not None:
        _print_closed(closed)
    if out is not None:
        improved = _improved(out, found)
        print(f"written to {out}" + (f"; use the corrected plant as --plant {improved}" if improved else ""))
        if improved and found.plant.model == "nonlinear" and "linear" in models_of(improved):
            print("  its linear set is as it was; `identify --linear sliding` on it writes one that follows")
    for line in next_lines(found.experiment, out):
        print(line)


def _improved(out: Path, found: Diagnosis) -> Path | None:
    """File of the corrected plant; None where there is none, or none that could be written."""
    there = found.improved is not None and found.plant.path is not None
    return out / f"{found.plant.name}_improved.toml" if there else None


def _found(
    nominal: Plant,
    log: Path,
    validate: Path | None,
    before: Path | None,
    scenario: str | None,
    controller: str | None,
    preparation: Preparation,
    *,
    replay: bool,
    threshold: float,
    jobs: int | None,
    check: bool,
) -> tuple[Diagnosis, Change | None, Closed | None, list[dict[str, Any]]]:
    """The diagnosis of one log, what changed since an earlier one, what that does to a closed loop, and what was done
    to the logs."""
    from ..diagnosis.changed import what_changed
    from ..diagnosis.diagnose import diagnose
    from ..identification.plant_log import missing_information
    from .closed_loop import case_of, check_replay, close
    from .output import warn
    from .prepared import read_prepared, whole
    from .progress import compiling, counting

    steps: list[dict[str, Any]] = []

    def ready(path: Path, how: Preparation) -> Log:
        with compiling():
            read = read_prepared(path, nominal, how)
        steps.extend(read.cautioned())
        return read.log

    measured = ready(log, preparation)
    second = ready(validate, whole(preparation)) if validate is not None else None
    earlier = ready(before, whole(preparation)) if before is not None else None
    # What is wrong with the scenario is said before the long work and not after it.
    case = case_of(scenario, controller, nominal) if scenario is not None else None
    if case is not None and replay:
        check_replay(case, nominal, measured)
    missing = missing_information(measured, nominal)
    if "force" in missing:
        warn(missing["force"])
    change = None
    with compiling(), counting() as watch:
        if earlier is not None:
            change = what_changed(nominal, earlier, measured, threshold=threshold, jobs=jobs, watch=watch, check=check)
            found = change.after
        else:
            found = diagnose(
                nominal, measured, validate=second, threshold=threshold, jobs=jobs, watch=watch, check=check
            )
        words = ("believed", "improved") if change is None else ("before", "after")
        closed = close(case, found, replay=replay, words=words) if case is not None else None
    for sentence in dict.fromkeys([*(change.before.findings if change is not None else ()), *found.findings]):
        warn(sentence)
    return found, change, closed, steps


def _print_closed(closed: Closed) -> None:
    """The table of the closed loop, with what is to be said of it."""
    from rich.console import Console

    from ..report.closed_loop import OTHER
    from .closed_loop import table
    from .output import warn

    console = Console(highlight=False)
    console.print(f"\n{closed.scenario} with {closed.controller}:")
    console.print(table(closed))
    for word, reasons in closed.failures.items():
        console.print(f"{word} plant: " + ("keeps the limits" if not reasons else "; ".join(reasons)), markup=False)
    if len(closed.metrics) == 1:
        console.print("No cause was named, so that there is no other plant to compare.")
    if closed.replay is not None and closed.replay.other > OTHER:
        warn(
            f"the logged current differs by {100 * closed.replay.other:.0f} % from what {closed.controller} asks for "
            "on the log's own measurements: was it recorded under this loop?"
        )


#: Figures that a diagnosis has or may have.
FIGURES = ("signals", "where", "unknown_inputs", "candidates", "shrinkage")


def names_of(plant: Plant, before: bool = False, closed: bool = False) -> list[str]:
    """Files that a diagnosis has or may have beside its figures, the main one first."""
    from ..diagnosis.next_experiment import FILE
    from ..report.diagnosis_page import FILE as PAGE

    names = ["diagnosis.json", PAGE, f"{plant.name}_improved.toml", "signals.csv", "causes.csv", FILE]
    names += ["before.json", f"{plant.name}_before.toml"] if before else []
    return [*names, "closed_loop.json"] if closed else names


def next_lines(experiment: Experiment | None, out: Path | None) -> list[str]:
    """What to call for the proposed experiment on the virtual bench."""
    from ..diagnosis.next_experiment import FILE

    if experiment is None:
        return []
    if out is not None:
        return [f"next experiment: {out / FILE}; on the virtual bench", f"  {experiment.command_in(out)}"]
    if FILE in experiment.command:
        return [f"say --out DIR to have the next experiment's current as {FILE}"]
    return ["next experiment on the virtual bench", f"  {experiment.command}"]


def _write(
    out: Path,
    found: Diagnosis,
    change: Change | None = None,
    closed: Closed | None = None,
    files: Sequence[Path | None] = (),
    steps: Sequence[Mapping[str, Any]] = (),
) -> None:
    """JSON, the improved plant, a table of causes and one of signals, figures and page.

    files: logs that hashes are given of; those of the diagnosis alone by default. steps: what was done to them.
    """
    from ..diagnosis.next_experiment import FILE
    from ..identification.plant_toml import write_plant
    from ..report.diagnosis_page import diagnosis_figures, write_diagnosis_page
    from ..report.diagnosis_signals import signals_table
    from ..report.figures import closed_figure, save
    from .output import command_line, rests_on, to_json
    from .prepared import sentences

    if found.experiment is not None:
        found.experiment.write(out / FILE)
    read = [file for file in files or (found.log.path,) if file is not None]
    answer = {
        **(found if change is None else change).to_dict(),
        "preparation": list(steps),
        "rests_on": rests_on([found.plant if change is None else change.before.plant], read),
    }
    (out / "diagnosis.json").write_text(to_json(answer) + "\n")
    if change is not None:
        (out / "before.json").write_text(to_json(change.before.to_dict()) + "\n")
        write_plant(out / f"{change.rig.name}_before.toml", change.rig)
    improved = _improved(out, found)
    if improved is not None and found.improved is not None:
        write_plant(improved, found.improved)
    signals_table(found).to_csv(out / "signals.csv", index=False, float_format="%.7g")
    if found.effects:
        found.to_pandas().to_csv(out / "causes.csv", index=False)
    drawn = diagnosis_figures(found)
    for name, (_, figure) in drawn.items():
        save(figure, out / name)
    loop_figure = None
    if closed is not None:
        (out / "closed_loop.json").write_text(to_json(closed.to_dict()) + "\n")
        loop_figure = closed_figure(closed.loops, f"{closed.scenario} with {closed.controller}")
        save(loop_figure, out / "closed_loop")
    write_diagnosis_page(
        found,
        out,
        command=command_line(),
        change=change,
        closed=closed.to_dict() if closed is not None else None,
        closed_loop=loop_figure,
        files=read,
        steps=sentences(steps),
    )
