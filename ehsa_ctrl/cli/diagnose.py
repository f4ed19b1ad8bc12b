"""`ehsa-ctrl diagnose`: where a log and the simulation differ, which effect causes it, how far the gap shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Force, Json, Out, Settings, read_pairs

if TYPE_CHECKING:
    from ..diagnosis.diagnosis import Diagnosis


def command(
    log: Annotated[Path, typer.Argument(help="Measured log: CSV, Parquet or MAT.")],
    plant: Annotated[str, typer.Option("--plant", help="Name of a plant, or the path of its TOML.")],
    model: Annotated[str, typer.Option(help="linear or nonlinear: which of its models is believed.")] = "nonlinear",
    validate: Annotated[
        Path | None, typer.Option(help="A second log to hold out; else the last third of the log is.")
    ] = None,
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    threshold: Annotated[float, typer.Option(help="A gap of a signal from which on it matters.")] = 0.03,
    jobs: Annotated[int | None, typer.Option(help="Threads; all cores by default.")] = None,
    unchecked: Annotated[bool, typer.Option("--unchecked", help="Go on with a log that looks plainly wrong.")] = False,
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Say where the gap between a log and the believed plant lies, which effect causes it, and how far it shrinks.

    Examples: ehsa-ctrl diagnose log.csv --plant ehsa --out results/diagnosis · ehsa-ctrl diagnose log.csv --plant
    my/rig.toml --validate other.csv --set load.stiffness=50e3 --threshold 0.05
    """
    from ..core.errors import InputError
    from ..diagnosis.diagnose import diagnose
    from ..identification.record import read_plant_log, untold
    from ..plant.plant import load_plant
    from .output import prepare_folder, to_json, warn, warn_unbelieved
    from .progress import compiling, counting

    if model not in ("linear", "nonlinear"):
        raise InputError(f"--model {model!r}: expected linear or nonlinear")
    believed = load_plant(plant, model=model, settings=read_pairs(settings))  # type: ignore[arg-type]
    warn_unbelieved([believed])
    if out is not None:
        prepare_folder(out, "diagnosis.json", force=force)
    measured = read_plant_log(log, believed)
    second = read_plant_log(validate, believed) if validate is not None else None
    for sentence in untold(measured, believed):
        warn(sentence)
    with compiling(), counting() as watch:
        found = diagnose(
            believed, measured, validate=second, threshold=threshold, jobs=jobs, watch=watch, check=not unchecked
        )
    for sentence in found.findings:
        warn(sentence)
    if out is not None:
        _write(out, found)
    if as_json:
        print(to_json(found.to_dict()))
        return
    print(found)
    if out is not None:
        print(f"written to {out}")


def _write(out: Path, found: Diagnosis) -> None:
    """JSON, the improved plant, a table of causes and one of signals, figures and page."""
    import sys

    from ..identification.write import write_plant
    from ..report.diagnosis_page import diagnosis_figures, write_diagnosis_page
    from ..report.diagnosis_signals import signals_table
    from ..report.figures import save
    from .output import to_json

    (out / "diagnosis.json").write_text(to_json(found.to_dict()) + "\n")
    if found.improved is not None and found.plant.path is not None:
        write_plant(out / f"{found.plant.name}_improved.toml", found.improved)
    signals_table(found).to_csv(out / "signals.csv", index=False, float_format="%.7g")
    if found.effects:
        found.to_pandas().to_csv(out / "causes.csv", index=False)
    for name, (_, figure) in diagnosis_figures(found).items():
        save(figure, out / name)
    write_diagnosis_page(found, out, command="ehsa-ctrl " + " ".join(sys.argv[1:]))
