"""The next experiment on a rig whose rod another machine moves: speeds and currents that its logs do not combine.

Effects of speed and effects of pressure separate only where the two vary independently. The pump's pressure follows the
current, so that a rig that always loads the rod in the same way shows their sum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.log import CHANNELS, Log
from ..core.text import join_words
from ..plant.system import System

#: Levels of the rod's velocity and of the drive as shares of the largest in the logs, and half the width of a level.
#: Engineering judgement.
VELOCITIES, DRIVES, WIDTH = (-1.0, -0.5, 0.5, 1.0), (-1.0, 0.0, 1.0), 0.25
#: Shortest time that shows a combination [s], and most combinations that are listed. Engineering judgement.
SHORTEST, MOST = 1.0, 4


def missing_combinations(system: System, logs: Sequence[Log]) -> str:
    """Words and numbers: which combinations of rod velocity and drive to add; empty if the logs lack a channel."""
    motion = next((channel for channel in system.drives.values() if channel != system.drive), "")
    if any(channel not in log.channels for log in logs for channel in (motion, system.drive)):
        return ""
    v, drive = (np.concatenate([log[channel] for log in logs]) for channel in (motion, system.drive))
    largest = float(np.max(np.abs(v))), float(np.max(np.abs(drive)))
    if min(largest) == 0.0:
        return f"vary {motion} and {system.drive}: one of them is always zero in the logs"
    moving = np.abs(v) > 0.5 * WIDTH * largest[0]
    together = float(np.corrcoef(v[moving], drive[moving])[0, 1]) if np.ptp(drive[moving]) > 0.0 else 0.0
    units = CHANNELS[motion].unit, system.drive_unit
    missing = [
        f"{_number(a * largest[0])} {units[0]} with {_number(b * largest[1])} {units[1]}"
        for a in VELOCITIES
        for b in DRIVES
        if np.sum(_near(v / largest[0], a) & _near(drive / largest[1], b)) * logs[0].sample_time < SHORTEST
    ]
    words = f"vary {motion} and {system.drive} independently (their correlation in motion is {together:.2f} so far)"
    if not missing:
        return f"{words}; all combinations of their levels are there: repeat them at another temperature"
    further = f" and {len(missing) - MOST} more" if len(missing) > MOST else ""
    return f"{words}: hold {join_words(missing[:MOST]) if not further else ', '.join(missing[:MOST])}{further}"


def _near(share: np.ndarray, level: float) -> np.ndarray:
    return np.asarray(np.abs(share - level) <= WIDTH)


def _number(value: float) -> str:
    return f"{value:+.2g}" if value else "0"
