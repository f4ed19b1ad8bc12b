"""The page of a result that was computed in Python: what a command's --out writes as HTML, without the rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..core.errors import InputError
from ..core.files import FORCE_ARGUMENT
from ..core.result_folder import ResultFolder
from ..diagnosis.changed import Change
from ..diagnosis.diagnosis import Diagnosis
from ..identification.comparison import Comparison
from ..identification.identification import Identification
from ..scenario.result import ScenarioResult
from .comparison_page import write_comparison_page
from .diagnosis_page import FILE, write_diagnosis_page
from .identification_page import write_identification_page
from .page import write_page


def _diagnosis(found: Sequence[Any], folder: Path) -> Path:
    return write_diagnosis_page(found[0], folder, command="")


def _change(found: Sequence[Any], folder: Path) -> Path:
    return write_diagnosis_page(found[0].after, folder, command="", change=found[0])


def _runs(found: Sequence[Any], folder: Path) -> Path:
    return write_page(found, folder, command="")


def _identifications(found: Sequence[Any], folder: Path) -> Path:
    return write_identification_page(found, folder, command="")


def _replays(found: Sequence[Any], folder: Path) -> Path:
    return write_comparison_page(found, folder, command="")


#: Class of a result -> file of its page, what writes it, and whether several share one.
PAGES: dict[type, tuple[str, Callable[[Sequence[Any], Path], Path], bool]] = {
    ScenarioResult: ("report.html", _runs, True),
    Identification: ("report.html", _identifications, True),
    Comparison: ("report.html", _replays, True),
    Diagnosis: (FILE, _diagnosis, False),
    Change: (FILE, _change, False),
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
    InputError: a result without a page, results of two kinds, a page that is there already (without force, or where it
        is not one that this function wrote), a folder that can't be written to.
    """
    found = list(result) if isinstance(result, list | tuple) else [result]
    if not found:
        raise InputError("write_report: there is no result; give what run, identify, diagnose or replay returned")
    kind = type(found[0])
    others = {type(each).__name__ for each in found} - {kind.__name__}
    if kind not in PAGES:
        known = ", ".join(sorted(each.__name__ for each in PAGES))
        drawn = "; its plot() draws it" if hasattr(kind, "plot") else ""
        raise InputError(f"write_report: a result of the kind {kind.__name__} has no page ({known} have one){drawn}")
    name, write, several = PAGES[kind]
    if others or (len(found) > 1 and not several):
        what = f"{kind.__name__} and {', '.join(sorted(others))}" if others else f"{len(found)} of {kind.__name__}"
        raise InputError(f"write_report: {what} don't share a page; write them to a folder each")
    place = ResultFolder(Path(folder), "write_report", force, how=FORCE_ARGUMENT)
    with place.check(name).draft() as draft:
        write(found, draft)
    return place.folder / name
