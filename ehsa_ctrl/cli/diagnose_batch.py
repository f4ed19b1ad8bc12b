"""`ehsa-ctrl diagnose` with several logs: a folder each, and a summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..core.errors import InputError
from .diagnose import FIGURES, DiagnosisOutcome, file_names, write_files
from .output import OutputOptions, provenance, to_json

if TYPE_CHECKING:
    from ..core.log import Log
    from ..diagnosis.batch import LogBatch
    from ..diagnosis.diagnosis import Diagnosis
    from ..identification.preparation import Preparation
    from ..plant.plant import Plant


def diagnose_batch(
    nominal: Plant,
    logs: Sequence[Path],
    how: Preparation,
    output: OutputOptions,
    *,
    threshold: float,
    jobs: int,
    backend: str,
    check: bool,
) -> None:
    """Diagnose the logs: OUT/NAME for each as it is done, OUT/summary.csv and .json at the end, and a printed table.

    A log that can't be read gets a row with its error. A log that can't be prepared as the options ask ends the
    command before the first diagnosis.

    Raises InputError: a log given twice, an output folder with other diagnoses, a log that can't be prepared. Exits
    with 2 if no log could be diagnosed.
    """
    from ..core.parallel import parallel_backend
    from ..core.result_folder import ResultFolder
    from ..core.text import folder_names
    from ..diagnosis.batch import diagnose_many
    from ..report.results import write_result_page
    from .inputs import refuse_repeated
    from .progress import compiling, continuing, counting

    refuse_repeated(logs)
    out, anew = output.out, output.force
    folders = dict(zip(map(str, logs), folder_names(logs), strict=True))
    # Continuing an interrupted batch replaces its summary.
    output = replace(output, force=True)
    output.check("diagnose_batch", "summary.json", "summary.csv", "report.html")
    record = out / "diagnoses.jsonl" if out is not None else None
    if out is not None and record is not None and (anew or not record.exists()):
        for folder in folders.values():
            ResultFolder(out / folder, "diagnose", anew).check(*file_names(nominal), figures=FIGURES)

    with compiling():
        ready, steps = _prepare(nominal, logs, how)

    def keep(name: str, found: Diagnosis) -> None:
        if out is not None:
            outcome = DiagnosisOutcome(found, steps[name], [found.log.path])
            with ResultFolder(out / folders[name], "diagnose", force=True).draft() as draft:
                (draft / "diagnosis.json").write_text(to_json(outcome.stored()) + "\n")
                write_files(draft, outcome)
                write_result_page(draft, "diagnosis.json")

    with continuing("logs", out, *filter(None, [record])):
        with compiling(), counting() as watch, parallel_backend(backend):
            batch = diagnose_many(
                nominal, ready, threshold=threshold, check=check, jobs=jobs, file=record, anew=anew,
                watch=watch and (lambda done, total: watch("logs", done, total)), keep=keep,
            )  # fmt: skip
        done = [step for name in map(str, logs) for step in steps.get(name, ())]
        summary = {**batch.to_dict(), "preparation": done, "rests_on": provenance([nominal], logs)}
        output.deliver(
            "diagnose_batch", "summary.json", summary, lambda: _print(batch, out), then=None,
            files=lambda draft: batch.to_pandas().to_csv(draft / "summary.csv", float_format="%.7g"),
        )  # fmt: skip
        if batch.interrupted:
            raise KeyboardInterrupt
    if len(batch.failed) == len(batch.rows):
        raise typer.Exit(2)


def _prepare(
    nominal: Plant, logs: Sequence[Path], how: Preparation
) -> tuple[list[Path | Log], dict[str, list[dict[str, Any]]]]:
    """The prepared logs, and the preparation steps of each; a log that can't be read stays a path."""
    from .inputs import prepare, read_raw

    ready: list[Path | Log] = []
    steps: dict[str, list[dict[str, Any]]] = {}
    for path in logs:
        try:
            raw = read_raw(path, nominal, how)
        except InputError:
            ready.append(path)
            continue
        try:
            prepared = prepare(raw, nominal, how)
        except InputError as error:
            where = "" if str(error).startswith(str(path)) else f"{path}: "
            raise InputError(f"{where}{error}") from None
        ready.append(prepared.log)
        steps[str(path)] = prepared.diagnosis_step_dicts()
    return ready, steps


def _print(batch: LogBatch, out: Path | None) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from ..core.text import unique_names

    table = Table(box=None, pad_edge=False)
    for column in ("log", "verdict", "causes", "place"):
        table.add_column(column, overflow="fold")
    for column in ("probability", "gap, %", "after, %", "s"):
        table.add_column(column, justify="right")
    for name, row in zip(unique_names([row.file for row in batch.rows]), batch.rows, strict=True):
        if row.error:
            table.add_row(name, "failed")
            continue
        numbers = (f"{row.probability:.2f}" if row.cause else "", f"{100 * row.gap_before:.3g}")
        after = f"{100 * row.gap_after:.3g}" if row.verdict != "no_gap" else ""
        table.add_row(name, row.verdict, row.cause_words, row.place, *numbers, after, f"{row.seconds:.0f}")
    console = Console(highlight=False)
    console.print(table)
    console.print("gap, after: total gap on held-out data, of the nominal plant and with the law or the causes added")
    for row in batch.failed:
        console.print(Text(row.error, "red"))
    words = ", ".join(f"{count} {word}" for word, count in batch.counts.items())
    console.print(f"{len(batch.rows)} logs: {words}" + (f"; written to {out}" if out is not None else ""))
