"""Whether an input keeps a plant's limits, for the nominal plant and for variations of its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import SimulationError
from ..plant.plant import Plant
from ..simulation.bench import record
from ..simulation.engine import simulate_batch
from ..simulation.limits import NAMES, SHOWN, reached, scale_of
from ..simulation.trajectory import Trajectory
from .parameters import FreeParameter, with_values


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
    lower, upper = np.array([p.lower for p in symbols]), np.array([p.upper for p in symbols])
    names = [p.name for p in symbols]
    return [with_values(plant, names, np.clip(values + corner * reach, lower, upper)) for corner in corners]


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
    if centre:
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
