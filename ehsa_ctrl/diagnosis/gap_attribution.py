"""Where the gap of a nominal plant to a log lies, without the catalogue of effects.

Each balance gives its unknown input (`unknown_inputs`), the regime that it follows (`regimes`), and how much of the gap
it closes when it is injected (`place_sets`). Places share a gap by the Shapley value: the mean of what a place closes
over all orders in which places could be injected (L. S. Shapley, "A value for n-person games", Annals of Mathematics
Studies 28, 1953), among the fewest places that explain the gap; sets of nearly equal cost share it.
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
from ..identification.initial_state import find_initial_state
from ..identification.logged_inputs import acting_drive, logged_inputs, undo_sensor
from ..physics.effects import PLACES
from ..plant.plant import Plant
from .injection import Energy, SquaredGap
from .place_sets import BUMP, Form, InjectionCase, Places, PlaceSet, evaluate_sets
from .regimes import CurveKey, Regime, regime_of
from .regressors import DRIVE
from .sensor_error import SensorError, fitted_sensor_error, implausible_sensor
from .unknown_inputs import smooth, unknown_inputs_of

#: Share of the gap that a sensor has to explain: it has two or three numbers, and errors of the plant often resemble
#: its scale.
SENSOR_PRICE = 0.06
#: Sensors are not combined with other places where a set leaves less than this part of the squared gap.
EXPLAINED = 0.1
#: Where balances are silent a sensor has few competitors: it has to leave less than this part by itself.
SENSOR_ALONE = 0.3
#: Sets of places whose costs differ by less than this share the gap.
CLOSE = 0.03
#: Length of an interval of `over_time` [s].
INTERVAL = 1.0
SENSOR = Places({"sensor"})


@dataclass(frozen=True)
class Location:
    """Where a gap lies.

    shares: (place, share) with sum one, the largest first. time: (N,) s. unknown: balance -> (N,) unknown input in SI
    units, smoothed over 48 ms at 250 Hz, NaN where the log does not show it; a positive torque or flow drives, a
    positive force resists extension. regimes: what the unknown inputs of places with a share follow. by_signal:
    signal -> gap of the nominal plant and the part of its square that each place closes. explained: part of the squared
    gap that the places with a share close together. over_time: start of each second, squared gap of the nominal plant
    as part of the whole, and what these places leave of it. sensor: which, in words. load_cell: part of the unknown
    force's square that the load cell shows, so that it is the load's and not the rod's; None without one. untold: what
    the log does not show. silent: places whose balances it does not show; they share what the others leave.
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
    silent: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """The place with the largest share."""
        return self.shares[0][0]

    def to_dict(self) -> dict[str, Any]:
        """As under `location` in diagnosis.json."""
        regimes = [as_dict(r, "balance words explained gap_closed") for r in self.regimes]
        return as_dict(self, "by_signal sensor untold", shares=dict(self.shares), regimes=regimes)

    def __str__(self) -> str:
        told = [f"{place} {100 * s:.0f} %" for place, s in self.shares if s >= 0.005 and place not in self.silent]
        lines = ["the gap lies in " + ", ".join(told)] if told else []
        if self.sensor is not None and dict(self.shares)["sensor"] >= 0.05:
            lines.append(f"  sensor: {self.sensor}")
        for regime in self.regimes:
            closes = f", closes {100 * regime.gap_closed:.0f} % of the squared gap" if regime.gap_closed > 0.0 else ""
            lines.append(f"  {regime} ({100 * regime.explained:.0f} % of it{closes})")
        if self.load_cell is not None and dict(self.shares)["force"] >= 0.05:
            lines.append(f"  the load cell shows {100 * self.load_cell:.0f} % of the unknown force")
        lines += [f"  {sentence}" for sentence in self.untold]
        return "\n".join(lines)


def attribute_gap(plant: Plant, log: Log, noise: Mapping[str, float]) -> Location:
    """Say where the gap of a nominal plant to a log lies.

    Parameters
    ----------
    plant: nominal, of either model; its sensors are undone before anything is compared.
    log: channels in SI units; places whose balances it does not show get what the others leave unexplained.
    noise: channel -> standard deviation, from `signals.noise_of`.
    """
    dt, system = log.sample_time, plant.structure.system
    start = find_initial_state(plant, log).state
    asked, outside = logged_inputs(plant, log)
    plant, current = acting_drive(plant, asked, dt)
    measured = {c: undo_sensor(plant, log, c) for c in system.outputs if c in log.channels}
    case = InjectionCase.of(plant, log, current, outside, start, noise, SquaredGap.of(system, measured, noise, dt))
    (run,) = case.run([{}])
    base = case.gap.energy(run)
    case = replace(case, gap=replace(case.gap, whole=max(float(base.sum()), 1e-300)))
    nominal = PlaceSet(base, 1.0, {}, run)
    found, closed_as_measured = evaluate_sets(case)
    sets, closed = {Places(): nominal, **found}, closed_as_measured
    best = min(sets.values(), key=lambda one: one.cost)
    sensor = fitted_sensor_error(case.gap, [nominal, best])
    implausible = implausible_sensor(case.gap, nominal)
    corrected = None
    if sensor is not None:
        log = replace(log, channels={**log.channels, sensor.channel: sensor.corrected(log[sensor.channel], dt)})
        gap = case.gap.with_measured({**measured, sensor.channel: undo_sensor(plant, log, sensor.channel)})
        left = gap.energy(run)
        if not case.silent or float(left.sum()) < SENSOR_ALONE * gap.whole:
            sets[SENSOR] = PlaceSet(left, gap.share(left) + SENSOR_PRICE, {}, run)
        least = min(float(e.sum()) for e in (left, best.energy, *([implausible[1].energy] if implausible else [])))
        if least > EXPLAINED * gap.whole and SENSOR in sets:
            corrected = InjectionCase.of(plant, log, current, outside, start, noise, gap)
            found, closed = evaluate_sets(corrected)
            for places, one in found.items():
                sets[places | SENSOR] = replace(one, cost=one.cost + SENSOR_PRICE)
    if implausible is not None and implausible[1].cost < sets.get(SENSOR, nominal).cost:
        sensor, corrected, closed = implausible[0], None, closed_as_measured
        sets = {places: one for places, one in sets.items() if "sensor" not in places} | {SENSOR: implausible[1]}
    return _location(case, corrected, sets, closed_as_measured, closed, sensor)


def _subsets(places: Places) -> list[Places]:
    return [Places(part) for n in range(len(places)) for part in combinations(sorted(places), n)]


def _shapley(places: Places, worth: Mapping[Places, Energy]) -> dict[str, Energy]:
    """Place -> (signals,) what it closes of each signal's squared gap, the mean over all orders."""
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


def _location(
    case: InjectionCase,
    corrected: InjectionCase | None,
    sets: Mapping[Places, PlaceSet],
    closed: Mapping[CurveKey, float],
    closed_corrected: Mapping[CurveKey, float],
    sensor: SensorError | None,
) -> Location:
    """Shares, regimes and sentences from what every set of places leaves."""
    gap, base = case.gap, sets[Places()].energy
    parts, best = _parts(sets)
    sizes = {place: max(float(part.sum()), 0.0) for place, part in parts.items()}
    system = case.plant.structure.system
    silent = [place for place in PLACES if not set(case.silent).isdisjoint(system.places.get(place, ()))]
    rest = max(gap.whole - sum(sizes.values()), 0.0)
    for place in silent:
        sizes[place] += rest / len(silent)
    whole = sum(sizes.values())
    shares = {place: size / whole if whole > 0.0 else 1.0 / len(PLACES) for place, size in sizes.items()}
    final, final_closed = case, closed
    if corrected is not None and "sensor" in best:
        final, final_closed = corrected, closed_corrected
    known = final.unknown.values
    return Location(
        shares=tuple(sorted(shares.items(), key=lambda row: -row[1])),
        time=case.log.time,
        unknown={
            name: np.append(final.smoothed(name), np.nan) if name in known else np.full(len(case.log), np.nan)
            for name in unknown_inputs_of(system)
        },
        regimes=_regimes(final, sets[best].forms if best else {}, final_closed),
        by_signal={
            name: {"gap": float(np.sqrt(base[i]))}
            | {place: float(part[i] / base[i]) for place, part in parts.items() if base[i] > 0.0 and part.any()}
            for i, name in enumerate(gap.names)
        },
        explained=max(1.0 - gap.share(sets[best].energy), 0.0) if best else 0.0,
        over_time=_over_time(case, final, sets[Places()], sets[best]),
        sensor=str(sensor) if sensor is not None else None,
        load_cell=_load_cell_share(final),
        untold=_untold(case),
        silent=tuple(silent),
    )


def _parts(sets: Mapping[Places, PlaceSet]) -> tuple[dict[str, Energy], Places]:
    """Place -> (signals,) what it closes of each signal's squared gap, and the set of the least cost."""
    left = {places: one.energy for places, one in sets.items()}
    parts: dict[str, Energy] = {place: 0.0 * left[Places()] for place in PLACES}
    costs = {p: one.cost for p, one in sets.items() if p and all(part in sets for part in _subsets(p))}
    if not costs:
        return parts, Places()
    lowest = min(costs.values())
    weights = {p: float(np.exp(-(c - lowest) / CLOSE)) for p, c in costs.items() if c - lowest < 6.0 * CLOSE}
    for places, weight in weights.items():
        for place, part in _shapley(places, left).items():
            parts[place] = parts[place] + weight / sum(weights.values()) * part
    return parts, min(costs, key=lambda p: costs[p])


def _regimes(case: InjectionCase, forms: Mapping[str, Form], closed: Mapping[CurveKey, float]) -> tuple[Regime, ...]:
    """Two curves for each balance of the places used: the injected one and the next, the better explained first.

    Those of the force on a rod with prescribed motion come last: it causes no gap of a signal, and shows where the
    nominal areas and friction of the rod are off.
    """
    found = []
    for place, form in forms.items():
        for balance in case.plant.structure.system.places[place]:
            first = [c for c in form.curves if c.unknown_input == balance]
            keys = {c.key for c in first}
            rest = [c for c in case.curves[balance] if c.key not in keys and c.explained > 0.1]
            if balance == "torque":
                rest = [c for c in rest if (c.family in DRIVE) == (place == "drive")]
            shown = sorted([*first, *rest][:2], key=lambda c: (-round(c.explained, 2), c.numbers))
            values = case.smoothed(balance)
            found += [regime_of(c, values, closed.get(c.key, float("nan"))) for c in shown]
    if case.plant.structure.system.prescribed and "force" in case.unknown.values:
        values = case.smoothed("force")
        found += [regime_of(c, values) for c in case.curves["force"][:2] if c.explained > 0.1]
    return tuple(found)


def _load_cell_share(case: InjectionCase) -> float | None:
    """Part of the unknown force's square that is the load's, by the load cell; None without one."""
    if case.unknown.load is None or "force" not in case.unknown.values:
        return None
    force = case.smoothed("force")
    known = np.isfinite(force)
    if not known.any():
        return None
    rest = (force - smooth(case.unknown.load, BUMP))[known]
    return float(np.clip(1.0 - np.sum(rest**2) / max(float(np.sum(force[known] ** 2)), 1e-300), 0.0, 1.0))


def _over_time(
    case: InjectionCase, final: InjectionCase, nominal: PlaceSet, best: PlaceSet
) -> tuple[tuple[float, float, float], ...]:
    before, after = case.gap.errors(nominal.run), final.gap.errors(best.run)
    floor = case.gap.floor[:, None]
    size = max(int(round(INTERVAL / case.log.sample_time)), 1)
    whole = case.gap.whole * len(case.log)
    rows = []
    for k in range(0, len(case.log), size):
        squares = [float(np.sum(np.nan_to_num(e[:, k : k + size]) ** 2 - floor)) / whole for e in (before, after)]
        rows.append((float(case.log.time[k]), max(squares[0], 0.0), max(squares[1], 0.0)))
    return tuple(rows)


def _untold(case: InjectionCase) -> tuple[str, ...]:
    """What the log does not show, and which channels it lacks for that."""
    names = {"torque": "the torque balance", "flow_1": "the flow balances", "force": "the force balance"}
    missing = [c for c in case.plant.structure.system.outputs if c not in case.log.channels]
    silent = [words for name, words in names.items() if name in case.silent]
    if not silent:
        return ()
    return (f"without {', '.join(missing) or 'more channels'} {join_words(silent)} can't be told",)
