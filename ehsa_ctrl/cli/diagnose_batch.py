"""`ehsa-ctrl diagnose` with several logs: a folder each, and a summary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..core.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from ..core.log import Log
    from ..diagnosis.batch import Batch
    from ..diagnosis.diagnosis import Diagnosis
    from ..identification.preparation import Preparation
    from ..plant.plant import Plant


def diagnose_batch(
    nominal: Plant,
    logs: Sequence[Path],
    preparation: Preparation,
    *,
    threshold: float,
    jobs: int,
    backend: str,
    address: str | None,
    check: bool,
    out: Path | None,
    force: bool,
    as_json: bool,
    write: Callable[..., None],
) -> None:
    """Diagnose the logs, write OUT/NAME for each as it comes and OUT/summary.csv and .json at the end, print a table.

    write: puts the files of one diagnosis into a folder; is given the folder, the diagnosis and, as `steps`, what was
        done to its log. A log that can't be read is a row that says so; one that can't be prepared as asked ends it all
        before any work.

    Raises InputError: a log given twice, an output folder of other diagnoses, a log that can't be prepared so. Exits
    2 if no log could be diagnosed.
    """
    from ..core.result_folder import ResultFolder
    from ..core.text import folder_names
    from ..diagnosis.batch import diagnose_many
    from .diagnose import FIGURES, names_of
    from .output import rests_on, to_json
    from .progress import compiling, counting

    files = [log.resolve() for log in logs]
    twice = next((log for log, file in zip(logs, files, strict=True) if files.count(file) > 1), None)
    if twice is not None:
        raise InputError(f"{twice}: is given twice; give it once")
    folders = dict(zip(map(str, logs), folder_names(logs), strict=True))
    place, file = None, None
    if out is not None:
        file = out / "diagnoses.jsonl"
        # What was written of the logs so far is replaced as they are continued.
        place = ResultFolder(out, "diagnose_batch", force=True).check("summary.json", "summary.csv", "report.html")
        if force or not file.exists():
            for folder in folders.values():
                ResultFolder(out / folder, "diagnose", force).check(*names_of(nominal), figures=FIGURES)

    with compiling():
        ready, steps = _prepared(nominal, logs, preparation)

    def keep(name: str, found: Diagnosis) -> None:
        if out is not None:
            with ResultFolder(out / folders[name], "diagnose", force=True).draft() as draft:
                write(draft, found, steps=steps[name])

    with compiling(), counting() as watch:
        batch = diagnose_many(
            nominal, ready, threshold=threshold, check=check, jobs=jobs, backend=backend, address=address, file=file,
            anew=force, watch=watch and (lambda done, total: watch("logs", done, total)), keep=keep,
        )  # fmt: skip
    done = [step for name in map(str, logs) for step in steps.get(name, ())]
    summary = {**batch.to_dict(), "preparation": done, "rests_on": rests_on([nominal], logs)}
    if place is not None:
        from ..report.result_page import write_result_page

        with place.draft() as draft:
            (draft / "summary.json").write_text(to_json(summary) + "\n")
            batch.to_pandas().to_csv(draft / "summary.csv", float_format="%.7g")
            write_result_page(draft, "summary.json")
    if as_json:
        print(to_json(summary))
    else:
        _print(batch, out)
    if batch.interrupted:
        kept = f"what was done is kept in {out}, and the same call goes on from there" if out is not None else ""
        raise KeyboardInterrupt(kept)
    if len(batch.failed) == len(batch.rows):
        raise typer.Exit(2)


def _prepared(
    nominal: Plant, logs: Sequence[Path], how: Preparation
) -> tuple[list[Path | Log], dict[str, list[dict[str, Any]]]]:
    """The logs as they are used, and what was done to each; one that can't be read is left as a path."""
    from .prepared import prepared, read_raw

    ready: list[Path | Log] = []
    steps: dict[str, list[dict[str, Any]]] = {}
    for path in logs:
        try:
            raw = read_raw(path, nominal, how)
        except InputError:
            ready.append(path)
            continue
        try:
            read = prepared(raw, nominal, how)
        except InputError as error:
            where = "" if str(error).startswith(str(path)) else f"{path}: "
            raise InputError(f"{where}{error}") from None
        ready.append(read.log)
        steps[str(path)] = read.cautioned()
    return ready, steps


def _print(batch: Batch, out: Path | None) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    console.print(_table(batch))
    console.print("gap, after: of all signals, on held-out data, as believed and with the causes")
    for row in batch.failed:
        console.print(Text(row.error, "red"))
    words = ", ".join(f"{count} {word}" for word, count in batch.counts.items())
    console.print(f"{len(batch.rows)} logs: {words}" + (f"; written to {out}" if out is not None else ""))


def _table(batch: Batch) -> Table:
    from rich.table import Table

    from ..core.text import unique_names

    table = Table(box=None, pad_edge=False)
    for column in ("log", "verdict", "cause", "place"):
        table.add_column(column, overflow="fold")
    for column in ("probability", "gap, %", "after, %", "s"):
        table.add_column(column, justify="right")
    for name, row in zip(unique_names([row.file for row in batch.rows]), batch.rows, strict=True):
        if row.error:
            table.add_row(name, "failed")
            continue
        numbers = (f"{row.probability:.2f}" if row.cause else "", f"{100 * row.gap_before:.3g}")
        after = f"{100 * row.gap_after:.3g}" if row.verdict != "no_gap" else ""
        table.add_row(name, row.verdict, " or ".join(row.set), row.place, *numbers, after, f"{row.seconds:.0f}")
    return table
