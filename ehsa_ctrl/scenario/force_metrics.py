"""Metrics of the load's force in a closed loop with a force target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..simulation.closed_loop import ClosedLoop
from .force_reference import ForceChange
from .response import step_metrics

#: Part of a hold over which the mean error is taken, as for the position.
TAIL = 0.1
#: Time after the first contact that counts as impact [s]: some periods of a rod that rebounds from a stiff load.
#: Engineering judgement.
IMPACT_TIME = 0.05
#: Least half width of the settling band of a force [N]: the force changes by about as much when the EHSA's rod slips.
BAND_ABSOLUTE = 100.0


def force_metrics(loop: ClosedLoop, changes: Sequence[ForceChange]) -> dict[str, float]:
    """Metrics of the true force between rod and load; nan for an event that does not happen.

    Parameters
    ----------
    changes: of the force target. Those to zero are releases: they have no metrics, because a load that only pushes
        can't be held at zero force.

    Returns
    -------
    ForceOvershoot (share of the change), ForceSettlingTime [s] (within 2 % of the change, at least 100 N, from its
    start) and ForceSteadyStateError [N] (mean over the last tenth of its hold), each of the worst change; a
    force that never settles makes ForceSettlingTime nan. Then those of `tracking_metrics`.
    """
    time, force = loop.trajectory.time, loop.trajectory.cell_force
    overshoots, settlings, errors = [], [], []
    for change in changes:
        part = np.flatnonzero((time >= change.start - 1e-9) & (time < change.until - 1e-9))
        held = np.flatnonzero((time >= change.end - 1e-9) & (time < change.until - 1e-9))
        if change.after == 0.0 or part.size < 3 or held.size < 3:
            continue
        step = step_metrics(time[part], force[part], change.before, change.after, BAND_ABSOLUTE)
        overshoots.append(step["Overshoot"])
        settlings.append(step["SettlingTime"])
        errors.append(abs(float(np.mean(force[held[-max(int(TAIL * held.size), 1) :]])) - change.after))
    found = {}
    if errors:
        found = {
            "ForceOvershoot": float(np.max(overshoots)),
            "ForceSettlingTime": float(np.max(np.array(settlings))),
            "ForceSteadyStateError": float(np.max(errors)),
        }
    if all(change.after == 0.0 for change in changes):
        return found
    asked = np.ones(time.size, dtype=bool)
    for change in changes:
        if change.after == 0.0:
            asked &= (time < change.start - 1e-9) | (time >= change.until - 1e-9)
    gap = any(np.isfinite(loop.trajectory.plant.values.get(symbol, np.nan)) for symbol in ("x_C", "x_R"))
    return found | tracking_metrics(time, force, loop["reference_force"], asked, gap=gap)


def tracking_metrics(
    time: np.ndarray, force: np.ndarray, target: np.ndarray, asked: np.ndarray, *, gap: bool
) -> dict[str, float]:
    """Metrics from the first contact on.

    Parameters
    ----------
    time, force, target: (N,) [s, N, N]. asked: (N,) bool, samples at which a force is asked, releases left out.
    gap: whether the load is behind a gap, so that it can be met and lost.

    Returns
    -------
    ForceRMSError [N]; nan without contact. Behind a gap also ContactImpact [N], the largest excess of the force over
    its target within IMPACT_TIME of the first contact, 0 for none, and LostContacts, how often the rod leaves the load.
    """
    pushes = force * np.sign(target)
    touched = np.flatnonzero(pushes > 0.0)
    if touched.size == 0:
        return {"LostContacts": 0.0} if gap else {}
    first = int(touched[0])
    asked = asked & (target != 0.0) & (np.arange(time.size) >= first)
    if not asked.any():
        return {"LostContacts": 0.0} if gap else {}
    found = {"ForceRMSError": float(np.sqrt(np.mean((target - force)[asked] ** 2)))}
    if not gap:
        return found
    early = asked & (time <= time[first] + IMPACT_TIME)
    leaves = asked[1:] & (force[1:] == 0.0) & (force[:-1] != 0.0)
    return found | {
        "ContactImpact": max(float(np.max((pushes - np.abs(target))[early])), 0.0),
        "LostContacts": float(np.count_nonzero(leaves)),
    }
