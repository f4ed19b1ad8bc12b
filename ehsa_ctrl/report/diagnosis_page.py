"""The page of a diagnosis: the verdict, then what differs, where, which cause, how far, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from ..diagnosis.diagnosis import MODELS, Diagnosis
from ..diagnosis.signals import SIGNALS
from . import diagnosis_rows as rows
from .channel import name_of
from .diagnosis_cause import CauseSection, sentence
from .diagnosis_signals import after_model, after_words, models_shown, signal_shown
from .document import Picture, assumed_of, embedded, write_document
from .figures import (
    candidates_figure,
    diagnosis_figure,
    shrinkage_figure,
    unknown_inputs_figure,
    where_figure,
)
from .figures.diagnosis import percent
from .figures.unknown_inputs import regimes_by_balance
from .verdict import listed

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
    "signals": "Free runs, driven by the logged current and nothing else. A gap is the RMS of measured minus simulated "
    "on held-out data, the sensor's noise taken off, over the standard deviation of the signal; 0 % is within noise. "
    "A run far off the measurement leaves its panel.",
    "where": "Left: shares of the squared gap. The balances know no effect: each is asked what it lacks, and how much "
    "of the gap vanishes when that is put into a simulation. Right: when the gap comes, and what is left of it then.",
    "unknown_inputs": "What each balance lacks, smoothed, and along what it goes: mean in bins, the band is one "
    "standard deviation within a bin. A positive torque or flow helps, a positive force resists extension. How much is "
    "explained is judged on data that was not fitted.",
    "candidates": "Evidence against a hypothesis is twice the difference of its log-likelihood to the best one, "
    "nominal parameters fitted together with it; logarithmic. Right: its largest gap of a signal on held-out data.",
    "shrinkage": "Refitted: the nominal parameters alone, far beyond what is believed of them. A bar out of all "
    "proportion ends early.",
}


def write_diagnosis_page(diagnosis: Diagnosis, folder: Path, *, command: str) -> Path:
    """Write `diagnosis.html` to the folder and return its path; the same diagnosis gives the same bytes.

    Parameters
    ----------
    command: the command line that made it, for the page's end.
    """
    mark, heading, good = VERDICTS[diagnosis.verdict]
    drawn = diagnosis_figures(diagnosis)
    return write_document(
        "diagnosis.html.j2",
        folder,
        file=FILE,
        diagnosis=diagnosis,
        log=name_of(diagnosis.log),
        mark=mark,
        heading=heading,
        good=good,
        glance=_glance(diagnosis),
        order=ORDER[diagnosis.verdict],
        pictures={name: _picture(diagnosis, name, *drawn[name]) for name in drawn},
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
        versions=diagnosis.provenance,
        assumed=assumed_of([diagnosis.plant]),
        command=command,
    )


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
    words = f"{heading} of the diagnosis of {name_of(diagnosis.log)}. {diagnosis.sentence}"
    return Picture(heading, embedded(figure, words, name.replace("_", "-")), CAPTIONS[name])


def _glance(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Where, which and how far, each in a line."""
    if diagnosis.verdict == "no_gap":
        return []
    lines = []
    if diagnosis.where:
        shares = [f"{place} {100.0 * share:.0f} %" for place, share in diagnosis.where if share >= 0.01]
        lines.append(("where", ", ".join(shares)))
    for section in (CauseSection(cause, diagnosis) for cause in diagnosis.effects):
        numbers = ", ".join(f"{n.name} = {n.value} {n.unit}".rstrip() for n in section.numbers)
        others = f"; or {' or '.join(section.cause.ambiguous_with)}" if section.cause.ambiguous_with else ""
        lines.append(("which", f"{section.name}, probability {section.probability}: {numbers}{others}"))
    if not diagnosis.effects:
        lines.append(("which", "none of the catalogue"))
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
    return (
        f"{how}, {listed(left)} still {'have' if len(left) > 1 else 'has'} a gap of {limit} or more on held-out data."
    )
