"""Slip quantum: the smallest motion from rest of a plant with static friction."""

from __future__ import annotations

import numpy as np

from ..core.errors import InputError
from ..plant.plant import Plant
from .engine import simulate_batch

#: Pulse heights of one search round, and number of rounds, each within the interval found by the one before.
HEIGHTS, ROUNDS = 16, 8
#: Time for the rod to come to rest again [s], highest pulse [A].
REST, HIGHEST = 0.4, 1e3
#: Smallest displacement that counts as a slip [m].
NOTHING = 1e-9


def slip_quantum(plant: Plant, *, width: float | None = None, direction: int = 1, excess: float = 1e-3) -> float:
    """Length of the shortest slip that a pulse of current causes from rest at x_0 [m].

    A search by simulation finds the lowest pulse at which the rod breaks away; the result is the slip of a pulse that
    is higher by `excess`, as no drive meets a height exactly. At breakaway friction drops from its static to its
    Coulomb level, which carries the rod on: the length rises within a ten-thousandth of the height to some tens of um
    and slowly from there. A standing error below it can't be corrected, only avoided.

    Parameters
    ----------
    width: of the pulse [s]; one sample of the plant by default. The current rises as a ramp over a longer one and
        falls to zero at its end.
    direction: 1 extends, -1 retracts.
    excess: by what share the pulse is higher than the lowest one that moves the rod.

    Returns
    -------
    Metres; 0 for a rod whose friction can't hold it, where any motion can be made small.

    Raises
    ------
    InputError: a width below the plant's sample time, or a rod that nothing up to 1000 A moves.
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
                f"{plant.name}: no pulse up to {heights[-1]:g} A moves the rod; look at its friction and load"
            )
        lowest = heights[slipped[0]]
        heights = np.linspace(heights[max(slipped[0] - 1, 0)], lowest, HEIGHTS)
    return float(_moved(plant, np.array([lowest * (1 + excess)]), shape)[0])


def _moved(plant: Plant, heights: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """How far each pulse moves the rod (heights,) [m]; its height is put into K_T, as only their product acts."""
    rows = np.tile(plant.vector, (heights.size, 1))
    rows[:, plant.structure.equations.parameter_names.index("K_T")] *= heights
    ends = simulate_batch(plant, rows, shape, tolerance=1e-7).states[:, -1, plant.structure.equations.index("x")]
    # A pulse so high that the run can't be finished has moved the rod.
    return np.where(np.isfinite(ends), np.abs(ends - plant.rest[plant.structure.equations.index("x")]), np.inf)
