"""`ehsa-ctrl diagnose`: where log and simulation differ, which effect causes it, how much of the gap it closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError
from ..core.text import stems
from .complete import controllers, scenarios
from .options import (
    LogOptions,
    LogSettings,
    NominalModel,
    PlantOption,
    Settings,
    Threshold,
    read_pairs,
    settings_by_log,
)
from .output import OutputOptions, bare_table, provenance, to_json, warn

if TYPE_CHECKING:
    from ..core.log import Log
    from ..design.controller import SampledController
    from ..diagnosis.changed import Change
    from ..diagnosis.closed_loop import LoopComparison
    from ..diagnosis.diagnosis import Diagnosis
    from ..diagnosis.next_experiment import NextExperiment
    from ..identification.preparation import Preparation
    from ..plant.plant import Plant
    from ..scenario.prepare import PreparedScenario

#: All figures that a diagnosis can have.
FIGURES = ("signals", "law", "where", "unknown_inputs", "candidates", "shrinkage")


@dataclass(frozen=True)
class SingleLogOptions:
    """Options for the diagnosis of one log."""

    validate: Annotated[
        Path | None, typer.Option(help="Second log, for validation; by default a third of the log is held out.")
    ] = None
    before: Annotated[
        Path | None, typer.Option(help="Earlier log of the same rig, to find what has changed since.")
    ] = None
    scenario: Annotated[
        str | None,
        typer.Option(help="Scenario to run on the nominal and on the improved plant.", autocompletion=scenarios),
    ] = None
    controller: Annotated[
        str | None,
        typer.Option(
            help="Controller under which the log was recorded: simulate the closed loop as well, along the log's "
            "channel reference; by default that of the plant's \\[log.controller]. With --scenario: controller instead "
            "of the scenario's own.",
            autocompletion=controllers,
        ),
    ] = None
    replay: Annotated[
        bool, typer.Option("--replay", help="The log was recorded in the scenario: simulate its closed loop as well.")
    ] = False

    def check(self, logs: int, preparation: LogOptions, *, together: bool = False) -> None:
        """Raises InputError for options that exclude each other."""
        ruled_out = ("before", "scenario", "controller")
        for word in ruled_out if together else ("validate", *ruled_out):
            if getattr(self, word) is not None and logs > 1:
                raise InputError(f"--{word} is for a single log, but {logs} are given; diagnose them one by one")
        if self.validate is not None and self.before is not None:
            raise InputError(
                "--validate and --before exclude each other, because --before holds out a third of each log; "
                "leave one out"
            )
        if self.replay and self.scenario is None:
            raise InputError(
                "--replay needs a scenario; name it with --scenario, or the controller alone with --controller"
            )
        if self.replay and (preparation.start is not None or preparation.stop is not None):
            raise InputError(
                "--replay compares the whole log with the scenario from its beginning; leave out --from and --to"
            )


@dataclass(frozen=True)
class DiagnosisOutcome:
    """The diagnosis of a log, and what else goes into its files.

    steps: preparation of the logs, as JSON. files: the logs. change: None unless an earlier log was given.
    closed: None unless a scenario was given.
    """

    found: Diagnosis
    steps: Sequence[dict[str, Any]]
    files: Sequence[Path | None]
    change: Change | None = None
    closed: LoopComparison | None = None

    def to_dict(self) -> dict[str, Any]:
        content = (self.change or self.found).to_dict()
        if self.closed is not None:
            # The scenario's metrics stand beside the gaps of a closed-loop replay.
            content["closed_loop"] = {**content.get("closed_loop", {}), **self.closed.to_dict()}
        return {**content, "preparation": self.steps}

    def stored(self) -> dict[str, Any]:
        """Content of diagnosis.json."""
        plant = self.found.plant if self.change is None else self.change.before.plant
        content = (self.change or self.found).to_dict()
        if self.found.law is not None:
            content["law"]["proposal"] = self.found.law.proposal
        return {
            **content,
            "improved": improved_name(self.found),
            "preparation": self.steps,
            "rests_on": provenance([plant], [file for file in self.files if file is not None]),
        }


def command(
    logs: Annotated[list[Path], typer.Argument(help="Measured logs: CSV, TDMS, MDF, MCAP, MAT ...")],
    plant: PlantOption,
    single: SingleLogOptions,
    preparation: LogOptions,
    output: OutputOptions,
    model: NominalModel = "nonlinear",
    settings: Settings = [],
    threshold: Threshold = 0.03,
    jobs: Annotated[int | None, typer.Option(help="Number of cores to use; all by default.")] = None,
    backend: Annotated[str, typer.Option(help="For several logs: loky (processes) or threading.")] = "loky",
    unchecked: Annotated[
        bool, typer.Option("--unchecked", help="Diagnose the log even if the checks find an error in it.")
    ] = False,
    together: Annotated[
        bool, typer.Option("--together", help="One diagnosis over all logs, which are of one rig in one state.")
    ] = False,
    log_settings: LogSettings = [],
    without: Annotated[
        list[str],
        typer.Option(metavar="ID", help="Leave this effect out of the catalogue; the option can be repeated."),
    ] = [],
) -> None:
    """Find where log and nominal plant differ, which effect causes the gap, and how much of it that effect closes.

    Several logs get a folder each and a summary; after an interruption, the same command continues. With --together
    they get one diagnosis: causes and nominal parameters are shared, also offsets of sensors and of the current. What
    was set for one of them, such as the stiffness of a spring, is given by --log-set.

    --controller, or \\[log.controller] in the plant's file, adds a closed-loop replay: the gaps of the same models
    under the controller of the log, along the logged reference, with the position.

    --from and --to apply to each log that is diagnosed; logs of --validate and --before are used whole. --zero and
    --align remove the offset or delay of a channel, so that the diagnosis can't find it.

    Examples: ehsa-ctrl diagnose log.csv --plant ehsa --out results/diagnosis · ehsa-ctrl diagnose log.csv --plant
    my/rig.toml --validate other.csv --set load.stiffness=50e3 --threshold 0.05 · ehsa-ctrl diagnose logs/*.csv --plant
    ehsa --out results/logs · ehsa-ctrl diagnose free.csv spring.csv --together --log-set spring.csv:load.stiffness=50e3
    --plant ehsa · ehsa-ctrl diagnose rig.csv --plant my/rig.toml --from 2 --to 26 --resample 250 --zero p1,p2 ·
    ehsa-ctrl diagnose today.csv --before last_year.csv --plant ehsa · ehsa-ctrl diagnose log.csv --plant ehsa
    --scenario steps_spring --controller pid_position --replay --set load.stiffness=50e3 ·
    ehsa-ctrl diagnose loop.csv --plant my/rig.toml --controller pid_position --out results/loop
    """
    from ..plant.load import models_of
    from .inputs import load_model, preparation_sentences

    single.check(len(logs), preparation, together=together)
    own = settings_by_log(log_settings, logs)
    if log_settings and len(logs) > 1 and not together:
        raise InputError("--log-set is for logs that are diagnosed together; add --together")
    if without and len(logs) > 1 and not together:
        raise InputError("--without is for one diagnosis, of a log or of several --together; diagnose them one by one")
    how = preparation.preparation()
    nominal = load_model(plant, model, read_pairs(settings))
    if len(logs) > 1 and not together:
        from .diagnose_batch import diagnose_batch

        diagnose_batch(
            nominal, logs, how, output, threshold=threshold, jobs=-1 if jobs is None else jobs, backend=backend,
            check=not unchecked,
        )  # fmt: skip
        return
    closed_figure = ["closed_loop"] if single.scenario is not None else []
    output.check(
        "diagnose",
        *file_names(nominal, before=single.before is not None, closed=single.scenario is not None, logs=len(logs)),
        figures=[*FIGURES, *stems("signals", len(logs))[1:], "closed_loop_replay", *closed_figure],
    )
    outcome = _diagnose(
        nominal, logs, own, single, how, threshold=threshold, jobs=jobs, check=not unchecked, without=without
    )
    found, out = outcome.found, output.out
    improved = _improved_path(out, found) if out is not None else None

    def print_result() -> None:
        for sentence in preparation_sentences(outcome.steps, reading=False):
            print(sentence)
        print(found if outcome.change is None else outcome.change)
        if outcome.closed is not None:
            _print_closed(outcome.closed)

    output.deliver(
        "diagnose", "diagnosis.json", outcome.to_dict(), print_result, stored=outcome.stored(),
        files=lambda draft: write_files(draft, outcome),
        then=_then(found, improved) if improved else "",
    )  # fmt: skip
    if output.as_json:
        return
    if improved and found.plant.model == "nonlinear" and "linear" in models_of(improved):
        print("  its linear parameters are unchanged; derive new ones with `identify --linear sliding` and this plant")
    for line in next_lines(found.experiment, out):
        print(line)


def _then(found: Diagnosis, improved: Path) -> str:
    """What the improved plant is worth, and how to use it."""
    from ..diagnosis.diagnosis import NAMING

    if found.law is not None and found.gap["with_law"]["total"] > found.gap["nominal"]["total"]:
        return f"; {improved.name} has the law of effects/ beside it; its free run leaves more than the nominal plant's"
    if found.law is not None:
        return f"; use the corrected plant as --plant {improved}, which has the law of effects/ beside it"
    if found.verdict in NAMING:
        quality = "partly corrected" if found.verdict == "partly" else "corrected"
        return f"; use the {quality} plant as --plant {improved}"
    if found.gap["refit"]["total"] > found.gap["nominal"]["total"]:
        return f"; the refitted plant {improved.name} leaves more of held-out data than the nominal one: keep that one"
    return f"; use the refitted (no cause is named) plant as --plant {improved}"


def _improved_path(out: Path, found: Diagnosis) -> Path | None:
    """File of the improved plant; None without one."""
    name = improved_name(found)
    return out / name if name is not None else None


def improved_name(found: Diagnosis) -> str | None:
    """Name of the improved plant's file; None without a gap, and for a plant that does not come from a file."""
    exists = found.improved is not None and found.plant.path is not None
    return f"{found.plant.name}_improved.toml" if exists else None


def _diagnose(
    nominal: Plant,
    logs: Sequence[Path],
    own: Mapping[Path, Mapping[str, str]],
    single: SingleLogOptions,
    how: Preparation,
    *,
    threshold: float,
    jobs: int | None,
    check: bool,
    without: Sequence[str],
) -> DiagnosisOutcome:
    """Read and diagnose the logs, compare a single one with an earlier one, and run the scenario, as the options ask.

    own: log -> settings of this log alone.
    """
    from ..diagnosis.changed import what_changed
    from ..diagnosis.closed_loop import check_replay, compare_loops
    from ..diagnosis.closed_loop_replay import replay_closed_loop
    from ..diagnosis.diagnose import diagnose
    from ..identification.plant_log import missing_information
    from ..plant.load import read_settings
    from .inputs import read_prepared, refuse_repeated, whole
    from .progress import compiling, counting

    steps: list[dict[str, Any]] = []

    def read(path: Path, how: Preparation) -> Log:
        with compiling():
            prepared = read_prepared(path, nominal, how)
        steps.extend(prepared.diagnosis_step_dicts())
        return prepared.log

    refuse_repeated(logs)
    together = [replace(read(path, how), settings=read_settings(nominal, own[path])) for path in logs]
    measured = together[0]
    second = read(single.validate, whole(how)) if single.validate is not None else None
    earlier = read(single.before, whole(how)) if single.before is not None else None
    # Prepared now, so that an error in the scenario is reported before the long computation.
    case = prepare_case(single.scenario, single.controller, nominal) if single.scenario is not None else None
    if case is not None and single.replay:
        check_replay(case, nominal, measured)
    followed = [one for one in (measured, second) if one is not None]
    controller = _controller_of_log(nominal, single, followed) if len(logs) == 1 else None
    missing = missing_information(measured, nominal)
    if "force" in missing:
        warn(missing["force"])
    change = None
    with compiling(), counting() as watch:
        if earlier is not None:
            change = what_changed(
                nominal, earlier, measured, threshold=threshold, jobs=jobs, watch=watch, check=check, without=without
            )
            found = change.after
        else:
            found = diagnose(
                nominal, together, validate=second, threshold=threshold, jobs=jobs, watch=watch, check=check,
                without=without,
            )  # fmt: skip
        words = ("believed", "improved") if change is None else ("before", "after")
        if controller is not None:
            found = replay_closed_loop(found, controller, validate=second)
        closed = compare_loops(case, found, replay=single.replay, words=words) if case is not None else None
        if closed is not None and closed.replay is not None:
            found = replace(found, closed_loop=closed.replay)
        if change is not None:
            change = replace(change, after=found)
    for sentence in dict.fromkeys([*(change.before.findings if change is not None else ()), *found.findings]):
        warn(sentence)
    return DiagnosisOutcome(found, steps, (*logs, single.validate, single.before), change, closed)


def _controller_of_log(plant: Plant, single: SingleLogOptions, logs: Sequence[Log]) -> SampledController | None:
    """The controller for a closed-loop replay along the reference of these logs; None if none is asked for.

    Raises InputError as `log_controller` and `reference_of` do; where only the plant's file names a controller, a log
    without a reference, or with a sample time that does not fit, has no closed-loop replay.
    """
    from ..core.log import REFERENCES
    from ..diagnosis.logged_reference import reference_of
    from ..scenario.log_controller import log_controller

    asked = single.controller if single.scenario is None else None
    if asked is None and (plant.log_controller is None or single.replay):
        return None
    if asked is None and any(REFERENCES[0] not in log.channels for log in logs):
        warn(f"the log has no channel {REFERENCES[0]}: no closed-loop replay with the plant's [log.controller]")
        return None
    controller = log_controller(plant, asked)
    try:
        for log in logs:
            reference_of(log, controller)
    except InputError as error:
        if asked is not None:
            raise
        warn(f"no closed-loop replay with the plant's [log.controller]: {error}")
        return None
    return controller


def prepare_case(scenario: str, controller: str | None, plant: Plant) -> PreparedScenario:
    """The scenario with its controller designed on this plant's linear set; warns if it names another plant.

    Raises InputError as `prepare` does, and for a scenario of another system.
    """
    from ..core.catalogue import plants
    from ..plant.load import load_plant
    from ..scenario.definition import load_scenario
    from ..scenario.prepare import prepare

    loaded = load_scenario(scenario)
    named = load_plant(plants.find(loaded.definition.plant, beside=loaded.path))
    if named.structure.system_name != plant.structure.system_name:
        raise InputError(
            f"scenario {loaded.name} is for {named.name} ({named.structure.system_name}), but the log is of "
            f"{plant.name} ({plant.structure.system_name}); give a scenario for {plant.structure.system_name}"
        )
    if named.path is not None and plant.path is not None and named.path.resolve() != plant.path.resolve():
        warn(f"scenario {loaded.name} names plant {named.path}, but runs on {plant.path} here")
    return prepare(loaded, controller=controller, plant=plant.path)


def _print_closed(closed: LoopComparison) -> None:
    """Print the metrics and closed-loop gaps of each plant, and their failures."""
    from rich.console import Console

    from ..diagnosis.closed_loop_replay import MAX_DRIVE_DIFFERENCE
    from ..report.closed_loop import closed_table, plant_title

    console = Console(highlight=False)
    console.print(f"\n{closed.scenario} with {closed.controller}:")
    head, rows = closed_table(closed.to_dict())
    table = bare_table("", *head, "unit", right=len(head))
    for row in rows:
        table.add_row(*row)
    console.print(table)
    for word, reasons in closed.failures.items():
        console.print(
            f"{plant_title(word)}: " + ("keeps the limits" if not reasons else "; ".join(reasons)), markup=False
        )
    if len(closed.metrics) == 1:
        console.print("No cause was named, so that there is no other plant to compare.")
    if closed.replay is not None and (difference := closed.replay.drive_difference) > MAX_DRIVE_DIFFERENCE:
        warn(
            f"the logged current differs by {100 * difference:.0f} % from the output of {closed.controller} on the "
            "logged measurements: was the log recorded under this loop?"
        )


def file_names(plant: Plant, *, before: bool = False, closed: bool = False, logs: int = 1) -> list[str]:
    """All files that a diagnosis of so many logs can have besides its figures, the main one first."""
    from ..diagnosis.next_experiment import FILE
    from ..report.kinds._charts import LOOP_REPLAY, REGIMES
    from ..report.kinds.diagnosis import KIND

    names = ["diagnosis.json", KIND.page, f"{plant.name}_improved.toml", "causes.csv", REGIMES, LOOP_REPLAY, FILE]
    names += [f"{stem}.csv" for stem in stems("signals", logs)]
    names += ["before.json", f"{plant.name}_before.toml"] if before else []
    return [*names, "closed_loop.json"] if closed else names


def next_lines(experiment: NextExperiment | None, out: Path | None) -> list[str]:
    """The command that runs the proposed experiment on the virtual bench."""
    from ..diagnosis.next_experiment import FILE

    if experiment is None:
        return []
    if out is not None:
        return [f"next experiment: {out / FILE}; on the virtual bench", f"  {experiment.command_in(out)}"]
    if FILE in experiment.command:
        return [f"add --out DIR to write the next experiment's current to {FILE}"]
    return ["next experiment on the virtual bench", f"  {experiment.command}"]


def write_files(out: Path, outcome: DiagnosisOutcome) -> None:
    """Write the improved plant, tables of causes and signals, and figures."""
    from ..diagnosis.next_experiment import FILE
    from ..identification.plant_toml import write_plant
    from ..report.figures import closed_figure, save
    from ..report.result_figures import diagnosis_figures, save_all
    from ..report.result_tables import diagnosis_tables, save_tables

    found, change, closed = outcome.found, outcome.change, outcome.closed
    if found.experiment is not None:
        found.experiment.write(out / FILE)
    if change is not None:
        (out / "before.json").write_text(to_json(change.before.to_dict()) + "\n")
        write_plant(out / f"{change.rig.name}_before.toml", change.rig)
    improved = _improved_path(out, found)
    if improved is not None and found.improved is not None:
        write_plant(improved, found.improved)
    by_log = found.by_log()
    if found.law is not None:
        (out / found.law.proposal).parent.mkdir(exist_ok=True)
        (out / found.law.proposal).write_text(found.law.text([one.log for one in by_log]), encoding="utf-8")
    save_tables(diagnosis_tables(found), out)
    if found.effects:
        found.to_pandas().to_csv(out / "causes.csv", index=False)
    save_all(diagnosis_figures(found), out)
    if closed is not None:
        (out / "closed_loop.json").write_text(to_json(closed.to_dict()) + "\n")
        save(closed_figure(closed.loops, f"{closed.scenario} with {closed.controller}"), out / "closed_loop")
