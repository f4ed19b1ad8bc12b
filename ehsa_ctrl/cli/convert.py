"""`ehsa-ctrl convert`: a log of any format becomes a log in SI units, or its contents are listed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import InputError
from .complete import plants
from .options import Json
from .output import to_json

if TYPE_CHECKING:
    from ..core.log import Log
    from ..identification.preparation import Preparation, Step

#: Endings of the file that is written.
WRITTEN = (".parquet", ".pq", ".csv", ".mat")
#: The drive that a log holds between its samples where no plant says so.
HELD = ("current",)


def command(
    log: Annotated[Path, typer.Argument(help="Measured log: CSV, TDMS, MDF, MCAP, MAT ...")],
    out: Annotated[
        Path | None, typer.Argument(metavar="[OUT]", help="File to write: .parquet, .csv or .mat; none lists the log.")
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            help="Plant whose \\[log] maps the columns: its name, or the path of its TOML.", autocompletion=plants
        ),
    ] = None,
    start: Annotated[float | None, typer.Option("--from", metavar="S", help="First second to write.")] = None,
    stop: Annotated[float | None, typer.Option("--to", metavar="S", help="Last second to write.")] = None,
    resample: Annotated[float | None, typer.Option(metavar="HZ", help="Resample the log to this rate.")] = None,
    sample_time: Annotated[
        float | None, typer.Option(metavar="S", help="Sample time of the rows, instead of the time in the file.")
    ] = None,
    as_json: Json = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a log of any format with the channels' own names in SI units; without OUT, list what a file contains.

    Examples: ehsa-ctrl convert rig.tdms · ehsa-ctrl convert rig.tdms log.parquet --plant my/rig.toml ·
    ehsa-ctrl convert rig.mcap log.csv --plant rig --resample 250 --from 2 --to 20
    """
    from ..identification.preparation import Preparation
    from .inputs import print_notes

    if out is None:
        _list(log, plant, as_json)
        return
    _check_target(log, out, force)
    how = Preparation(start, stop, resample=resample, sample_time=sample_time)
    read, ready, steps = _read(log, plant, how)
    print_notes(read)
    ready.write(out)
    if as_json:
        print(
            to_json(
                {
                    "log": log, "out": out, "plant": plant, "samples": len(ready), "sample_time": ready.sample_time,
                    "channels": list(ready.channels), "missing": list(read.missing), "preparation": list(steps),
                }
            )
        )  # fmt: skip
        return
    print(f"{log.name}: {len(ready)} samples from {ready.time[0]:g} to {ready.time[-1]:g} s, "
          f"{1 / ready.sample_time:.6g} Hz: {', '.join(ready.channels)}")  # fmt: skip
    for step in steps:
        if step.kind != "read":
            print(f"  {step}")
    print(f"written to {out}")


def _list(path: Path, plant: str | None, as_json: bool) -> None:
    from ..core.log_contents import log_contents
    from ..plant.load import load_plant

    columns = {} if plant is None else load_plant(plant).log
    found = log_contents(path, columns.get("t"))
    print(to_json(found.to_dict()) if as_json else found)


def _check_target(log: Path, out: Path, force: bool) -> None:
    from ..core.files import refuse_existing

    if out.suffix.lower() not in WRITTEN:
        raise InputError(f"{out}: is not a kind of file that is written; expected one of {', '.join(WRITTEN)}")
    if out.exists() and log.exists() and out.samefile(log):
        raise InputError(f"{out}: is the log itself, which is never replaced; choose another name")
    refuse_existing(out, force=force)


def _read(path: Path, plant: str | None, how: Preparation) -> tuple[Log, Log, tuple[Step, ...]]:
    """The log as read, as it will be written, and the steps between them."""
    from ..core.log import CHANNELS
    from ..core.log_reader import read_log
    from ..identification.plant_log import check_sample_time
    from ..plant.load import load_plant
    from .inputs import read_prepared

    if plant is not None:
        done = read_prepared(path, load_plant(plant), how, notes=False)
        return done.raw, done.log, done.steps
    if how.sample_time is not None:
        check_sample_time(how.sample_time)
    read = read_log(
        path, (), wanted=tuple(CHANNELS), uniform=how.resample is None, sample_time=how.sample_time, rate=how.resample,
        held=HELD,
    )  # fmt: skip
    ready, steps = how.apply_to_time(read, HELD)
    return read, ready, steps
