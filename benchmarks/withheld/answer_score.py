"""Score one answer against one key."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from effect_gap import THRESHOLD, UNCERTAIN
from effects import IDS, place_of
from effects_outside import OUTSIDE
from gap import SIGNALS

#: A listed effect counts as named from this probability on; the first one always where the verdict names causes.
NAMED = 0.5
#: Verdicts that name causes.
NAMING = ("effect", "ambiguous", "partly", "parameters")
FAILED = "failed"
#: A size is right within this share of the true one, or this many deviations.
SIZE_SHARE, SIZE_SDS = 0.1, 2.0
#: Half a 95 % interval in standard deviations.
HALF_INTERVAL = 1.96

Name = tuple[str, str | None]


@dataclass(frozen=True)
class AnswerScore:
    """One case.

    truth: ids of the causes, largest first, empty without a gap. answer: verdict, or "failed".
    first: first id, or the verdict if nothing is named. in_set: the first one's set contains a cause.
    found: causes that are named, alone or in a set; listed: those among the effects with any probability.
    missed: causes that are not named. wrong: named, and neither a cause nor a true change below the threshold; minor:
    number of the latter. probabilities: (K,) of the ids; labels: (K,) 1 cause, 0 not, None for an equivalent of a
    cause and for a true change below the threshold.
    on_truth: mean probability given to the causes.
    sizes: for each cause named by its own id, whether its parameters are within the larger of 10 % and two standard
    deviations. in_interval: for each of those parameters, whether its 95 % interval holds the true value.
    closed, closable: share of the nominal gap that the answer closed on held-out data, and that the truth closes.
    hidden: effects that make a gap alone and none beside the others.
    repeatable: share that the truth closes where the noise of its input is drawn again; None in older keys.
    """

    name: str
    family: str
    verdict: str
    truth: tuple[str, ...]
    laws: tuple[str, ...]
    answer: str
    first: str
    top_1: bool
    in_set: bool
    set_size: int
    found: int
    listed: int
    missed: tuple[str, ...]
    wrong: tuple[str, ...]
    minor: int
    place_right: bool
    probabilities: tuple[float, ...]
    labels: tuple[int | None, ...]
    on_truth: float
    sizes: tuple[bool, ...]
    in_interval: tuple[bool, ...]
    closed: float | None
    closable: float | None
    repeatable: float | None
    hidden: int
    largest: float
    loop: str
    load_cell: bool
    seconds: float | None


def score_answer(name: str, key: Mapping[str, Any], answer: Mapping[str, Any] | None) -> AnswerScore:
    """`answer` is a diagnosis.json, or None without an answer.

    An effect that makes no gap beside the others is no cause: to name it is neither right nor wrong.
    """
    acting = acting_effects(key)
    causes = [_accepted(effect) for effect in acting]
    truth = tuple(effect["id"] for effect in acting)
    catalogued = [cause for cause, id in zip(causes, truth, strict=True) if id != OUTSIDE]
    effects: list[Mapping[str, Any]] = list(answer["effects"]) if answer else []
    verdict = str(answer["verdict"]) if answer else FAILED
    answered = verdict in NAMING
    named = [e for i, e in enumerate(effects) if float(e["probability"]) >= NAMED or (answered and i == 0)]
    if verdict in ("no_gap", "underdetermined"):
        named = []
    found = [any(_covers(e, cause) for e in named) for cause in catalogued]
    off: set[Name] = {(UNCERTAIN[p], None) for p in key.get("parameter_errors", {})}
    off |= {_name(e) for e in key.get("below_threshold", [])}
    off |= {name for effect in key["effects"] if effect not in acting for name in _accepted(effect)}
    stray = [e for e in named if not any(_covers(e, cause) for cause in catalogued)]
    wrong = tuple(e["id"] for e in stray if _name(e) not in off)
    first = effects[0] if effects and verdict != "no_gap" else None
    by_id = {id: cause for cause, id in zip(causes, truth, strict=True) if id != OUTSIDE}
    probabilities, labels = _scored(effects, by_id, {id for id, _ in off})
    on_truth = [
        max((float(e["probability"]) for e in effects if _matches(e, cause)), default=0.0) for cause in catalogued
    ]
    sized = [
        (effect, e) for effect in acting for e in named if _matches(e, {_name(effect)}) and _common_sizes(effect, e)
    ]
    places = {p for effect in acting for p in _places(effect)}
    where = max(answer["where"], key=lambda w: w["share"], default=None) if answer and answer.get("where") else None
    return AnswerScore(
        name=name,
        family=key.get("family", ""),
        verdict=key.get("verdict") or ("no_gap" if not truth else OUTSIDE if OUTSIDE in truth else "effect"),
        truth=truth,
        laws=tuple(effect.get("law", "") for effect in acting),
        answer=verdict,
        first=first["id"] if answered and first else verdict,
        top_1=bool(first and answered and any(_matches(first, cause) for cause in catalogued)),
        in_set=bool(first and answered and any(_covers(first, cause) for cause in catalogued)),
        set_size=1 + len(first.get("ambiguous_with") or []) if first and answered else 0,
        found=sum(found),
        listed=sum(any(_covers(e, cause) for e in effects) for cause in catalogued) if verdict != "no_gap" else 0,
        missed=tuple(id for id, there in zip((i for i in truth if i != OUTSIDE), found, strict=True) if not there),
        wrong=wrong,
        minor=len(stray) - len(wrong),
        place_right=bool(where and where["place"] in places),
        probabilities=probabilities,
        labels=labels,
        on_truth=sum(on_truth) / len(on_truth) if on_truth else float("nan"),
        sizes=tuple(_size_right(effect, e) for effect, e in sized),
        in_interval=tuple(inside for effect, e in sized for inside in _in_interval(effect, e)),
        closed=_closed(answer, "with_effects") if answer else None,
        closable=_closed(key.get("held_out"), "truth"),
        repeatable=_closed(key.get("held_out"), "repeated"),
        hidden=len(key["effects"]) - len(acting),
        largest=max(key["gap"][s] for s in SIGNALS),
        loop=key.get("loop", ""),
        load_cell=bool(key.get("load_cell", True)),
        seconds=float(answer["seconds"]) if answer and answer.get("seconds") is not None else None,
    )


def acting_effects(key: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The effects of a key that make a gap beside the others; older keys do not say so."""

    def hidden(effect: Mapping[str, Any]) -> bool:
        beside = effect.get("beside")
        return effect["id"] != OUTSIDE and bool(beside) and max(beside[signal] for signal in SIGNALS) < THRESHOLD

    return [effect for effect in key["effects"] if not hidden(effect)]


def _places(effect: Mapping[str, Any]) -> list[str]:
    """From the key, otherwise by the id; keys of other benches may lack the place of an unknown effect."""
    if "place" in effect or effect["id"] not in IDS:
        return list(effect.get("place", []))
    return place_of(effect["id"], "")


def _accepted(effect: Mapping[str, Any]) -> set[Name]:
    rows: Iterable[Mapping[str, Any]] = effect.get("accepted") or [effect]
    return {(row["id"], row.get("channel")) for row in rows}


def _name(effect: Mapping[str, Any]) -> Name:
    return effect["id"], effect.get("channel")


def _common_sizes(effect: Mapping[str, Any], answered: Mapping[str, Any]) -> set[str]:
    """Parameters that both the key and the answer have."""
    return set(effect.get("parameters") or {}) & set(answered.get("parameters") or {})


def _size_right(effect: Mapping[str, Any], answered: Mapping[str, Any]) -> bool:
    """Whether all of them are within the larger of 10 % and two deviations; see the README."""
    for name in _common_sizes(effect, answered):
        true, got = float(effect["parameters"][name]), answered["parameters"][name]
        if abs(float(got["value"]) - true) > max(SIZE_SHARE * abs(true), SIZE_SDS * float(got["sd"] or 0.0)):
            return False
    return True


def _in_interval(effect: Mapping[str, Any], answered: Mapping[str, Any]) -> list[bool]:
    """Whether value +- 1.96 sd holds the truth, for each common parameter that the answer determines.

    An sd that is null is infinite: such an interval holds anything, and does not count.
    """
    out = []
    for name in sorted(_common_sizes(effect, answered)):
        true, got = float(effect["parameters"][name]), answered["parameters"][name]
        if got["sd"] is not None:
            out.append(abs(float(got["value"]) - true) <= HALF_INTERVAL * float(got["sd"]))
    return out


def _matches(effect: Mapping[str, Any], cause: set[Name]) -> bool:
    return (effect["id"], effect.get("channel")) in cause


def _covers(effect: Mapping[str, Any], cause: set[Name]) -> bool:
    """The effect or one of its ambiguous alternatives is the cause. Sets name ids without channels."""
    return _matches(effect, cause) or bool({id for id, _ in cause} & set(effect.get("ambiguous_with") or []))


def _scored(
    effects: list[Mapping[str, Any]], causes: Mapping[str, set[Name]], off: set[str]
) -> tuple[tuple[float, ...], tuple[int | None, ...]]:
    """Probability and label of each id, first those of the bench, then others that are listed.

    Equivalents of a cause share its probability.
    """
    p = dict.fromkeys((*IDS, *(str(e["id"]) for e in effects)), 0.0)
    # A true change below the threshold is neither: it is present and does not matter.
    label: dict[str, int | None] = {id: None if id in off else 0 for id in p}
    for e in effects:
        p[e["id"]] = max(p[e["id"]], float(e["probability"]))
    for cause in causes.values():
        for id, _ in cause:
            label[id] = None
    for id, cause in causes.items():
        label[id] = 1
        p[id] = max((float(e["probability"]) for e in effects if _matches(e, cause)), default=0.0)
    return tuple(p.values()), tuple(label[id] for id in p)


def _closed(table: Mapping[str, Any] | None, model: str) -> float | None:
    """1 - G(model) / G(nominal) in total."""
    gaps = table.get("gap") if table else None
    if not gaps or not gaps.get(model) or not gaps.get("nominal") or not gaps["nominal"]["total"]:
        return None
    return 1.0 - float(gaps[model]["total"]) / float(gaps["nominal"]["total"])
