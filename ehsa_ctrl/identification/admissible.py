"""Whether an input keeps a plant's limits, on the plant as it is believed and on others that it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.errors import SimulationError
from ..plant.plant import Plant
from ..simulation.bench import record
from ..simulation.engine import simulate_batch
from ..simulation.limits import NAMES, SHOWN, reached, scale_of
from ..simulation.trajectory import Trajectory
from .free import FreeParameter, with_values


@dataclass(frozen=True)
class LimitUse:
    """How far a run goes towards a limit.

    limit, unit, allowed: as in the plant's file. reached: by the believed plant. worst: by the worst of its variations.
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


def shares(plant: Plant, values: Mapping[str, float]) -> dict[str, float]:
    """Limit -> share of the way from rest to the limit that `values` went; above 1 it is passed."""
    found = {}
    for name, limit in plant.limits.items():
        # Pressures rest at P_0; what else has a limit is zero at rest, or is counted from zero.
        rest = plant["P_0"] if name.startswith("pressure") else 0.0
        sign = -1.0 if name == "pressure_min" else 1.0
        way, gone = sign * (limit.value - rest), sign * (values[name] - rest)
        found[name] = gone / way if way > 0.0 else (0.0 if gone <= way else math.inf)
    return found


def run_shares(run: Trajectory) -> tuple[dict[str, float], dict[str, float]]:
    """What a run reached, and which share of each limit that is; a run that ended early passed all of them."""
    values = reached(run.plant, run.current, run.states, run.extremes)
    found = shares(run.plant, values)
    return values, dict.fromkeys(found, math.inf) if run.stopped else found


def variations(plant: Plant, parameters: Sequence[FreeParameter], spread: float, draws: int, seed: int) -> list[Plant]:
    """What the plant may be: its free parameters off by up to `spread` (relative), or two sd where the file has one.

    The first two have all of its frictions and its leakage low, and high; the others are draws. Numbers of sensors
    stay, for they move nothing.
    """
    symbols = [p for p in parameters if p.sensor is None and p.value != 0.0]
    if not symbols or draws < 1:
        return []
    reach = np.array([_reach(plant, p, spread) for p in symbols])
    losses = {c.symbol(symbol) for c in plant.structure.system.contacts for symbol in "ABC"} | {"K_L"}
    lossy = np.array([p.name in losses for p in symbols], dtype=float)
    random = np.random.default_rng([seed, 78])
    corners = [-lossy, lossy, *random.uniform(-1.0, 1.0, (max(draws - 2, 0), len(symbols)))][:draws]
    lower, upper = np.array([p.lower for p in symbols]), np.array([p.upper for p in symbols])
    values = np.array([p.value for p in symbols])
    names = [p.name for p in symbols]
    return [with_values(plant, names, np.clip(values + corner * reach, lower, upper)) for corner in corners]


def _reach(plant: Plant, parameter: FreeParameter, spread: float) -> float:
    sd = plant.parameters[parameter.name].sd
    return spread * abs(parameter.value) if sd is None or not math.isfinite(sd) else 2.0 * sd


def worst_of(
    plants: Sequence[Plant], time: np.ndarray, current: np.ndarray, *, centre: bool
) -> tuple[dict[str, float], dict[str, float]]:
    """Worst value, and worst share, of each limit over the variations under one current."""
    worst: dict[str, float] = {}
    share: dict[str, float] = {}
    for values, used in _all_shares(plants, time, current, centre):
        for name, part in used.items():
            if name not in share or part > share[name]:
                share[name], worst[name] = part, values[name]
    return worst, share


def _all_shares(
    plants: Sequence[Plant], time: np.ndarray, current: np.ndarray, centre: bool
) -> list[tuple[dict[str, float], dict[str, float]]]:
    if not plants:
        return []
    if centre:
        found = []
        for plant in plants:
            try:
                found.append(run_shares(record(plant, time, current, sensor_noise=False, centre=True)[1]))
            except SimulationError:
                found.append((dict.fromkeys(plant.limits, math.nan), dict.fromkeys(plant.limits, math.inf)))
        return found
    first = plants[0]
    step = float((time[-1] - time[0]) / (time.size - 1))
    batch = simulate_batch(first, np.stack([plant.vector for plant in plants]), current, sample_time=step, jobs=1)
    found = []
    for plant, states, extremes, status in zip(plants, batch.states, batch.extremes, batch.status, strict=True):
        if status:
            found.append((dict.fromkeys(plant.limits, math.nan), dict.fromkeys(plant.limits, math.inf)))
            continue
        values = reached(plant, current, states, extremes)
        found.append((values, shares(plant, values)))
    return found
