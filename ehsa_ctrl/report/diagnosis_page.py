"""The page of a diagnosis: the verdict, then what differs, where, which cause, how far, and what to do next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ..core.text import join_words
from ..diagnosis.changed import Change
from ..diagnosis.diagnosis import MODELS, Diagnosis
from ..diagnosis.signals import SIGNALS
from . import diagnosis_rows as rows
from .closed_loop import OTHER, closed_table
from .diagnosis_cause import CauseSection, sentence
from .diagnosis_signals import after_model, after_words, models_shown, signal_shown
from .document import Picture, embedded, write_document
from .figures import (
    candidates_figure,
    diagnosis_figure,
    shrinkage_figure,
    unknown_inputs_figure,
    where_figure,
)
from .figures.diagnosis import percent
from .figures.unknown_inputs import regimes_by_balance
from .grounds import assumed_of, hashes

#: File of the page.
FILE = "diagnosis.html"
#: Mark, heading and whether all is well, of each verdict; told apart without colour too.
VERDICTS = {
    "no_gap": ("✓", "no gap that matters", True),
    "effect": ("✓", "the cause is known", True),
    "ambiguous": ("△", "a cause that this log can't tell from others", False),
    "outside_catalogue": ("✗", "no known effect explains the gap", False),
    "underdetermined": ("?", "the log does not tell the cause", False),
}
#: The heading where two logs were compared.
CHANGED = {"no_gap": "nothing that matters changed", "effect": "what changed is known"}
#: The parts of the page in the order in which they answer what is asked first.
ORDER = {
    "no_gap": ("signals", "gaps"),
    "effect": ("signals", "where", "causes", "candidates", "gaps", "next"),
    "ambiguous": ("signals", "causes", "candidates", "where", "gaps", "next"),
    "outside_catalogue": ("where", "signals", "causes", "gaps", "candidates", "next"),
    "underdetermined": ("causes", "candidates", "next", "where", "signals", "gaps"),
}
#: What to look for in each figure.
CAPTIONS = {
    "signals": "Free runs, driven by the logged drive and nothing else. A gap is the RMS of measured minus simulated "
    "on held-out data, the sensor's noise taken off, over the standard deviation of the signal; 0 % is within noise. "
    "A run far off the measurement leaves its panel.",
    "where": "Of the whole log. Left: shares of the squared gap. The balances know no effect: each is asked what it "
    "lacks, and how much of the gap vanishes when that is put into a simulation. Right: when the gap comes, and "
    "what is left of it then.",
    "unknown_inputs": "What each balance lacks, smoothed, and along what it goes: mean in bins, the band is one "
    "standard deviation within a bin. A positive torque or flow helps, a positive force resists extension; what goes "
    "against the motion is shown times its sign: a positive torque helps the motion, a positive force resists it. How "
    "much is explained is judged on data that was not fitted.",
    "candidates": "Evidence against a hypothesis is twice the difference of its log-likelihood to the best one, "
    "nominal parameters fitted together with it; logarithmic. Right: its largest gap of a signal on held-out data.",
    "closed_loop": "The same controller on the plant before and after, with the scenario's load, sampling and noise; "
    "bars: the rod sticks.",
    "shrinkage": "Refitted: the nominal parameters alone, far beyond what is believed of them. A bar out of all "
    "proportion ends early.",
}


def write_diagnosis_page(
    diagnosis: Diagnosis,
    folder: Path,
    *,
    command: str,
    change: Change | None = None,
    closed: Mapping[str, Any] | None = None,
    closed_loop: Figure | None = None,
    files: Iterable[str | Path | None] = (),
    steps: Iterable[str] = (),
) -> Path:
    """Write `diagnosis.html` to the folder and return its path; the same diagnosis gives the same bytes.

    Parameters
    ----------
    command: the command line that made it, for the page's end.
    change: what changed since an earlier log, if this is the diagnosis of the later one.
    closed, closed_loop: a scenario on the plants before and after, as closed_loop.json has it, and its figure.
    files: of which hashes are given; the log's by default.
    steps: what was done to the logs before they were used, in sentences.
    """
    mark, heading, good = VERDICTS[diagnosis.verdict]
    if change is not None:
        heading = CHANGED.get(diagnosis.verdict, f"what changed: {heading}")
    drawn = diagnosis_figures(diagnosis)
    pictures = {name: _picture(diagnosis, name, *drawn[name]) for name in drawn}
    if closed_loop is not None:
        pictures["closed_loop"] = _picture(diagnosis, "closed_loop", "The closed loop before and after", closed_loop)
    return write_document(
        "diagnosis.html.j2",
        folder,
        file=FILE,
        diagnosis=diagnosis,
        log=diagnosis.log.name,
        mark=mark,
        heading=heading,
        good=good,
        glance=_glance(diagnosis),
        order=ORDER[diagnosis.verdict],
        pictures=pictures,
        change=change,
        changes=rows.changes(change) if change is not None else [],
        closed=_closed(closed) if closed is not None else None,
        named=diagnosis.verdict in ("effect", "ambiguous"),
        places=rows.places(diagnosis),
        by_signal=rows.by_signal(diagnosis),
        regimes=rows.regimes(diagnosis),
        untold=[sentence(words) for words in diagnosis.location.untold] if diagnosis.location is not None else [],
        suspected=rows.suspected(diagnosis),
        causes=[CauseSection(cause, diagnosis) for cause in diagnosis.effects],
        candidates=rows.candidates(diagnosis),
        models=[(model, MODELS[model]) for model in models_shown(diagnosis)],
        gaps=rows.gaps(diagnosis),
        reached=_reached(diagnosis),
        noise=rows.noise(diagnosis),
        facts=rows.facts(diagnosis),
        steps=list(steps),
        files=hashes([*(list(files) or [diagnosis.log.path]), diagnosis.plant.path]),
        versions=diagnosis.provenance,
        assumed=assumed_of([diagnosis.plant]),
        command=command,
    )


def _closed(closed: Mapping[str, Any]) -> dict[str, Any]:
    """What the section of the closed loop shows."""
    head, table = closed_table(closed)
    other = (closed.get("replay") or {}).get("current_not_of_this_loop")
    return {
        "name": f"{closed['scenario']} with {closed['controller']}",
        "verdicts": [(word, list(reasons)) for word, reasons in closed["failures"].items()],
        "head": head,
        "rows": table,
        "other": f"{100.0 * other:.0f} %" if other is not None and other > OTHER else "",
    }


def diagnosis_figures(diagnosis: Diagnosis) -> dict[str, tuple[str, Figure]]:
    """Name of each figure that there is to draw -> its heading and itself."""

    def drawn() -> Iterator[tuple[str, str, Figure]]:
        yield "signals", "Measured and simulated", diagnosis_figure(diagnosis)
        if diagnosis.verdict == "no_gap":
            return
        if diagnosis.where:
            yield "where", "Shares by place", where_figure(diagnosis)
        if regimes_by_balance(diagnosis.location):
            yield "unknown_inputs", "What the balances lack", unknown_inputs_figure(diagnosis)
        if diagnosis.candidates:
            yield "candidates", "Candidates by evidence", candidates_figure(diagnosis)
        yield "shrinkage", "Gaps of each model", shrinkage_figure(diagnosis)

    return {name: (heading, figure) for name, heading, figure in drawn()}


def _picture(diagnosis: Diagnosis, name: str, heading: str, figure: Figure) -> Picture:
    words = f"{heading} of the diagnosis of {diagnosis.log.name}. {diagnosis.sentence}"
    return Picture(heading, embedded(figure, words), CAPTIONS[name])


def _glance(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Where, which and how far, each in a line."""
    if diagnosis.verdict == "no_gap":
        return []
    lines = []
    if diagnosis.where:
        shares = [f"{place} {100.0 * share:.0f} %" for place, share in diagnosis.where if share >= 0.01]
        lines.append(("where", f"{', '.join(shares)} of the gap over the whole log"))
    for section in (CauseSection(cause, diagnosis) for cause in diagnosis.effects):
        numbers = ", ".join(f"{n.name} = {n.value} {n.unit}".rstrip() for n in section.numbers)
        others = f"; or {' or '.join(section.cause.ambiguous_with)}" if section.cause.ambiguous_with else ""
        lines.append(("which", f"{section.name}, probability {section.probability}: {numbers}{others}"))
    if not diagnosis.effects:
        nearest = f"; {diagnosis.nearest}" if diagnosis.nearest else ""
        lines.append(("which", f"none of the catalogue{nearest}"))
    after = after_model(diagnosis)
    if after is not None:
        now = f"{percent(diagnosis.gap['nominal']['total'])} to {percent(diagnosis.gap[after]['total'])}"
        lines.append(("how far", f"the gap of all signals on held-out data goes from {now} {after_words(diagnosis)}"))
    if diagnosis.next_experiment:
        lines.append(("next", diagnosis.next_experiment))
    return lines


def _reached(diagnosis: Diagnosis) -> str:
    """Which signals still have a gap that matters."""
    after = after_model(diagnosis)
    limit = f"{100.0 * diagnosis.threshold:g} %"
    gaps = diagnosis.gap[after or "nominal"]
    left = [signal_shown(name).words for name in SIGNALS if gaps.get(name, 0.0) >= diagnosis.threshold]
    how = sentence(after_words(diagnosis)).rstrip(".") if after is not None else "As believed"
    if not left:
        return f"{how}, every signal is closer than {limit} on held-out data."
    have = "have" if len(left) > 1 else "has"
    return f"{how}, {join_words(left)} still {have} a gap of {limit} or more on held-out data."
