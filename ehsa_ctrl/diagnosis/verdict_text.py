"""The verdict and the advice of a diagnosis in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..plant.system import System
from .signals import largest

if TYPE_CHECKING:
    from .diagnosis import Cause, Diagnosis


def verdict_sentence(d: Diagnosis) -> str:
    """The verdict in one sentence.

    Its gap is that of the held-out data, as in the table, or that of the whole log, which decides the verdict, where
    the held-out data shows none.
    """
    shown = d.gap["nominal"]
    seen = d.verdict != "no_gap" and largest(shown) >= d.threshold
    shown = shown if seen else d.whole
    worst = max((s for s in shown if s != "total"), key=lambda s: shown[s])
    data = "on held-out data" if seen else "over the whole log"
    size = f"{100 * shown[worst]:.3g} % in {worst.replace('_', ' ')} {data}"
    if d.verdict == "no_gap":
        return f"No gap that matters: the largest is {size}, below {100 * d.threshold:g} %."
    names = " and ".join(cause.name for cause in d.effects[:3])
    if d.verdict == "effect":
        return f"The gap ({size}) comes from {names}{_closed(d, seen=seen)}."
    if d.verdict == "ambiguous":
        sets = " and ".join(" or ".join([cause.name, *cause.ambiguous_with]) for cause in d.effects)
        return f"The gap ({size}) comes from {sets}{_closed(d, seen=seen)}; this log can't tell more."
    place = _place(d)
    if d.verdict == "outside_catalogue":
        certain = f" Certain beside it: {names}." if d.effects else ""
        return f"No effect of the catalogue explains the gap ({size}).{place}{certain}"
    if not d.effects:
        return f"The gap ({size}) has several contributions, none of which matters alone in this log.{place}"
    return f"The log does not excite what would tell the causes of the gap ({size}) apart; candidates: {names}.{place}"


def _closed(d: Diagnosis, *, seen: bool) -> str:
    """How much of the gap the named causes close; seen: whether the held-out data shows a gap."""
    if d.gap["nominal"]["total"] <= 0.0:
        return ""
    after = None if seen else d.whole_with_effects
    if after is not None:
        return (
            f"; over the whole log it goes from {100 * largest(d.whole):.3g} to {100 * largest(after):.3g} %, while "
            f"the held-out data shows no gap of {100 * d.threshold:g} % (another log, with --validate, would)"
        )
    share = 1.0 - d.gap["with_effects"]["total"] / d.gap["nominal"]["total"]
    closes, where = "closes" if len(d.effects) == 1 else "close", "there" if seen else "on held-out data"
    return f", which {closes} {100 * share:.0f} % of the gap of all signals {where}"


def _place(d: Diagnosis) -> str:
    """Where the gap lies, or why the log does not show it."""
    if not d.where:
        return ""
    place = d.where[0][0]
    if d.location is not None and place in d.location.silent and not d.effects:
        (why,) = d.location.untold or ("its channels do not show it",)
        return f" Its place is unknown: {why}."
    return " It lies in a sensor." if place == "sensor" else f" It lies in the {place} balance."


def nearest_sentence(d: Diagnosis) -> str:
    """The nearest set of effects where none is the cause; empty where nothing halves the gap."""
    if d.verdict != "outside_catalogue" or not d.candidates:
        return ""
    best = d.candidates[0]
    before = largest(d.gap["nominal"])
    if not best.members or best.gap > 0.5 * before:
        return ""
    return (
        f"nearest in the catalogue, but not the cause: {', '.join(best.members)}; together they take the largest gap "
        f"on held-out data from {100 * before:.3g} to {100 * best.gap:.3g} %"
    )


def advice(verdict: str, causes: Sequence[Cause], system: System) -> str | None:
    """What to do where no experiment is proposed."""
    if verdict == "outside_catalogue":
        return (
            "inspect the balance in which the gap lies and the curve that was found there; a log with another load and "
            "another temperature shows whether the curve stays"
        )
    if verdict not in ("ambiguous", "underdetermined"):
        return None
    if verdict == "ambiguous" and all(set(c.ambiguous_with) <= set(c.why_same) for c in causes):
        return "no experiment with these sensors can tell them apart; measure the quantity itself"
    if system.prescribed:
        return (
            "move the rod differently from this log, with another current: at one speed under several currents, and at "
            "one current with several speeds; the library of inputs is for rods that the pump moves"
        )
    return "no input of the library tells the candidates apart within the plant's limits; measure another quantity"


def name_of(key: tuple[str, str | None]) -> str:
    """A cause by its id, with the channel of a sensor's."""
    return key[0] if key[1] is None else f"{key[0]} ({key[1]})"
