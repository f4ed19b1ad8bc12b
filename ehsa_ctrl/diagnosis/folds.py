"""Each third of a long log held out in turn: whether the causes close the gap everywhere, or in one part only.

One held-out part shows whether a fit holds beyond its training data, but not whether it holds in all of them: a valve
may open in one minute of ten, and a parameter may drift. The chosen causes are therefore refitted without each third
and scored on it: cross-validation with contiguous folds, because neighbouring samples are not independent (T. Hastie,
R. Tibshirani, J. Friedman, "The Elements of Statistical Learning", 2009, 7.10). The search is not repeated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..core.text import join_words
from .objective import Objective
from .pool import Pool
from .prepared_logs import PreparedLogs, Segments
from .records import Segment
from .refit import HypothesisFit, refit_until_converged
from .signals import largest
from .split import EXCITED, Split, excitation, thirds

#: Logs that last longer together are held out in folds [s]. Engineering judgement: a third is then about as long as a
#: whole log of a bench.
LONG = 60.0


@dataclass(frozen=True)
class Fold:
    """A third of each log that a refit of the causes did not use.

    part: which third, in words. gap: model (nominal, with_effects) -> signal -> gap there.
    """

    part: str
    gap: Mapping[str, Mapping[str, float]]


def folds_of(
    prepared: PreparedLogs, segments: Segments, objective: Objective, fit: HypothesisFit, pool: Pool
) -> tuple[Fold, ...]:
    """The gaps with each third of the logs held out in turn; empty for a short log and with a log for validation.

    fit: the chosen hypothesis, which serves for the part that the diagnosis held out. Thirds in which, or beside which,
    a log stands still are left out.
    """
    logs = prepared.logs
    seconds = sum(float(one.log.time[-1] - one.log.time[0]) for one in logs)
    if segments.splits is None or seconds < LONG:
        return ()
    folds = list(zip(*(thirds(len(one.log)) for one in logs), strict=True))
    moving = [f for f in folds if all(excitation(one.record, s) >= EXCITED for one, s in zip(logs, f, strict=True))]
    if len(moving) < 2:
        return ()

    def without(fold: Sequence[Split]) -> Fold | None:
        pairs = list(zip(logs, fold, strict=True))
        training = Segment(tuple(one.part(split.training) for one, split in pairs), "")
        held_out = Segment(tuple(one.part(split.held_out) for one, split in pairs), "")
        found: HypothesisFit | None = fit
        if tuple(fold) != segments.splits:
            # Scales and priors stay those of the diagnosis: only the data differ.
            found = refit_until_converged(replace(objective, segment=training), fit.candidates, fit.values)
        if found is None:
            return None
        return Fold(fold[0].name, {"nominal": held_out.gap({}), "with_effects": held_out.gap(found.values)})

    found = pool.map("thirds held out in turn", without, moving)
    return tuple(one for one in found if one is not None)


def folds_sentence(folds: Sequence[Fold]) -> str:
    """The largest gap of a signal in each fold, in one sentence; empty without folds."""
    if not folds:
        return ""
    gaps = [tuple(f"{100.0 * largest(one.gap[model]):.3g}" for model in ("nominal", "with_effects")) for one in folds]
    rows = (f"from {before} to {after} % in {one.part}" for one, (before, after) in zip(folds, gaps, strict=True))
    return f"with thirds of the log held out in turn, the largest gap falls {join_words(rows)}"


def uneven_folds(folds: Sequence[Fold], threshold: float) -> list[str]:
    """A finding where the causes leave a gap in some thirds and none in others."""
    left = {one.part: largest(one.gap["with_effects"]) for one in folds}
    open_parts = {part: gap for part, gap in left.items() if gap >= threshold}
    if not open_parts or len(open_parts) == len(left):
        return []
    words = join_words(f"{100.0 * gap:.3g} % in {part}" for part, gap in open_parts.items())
    return [
        f"fitted to the rest of the log, the causes leave {words}, and less than the threshold in the other parts: "
        "something acts there alone, or changes over the log"
    ]
