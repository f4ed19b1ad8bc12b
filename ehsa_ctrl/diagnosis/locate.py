"""Where the gap of a believed plant to a log lies, without a catalogue of effects.

Each balance is asked what it lacks (`unknown_input`), along what that goes (`regime`), and how much of the gap
vanishes when it is put into a simulation. Places share a gap by the Shapley value: the mean of what a place takes away
over all orders in which places could be put in (L. S. Shapley, "A value for n-person games", Annals of Mathematics
Studies 28, 1953). The game is played among the fewest places that explain the gap; close calls share it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import factorial

import numpy as np

from ..core.log import Log
from ..identification.drives import acting_drive, logged_drives, undo_sensor
from ..identification.start import find_start
from ..plant.plant import Plant
from ..simulation.sensors import first_order
from .regime import DRIVE, MEMORYLESS, Curve, Regime, curves_of, regime_of
from .signals import SIGNALS, scored, signal_noise
from .unknown_input import INPUTS, filled, run_with, signals_of, smooth, unknown_inputs

PLACES = ("torque", "drive", "flow", "force", "sensor")
#: Part of the gap that a further place has to explain, an unknown input of any form and one of few numbers.
FREE_PRICE, CURVE_PRICE, NUMBER_PRICE = 0.08, 0.025, 0.0005
#: The same for a sensor: it has two or three numbers, and errors of the plant often look a little like its scale.
SENSOR_PRICE = 0.06
#: A curve along the current counts as the drive's if what it leaves of an unknown torque is less than this part of
#: what the best of the others leaves.
CLEARLY = 0.75
#: Families of a flow error that may be one of the pump's displacement.
PUMPED = ("line", "speed", "pumped")
#: Sensors are not asked together with other places where a set leaves less than this part of the squared gap.
ENOUGH = 0.1
#: Sets of places whose worth differs by less than this share the gap.
CLOSE = 0.03
#: Samples of the bump that smooths an unknown input, and length of a stretch of `over_time` [s].
BUMP, STRETCH = 12, 1.0
#: A curve stands for an unknown input beside others if it explains this part of it.
TOLD = 0.85
#: A sensor is asked further where it alone explains this part of the gap.
SENSOR_ASKED = 0.2
#: Delays and lags of a sensor that are tried [s].
LATE = (0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.010, 0.013, 0.016, 0.020, 0.025, 0.030, 0.040, 0.060)

Energy = np.ndarray


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
    the log can't tell.
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

    @property
    def place(self) -> str:
        """The place with the largest share."""
        return self.shares[0][0]

    def __str__(self) -> str:
        lines = ["the gap lies in " + ", ".join(f"{place} {100 * s:.0f} %" for place, s in self.shares if s >= 0.005)]
        if self.sensor is not None and dict(self.shares)["sensor"] >= 0.05:
            lines.append(f"  sensor: {self.sensor}")
        for regime in self.regimes:
            closes = f", closes {100 * regime.gap_closed:.0f} % of the squared gap" if regime.gap_closed > 0.0 else ""
            lines.append(f"  {regime} ({100 * regime.explained:.0f} % of it{closes})")
        if self.load_cell is not None and dict(self.shares)["force"] >= 0.05:
            lines.append(f"  the load cell shows {100 * self.load_cell:.0f} % of the unknown force")
        lines += [f"  {sentence}" for sentence in self.untold]
        return "\n".join(lines)


@dataclass(frozen=True)
class _Option:
    """One form of a place's unknown input: balance -> (N - 1,), what its freedom costs, the curve that it is."""

    inputs: Mapping[str, np.ndarray]
    price: float
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class _Trial:
    """A set of places put in: (signals,) squared gap left, that as part of the whole plus its price, forms, the run."""

    energy: Energy
    cost: float
    options: dict[str, _Option]
    run: dict[str, np.ndarray]


@dataclass(frozen=True)
class _Sensor:
    """A channel as its sensor may have changed it, and what of the squared gap is then left in its signal."""

    channel: str
    bias: float
    scale: float
    delay: float
    lag: float

    def undone(self, values: np.ndarray, dt: float) -> np.ndarray:
        index = np.arange(values.size)
        return np.interp(index + (self.delay + self.lag) / dt, index, (values - self.bias) / self.scale)

    def __str__(self) -> str:
        parts = [f"scale {self.scale:.4g}"] if abs(self.scale - 1.0) > 0.005 else []
        parts += [f"{word} {1e3 * t:.2g} ms" for word, t in (("delay", self.delay), ("lag", self.lag)) if t]
        if self.bias:
            parts.append(f"bias {self.bias:.4g}")
        return f"{self.channel} with {', '.join(parts)}" if parts else f"{self.channel} alone is off"


class _Gap:
    """Squared gap by signal of what was measured to simulations, noise taken off, as part of the believed plant's."""

    def __init__(self, measured: Mapping[str, np.ndarray], noise: Mapping[str, float], dt: float) -> None:
        self.dt, self.noise = dt, signal_noise(noise, dt)
        self.signals = scored(measured, dt)
        self.names = tuple(name for name in SIGNALS if name in self.signals)
        self.power = {name: max(float(np.var(self.signals[name])), 1e-300) for name in self.names}
        self.whole = 1.0

    def other(self, measured: Mapping[str, np.ndarray]) -> _Gap:
        """The same yardstick for a log whose sensors were put right."""
        twin = object.__new__(_Gap)
        twin.__dict__.update(self.__dict__)
        twin.signals = scored(measured, self.dt)
        return twin

    def errors(self, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
        """(signals, N) measured less simulated over the signal's spread."""
        shown = scored(simulated, self.dt)
        return np.array([(self.signals[n] - shown[n]) / np.sqrt(self.power[n]) for n in self.names])

    def energy(self, simulated: Mapping[str, np.ndarray]) -> Energy:
        """(signals,) squared gap; large for a run that stopped."""
        floor = np.array([self.noise[n] ** 2 / self.power[n] for n in self.names])
        errors = self.errors(simulated)
        if not np.isfinite(errors).all():
            return np.full(len(self.names), 1e3 * self.whole)
        return np.maximum(np.mean(errors**2, axis=1) - floor, 0.0)


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
    plant, current = acting_drive(plant, logged_drives(plant, log)[0], dt)
    measured = {c: undo_sensor(plant, log, c) for c in plant.structure.system.outputs if c in log.channels}
    gap = _Gap(measured, noise, dt)
    case = _Case(plant, log, current, start, noise, gap)
    believed = case.run([{}])[0]
    base = gap.energy(believed)
    gap.whole = max(float(base.sum()), 1e-300)
    worth = {frozenset[str](): _Trial(base, 1.0, {}, believed), **case.sets()}
    best = min(worth.values(), key=lambda trial: trial.cost)
    sensor = _suspected_sensor(gap, [worth[frozenset()], best])
    odd = _impossible(gap, believed, base)
    right = None
    if sensor is not None:
        channel = sensor.channel
        fixed = replace(log, channels={**log.channels, channel: sensor.undone(log[channel], dt)})
        corrected = {**measured, channel: undo_sensor(plant, fixed, channel)}
        other = gap.other(corrected)
        left = other.energy(believed)
        alone = _Trial(left, float(left.sum()) / gap.whole + SENSOR_PRICE, {}, believed)
        # Where balances are silent a sensor has few rivals: it has to explain most of the gap by itself.
        if len(case.unknown.values) == len(INPUTS) or float(left.sum()) < 0.3 * gap.whole:
            worth[frozenset({"sensor"})] = alone
        enough = min(float(left.sum()), float(best.energy.sum()), float(odd[1].energy.sum()) if odd else np.inf)
        if enough > ENOUGH * gap.whole and frozenset({"sensor"}) in worth:
            right = _Case(plant, fixed, current, start, noise, other)
            for places, trial in right.sets().items():
                worth[places | {"sensor"}] = replace(trial, cost=trial.cost + SENSOR_PRICE)
    if odd is not None and odd[1].cost < worth.get(frozenset({"sensor"}), worth[frozenset()]).cost:
        worth = {places: trial for places, trial in worth.items() if "sensor" not in places}
        sensor, right = odd[0], None
        worth[frozenset({"sensor"})] = odd[1]
    return _judged(plant, log, case, right, worth, sensor)


def _merged(options: Mapping[str, _Option]) -> dict[str, np.ndarray]:
    return {name: values for option in options.values() for name, values in option.inputs.items()}


class _Case:
    """A plant, a log and the unknown inputs between them, with the forms in which these may be put in."""

    def __init__(
        self, plant: Plant, log: Log, current: np.ndarray, start: np.ndarray, noise: Mapping[str, float], gap: _Gap
    ) -> None:
        self.plant, self.log, self.current, self.start, self.gap = plant, log, current, start, gap
        self.signals = signals_of(plant, log, current, noise, start)
        self.unknown = unknown_inputs(plant, self.signals)
        self.curves = {name: curves_of(plant, self.signals, name, w) for name, w in self.unknown.values.items()}
        self.closed: dict[int, float] = {}

    def run(self, injections: Sequence[Mapping[str, np.ndarray]]) -> list[dict[str, np.ndarray]]:
        return run_with(self.plant, self.current, self.start, self.log.sample_time, injections, self.unknown.softness)

    def sets(self) -> dict[frozenset[str], _Trial]:
        """What every set of torque or drive, flow and force leaves of the gap, with the best forms found."""
        forms = {
            "torque": self._forms("torque", [c for c in self.curves.get("torque", ()) if c.family not in DRIVE], True),
            "drive": self._forms("torque", self._of_drive(), False),
            "force": self._forms("force", self.curves.get("force", ()), True),
        }
        best = {place: self._best(options) for place, options in forms.items() if options}
        chosen = {place: option for place, option in best.items() if option is not None}
        shafts = [place for place in ("torque", "drive") if place in chosen]
        # What does best alone may do the work of another place; beside others the balance itself has to choose.
        beside = {place: _told_best(forms[place]) for place in chosen}
        dry = [frozenset(places) for places in [*((s,) for s in shafts), *((s, "force") for s in shafts), ("force",)]]
        dry = [places for places in dry if places <= set(chosen)]
        found = self._tried([{place: by[place] for place in places} for places in dry for by in (chosen, beside)])
        # A shaft's error goes with flows in the form that does better without them.
        shafts.sort(key=lambda place: min(t.cost for places, t in found.items() if place in places))
        heads = [frozenset(), *(p for p in found if not p & set(shafts[1:]))]
        if len(shafts) > 1:
            worse = [p for p in found if shafts[1] in p and found[p].cost < 0.15]
            heads += [p for p in worse if p not in heads]
        flows = self._flows()
        rows = []
        for head in heads:
            known = [{place: beside[place] for place in head}]
            if head == {"force"} and beside["force"] is not chosen["force"]:
                known.append({"force": chosen["force"]})
            usable = [flow for flow in flows if "torque" not in flow.inputs or not head & {"torque", "drive"}]
            rows += [{**options, "flow": flow} for options in known for flow in usable]
        return found | self._tried(rows)

    def _tried(self, rows: Sequence[dict[str, _Option]]) -> dict[frozenset[str], _Trial]:
        found: dict[frozenset[str], _Trial] = {}
        for row, run in zip(rows, self.run([_merged(row) for row in rows]), strict=True):
            energy, price = self.gap.energy(run), sum(option.price for option in row.values())
            trial = _Trial(energy, float(energy.sum()) / self.gap.whole + price, row, run)
            places = frozenset(row)
            for curve in next(iter(row.values())).curves if len(row) == 1 else ():
                self.closed[id(curve)] = 1.0 - float(energy.sum()) / self.gap.whole
            if places not in found or trial.cost < found[places].cost:
                found[places] = trial
        return found

    def _of_drive(self) -> list[Curve]:
        """Curves of an error of the current; those that a torque of the shaft would follow too must explain more."""
        curves = self.curves.get("torque", [])
        bar = max((c.explained for c in curves if c.family not in DRIVE), default=0.0)
        return [
            c
            for c in curves
            if c.family in DRIVE and (c.family not in MEMORYLESS or 1.0 - c.explained < CLEARLY * (1.0 - bar))
        ]

    def _forms(self, balance: str, curves: Sequence[Curve], free: bool, count: int = 5) -> list[_Option]:
        """The unknown input as it is, smoothed, and as the curves that explain most of it."""
        values = self.unknown.values.get(balance)
        if values is None:
            return []
        found = [_Option({balance: curve.values}, _price(curve), (curve,)) for curve in curves[:count]]
        if free:
            found += [_Option({balance: filled(w)}, FREE_PRICE) for w in (values, smooth(values, BUMP))]
        return found

    def _flows(self) -> list[_Option]:
        flows = {name: w for name, w in self.unknown.values.items() if name in ("flow_1", "flow_2")}
        if len(flows) < 2:
            return []
        found = [
            _Option({n: filled(w) for n, w in flows.items()}, FREE_PRICE),
            _Option({n: filled(smooth(w, BUMP)) for n, w in flows.items()}, FREE_PRICE),
        ]
        second = {(c.family, c.against.replace("chamber 2", "chamber 1")): c for c in self.curves["flow_2"]}
        pairs = []
        for curve in self.curves["flow_1"]:
            partner = second.get((curve.family, curve.against))
            if partner is not None:
                pairs.append((curve.explained + partner.explained, curve, partner))
        pairs.sort(key=lambda row: -row[0])
        for _, one, two in pairs[:3]:
            found.append(_Option({"flow_1": one.values, "flow_2": two.values}, _price(one), (one, two)))
        pumped = [(one, two) for _, one, two in pairs if one.family in PUMPED and "shaft" in one.against]
        for one, two in pumped[:2]:
            # What a pump does not deliver it does not load the shaft with: one error of its displacement.
            omega, dP = self.signals["omega"][:-1], (self.signals["P_1"] - self.signals["P_2"])[:-1]
            flow = 0.5 * (one.values - two.values)
            lost = np.where(np.abs(omega) > 1.0, flow / np.where(np.abs(omega) > 1.0, omega, 1.0), 0.0)
            inputs = {"flow_1": flow, "flow_2": -flow, "torque": -lost * dP}
            found.append(_Option(inputs, _price(one), (one, two)))
        return found

    def _best(self, options: Sequence[_Option]) -> _Option | None:
        costs = []
        for option, run in zip(options, self.run([option.inputs for option in options]), strict=True):
            energy = self.gap.energy(run)
            for curve in option.curves:
                self.closed[id(curve)] = 1.0 - float(energy.sum()) / self.gap.whole
            costs.append(float(energy.sum()) / self.gap.whole + option.price)
        return options[int(np.argmin(costs))] if costs else None


def _told_best(options: Sequence[_Option]) -> _Option:
    """The curve that explains most of an unknown input, or the input itself, smoothed, where no curve comes near."""
    curves = [option for option in options if option.curves]
    if curves and (len(curves) == len(options) or curves[0].curves[0].explained > TOLD):
        return curves[0]
    return options[-1]


def _price(curve: Curve) -> float:
    return CURVE_PRICE + NUMBER_PRICE * curve.numbers


def _suspected_sensor(gap: _Gap, trials: Sequence[_Trial]) -> _Sensor | None:
    """The one channel whose bias, scale, delay or lag explains most of what runs leave; None if none does enough."""
    best: tuple[float, _Sensor | None] = (SENSOR_ASKED, None)
    for trial in trials:
        for i, name in enumerate(gap.names):
            if trial.energy[i] < best[0] * gap.whole:
                continue
            channel = "position" if name == "rod_velocity" else name
            left, sensor = _fit_sensor(channel, gap.signals[name], scored(trial.run, gap.dt)[name], gap.dt)
            floor = gap.noise[name] ** 2 / gap.power[name]
            gain = (float(trial.energy[i]) - max(left / gap.power[name] - floor, 0.0)) / gap.whole
            if gain > best[0]:
                best = (gain, sensor)
    return best[1]


def _impossible(gap: _Gap, believed: Mapping[str, np.ndarray], base: Energy) -> tuple[_Sensor, _Trial] | None:
    """A sensor that errs as the plant can't: one signal alone is off, or both pressures jump together.

    The plant couples its signals, so that a free run that meets all but one shows what that one's sensor did. Both
    pressures rise together only as fast as oil flows in; what comes and goes from sample to sample is not oil.
    """
    errors = gap.errors(believed)
    tries: list[tuple[tuple[str, ...], float]] = [((name,), FREE_PRICE) for name in gap.names]
    if {"p1", "p2"} <= set(gap.names):
        one, two = (errors[gap.names.index(n)] * np.sqrt(gap.power[n]) for n in ("p1", "p2"))
        common = one + two
        jumps = float(np.mean(np.diff(common) ** 2)) / max(float(np.mean(common**2)), 1e-300)
        if jumps > 0.5 and np.var(common) > 4.0 * np.var(one - two):
            tries.append((("p1", "p2"), FREE_PRICE))
    found = None
    for names, price in tries:
        left = np.where([n in names for n in gap.names], 0.0, base)
        trial = _Trial(left, float(left.sum()) / gap.whole + price, {}, dict(believed))
        if found is None or trial.cost < found[1].cost:
            channels = ["position" if n == "rod_velocity" else n for n in names]
            found = (_Sensor(" and ".join(channels), 0.0, 1.0, 0.0, 0.0), trial)
    return found if found is not None and found[1].cost < 1.5 * ENOUGH else None


def _fit_sensor(channel: str, shown: np.ndarray, true: np.ndarray, dt: float) -> tuple[float, _Sensor]:
    """Mean square that is left, and the sensor that leaves it."""
    best: tuple[float, _Sensor | None] = (np.inf, None)
    index = np.arange(true.size)
    for delay, lag in ((0.0, 0.0), *((t, 0.0) for t in LATE), *((0.0, t) for t in LATE)):
        seen = true
        if delay:
            seen = np.interp(index - delay / dt, index, true)
        if lag:
            seen = first_order(true, lag, dt)
        columns = np.column_stack([seen, np.ones_like(seen)]) if channel != "position" else seen[:, None]
        a = np.linalg.solve(columns.T @ columns, columns.T @ shown)
        left = float(np.mean((shown - columns @ a) ** 2))
        # A delay has to be worth its number.
        if left < (1.0 - (0.02 if delay or lag else 0.0)) * best[0] and a[0] > 0.05:
            bias = float(a[1]) if a.size > 1 else 0.0
            best = (left, _Sensor(channel, bias, float(a[0]), delay, lag))
    left, sensor = best
    return left, sensor if sensor is not None else _Sensor(channel, 0.0, 1.0, 0.0, 0.0)


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
    case: _Case,
    right: _Case | None,
    worth: Mapping[frozenset[str], _Trial],
    sensor: _Sensor | None,
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
    silent = [place for place, balance in balances.items() if balance not in case.unknown.values]
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
            | {p: float(part[i] / max(left[frozenset()][i], 1e-300)) for p, part in parts.items() if part.any()}
            for i, name in enumerate(gap.names)
        },
        explained=max(1.0 - float(left[best].sum()) / gap.whole, 0.0) if best else 0.0,
        over_time=_over_time(case, where, worth[frozenset()], worth[best]),
        sensor=str(sensor) if sensor is not None else None,
        load_cell=_seen_by_the_cell(where),
        untold=untold,
    )


def _regimes(case: _Case, options: Mapping[str, _Option]) -> tuple[Regime, ...]:
    """Two curves for each balance of the places that were used: the one put in and the next, the better told first."""
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
    return tuple(found)


def _seen_by_the_cell(case: _Case) -> float | None:
    """Part of the unknown force's square that is the load's, by the load cell."""
    if case.unknown.load is None or "force" not in case.unknown.values:
        return None
    force = smooth(case.unknown.values["force"], BUMP)
    told = np.isfinite(force)
    if not told.any():
        return None
    rest = (force - smooth(case.unknown.load, BUMP))[told]
    return float(np.clip(1.0 - np.sum(rest**2) / max(float(np.sum(force[told] ** 2)), 1e-300), 0.0, 1.0))


def _over_time(case: _Case, where: _Case, believed: _Trial, best: _Trial) -> tuple[tuple[float, float, float], ...]:
    before, after = case.gap.errors(believed.run), where.gap.errors(best.run)
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


def _untold(plant: Plant, log: Log, case: _Case) -> tuple[str, ...]:
    names = {"torque": "the torque balance", "flow_1": "the flow balances", "force": "the force balance"}
    missing = [c for c in plant.structure.system.outputs if c not in log.channels]
    quiet = [words for name, words in names.items() if name not in case.unknown.values]
    if not quiet:
        return ()
    listed = " and ".join([", ".join(quiet[:-1]), quiet[-1]] if len(quiet) > 1 else quiet)
    return (f"without {', '.join(missing) or 'more channels'} {listed} can't be told",)
