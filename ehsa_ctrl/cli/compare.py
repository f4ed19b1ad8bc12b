"""`ehsa-ctrl compare`: a measured log beside the simulation that it drives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError, SimulationError
from .complete import models_or_both, plants
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
    from collections.abc import Iterable

    from ..identification.checks import LogFinding
    from ..identification.comparison import Comparison
    from ..identification.preparation import Step
    from ..plant.plant import Plant


def command(
    log: Annotated[Path, typer.Argument(help="Measured log: CSV, Parquet or MAT.")],
    plant: Annotated[
        str, typer.Option("--plant", help="Name of a plant, or the path of its TOML.", autocompletion=plants)
    ],
    model: Annotated[
        str, typer.Option(help="linear, nonlinear or both (what the plant has).", autocompletion=models_or_both)
    ] = "both",
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    start: First = None,
    stop: Last = None,
    zero: Zero = "",
    rest: Rest = "",
    resample: Resample = None,
    align: Align = "",
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Overlay a log and the free run that its drive gives, and say how well they fit; no diagnosis.

    Examples: ehsa-ctrl compare log.csv --plant ehsa · ehsa-ctrl compare log.csv --plant my/rig.toml --model nonlinear
    --set load.stiffness=50e3 --from 2 --to 12 --zero p1,p2 --out results/compare
    """
    from ..core.result_folder import ResultFolder
    from ..identification.checks import check_log, raise_on_error
    from ..identification.comparison import fit_words, replay
    from ..identification.plant_log import missing_information
    from .output import rests_on, to_json, warn, warn_implausible
    from .prepared import read_prepared
    from .progress import compiling

    nominal = load_models(plant, model, read_pairs(settings))
    warn_implausible(nominal)
    place = None
    if out is not None:
        place = ResultFolder(out, "compare", force).check(
            "comparison.json", "compare.csv", "report.html", figures=["compare"]
        )
    last = nominal[-1]
    preparation = read_preparation(start, stop, zero, rest, resample, align)
    with compiling():
        raw, ready, steps = read_prepared(log, last, preparation)
        findings = check_log(ready, last)
        raise_on_error(ready, (finding for finding in findings if finding.kind == "time_unit"))
        replays = [replay(each, ready) for each in nominal]
    if all(run.stopped for run in replays):
        for finding in findings:
            warn(str(finding))
        raise SimulationError("; ".join(run.stopped for run in replays))
    missing = missing_information(raw, last)
    cannot_tell = list(missing.values())
    result: dict[str, Any] = {
        "log": log,
        "plant": plant,
        "settings": read_pairs(settings),
        "samples": len(ready),
        "sample_time": ready.sample_time,
        "from": float(ready.time[0]),
        "to": float(ready.time[-1]),
        "models": {run.plant.model: _figures(run) for run in replays},
        "preparation": [step.to_dict() for step in steps],
        "findings": [finding.to_dict() for finding in findings],
        "untold": cannot_tell,
        "assumed": [name for name, p in last.parameters.items() if p.source == "assumed"],
        "provenance": replays[0].provenance,
        "rests_on": rests_on(nominal, [log]),
    }
    for finding in findings:
        warn(str(finding))
    for run in replays:
        if run.stopped:
            warn(f"{run.plant.model} model: {run.stopped}; no fit is given")
    if place is not None:
        with place.draft() as draft:
            _write(draft, result, replays, findings, cannot_tell, steps)
    if as_json:
        print(to_json(result))
        return
    print(f"{last.name} beside {log.name}: {len(ready)} samples from {ready.time[0]:g} to {ready.time[-1]:g} s")
    for step in steps:
        if step.kind != "read":
            print(f"  {step}")
    print(table(replays))
    for run in replays:
        words = fit_words(run.fit_percent)
        print(f"{run.plant.model} starts {run.start}" + (f"; its fit is {words}" if words else ""))
    if "force" in missing:
        print(missing["force"])
    if out is not None:
        print(f"written to {out}")


def load_models(plant: str, model: str, settings: dict[str, str]) -> list[Plant]:
    """The models asked for. With both, a setting that only one of them knows is meant for that one.

    Raises InputError as load_plant does, and for a setting that no model knows.
    """
    from ..plant.load import has_setting, load_plant, models_of

    if model not in ("linear", "nonlinear", "both"):
        raise InputError(f"--model {model!r}: expected linear, nonlinear or both")
    if model != "both":
        return [load_plant(plant, model=model, settings=settings)]  # type: ignore[arg-type]
    plain = [load_plant(plant, model=word) for word in models_of(plant)]
    for key in settings:
        if not any(has_setting(each, key) for each in plain):
            load_plant(plant, model=plain[-1].model, settings={key: settings[key]})
    return [
        load_plant(plant, model=each.model, settings={k: v for k, v in settings.items() if has_setting(each, k)})
        for each in plain
    ]


def table(replays: list[Comparison]) -> str:
    """Fit in percent, a row a channel, a column a model."""
    from ..identification.comparison import fit_cell

    lines = ["fit, %     " + "".join(f"{run.plant.model:>12}" for run in replays)]
    for channel in replays[0].fit_percent:
        cells = "".join(f"{fit_cell(run.fit_percent[channel]):>12}" for run in replays)
        lines.append(f"{channel:<11}{cells}")
    return "\n".join(lines)


def _figures(run: Comparison) -> dict[str, Any]:
    states = [state.name for state in run.plant.structure.equations.states]
    return {
        "fit_percent": run.fit_percent,
        "start": {"words": run.start.words, "state": dict(zip(states, run.start.state, strict=True))},
        "stopped": run.stopped,
    }


def _write(
    out: Path,
    result: dict[str, Any],
    replays: list[Comparison],
    findings: Iterable[LogFinding],
    cannot_tell: Iterable[str],
    steps: Iterable[Step],
) -> None:
    from ..report.comparison_page import write_comparison_page
    from ..report.figures import replay_figure, save
    from .output import command_line, to_json

    (out / "comparison.json").write_text(to_json(result) + "\n")
    frame = replays[0].to_pandas().rename(columns=lambda name: _column(name, replays[0].plant.model))
    for run in replays[1:]:
        for channel, values in run.simulated.items():
            frame[_column(f"{channel}_simulated", run.plant.model)] = values
    frame.to_csv(out / "compare.csv", index=False, float_format="%.9g")
    save(replay_figure(replays), out / "compare")
    write_comparison_page(
        replays,
        out,
        command=command_line(),
        findings=findings,
        untold=cannot_tell,
        steps=steps,
    )


def _column(name: str, model: str) -> str:
    return f"{name.removesuffix('_simulated')}_{model}" if name.endswith("_simulated") else name
