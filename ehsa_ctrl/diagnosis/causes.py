"""The causes of a gap as they are reported: numbers, parts of the gap, what could stand in their place."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations

import numpy as np

from ..core.log import Log
from ..physics.effects import EFFECTS
from ..physics.effects.presliding import HARD, SOFTNESS
from ..plant.file import CHANNEL_UNITS
from ..plant.plant import Plant
from .diagnosis import Cause, Estimated
from .evidence import deviations
from .judge import Judge, Judged, Key, ids_of
from .signals import largest
from .weigh import Weighed

#: Candidates less probable than this are not listed.
POSSIBLE = 0.02


def causes_of(
    plant: Plant,
    weighed: Weighed,
    judge: Judge,
    sd: Mapping[str, float],
    gap: Mapping[str, Mapping[str, float]],
    log: Log,
) -> tuple[Cause, ...]:
    """Causes of the chosen hypothesis, the largest first; behind them what else is held for possible."""
    chosen = weighed.chosen
    closed = _parts(weighed, judge, gap["nominal"]["total"])
    nominal, refitted, final = (gap[m]["total"] for m in ("nominal", "refit", "with_effects"))
    absorbed = float(np.clip((nominal - refitted) / (nominal - final), 0.0, 1.0)) if nominal > final else 0.0
    flow = (
        plant["A"] * float(np.max(np.abs(np.diff(log["position"])))) / log.sample_time
        if "position" in log.channels and "A" in plant.parameters
        else 0.0
    )
    found = []
    for key in chosen.causes:
        numbers = _numbers(key, chosen, judge, sd)
        same = _same_in_principle(key[0], chosen.fit.values, plant, flow)
        alike = tuple(dict.fromkeys([*same, *(other for other, _ in weighed.rivals.get(key, ()) if other != key[0])]))
        found.append(
            Cause(
                key[0], key[1], EFFECTS[key[0]].place, min(weighed.probability.get(key, 0.0), 1.0), numbers, alike,
                absorbed, closed.get(key, 0.0), chosen.own[key], same,
            )
        )  # fmt: skip
    found.sort(key=lambda cause: -largest(cause.alone))
    if weighed.verdict == "underdetermined":
        found += _others(weighed, judge)
    return tuple(found)


def _same_in_principle(id: str, values: Mapping[str, float], plant: Plant, flow: float) -> Mapping[str, str]:
    """Ids that no log of a hydraulic plant can tell from this one, whatever it excites, and why."""
    same = EFFECTS[id].same
    return {} if same is None or plant.structure.chambers is None else same(values, plant.values, flow)


def _others(weighed: Weighed, judge: Judge) -> list[Cause]:
    """Candidates beside the chosen ones, the most probable first, each with the numbers of its own best hypothesis."""
    found: dict[Key, Cause] = {}
    for judged in weighed.labels:
        for key in judged.causes:
            p = weighed.probability.get(key, 0.0)
            if key in weighed.chosen.causes or key in found or p < POSSIBLE:
                continue
            numbers = _numbers(key, judged, judge, deviations(judged.fit, judge.worth))
            found[key] = Cause(key[0], key[1], EFFECTS[key[0]].place, min(p, 1.0), numbers, alone=judged.own[key])
    return sorted(found.values(), key=lambda cause: -cause.probability)


def _numbers(key: Key, chosen: Judged, judge: Judge, sd: Mapping[str, float]) -> dict[str, Estimated]:
    """The numbers of a cause; those of a sensor are called `value`, as the channel says which."""
    plant = judge.search.bench.twin.plant
    kinds = {kind.name: kind.unit for kind in plant.structure.equations.parameters}
    ids = ids_of(plant)
    out = {}
    for suspect in chosen.fit.suspects:
        if suspect.key != key:
            continue
        for free in suspect.free:
            name = free.name
            word, dot, channel = name.partition(".")
            if dot and suspect.channel is None:
                continue
            unit = {"scale": "1", "bias": CHANNEL_UNITS[channel]}.get(word, "s") if dot else _unit(name, kinds)
            if name == SOFTNESS:
                soft = max(chosen.fit.values[name], HARD)
                out["sigma_0"] = Estimated(1.0 / soft, sd.get(name, np.nan) / soft**2, "N/m")
                continue
            deviation = 0.0 if free.fixed else sd.get(name, np.nan)
            out["value" if dot else name] = Estimated(chosen.fit.values[name], deviation, unit)
    for f in chosen.fit.frees:
        if (ids.get(f.name), None) == key and f.name not in out:
            out[f.name] = Estimated(chosen.fit.values[f.name], f.scale, _unit(f.name, kinds))
    return out


def _unit(name: str, kinds: Mapping[str, str]) -> str:
    return kinds.get(name, "N s/m")


def _parts(weighed: Weighed, judge: Judge, nominal: float) -> dict[Key, float]:
    """Share of the gap that each cause closes: its mean part over all orders in which they could be added (Shapley)."""
    causes = weighed.chosen.causes
    if nominal == 0.0:
        return dict.fromkeys(causes, 0.0)
    known: dict[frozenset[Key], float] = {frozenset(): nominal, frozenset(causes): weighed.chosen.held["total"]}
    for judged in judge.known.values():
        part = frozenset(judged.causes)
        if part < frozenset(causes) and part:
            known[part] = min(known.get(part, np.inf), judged.held["total"])

    def left(members: frozenset[Key]) -> float:
        if members not in known:
            gone = {n for s in weighed.chosen.fit.suspects if s.key not in members for n in s.names}
            values = {n: v for n, v in weighed.chosen.fit.values.items() if n not in gone}
            known[members] = judge.held.gap(values)["total"]
        return min(known[members], nominal * 10.0)

    out = dict.fromkeys(causes, 0.0)
    orders = list(permutations(causes))
    for order in orders:
        for i, key in enumerate(order):
            out[key] += (left(frozenset(order[:i])) - left(frozenset(order[: i + 1]))) / nominal / len(orders)
    return out
