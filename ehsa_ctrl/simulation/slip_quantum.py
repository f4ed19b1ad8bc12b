"""The smallest motion that a plant with static friction can be made to do from rest."""

from __future__ import annotations

import numpy as np

from ..core.errors import InputError
from ..plant.plant import Plant
from .engine import simulate_batch

#: Heights of the pulse that are tried at once, and how often the range is narrowed to its decisive part.
HEIGHTS, ROUNDS = 16, 8
#: s, what the rod is given to come to rest again, and A, the highest pulse that is tried.
REST, HIGHEST = 0.4, 1e3
#: m, below which nothing has slipped.
NOTHING = 1e-9


def slip_quantum(plant: Plant, *, width: float | None = None, direction: int = 1, excess: float = 1e-3) -> float:
    """Length of the shortest slip that a pulse of current causes from rest at x_0 [m].

    The lowest pulse at which the rod breaks away is looked for by simulation, then one that is higher by `excess`, as
    no drive meets a height exactly. What static friction exceeds Coulomb friction by is set free at breakaway and
    carries the rod on: the length rises within a ten-thousandth of the height from nothing to some tens of micrometres
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
