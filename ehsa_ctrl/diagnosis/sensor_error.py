"""The error of a single sensor: fitted to the residuals of simulations, or inferred from inconsistent signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..plant.system import ScoredSignal
from ..simulation.sensors import first_order
from .injection import GapMeasure
from .place_sets import FREE_PENALTY, PlaceSet
from .signals import scored_signals

# Engineering judgement; shares are shares of the nominal plant's squared gap.

#: A sensor is a candidate if its error explains at least this share.
MIN_EXPLAINED = 0.2
#: A sensor is inconsistent with the others if all other signals together leave less than this share.
MAX_LEFT = 0.15
#: A delay or lag is accepted if it reduces the squared error by this share.
MIN_DELAY_GAIN = 0.02
#: Delays and lags that are tried [s]: from a quarter of a sample to 15 samples at 250 Hz.
DELAYS = (0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.010, 0.013, 0.016, 0.020, 0.025, 0.030, 0.040, 0.060)


@dataclass(frozen=True)
class SensorError:
    """The error of a sensor: reading = scale * signal + bias, with a delay [s] and a first-order lag [s]."""

    channel: str
    bias: float
    scale: float
    delay: float
    lag: float

    def corrected(self, values: np.ndarray, dt: float) -> np.ndarray:
        """The signal (N,) from readings (N,); a lag is corrected as a delay."""
        index = np.arange(values.size)
        return np.interp(index + (self.delay + self.lag) / dt, index, (values - self.bias) / self.scale)

    def __str__(self) -> str:
        parts = [f"scale {self.scale:.4g}"] if abs(self.scale - 1.0) > 0.005 else []
        parts += [f"{word} {1e3 * t:.2g} ms" for word, t in (("delay", self.delay), ("lag", self.lag)) if t]
        if self.bias:
            parts.append(f"bias {self.bias:.4g}")
        return f"{self.channel} with {', '.join(parts)}" if parts else f"{self.channel} alone deviates"


def fit_sensor_error(gap: GapMeasure, sets: Sequence[PlaceSet]) -> SensorError | None:
    """The sensor error that explains most of what simulations leave; None if none explains MIN_EXPLAINED."""
    found: SensorError | None = None
    most = MIN_EXPLAINED
    for one in sets:
        simulated = scored_signals(gap.system.scored, one.run, gap.sample_time)
        for i, name in enumerate(gap.names):
            if one.squared_gap[i] < most * gap.nominal:
                continue
            left, sensor = _fit_sensor(_signal(gap, name), gap.signals[name], simulated[name], gap.sample_time)
            gain = (float(one.squared_gap[i]) - max(left / gap.variance[name] - gap.noise_floor[i], 0.0)) / gap.nominal
            if gain > most:
                most, found = gain, sensor
    return found


def find_inconsistent_sensor(gap: GapMeasure, nominal: PlaceSet) -> tuple[SensorError, PlaceSet] | None:
    """A sensor whose signal is inconsistent with the others; None if there is none.

    The plant couples its signals: if a free run agrees with all but one, the sensor of that one is wrong. And both
    pressures can rise together only as fast as oil flows in: a common error that jumps from sample to sample is a
    sensor error.
    """
    if len(gap.names) < 2:
        return None
    errors = gap.errors(nominal.run)
    tries: list[tuple[str, ...]] = [(name,) for name in gap.names if not _follows_other_pressure(gap, errors, name)]
    pressures = _pressures(gap)
    if pressures:
        one, two = (errors[gap.names.index(n)] * np.sqrt(gap.variance[n]) for n in pressures)
        common = one + two
        jumps = float(np.mean(np.diff(common) ** 2)) / max(float(np.mean(common**2)), 1e-300)
        # White noise has a ratio of 2 and an error that oil flow can make nearly 0; 4: the common part prevails.
        if jumps > 0.5 and np.var(common) > 4.0 * np.var(one - two):
            tries.append(pressures)
    found = None
    for names in tries:
        left = np.where([n in names for n in gap.names], 0.0, nominal.squared_gap)
        result = PlaceSet(left, gap.share(left) + FREE_PENALTY, {}, nominal.run)
        if found is None or result.cost < found[1].cost:
            found = (
                SensorError(" and ".join(_signal(gap, name).channel for name in names), 0.0, 1.0, 0.0, 0.0),
                result,
            )
    return found if found is not None and found[1].cost < MAX_LEFT else None


def _signal(gap: GapMeasure, name: str) -> ScoredSignal:
    return next(one for one in gap.system.scored if one.name == name)


def _pressures(gap: GapMeasure) -> tuple[str, ...]:
    """The scored pressures of the two chambers; empty unless the log has both."""
    system = gap.system
    found = tuple(one.name for one in system.scored if system.outputs[one.channel] in system.pressures and not one.span)
    return found if len(found) == 2 and set(found) <= set(gap.names) else ()


def _follows_other_pressure(gap: GapMeasure, errors: np.ndarray, name: str) -> bool:
    """Whether a signal is a pressure and the other pressure has an error of similar size in Pa.

    The relative error of the other one may look small, because it moves more.
    """
    pressures = _pressures(gap)
    if name not in pressures:
        return False
    (other,) = set(pressures) - {name}
    here, there = (float(np.mean(errors[gap.names.index(n)] ** 2)) * gap.variance[n] for n in (name, other))
    return there > MAX_LEFT * here


def _fit_sensor(
    signal: ScoredSignal, measured: np.ndarray, simulated: np.ndarray, dt: float
) -> tuple[float, SensorError]:
    """The sensor error that turns a simulated signal (N,) into the measured one (N,), and the mean square left."""
    best: tuple[float, SensorError | None] = (np.inf, None)
    index = np.arange(simulated.size)
    for delay, lag in ((0.0, 0.0), *((t, 0.0) for t in DELAYS), *((0.0, t) for t in DELAYS)):
        late = simulated
        if delay:
            late = np.interp(index - delay / dt, index, simulated)
        if lag:
            late = first_order(simulated, lag, dt)
        # A slope does not show a bias.
        columns = np.column_stack([late, np.ones_like(late)]) if not signal.span else late[:, None]
        a = np.linalg.lstsq(columns, measured, rcond=None)[0]
        left = float(np.mean((measured - columns @ a) ** 2))
        # With a scale near zero or below, simulation and measurement do not move together: no scale error.
        if left < (1.0 - (MIN_DELAY_GAIN if delay or lag else 0.0)) * best[0] and a[0] > 0.05:
            bias = float(a[1]) if a.size > 1 else 0.0
            best = (left, SensorError(signal.channel, bias, float(a[0]), delay, lag))
    left, sensor = best
    return left, sensor if sensor is not None else SensorError(signal.channel, 0.0, 1.0, 0.0, 0.0)
