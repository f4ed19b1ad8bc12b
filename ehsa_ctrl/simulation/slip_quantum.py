"""Slip quantum: the smallest motion from rest of a plant with static friction."""

from __future__ import annotations

import numpy as np

from ..core.errors import InputError
from ..plant.plant import Plant
from .engine import simulate_batch

#: Pulse heights of one search round, and number of rounds, each within the interval that the last one found: 15^7
#: intervals within the first one, more than double precision needs for `excess`.
HEIGHTS, ROUNDS = 16, 8
#: Time for the rod to come to rest again [s], highest pulse [A]. Engineering judgement.
REST, HIGHEST = 0.4, 1e3
#: Smallest displacement that counts as a slip [m]. Engineering judgement: far below the resolution of any sensor.
NOTHING = 1e-9


def slip_quantum(plant: Plant, *, width: float | None = None, direction: int = 1, excess: float = 1e-3) -> float:
    """Length of the shortest slip [m] that a current pulse causes from rest at x_0.

    A search by simulation finds the lowest pulse that makes the rod break away. The result is the slip of a pulse that
    is higher by `excess`, because no drive has infinite resolution. At breakaway, friction drops from its static to its
    Coulomb level, so that the rod slips: with the pulse height, the slip rises to some tens of um within a
    ten-thousandth of the height, and slowly from there. A controller can't correct a steady-state error below it.

    Parameters
    ----------
    width: of the pulse [s]; by default one sample of the plant. In a longer pulse, the current is a ramp that falls to
        zero at the end.
    direction: 1 extends, -1 retracts.
    excess: height of the pulse relative to the lowest one that moves the rod, minus 1.

    Returns
    -------
    Metres; 0 for a rod without stiction, which can move by any small amount.

    Raises
    ------
    InputError: a width below the plant's sample time, or a rod that no pulse up to 1000 A moves.
    """
    structure = plant.structure
    rod = next((c for c in structure.system.contacts if c.name == "rod"), None)
    if rod is None or not structure.law(rod).sticks:
        return 0.0
    dt = plant.sample_time
    samples = 1 if width is None else round(width / dt)
    if samples < 1 or direction not in (1, -1):
        raise InputError(f"width = {width} s, direction = {direction}: expected at least {dt:g} s and 1 or -1")
    shape = direction * np.concatenate([np.linspace(0.0, 1.0, samples + 1)[1:], np.zeros(round(REST / dt))])
    heights = np.geomspace(1e-2, HIGHEST, HEIGHTS)
    for _ in range(ROUNDS):
        slipped = np.flatnonzero(_moved(plant, heights, shape) > NOTHING)
        if slipped.size == 0:
            raise InputError(
                f"{plant.name}: no pulse up to {heights[-1]:g} A moves the rod; check its friction and load"
            )
        lowest = heights[slipped[0]]
        heights = np.linspace(heights[max(slipped[0] - 1, 0)], lowest, HEIGHTS)
    return float(_moved(plant, np.array([lowest * (1 + excess)]), shape)[0])


def _moved(plant: Plant, heights: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Displacement of the rod by each pulse (heights,) [m]. K_T is scaled by the height: only their product acts."""
    rows = np.tile(plant.vector, (heights.size, 1))
    rows[:, plant.structure.equations.parameter_names.index("K_T")] *= heights
    ends = simulate_batch(plant, rows, shape, tolerance=1e-7).states[:, -1, plant.structure.equations.index("x")]
    # A run that stopped early had a pulse so high that it certainly moved the rod.
    return np.where(np.isfinite(ends), np.abs(ends - plant.rest[plant.structure.equations.index("x")]), np.inf)
