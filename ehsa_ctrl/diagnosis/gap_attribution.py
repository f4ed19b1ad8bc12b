"""The place of the gap between a log and the nominal plant, found without the catalogue of effects.

The residual of each balance is an unknown input (`unknown_inputs`). Curve fits show what it depends on (`regimes`), and
a simulation with the unknown input injected shows how much of the gap it closes (`place_sets`). The shares are Shapley
values: what a place closes, averaged over all orders of adding places (L. S. Shapley, "A value for n-person games",
Annals of Mathematics Studies 28, 1953). They are computed for the set of places with the lowest cost; sets with nearly
the same cost are averaged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import factorial
from typing import Any

import numpy as np

from ..core.log import Log
from ..core.result import as_dict
from ..core.text import join_words
from ..physics.effects import PLACES
from ..plant.plant import Plant
from .injection import SquaredGaps
from .place_sets import SMOOTHING, Form, InjectionCase, Places, PlaceSet, evaluate_sets, undo_sensors
from .regimes import CurveKey, Regime, regime_of
from .regressors import DRIVE_FAMILIES
from .sensor_error import SensorError, find_inconsistent_sensor, fit_sensor_error
from .unknown_inputs import declared_unknown_inputs, smooth

# The shares below are shares of the nominal plant's squared gap. Engineering judgement, as the penalties in place_sets.

#: Penalty on a sensor error: it has two or three parameters, and errors of the plant often resemble a wrong scale.
SENSOR_PENALTY = 0.06
#: A sensor error is not combined with other places if one set alone leaves less than this share.
MAX_LEFT = 0.1
#: If the log does not show all balances, a sensor error has few competitors: it must leave less than this share.
MAX_LEFT_BY_SENSOR = 0.3
#: Scale of the cost difference over which sets of places are averaged with exponential weights.
SIMILAR_COST = 0.03
#: Length of an interval of `over_time` [s].
INTERVAL = 1.0
SENSOR = Places({"sensor"})


@dataclass(frozen=True)
class Location:
    """The place of a gap.

    Attributes
    ----------
    shares: (place, share), the largest first; the shares add up to one.
    time: (N,) s.
    unknown: balance -> (N,) unknown input, SI units, smoothed over 12 samples; NaN where the log does not show it. A
        positive torque or flow drives the motion, a positive force resists extension.
    regimes: what the unknown inputs of the places with a share depend on.
    by_signal: signal -> "gap": gap of the nominal plant; place -> share of its square that the place closes.
    explained: share of the squared gap that these places close together.
    over_time: for each second its start [s], and the squared gap before and after injection as shares of the total.
    sensor: channel and error of a sensor, in words.
    load_cell: share of the squared unknown force that the load cell shows, which is due to the load and not to the
        rod's friction; None without a load cell.
    untold: balances that the log does not show, and the missing channels, in sentences.
    unobserved: the places of these balances; they share equally what the other places leave.
    log: of several logs, the one that unknown inputs and regimes are of.
    """

    shares: tuple[tuple[str, float], ...]
    time: np.ndarray = field(repr=False)
    unknown: Mapping[str, np.ndarray] = field(repr=False)
    regimes: tuple[Regime, ...]
    by_signal: Mapping[str, Mapping[str, float]]
    explained: float
    over_time: tuple[tuple[float, float, float], ...] = field(repr=False)
    sensor: str | None = None
    load_cell: float | None = None
    untold: tuple[str, ...] = ()
    unobserved: tuple[str, ...] = ()
    log: str = ""

    @property
    def place(self) -> str:
        """The place with the largest share."""
        return self.shares[0][0]

    def to_dict(self) -> dict[str, Any]:
        """As under `location` in diagnosis.json."""
        names = "balance against unit words explained gap_closed bins mean sd"
        regimes = [as_dict(r, names) for r in self.regimes]
        of_log = {"log": self.log} if self.log else {}
        return as_dict(self, "by_signal sensor untold", shares=dict(self.shares), regimes=regimes, **of_log)

    def __str__(self) -> str:
        seen = [f"{place} {100 * s:.0f} %" for place, s in self.shares if s >= 0.005 and place not in self.unobserved]
        lines = ["place of the gap: " + ", ".join(seen)] if seen else []
        if self.sensor is not None and dict(self.shares)["sensor"] >= 0.05:
            lines.append(f"  sensor: {self.sensor}")
        for regime in self.regimes:
            closes = f", closes {100 * regime.gap_closed:.0f} % of the squared gap" if regime.gap_closed > 0.0 else ""
            lines.append(f"  {regime} (explains {100 * regime.explained:.0f} %{closes})")
        if self.load_cell is not None and dict(self.shares)["force"] >= 0.05:
            lines.append(f"  the load cell shows {100 * self.load_cell:.0f} % of the unknown force")
        lines += [f"  {sentence}" for sentence in self.untold]
        return "\n".join(lines)


def attribute_gap(plant: Plant, log: Log, noise: Mapping[str, float]) -> Location:
    """Find the place of the gap between a log and the nominal plant.

    Parameters
    ----------
    plant: nominal plant, linear or nonlinear; its sensor models are inverted before signals are compared.
    log: channels in SI units. Places whose balances it does not show get what the others leave unexplained.
    noise: channel -> standard deviation, see `signals.noise_of`.
    """
    case = InjectionCase.of(plant, log, noise).with_curves()
    (run,) = case.run([{}])
    base = case.gap.squared_gap(run)
    case = replace(case, gap=replace(case.gap, nominal=max(float(base.sum()), 1e-300)))
    nominal = PlaceSet(base, 1.0, {}, run)
    found, closed_as_measured = evaluate_sets(case)
    sets, closed = {Places(): nominal, **found}, closed_as_measured
    best = min(sets.values(), key=lambda one: one.cost)
    sensor = fit_sensor_error(case.gap, [nominal, best])
    implausible = find_inconsistent_sensor(case.gap, nominal)
    corrected = None
    if sensor is not None:
        values = sensor.corrected(log[sensor.channel], log.sample_time)
        log = replace(log, channels={**log.channels, sensor.channel: values})
        gap = case.gap.with_measured(undo_sensors(case.plant, log))
        left = gap.squared_gap(run)
        if not case.unobserved or float(left.sum()) < MAX_LEFT_BY_SENSOR * gap.nominal:
            sets[SENSOR] = PlaceSet(left, gap.share(left) + SENSOR_PENALTY, {}, run)
        smallest = min(
            float(e.sum()) for e in (left, best.squared_gap, *([implausible[1].squared_gap] if implausible else []))
        )
        if smallest > MAX_LEFT * gap.nominal and SENSOR in sets:
            corrected = case.with_log(log, noise).with_curves()
            found, closed = evaluate_sets(corrected)
            for places, one in found.items():
                sets[places | SENSOR] = replace(one, cost=one.cost + SENSOR_PENALTY)
    if implausible is not None and implausible[1].cost < sets.get(SENSOR, nominal).cost:
        sensor, corrected, closed = implausible[0], None, closed_as_measured
        sets = {places: one for places, one in sets.items() if "sensor" not in places} | {SENSOR: implausible[1]}
    return _build_location(case, corrected, sets, closed_as_measured, closed, sensor)


def _subsets(places: Places) -> list[Places]:
    return [Places(part) for n in range(len(places)) for part in combinations(sorted(places), n)]


def _shapley(places: Places, worth: Mapping[Places, SquaredGaps]) -> dict[str, SquaredGaps]:
    """Place -> (signals,) Shapley value of the squared gap. worth: set of places -> (signals,) squared gap left."""
    n = len(places)
    out = {}
    for place in places:
        rest = sorted(places - {place})
        total = 0.0 * worth[Places()]
        for size in range(n):
            weight = factorial(size) * factorial(n - size - 1) / factorial(n)
            for others in combinations(rest, size):
                total = total + weight * (worth[Places(others)] - worth[Places({*others, place})])
        out[place] = total
    return out


def _build_location(
    case: InjectionCase,
    corrected: InjectionCase | None,
    sets: Mapping[Places, PlaceSet],
    closed: Mapping[CurveKey, float],
    closed_corrected: Mapping[CurveKey, float],
    sensor: SensorError | None,
) -> Location:
    """Shares, regimes and sentences from the squared gap that every set of places leaves.

    corrected: case with the sensor error corrected. closed, closed_corrected: curve -> share that it alone closes.
    """
    gap, base = case.gap, sets[Places()].squared_gap
    parts, best = _closed_by_place(sets)
    system = case.plant.structure.system
    own = {*system.places, "sensor"}
    sizes = {place: max(float(part.sum()), 0.0) for place, part in parts.items() if place in own}
    unobserved = [place for place in PLACES if not set(case.unobserved).isdisjoint(system.places.get(place, ()))]
    rest = max(gap.nominal - sum(sizes.values()), 0.0)
    for place in unobserved:
        sizes[place] += rest / len(unobserved)
    whole = sum(sizes.values())
    shares = {place: size / whole if whole > 0.0 else 1.0 / len(sizes) for place, size in sizes.items()}
    final, final_closed = case, closed
    if corrected is not None and "sensor" in best:
        final, final_closed = corrected, closed_corrected
    known = final.unknown.values
    return Location(
        shares=tuple(sorted(shares.items(), key=lambda row: -row[1])),
        time=case.log.time,
        unknown={
            name: np.append(final.smoothed(name), np.nan) if name in known else np.full(len(case.log), np.nan)
            for name in declared_unknown_inputs(system)
        },
        regimes=_regimes(final, sets[best].forms if best else {}, final_closed),
        by_signal={
            name: {"gap": float(np.sqrt(base[i]))}
            | {place: float(part[i] / base[i]) for place, part in parts.items() if base[i] > 0.0 and part.any()}
            for i, name in enumerate(gap.names)
        },
        explained=max(1.0 - gap.share(sets[best].squared_gap), 0.0) if best else 0.0,
        over_time=_over_time(case, final, sets[Places()], sets[best]),
        sensor=str(sensor) if sensor is not None else None,
        load_cell=_load_cell_share(final),
        untold=_untold(case),
        unobserved=tuple(unobserved),
    )


def _closed_by_place(sets: Mapping[Places, PlaceSet]) -> tuple[dict[str, SquaredGaps], Places]:
    """Place -> (signals,) squared gap that it closes; and the set with the lowest cost."""
    left = {places: one.squared_gap for places, one in sets.items()}
    parts: dict[str, SquaredGaps] = {place: 0.0 * left[Places()] for place in PLACES}
    costs = {p: one.cost for p, one in sets.items() if p and all(part in sets for part in _subsets(p))}
    if not costs:
        return parts, Places()
    lowest = min(costs.values())
    weights = {
        p: float(np.exp(-(c - lowest) / SIMILAR_COST)) for p, c in costs.items() if c - lowest < 6.0 * SIMILAR_COST
    }
    for places, weight in weights.items():
        for place, part in _shapley(places, left).items():
            parts[place] = parts[place] + weight / sum(weights.values()) * part
    return parts, min(costs, key=lambda p: costs[p])


def _regimes(case: InjectionCase, forms: Mapping[str, Form], closed: Mapping[CurveKey, float]) -> tuple[Regime, ...]:
    """Two curves for each balance of the injected places: the injected one and the next best.

    The curves of the force on a rod with prescribed motion come last: this force causes no gap, but shows errors of the
    rod's area and friction.
    """
    found = []
    for place, form in forms.items():
        for balance in case.plant.structure.system.places[place]:
            first = [c for c in form.curves if c.unknown_input == balance]
            keys = {c.key for c in first}
            rest = [c for c in case.curves[balance] if c.key not in keys and c.explained > 0.1]
            if balance == "torque":
                rest = [c for c in rest if (c.family in DRIVE_FAMILIES) == (place == "drive")]
            shown = sorted([*first, *rest][:2], key=lambda c: (-round(c.explained, 2), c.numbers))
            values = case.smoothed(balance)
            found += [regime_of(c, values, closed.get(c.key, float("nan"))) for c in shown]
    if case.plant.structure.system.prescribed and "force" in case.unknown.values:
        values = case.smoothed("force")
        found += [regime_of(c, values) for c in case.curves["force"][:2] if c.explained > 0.1]
    return tuple(found)


def _load_cell_share(case: InjectionCase) -> float | None:
    """Share of the squared unknown force that the load cell shows; None without a load cell."""
    if case.unknown.load is None or "force" not in case.unknown.values:
        return None
    force = case.smoothed("force")
    known = np.isfinite(force)
    if not known.any():
        return None
    rest = (force - smooth(case.unknown.load, SMOOTHING))[known]
    return float(np.clip(1.0 - np.sum(rest**2) / max(float(np.sum(force[known] ** 2)), 1e-300), 0.0, 1.0))


def _over_time(
    case: InjectionCase, final: InjectionCase, nominal: PlaceSet, best: PlaceSet
) -> tuple[tuple[float, float, float], ...]:
    """See `Location.over_time`."""
    before, after = case.gap.errors(nominal.run), final.gap.errors(best.run)
    floor = case.gap.noise_floor[:, None]
    size = max(int(round(INTERVAL / case.log.sample_time)), 1)
    whole = case.gap.nominal * len(case.log)
    rows = []
    for k in range(0, len(case.log), size):
        squares = [float(np.sum(np.nan_to_num(e[:, k : k + size]) ** 2 - floor)) / whole for e in (before, after)]
        rows.append((float(case.log.time[k]), max(squares[0], 0.0), max(squares[1], 0.0)))
    return tuple(rows)


def _untold(case: InjectionCase) -> tuple[str, ...]:
    """Balances that the log does not show, and the channels that it lacks."""
    names = {"torque": "the torque balance", "flow_1": "the flow balances", "force": "the force balance"}
    missing = [c for c in case.plant.structure.system.outputs if c not in case.log.channels]
    unobserved = [words for name, words in names.items() if name in case.unobserved]
    if not unobserved:
        return ()
    return (f"without {', '.join(missing) or 'more channels'} {join_words(unobserved)} can't be evaluated",)
