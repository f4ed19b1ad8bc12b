"""Where the gap of a believed plant to a log lies, without a catalogue of effects.

Each balance is asked what it lacks (`unknown_input`), along what that goes (`regime`), and how much of the gap
vanishes when it is put into a simulation. Places share a gap by the Shapley value: the mean of what a place takes away
over all orders in which places could be put in (L. S. Shapley, "A value for n-person games", Annals of Mathematics
Studies 28, 1953). The game is played among the fewest places that explain the gap; close calls share it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import factorial

import numpy as np

from ..core.log import Log
from ..core.text import join_words
from ..identification.drives import acting_drive, logged_drives, undo_sensor
from ..identification.start import find_start
from ..plant.plant import Plant
from .bases import DRIVE
from .injections import BUMP, Form, Injections, Trial
from .regime import Regime, regime_of
from .sensor_error import SensorError, impossible, suspected_sensor
from .squared_gap import Energy, SquaredGap
from .unknown_input import INPUTS, smooth

PLACES = ("torque", "drive", "flow", "force", "sensor")
#: The price of a sensor: it has two or three numbers, and errors of the plant often look a little like its scale.
SENSOR_PRICE = 0.06
#: Sensors are not asked together with other places where a set leaves less than this part of the squared gap.
ENOUGH = 0.1
#: Sets of places whose worth differs by less than this share the gap.
CLOSE = 0.03
#: Length of a stretch of `over_time` [s].
STRETCH = 1.0


@dataclass(frozen=True)
class Location:
    """Where a gap lies.

    shares: (place, share) with sum one, the largest first. time: (N,) s. unknown: balance -> (N,) unknown input in SI
    units, smoothed over 48 ms at 250 Hz, NaN where it can't be told; a positive torque or flow helps, a positive force
    resists extension. regimes: what the unknown inputs of places with a share follow. by_signal: signal -> gap of the
    believed plant and the part of its square that each place takes away. explained: part of the squared gap that the
    places with a share take away together. over_time: start of each second -> squared gap of the believed plant, as
    part of the whole, and what of it is left with these places. sensor: which, in words. load_cell: part of the unknown
    force's square that the load cell shows, so that it is the load's and not the rod's; None without one. untold: what
    the log can't tell. silent: places whose balances it can't tell, which share what the others leave.
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


def locate(plant: Plant, log: Log, noise: Mapping[str, float]) -> Location:
    """Say where the gap of a believed plant to a log lies.

    Parameters
    ----------
    plant: as it is believed, of either model; its sensors are undone before anything is compared.
    log: channels in SI units; places whose balances it can't tell get what the others leave unexplained.
    noise: channel -> standard deviation, from `signals.noise_of`.
    """
    dt = log.sample_time
    start = find_start(plant, log).state
    asked, outside = logged_drives(plant, log)
    plant, current = acting_drive(plant, asked, dt)
    measured = {c: undo_sensor(plant, log, c) for c in plant.structure.system.outputs if c in log.channels}
    gap = SquaredGap(measured, noise, dt)
    case = Injections(plant, log, current, start, noise, gap, outside)
    nominal = case.run([{}])[0]
    base = gap.energy(nominal)
    gap.whole = max(float(base.sum()), 1e-300)
    worth = {frozenset[str](): Trial(base, 1.0, {}, nominal), **case.sets()}
    best = min(worth.values(), key=lambda trial: trial.cost)
    sensor = suspected_sensor(gap, [worth[frozenset()], best])
    odd = impossible(gap, nominal, base)
    right = None
    if sensor is not None:
        channel = sensor.channel
        fixed = replace(log, channels={**log.channels, channel: sensor.undone(log[channel], dt)})
        corrected = {**measured, channel: undo_sensor(plant, fixed, channel)}
        other = gap.other(corrected)
        left = other.energy(nominal)
        alone = Trial(left, float(left.sum()) / gap.whole + SENSOR_PRICE, {}, nominal)
        # Where balances are silent a sensor has few rivals: it has to explain most of the gap by itself.
        if not case.silent or float(left.sum()) < 0.3 * gap.whole:
            worth[frozenset({"sensor"})] = alone
        enough = min(float(left.sum()), float(best.energy.sum()), float(odd[1].energy.sum()) if odd else np.inf)
        if enough > ENOUGH * gap.whole and frozenset({"sensor"}) in worth:
            right = Injections(plant, fixed, current, start, noise, other, outside)
            for places, trial in right.sets().items():
                worth[places | {"sensor"}] = replace(trial, cost=trial.cost + SENSOR_PRICE)
    if odd is not None and odd[1].cost < worth.get(frozenset({"sensor"}), worth[frozenset()]).cost:
        worth = {places: trial for places, trial in worth.items() if "sensor" not in places}
        sensor, right = odd[0], None
        worth[frozenset({"sensor"})] = odd[1]
    return _judged(plant, log, case, right, worth, sensor)


def _subsets(places: frozenset[str]) -> list[frozenset[str]]:
    return [frozenset(part) for n in range(len(places)) for part in combinations(sorted(places), n)]


def _shapley(places: frozenset[str], worth: Mapping[frozenset[str], Energy]) -> dict[str, Energy]:
    """place -> (signals,) what it takes away of each signal's squared gap, the mean over all orders."""
    n = len(places)
    out = {}
    for place in places:
        rest = sorted(places - {place})
        total = 0.0 * worth[frozenset()]
        for size in range(n):
            weight = factorial(size) * factorial(n - size - 1) / factorial(n)
            for others in combinations(rest, size):
                total = total + weight * (worth[frozenset(others)] - worth[frozenset({*others, place})])
        out[place] = total
    return out


def _judged(
    plant: Plant,
    log: Log,
    case: Injections,
    right: Injections | None,
    worth: Mapping[frozenset[str], Trial],
    sensor: SensorError | None,
) -> Location:
    """Shares, regimes and words from what every set of places leaves."""
    gap = case.gap
    left = {places: trial.energy for places, trial in worth.items()}
    costs = {p: trial.cost for p, trial in worth.items() if p and all(part in worth for part in _subsets(p))}
    lowest = min(costs.values(), default=0.0)
    parts: dict[str, Energy] = {place: 0.0 * left[frozenset()] for place in PLACES}
    weights = {p: float(np.exp(-(c - lowest) / CLOSE)) for p, c in costs.items() if c - lowest < 6.0 * CLOSE}
    for places, weight in weights.items():
        for place, part in _shapley(places, left).items():
            parts[place] = parts[place] + weight / sum(weights.values()) * part
    untold = _untold(plant, log, case)
    sizes = {place: max(float(part.sum()), 0.0) for place, part in parts.items()}
    balances = {"torque": "torque", "drive": "torque", "flow": "flow_1", "force": "force"}
    silent = [place for place, balance in balances.items() if balance in case.silent]
    rest = max(gap.whole - sum(sizes.values()), 0.0)
    for place in silent:
        sizes[place] += rest / len(silent)
    whole = sum(sizes.values())
    shares = sorted(
        ((place, size / whole if whole > 0.0 else 1.0 / len(PLACES)) for place, size in sizes.items()),
        key=lambda row: -row[1],
    )
    best = min(costs, key=lambda p: costs[p]) if costs else frozenset()
    where = right if right is not None and "sensor" in best else case
    options = worth[best].options if best else {}
    return Location(
        shares=tuple(shares),
        time=log.time,
        unknown={
            name: np.append(smooth(where.unknown.values[name], BUMP), np.nan)
            if name in where.unknown.values
            else np.full(len(log), np.nan)
            for name in INPUTS
        },
        regimes=_regimes(where, options),
        by_signal={
            name: {"gap": float(np.sqrt(left[frozenset()][i]))}
            | {p: float(part[i] / left[frozenset()][i]) for p, part in parts.items() if part.any()}
            if left[frozenset()][i] > 0.0
            else {"gap": 0.0}
            for i, name in enumerate(gap.names)
        },
        explained=max(1.0 - float(left[best].sum()) / gap.whole, 0.0) if best else 0.0,
        over_time=_over_time(case, where, worth[frozenset()], worth[best]),
        sensor=str(sensor) if sensor is not None else None,
        load_cell=_seen_by_the_cell(where),
        untold=untold,
        silent=tuple(silent),
    )


def _regimes(case: Injections, options: Mapping[str, Form]) -> tuple[Regime, ...]:
    """Two curves for each balance of the places that were used: the one put in and the next, the better told first.

    Those of the force on a rod that is moved from outside come last.
    """
    found = []
    for place, option in options.items():
        balances = ("flow_1", "flow_2") if place == "flow" else ("force",) if place == "force" else ("torque",)
        for balance in balances:
            first = [c for c in option.curves if c.balance == balance]
            rest = [c for c in case.curves[balance] if c not in first and c.explained > 0.1]
            if balance == "torque":
                rest = [c for c in rest if (c.family in DRIVE) == (place == "drive")]
            values = smooth(case.unknown.values[balance], BUMP)
            shown = sorted([*first, *rest][:2], key=lambda c: (-round(c.explained, 2), c.numbers))
            found += [regime_of(c, values, case.closed.get(id(c), float("nan"))) for c in shown]
    if case.moved and "force" in case.unknown.values:
        # It lies behind no gap of a signal, and says where the believed areas and friction of the rod are off.
        values = smooth(case.unknown.values["force"], BUMP)
        found += [regime_of(c, values) for c in case.curves["force"][:2] if c.explained > 0.1]
    return tuple(found)


def _seen_by_the_cell(case: Injections) -> float | None:
    """Part of the unknown force's square that is the load's, by the load cell."""
    if case.unknown.load is None or "force" not in case.unknown.values:
        return None
    force = smooth(case.unknown.values["force"], BUMP)
    told = np.isfinite(force)
    if not told.any():
        return None
    rest = (force - smooth(case.unknown.load, BUMP))[told]
    return float(np.clip(1.0 - np.sum(rest**2) / max(float(np.sum(force[told] ** 2)), 1e-300), 0.0, 1.0))


def _over_time(
    case: Injections, where: Injections, nominal: Trial, best: Trial
) -> tuple[tuple[float, float, float], ...]:
    before, after = case.gap.errors(nominal.run), where.gap.errors(best.run)
    floor = np.array([case.gap.noise[n] ** 2 / case.gap.power[n] for n in case.gap.names])[:, None]
    size = max(int(round(STRETCH / case.log.sample_time)), 1)
    edges = np.arange(0, len(case.log), size)
    whole = case.gap.whole * len(case.log)
    rows = []
    for k in edges:
        piece = slice(k, k + size)
        squares = [float(np.sum(np.nan_to_num(e[:, piece]) ** 2 - floor)) / whole for e in (before, after)]
        rows.append((float(case.log.time[k]), max(squares[0], 0.0), max(squares[1], 0.0)))
    return tuple(rows)


def _untold(plant: Plant, log: Log, case: Injections) -> tuple[str, ...]:
    names = {"torque": "the torque balance", "flow_1": "the flow balances", "force": "the force balance"}
    missing = [c for c in plant.structure.system.outputs if c not in log.channels]
    quiet = [words for name, words in names.items() if name in case.silent]
    if not quiet:
        return ()
    return (f"without {', '.join(missing) or 'more channels'} {join_words(quiet)} can't be told",)
