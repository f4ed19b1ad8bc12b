"""The error of a single sensor: fitted to what simulations leave, or recognised by what no plant can do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..plant.system import ScoredSignal
from ..simulation.sensors import first_order
from .injection import SquaredGap
from .place_sets import FREE_PRICE, PlaceSet
from .signals import scored

#: A sensor is a candidate if it alone explains this part of the gap.
LEAST_EXPLAINED = 0.2
#: A sensor with an error that no plant can make leaves less than this part of the squared gap.
ALONE = 0.15
#: Delays and lags of a sensor that are tried [s].
LATE = (0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.010, 0.013, 0.016, 0.020, 0.025, 0.030, 0.040, 0.060)


@dataclass(frozen=True)
class SensorError:
    """A channel and the error of its sensor: reading = scale * signal + bias, late by delay and lag [s]."""

    channel: str
    bias: float
    scale: float
    delay: float
    lag: float

    def corrected(self, values: np.ndarray, dt: float) -> np.ndarray:
        """The signal (N,) behind readings."""
        index = np.arange(values.size)
        return np.interp(index + (self.delay + self.lag) / dt, index, (values - self.bias) / self.scale)

    def __str__(self) -> str:
        parts = [f"scale {self.scale:.4g}"] if abs(self.scale - 1.0) > 0.005 else []
        parts += [f"{word} {1e3 * t:.2g} ms" for word, t in (("delay", self.delay), ("lag", self.lag)) if t]
        if self.bias:
            parts.append(f"bias {self.bias:.4g}")
        return f"{self.channel} with {', '.join(parts)}" if parts else f"{self.channel} alone is off"


def fitted_sensor_error(gap: SquaredGap, sets: Sequence[PlaceSet]) -> SensorError | None:
    """The one channel whose bias, scale, delay or lag explains most of what runs leave; None if none does enough."""
    found: SensorError | None = None
    most = LEAST_EXPLAINED
    for one in sets:
        shown = scored(gap.system.scored, one.run, gap.sample_time)
        for i, name in enumerate(gap.names):
            if one.energy[i] < most * gap.whole:
                continue
            left, sensor = _fit_sensor(_signal(gap, name), gap.signals[name], shown[name], gap.sample_time)
            gain = (float(one.energy[i]) - max(left / gap.power[name] - gap.floor[i], 0.0)) / gap.whole
            if gain > most:
                most, found = gain, sensor
    return found


def implausible_sensor(gap: SquaredGap, nominal: PlaceSet) -> tuple[SensorError, PlaceSet] | None:
    """A sensor with an error that no plant can make: one signal alone is off, or both pressures jump together.

    The plant couples its signals, so that a free run that meets all but one shows the error of that sensor. Both
    pressures rise together only as fast as oil flows in; what changes from sample to sample is not oil.
    """
    if len(gap.names) < 2:
        return None
    errors = gap.errors(nominal.run)
    tries: list[tuple[str, ...]] = [(name,) for name in gap.names if not _follows_other_pressure(gap, errors, name)]
    pressures = _pressures(gap)
    if pressures:
        one, two = (errors[gap.names.index(n)] * np.sqrt(gap.power[n]) for n in pressures)
        common = one + two
        jumps = float(np.mean(np.diff(common) ** 2)) / max(float(np.mean(common**2)), 1e-300)
        if jumps > 0.5 and np.var(common) > 4.0 * np.var(one - two):
            tries.append(pressures)
    found = None
    for names in tries:
        left = np.where([n in names for n in gap.names], 0.0, nominal.energy)
        result = PlaceSet(left, gap.share(left) + FREE_PRICE, {}, nominal.run)
        if found is None or result.cost < found[1].cost:
            found = (
                SensorError(" and ".join(_signal(gap, name).channel for name in names), 0.0, 1.0, 0.0, 0.0),
                result,
            )
    return found if found is not None and found[1].cost < ALONE else None


def _signal(gap: SquaredGap, name: str) -> ScoredSignal:
    return next(one for one in gap.system.scored if one.name == name)


def _pressures(gap: SquaredGap) -> tuple[str, ...]:
    """The scored signals that are the pressures of the two chambers; empty unless both are there."""
    system = gap.system
    found = tuple(one.name for one in system.scored if system.outputs[one.channel] in system.pressures and not one.span)
    return found if len(found) == 2 and set(found) <= set(gap.names) else ()


def _follows_other_pressure(gap: SquaredGap, errors: np.ndarray, name: str) -> bool:
    """Whether one pressure has the error of the other one, which moves more, so that its own gap looks small."""
    pressures = _pressures(gap)
    if name not in pressures:
        return False
    (other,) = set(pressures) - {name}
    here, there = (float(np.mean(errors[gap.names.index(n)] ** 2)) * gap.power[n] for n in (name, other))
    return there > ALONE * here


def _fit_sensor(signal: ScoredSignal, shown: np.ndarray, true: np.ndarray, dt: float) -> tuple[float, SensorError]:
    """The smallest mean square left, and the sensor error that leaves it."""
    best: tuple[float, SensorError | None] = (np.inf, None)
    index = np.arange(true.size)
    for delay, lag in ((0.0, 0.0), *((t, 0.0) for t in LATE), *((0.0, t) for t in LATE)):
        seen = true
        if delay:
            seen = np.interp(index - delay / dt, index, true)
        if lag:
            seen = first_order(true, lag, dt)
        columns = np.column_stack([seen, np.ones_like(seen)]) if not signal.span else seen[:, None]
        # A slope does not show a bias; a run in which nothing moves does not show a scale.
        a = np.linalg.lstsq(columns, shown, rcond=None)[0]
        left = float(np.mean((shown - columns @ a) ** 2))
        # A delay has to improve the fit by 2 %.
        if left < (1.0 - (0.02 if delay or lag else 0.0)) * best[0] and a[0] > 0.05:
            bias = float(a[1]) if a.size > 1 else 0.0
            best = (left, SensorError(signal.channel, bias, float(a[0]), delay, lag))
    left, sensor = best
    return left, sensor if sensor is not None else SensorError(signal.channel, 0.0, 1.0, 0.0, 0.0)
