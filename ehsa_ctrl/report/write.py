"""The page of a result that was computed in Python, made from its JSON and figures like that of a command."""

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
from .figures import to_svg
from .kinds import kinds
from .page import unique
from .provenance import provenance
from .result_figures import Figures, comparison_figures, diagnosis_figures, identification_figures, run_figures
from .results import write_result_page


class Stored(NamedTuple):
    """What a result leaves in a folder: the content of its JSON, and its figures."""

    content: dict[str, Any]
    figures: Figures


def _runs(found: Sequence[ScenarioResult]) -> Stored:
    plants = [run.trajectory.plant for result in found for run in (result.nonlinear, result.linear)]
    runs = [result.to_dict() for result in found]
    rests_on = provenance(plants, [file for result in found for file in result.files])
    return Stored({"scenarios": runs, "rests_on": rests_on}, run_figures(found, runs))


def _identifications(found: Sequence[Identification]) -> Stored:
    models = dict(zip(unique(each.plant.model for each in found), found, strict=True))
    stated = {name: each.to_dict() for name, each in models.items()}
    runs = [run for each in found for run in (*each.train.after, *each.validation.after)]
    rests_on = provenance([each.plant for each in found], [run.log.path for run in runs])
    content = {**stated[next(iter(stated))], "plant": found[0].plant.name, "models": stated, "rests_on": rests_on}
    return Stored(content, identification_figures(models))


def _replays(found: Sequence[Comparison]) -> Stored:
    rests_on = provenance([run.plant for run in found], [found[0].log.path])
    return Stored({**comparison_dict(found), "rests_on": rests_on}, comparison_figures(found))


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
    return Stored({**found[0].to_dict(), "rests_on": rests_on}, diagnosis_figures(found[0]))


def _change(found: Sequence[Change]) -> Stored:
    change = found[0]
    rests_on = provenance([change.before.plant], [change.before.log.path, change.after.log.path])
    return Stored({**change.to_dict(), "rests_on": rests_on}, diagnosis_figures(change.after))


#: Class of a result -> the name of its JSON, what is stored of it, and whether several share a page.
RESULTS: dict[type, tuple[str, Callable[[Sequence[Any]], Stored], bool]] = {
    ScenarioResult: ("results.json", _runs, True),
    Identification: ("identification.json", _identifications, True),
    Comparison: ("comparison.json", _replays, True),
    Diagnosis: ("diagnosis.json", _diagnosis, False),
    Change: ("diagnosis.json", _change, False),
}


def write_report(result: Any, folder: str | Path, *, force: bool = False) -> Path:
    """Write the page of a result to a folder and return its path: one file with its figures in it, no network.

    Parameters
    ----------
    result: what `run`, `identify`, `diagnose`, `what_changed` or `replay` gives; of `run`, `identify` (both models) and
        `replay` also several in a list, which share a page. Other results are drawn by their `plot()`.
    force: replace a page that an earlier call wrote.

    Returns
    -------
    Of a diagnosis FOLDER/diagnosis.html, else FOLDER/report.html.

    Raises
    ------
    InputError: a result without a page, results of two kinds, a page that exists already (without force, or where it
        is not one that this function wrote), a folder that can't be written to.
    """
    found = list(result) if isinstance(result, list | tuple) else [result]
    if not found:
        raise InputError("write_report: there is no result; give what run, identify, diagnose or replay returned")
    kind = type(found[0])
    others = {type(each).__name__ for each in found} - {kind.__name__}
    if kind not in RESULTS:
        known = ", ".join(sorted(each.__name__ for each in RESULTS))
        drawn = "; its plot() draws it" if hasattr(kind, "plot") else ""
        raise InputError(f"write_report: a result of the kind {kind.__name__} has no page ({known} have one){drawn}")
    name, store, several = RESULTS[kind]
    if others or (len(found) > 1 and not several):
        what = f"{kind.__name__} and {', '.join(sorted(others))}" if others else f"{len(found)} of {kind.__name__}"
        raise InputError(f"write_report: {what} don't share a page; write them to a folder each")
    page = kinds()[name].page
    place = ResultFolder(Path(folder), "write_report", force, how=FORCE_ARGUMENT).check(page)
    with place.draft() as draft, tempfile.TemporaryDirectory() as temporary:
        stored, work = store(found), Path(temporary)
        (work / name).write_text(to_json(stored.content), encoding="utf-8", errors="backslashreplace")
        for stem, figure in stored.figures:
            (work / f"{stem}.svg").write_text(to_svg(figure), encoding="utf-8")
        shutil.copy(write_result_page(work, name), draft / page)
    return place.folder / page
