"""The page of a Python result, made from its JSON and figures in the same way as by a command."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..core.errors import InputError
from ..core.files import FORCE_ARGUMENT
from ..core.result import to_json
from ..core.result_folder import ResultFolder
from ..diagnosis.changed import Change
from ..diagnosis.diagnosis import Diagnosis
from ..identification.comparison import Comparison
from ..identification.identification import Identification
from ..scenario.result import ScenarioResult
from .figures import save
from .kinds import kinds
from .page import unique
from .provenance import provenance
from .result_figures import Figures, comparison_figures, diagnosis_figures, identification_figures, run_figures
from .result_tables import (
    Tables,
    comparison_tables,
    diagnosis_tables,
    identification_tables,
    run_tables,
    save_tables,
)
from .results import write_result_page


class Stored(NamedTuple):
    """Content of a result's JSON, its figures, and its time series."""

    content: dict[str, Any]
    figures: Figures
    tables: Tables


def _runs(found: Sequence[ScenarioResult]) -> Stored:
    plants = [run.trajectory.plant for result in found for run in (result.nonlinear, result.linear)]
    runs = [result.to_dict() for result in found]
    rests_on = provenance(plants, [file for result in found for file in result.files])
    return Stored({"scenarios": runs, "rests_on": rests_on}, run_figures(found, runs), run_tables(found, runs))


def _identifications(found: Sequence[Identification]) -> Stored:
    models = dict(zip(unique(each.plant.model for each in found), found, strict=True))
    stated = {name: each.to_dict() for name, each in models.items()}
    runs = [run for each in found for run in (*each.train.after, *each.validation.after)]
    rests_on = provenance([each.plant for each in found], [run.log.path for run in runs])
    content = {**stated[next(iter(stated))], "plant": found[0].plant.name, "models": stated, "rests_on": rests_on}
    return Stored(content, identification_figures(models), identification_tables(models))


def _replays(found: Sequence[Comparison]) -> Stored:
    rests_on = provenance([run.plant for run in found], [found[0].log.path])
    content = {**comparison_dict(found), "rests_on": rests_on}
    return Stored(content, comparison_figures(found), comparison_tables(found))


def comparison_dict(replays: Sequence[Comparison]) -> dict[str, Any]:
    """A comparison as in comparison.json; replays: of one log, each model once."""
    log, plant = replays[0].log, replays[0].plant
    return {
        "log": str(log.path or "log"),
        "plant": plant.name,
        "samples": len(log),
        "sample_time": log.sample_time,
        "from": float(log.time[0]),
        "to": float(log.time[-1]),
        "models": {run.plant.model: run.to_dict() for run in replays},
        "findings": [],
        "provenance": replays[0].provenance,
    }


def _diagnosis(found: Sequence[Diagnosis]) -> Stored:
    rests_on = provenance([found[0].plant], [found[0].log.path])
    content = {**found[0].to_dict(), "rests_on": rests_on}
    return Stored(content, diagnosis_figures(found[0]), diagnosis_tables(found[0]))


def _change(found: Sequence[Change]) -> Stored:
    change = found[0]
    rests_on = provenance([change.before.plant], [change.before.log.path, change.after.log.path])
    content = {**change.to_dict(), "rests_on": rests_on}
    return Stored(content, diagnosis_figures(change.after), diagnosis_tables(change.after))


#: Class of a result -> name of its JSON, function that prepares what is stored, and whether several can share a page.
RESULTS: dict[type, tuple[str, Callable[[Sequence[Any]], Stored], bool]] = {
    ScenarioResult: ("results.json", _runs, True),
    Identification: ("identification.json", _identifications, True),
    Comparison: ("comparison.json", _replays, True),
    Diagnosis: ("diagnosis.json", _diagnosis, False),
    Change: ("diagnosis.json", _change, False),
}


def write_report(result: Any, folder: str | Path, *, force: bool = False) -> Path:
    """Write the page of a result to a folder and return its path: one self-contained HTML file.

    Parameters
    ----------
    result: from `run`, `identify`, `diagnose`, `what_changed` or `replay`; a list of results of `run`, `identify` (both
        models) or `replay` shares a page. Other results have a `plot()` only.
    force: replace a page that an earlier call wrote.

    Returns
    -------
    FOLDER/diagnosis.html for a diagnosis, otherwise FOLDER/report.html.

    Raises
    ------
    InputError: a result without a page, results of different kinds, an existing page (without force, or not written by
        this function), or a folder that is not writable.
    """
    found = list(result) if isinstance(result, list | tuple) else [result]
    if not found:
        raise InputError("write_report: got no result; pass what run, identify, diagnose or replay returned")
    kind = type(found[0])
    others = {type(each).__name__ for each in found} - {kind.__name__}
    if kind not in RESULTS:
        known = ", ".join(sorted(each.__name__ for each in RESULTS))
        drawn = "; use its plot()" if hasattr(kind, "plot") else ""
        raise InputError(f"write_report: got a {kind.__name__}, which has no page; expected {known}{drawn}")
    name, store, several = RESULTS[kind]
    if others or (len(found) > 1 and not several):
        what = f"{kind.__name__} and {', '.join(sorted(others))}" if others else f"{len(found)} {kind.__name__} results"
        raise InputError(f"write_report: {what} can't share a page; write each to its own folder")
    page = kinds()[name].page
    place = ResultFolder(Path(folder), "write_report", force, how=FORCE_ARGUMENT).check(page)
    with place.draft() as draft, tempfile.TemporaryDirectory() as temporary:
        stored, work = store(found), Path(temporary)
        (work / name).write_text(to_json(stored.content), encoding="utf-8", errors="backslashreplace")
        save_tables(stored.tables, work)
        for stem, figure in stored.figures:
            save(figure, work / stem)
        shutil.copy(write_result_page(work, name), draft / page)
    return place.folder / page
