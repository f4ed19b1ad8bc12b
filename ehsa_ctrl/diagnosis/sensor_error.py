"""What a sensor alone may have done to its channel: fitted to what runs leave, or told by what no plant can do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..simulation.sensors import first_order
from .injections import FREE_PRICE, Trial
from .signals import scored
from .squared_gap import Energy, SquaredGap

#: A sensor is asked further where it alone explains this part of the gap.
SENSOR_ASKED = 0.2
#: A sensor that errs as the plant can't leaves less than this part of the squared gap.
ALONE = 0.15
#: Delays and lags of a sensor that are tried [s].
LATE = (0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.010, 0.013, 0.016, 0.020, 0.025, 0.030, 0.040, 0.060)


@dataclass(frozen=True)
class SensorError:
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


def suspected_sensor(gap: SquaredGap, trials: Sequence[Trial]) -> SensorError | None:
    """The one channel whose bias, scale, delay or lag explains most of what runs leave; None if none does enough."""
    best: tuple[float, SensorError | None] = (SENSOR_ASKED, None)
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


def impossible(gap: SquaredGap, nominal: Mapping[str, np.ndarray], base: Energy) -> tuple[SensorError, Trial] | None:
    """A sensor that errs as the plant can't: one signal alone is off, or both pressures jump together.

    The plant couples its signals, so that a free run that meets all but one shows what that one's sensor did. Both
    pressures rise together only as fast as oil flows in; what comes and goes from sample to sample is not oil.
    """
    errors = gap.errors(nominal)
    if len(gap.names) < 2:
        return None
    tries: list[tuple[tuple[str, ...], float]] = [
        ((name,), FREE_PRICE) for name in gap.names if not _goes_with_the_other(gap, errors, name)
    ]
    if {"p1", "p2"} <= set(gap.names):
        one, two = (errors[gap.names.index(n)] * np.sqrt(gap.power[n]) for n in ("p1", "p2"))
        common = one + two
        jumps = float(np.mean(np.diff(common) ** 2)) / max(float(np.mean(common**2)), 1e-300)
        if jumps > 0.5 and np.var(common) > 4.0 * np.var(one - two):
            tries.append((("p1", "p2"), FREE_PRICE))
    found = None
    for names, price in tries:
        left = np.where([n in names for n in gap.names], 0.0, base)
        trial = Trial(left, float(left.sum()) / gap.whole + price, {}, dict(nominal))
        if found is None or trial.cost < found[1].cost:
            channels = ["position" if n == "rod_velocity" else n for n in names]
            found = (SensorError(" and ".join(channels), 0.0, 1.0, 0.0, 0.0), trial)
    return found if found is not None and found[1].cost < ALONE else None


def _goes_with_the_other(gap: SquaredGap, errors: np.ndarray, name: str) -> bool:
    """Whether one pressure is off only as the other one is, which moves more, so that its own gap looks small."""
    if name not in ("p1", "p2") or not {"p1", "p2"} <= set(gap.names):
        return False
    other = "p2" if name == "p1" else "p1"
    here, there = (float(np.mean(errors[gap.names.index(n)] ** 2)) * gap.power[n] for n in (name, other))
    return there > ALONE * here


def _fit_sensor(channel: str, shown: np.ndarray, true: np.ndarray, dt: float) -> tuple[float, SensorError]:
    """Mean square that is left, and the sensor that leaves it."""
    best: tuple[float, SensorError | None] = (np.inf, None)
    index = np.arange(true.size)
    for delay, lag in ((0.0, 0.0), *((t, 0.0) for t in LATE), *((0.0, t) for t in LATE)):
        seen = true
        if delay:
            seen = np.interp(index - delay / dt, index, true)
        if lag:
            seen = first_order(true, lag, dt)
        columns = np.column_stack([seen, np.ones_like(seen)]) if channel != "position" else seen[:, None]
        # A run in which nothing moves says nothing of a scale.
        a = np.linalg.lstsq(columns, shown, rcond=None)[0]
        left = float(np.mean((shown - columns @ a) ** 2))
        # A delay has to be worth its number.
        if left < (1.0 - (0.02 if delay or lag else 0.0)) * best[0] and a[0] > 0.05:
            bias = float(a[1]) if a.size > 1 else 0.0
            best = (left, SensorError(channel, bias, float(a[0]), delay, lag))
    left, sensor = best
    return left, sensor if sensor is not None else SensorError(channel, 0.0, 1.0, 0.0, 0.0)
