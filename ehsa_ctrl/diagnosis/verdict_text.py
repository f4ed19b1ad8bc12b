"""The verdict and the advice of a diagnosis in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..core.log import Log
from ..core.text import join_words
from ..plant.file import label
from ..plant.system import System
from .moved_rod_experiment import missing_combinations
from .signals import largest

if TYPE_CHECKING:
    from .diagnosis import Cause, Diagnosis


#: Smaller relative changes of a nominal value are not listed: the other numbers of a cause move along with it.
LISTED = 0.01
#: A cause that is less probable than this may be one, in words.
LIKELY = 0.5


def verdict_sentence(d: Diagnosis) -> str:
    """The verdict in one sentence.

    It states the gap on held-out data, as the table does, or that over the whole log if the held-out data shows none.
    The gap over the whole log decides between "no_gap" and the other verdicts.
    """
    shown = d.gap["nominal"]
    seen = d.verdict != "no_gap" and largest(shown) >= d.threshold
    shown = shown if seen else d.whole
    worst = max((s for s in shown if s != "total"), key=lambda s: shown[s])
    data = "on held-out data" if seen else "over the whole log"
    size = f"{100 * shown[worst]:.3g} % in {worst.replace('_', ' ')} {data}"
    if d.verdict == "no_gap":
        return f"No relevant gap: the largest is {size}, below the threshold of {100 * d.threshold:g} %."
    names = join_words(cause.name for cause in d.effects)
    if d.verdict == "effect":
        return f"The gap ({size}) comes from {names}{_closed(d, seen=seen)}."
    if d.verdict == "ambiguous":
        untold = f"{the_data(d)} can't separate these alternatives"
        return f"The gap ({size}) comes from {with_alternatives(d.effects)}{_closed(d, seen=seen)}; {untold}."
    if d.verdict == "parameters":
        numbers = f"{_numbers(d)}{_closed(d, seen=seen)}"
        return f"Wrong nominal values cause the gap ({size}), and no effect is needed: {numbers}."
    if d.law is not None:
        return f"The gap ({size}) follows a law that the catalogue lacks{_law(d)}"
    place = _place(d)
    if d.verdict == "partly":
        left = f" What is left: {d.rest}." if d.rest else ""
        comes = "comes" if all(cause.probability >= LIKELY for cause in d.effects) else "may come"
        return f"Part of the gap ({size}) {comes} from {names}{_closed(d, seen=seen)}.{left}"
    if d.verdict == "outside_catalogue":
        return f"No effect of the catalogue explains the gap ({size}).{place}"
    if not d.effects:
        return f"No single cause makes the gap ({size}): several errors, each below the threshold, explain it.{place}"
    return f"The excitation of {the_data(d)} can't separate the possible causes of the gap ({size}): {names}.{place}"


def with_alternatives(causes: Sequence[Cause]) -> str:
    """Causes with the alternatives to each, in words."""
    sets = [" or ".join([cause.name, *alternatives_of(cause)]) for cause in causes]
    return join_words(f"({words})" if " or " in words and len(sets) > 1 else words for words in sets)


def alternatives_of(cause: Cause) -> list[str]:
    """The alternatives to a cause, in words: a sensor error of another channel has the same id."""
    return [f"{other} of another channel" if other == cause.id else other for other in cause.ambiguous_with]


def the_data(d: Diagnosis) -> str:
    """One log or several, as the subject of a sentence."""
    return "these logs" if d.logs else "this log"


def _numbers(d: Diagnosis) -> str:
    """Each wrong nominal value with its relative change."""
    values = {name: number.value for cause in d.effects for name, number in cause.parameters.items()}
    changes = {n: v / d.plant[n] - 1.0 for n, v in values.items() if d.plant.parameters.get(n) and d.plant[n] != 0.0}
    listed = [f"{label(name)} {100 * change:+.0f} %" for name, change in changes.items() if abs(change) >= LISTED]
    return ", ".join(listed) or " and ".join(cause.name for cause in d.effects)


def _closed(d: Diagnosis, *, seen: bool) -> str:
    """How much of the gap the causes close. seen: whether the held-out data shows a gap."""
    if d.gap["nominal"]["total"] <= 0.0:
        return ""
    after = None if seen else d.whole_with_effects
    if after is not None:
        return (
            f"; over the whole log it falls from {100 * largest(d.whole):.3g} to {100 * largest(after):.3g} %, but "
            f"the held-out data has no gap of {100 * d.threshold:g} %: validate with another log (--validate)"
        )
    share = 1.0 - d.gap["with_effects"]["total"] / d.gap["nominal"]["total"]
    closes, where = "closes" if len(d.effects) == 1 else "close", "there" if seen else "on held-out data"
    # Where effects are named in part, further numbers of the improved plant may have changed much.
    beside = " with the refitted nominal values" if d.verdict == "partly" else ""
    return f", which{beside} {closes} {100 * share:.0f} % of the total gap {where}"


def _law(d: Diagnosis) -> str:
    """The law, how much of the gap it closes, and how much of it the causes close that it replaces."""
    assert d.law is not None
    beside = f" beside {join_words(d.law.beside)}" if d.law.beside else ""
    percent = round(100 * d.law.forms[0].gap_closed)
    # A wave loses its phase: windows show the law, and the held-out data in one run do not.
    closed = f"{f'{percent} %' if percent > 0 else 'nothing'} of the total gap on held-out data"
    instead = [cause.name for cause in d.effects if cause.id not in d.law.beside]
    share = f"{100 * d.explained:.0f} %"
    others = f" Without it, {join_words(instead)} would close {share}." if instead and not d.law.beside else ""
    return f"{beside}, which closes {closed}: {d.law.words}.{others}"


def _place(d: Diagnosis) -> str:
    """The place of the gap, or why the log does not show it."""
    if not d.where:
        return ""
    place = d.where[0][0]
    if d.location is not None and place in d.location.unobserved and not d.effects:
        (why,) = d.location.untold or (f"the channels of {the_data(d)} do not show it",)
        return f" Its place is unknown: {why}."
    return " It lies in a sensor." if place == "sensor" else f" It lies in the {place} balance."


def nearest_sentence(d: Diagnosis) -> str:
    """The most similar set of effects if none is the cause; empty if it closes less than half of the gap."""
    if d.verdict != "outside_catalogue" or not d.candidates:
        return ""
    best = d.candidates[0]
    before = largest(d.gap["nominal"])
    if not best.members or best.gap > 0.5 * before:
        return ""
    return (
        f"most similar effects, but not the cause: {', '.join(best.members)}; they reduce the largest gap on held-out "
        f"data from {100 * before:.3g} to {100 * best.gap:.3g} %"
    )


def advice(
    verdict: str,
    causes: Sequence[Cause],
    system: System,
    logs: Sequence[Log],
    *,
    has_law: bool = False,
    has_curve: bool = False,
) -> str | None:
    """What to do if no experiment is proposed; None for a verdict that needs nothing.

    has_law: whether a law is proposed, in one form. has_curve: whether a free curve closes much of what is left.
    """
    combinations = missing_combinations(system, logs) if system.prescribed else ""
    if has_law or verdict in ("outside_catalogue", "partly"):
        curve = (
            "inspect the balance in which the gap lies and the curve found there; check with logs at another load and "
            "temperature whether the curve stays the same"
            if has_curve
            else "log the rig at another load and temperature, with every channel that it has: no curve over a "
            "variable of this log was found that closes much of what is left"
        )
        law = (
            "log the rig at another load or with another waveform, and confirm the law with that log by "
            "`ehsa-ctrl effects confirm`"
        )
        return (law if has_law else curve) + (f"; {combinations}" if combinations else "")
    if verdict not in ("ambiguous", "underdetermined"):
        return None
    if verdict == "ambiguous" and all(set(c.ambiguous_with) <= set(c.why_same) for c in causes):
        return "no experiment with these sensors can separate these effects; measure the quantity directly"
    if system.prescribed:
        return combinations or "log velocity and drive of the rig, and vary them independently"
    return "no input of the library separates the candidates within the plant's limits; measure another quantity"


def name_of(key: tuple[str, str | None]) -> str:
    """Id of a cause, with the channel for a sensor error."""
    return key[0] if key[1] is None else f"{key[0]} ({key[1]})"
