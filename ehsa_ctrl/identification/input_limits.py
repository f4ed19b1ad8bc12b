"""Whether an input keeps a plant's limits, for the nominal plant and for variations of its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError, SimulationError
from ..core.unit import factor
from ..plant.plant import Plant
from ..simulation.bench import record
from ..simulation.engine import simulate_batch
from ..simulation.limits import NAMES, SHOWN, reached, scale_of
from ..simulation.trajectory import Trajectory
from .parameters import FreeParameter, bounds_of, with_values

#: Amplitudes below this share of the first trial are not searched; the largest amplitude without any limit [A].
MIN_AMPLITUDE, MAX_AMPLITUDE = 1e-2, 1e4


@dataclass(frozen=True)
class LimitUse:
    """How close a run comes to a limit.

    limit, unit, allowed: as in the plant's file. reached: by the nominal plant. worst: by the worst of its variations.
    share, worst_share: of the way from rest to the limit.
    """

    limit: str
    unit: str
    allowed: float
    reached: float
    worst: float
    share: float
    worst_share: float

    def __str__(self) -> str:
        scale, unit = scale_of(self.limit, self.unit), SHOWN[self.limit]
        name = {"pressure_max": "highest pressure", "pressure_min": "lowest pressure"}.get(
            self.limit, NAMES[self.limit]
        )
        way = f"{100 * self.share:.0f} % of the way to {self.allowed / scale:.4g}"
        return (
            f"{name} {self.reached / scale:.4g} {unit} ({way}), at worst {self.worst / scale:.4g} {unit} "
            f"({100 * self.worst_share:.0f} %)"
        )


class ReachedLimits(NamedTuple):
    """Limit -> value that a run reached, and limit -> share of the way from rest to the limit."""

    values: dict[str, float]
    shares: dict[str, float]


def limit_shares(plant: Plant, values: Mapping[str, float]) -> dict[str, float]:
    """Limit -> share of the way from rest to the limit that `values` reached; above 1 the limit is exceeded."""
    found = {}
    for name, limit in plant.limits.items():
        # Pressures rest at P_0; every other limited quantity is zero at rest.
        rest = plant["P_0"] if name.startswith("pressure") else 0.0
        sign = -1.0 if name == "pressure_min" else 1.0
        way, gone = sign * (limit.value - rest), sign * (values[name] - rest)
        found[name] = gone / way if way > 0.0 else (0.0 if gone <= way else math.inf)
    return found


def reached_limits(run: Trajectory) -> ReachedLimits:
    """What a run reached of each limit; a run that ended early exceeds all of them."""
    values = reached(run.plant, run.current, run.states, run.extremes)
    shares = limit_shares(run.plant, values)
    return ReachedLimits(values, dict.fromkeys(shares, math.inf) if run.stopped else shares)


def variations(plant: Plant, parameters: Sequence[FreeParameter], spread: float, draws: int, seed: int) -> list[Plant]:
    """Plants whose free parameters are off by up to `spread` (relative), or by two sd where the file has one.

    The first has all friction and leakage low, the second high; the others are random. Numbers of sensors don't vary,
    because they don't change the motion.
    """
    symbols = [p for p in parameters if p.sensor is None and p.value != 0.0]
    if not symbols or draws < 1:
        return []
    values = np.array([p.value for p in symbols])
    sds = np.array([np.inf if (sd := plant.parameters[p.name].sd) is None else sd for p in symbols])
    reach = np.where(np.isfinite(sds), 2.0 * sds, spread * np.abs(values))
    losses = {contact.symbol(letter) for contact in plant.structure.system.contacts for letter in "ABC"} | {"K_L"}
    lossy = np.array([p.name in losses for p in symbols], dtype=float)
    random = np.random.default_rng([seed, 78])
    corners = [-lossy, lossy, *random.uniform(-1.0, 1.0, (max(draws - 2, 0), len(symbols)))][:draws]
    names = [p.name for p in symbols]
    return [with_values(plant, names, np.clip(values + corner * reach, *bounds_of(symbols))) for corner in corners]


def worst_of(plants: Sequence[Plant], time: np.ndarray, current: np.ndarray, *, centre: bool) -> ReachedLimits:
    """The worst value and share of each limit over several plants under one current."""
    worst = ReachedLimits({}, {})
    for values, shares in _all_reached(plants, time, current, centre):
        for name, share in shares.items():
            if name not in worst.shares or share > worst.shares[name]:
                worst.shares[name], worst.values[name] = share, values[name]
    return worst


def _all_reached(plants: Sequence[Plant], time: np.ndarray, current: np.ndarray, centre: bool) -> list[ReachedLimits]:
    if not plants:
        return []
    found = []
    diverged = ReachedLimits(dict.fromkeys(plants[0].limits, math.nan), dict.fromkeys(plants[0].limits, math.inf))
    if centre and plants[0].structure.system.centring[0]:
        for plant in plants:
            try:
                found.append(reached_limits(record(plant, time, current, sensor_noise=False, centre=True)[1]))
            except SimulationError:
                found.append(diverged)
        return found
    step = float((time[-1] - time[0]) / (time.size - 1))
    vectors = np.stack([plant.vector for plant in plants])
    batch = simulate_batch(plants[0], vectors, current, sample_time=step, jobs=1)
    for plant, states, extremes, status in zip(plants, batch.states, batch.extremes, batch.status, strict=True):
        values = {} if status else reached(plant, current, states, extremes)
        found.append(diverged if status else ReachedLimits(values, limit_shares(plant, values)))
    return found


@dataclass(frozen=True)
class AdmissibleRuns:
    """Runs of a plant and of its variations under an input, checked against the limits.

    margin: share of the way to each limit that the nominal plant has to leave. amplitude: largest current, A, or None.
    """

    plant: Plant
    others: Sequence[Plant]
    margin: float
    amplitude: float | None

    @property
    def largest_peak(self) -> float | None:
        """The largest peak of the current that could be allowed [A]."""
        peaks = [] if self.amplitude is None else [self.amplitude]
        if "motor_torque" in self.plant.limits:
            peaks.append((1.0 - self.margin) * self.plant.limits["motor_torque"].value / self.plant["K_T"])
        return min(peaks, default=None)

    def run(
        self, time: np.ndarray, current: np.ndarray, plant: Plant | None = None, *, centre: bool = True
    ) -> Trajectory | None:
        """The nominal plant, or another, held in its stroke where it has one; None if the run diverges."""
        centre = centre and bool(self.plant.structure.system.centring[0])
        try:
            return record(plant or self.plant, time, current, sensor_noise=False, centre=centre)[1]
        except SimulationError:
            return None

    def exceeded(self, run: Trajectory | None) -> str:
        """The limit that a run of the nominal plant exceeds, "range" or "amplitude"; "" for none."""
        if run is None or run.stopped:
            return "range"
        used = reached_limits(run).shares
        if used and max(used.values()) > 1.0 - self.margin:
            return max(used, key=lambda name: used[name])
        cap = np.inf if self.amplitude is None else self.amplitude
        return "amplitude" if np.max(np.abs(run.current)) > cap * (1 + 1e-9) else ""

    def exceeded_by_any(self, current: np.ndarray, time: np.ndarray, others: int) -> str:
        """The limit that the nominal plant exceeds, or without margin one of the first `others` variations."""
        why = self.exceeded(self.run(time, current))
        if why:
            return why
        used = worst_of(self.others[:others], time, current, centre=True).shares
        worst = max(used, key=lambda name: used[name], default="")
        return worst if worst and used[worst] > 1.0 else ""

    def check_rest(self, time: np.ndarray) -> None:
        """Raise InputError if a limit is exceeded without any input."""
        nothing, name = np.zeros(time.size), self.plant.name
        why = self.exceeded(self.run(time, nothing))
        if why in self.plant.limits:
            raise InputError(
                f"{name}: {limit_words(self.plant, why)} less a margin of {100 * self.margin:.0f} % is passed without "
                "any input; no input can keep it"
            )
        if why:
            raise InputError(f"{name}: can't be simulated even without an input")
        why = self.exceeded_by_any(nothing, time, len(self.others))
        if why:
            raise InputError(
                f"{name}: {limit_words(self.plant, why)} is passed without any input by a plant with slightly "
                "different parameters (less friction does not hold the load); lower the load, or the spread of the "
                "parameters"
            )


def largest_amplitude(exceeded: Callable[[float], str], top: float | None, refine: int) -> tuple[float, str]:
    """The largest amplitude [A] that exceeds nothing, within some percent, and what a larger one exceeds.

    0 if there is none down to MIN_AMPLITUDE of the first trial.
    """
    low, high = 0.0, top or 1.0
    while not (beyond := exceeded(high)) and top is None and high < MAX_AMPLITUDE:
        low, high = high, 2.0 * high
    if not beyond:
        return high, ""
    trial, least = high, MIN_AMPLITUDE * high
    while low == 0.0 or refine:
        if low == 0.0:
            trial *= 0.6
            if trial < least:
                return 0.0, beyond
        else:
            trial, refine = float(np.sqrt(low * high)), refine - 1
        why = exceeded(trial)
        if why:
            beyond, high = why, trial
        else:
            low = trial
    return low, beyond


def limit_words(plant: Plant, name: str) -> str:
    limit = plant.limits[name]
    return f"the limit {name} = {limit.value / factor(SHOWN[name], limit.unit):.4g} {SHOWN[name]}"
