"""Metrics of the load's force in a closed loop with a force target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..simulation.closed_loop import ClosedLoop
from .force_reference import ForceChange
from .response import step_metrics

#: Part of a hold over which the mean error is taken, as for the position.
TAIL = 0.1


def force_metrics(loop: ClosedLoop, changes: Sequence[ForceChange]) -> dict[str, float]:
    """Metrics of the true force between rod and load; nan for an event that does not happen.

    Parameters
    ----------
    changes: of the force target. Those to zero are releases: they have no metrics, because a load that only pushes
        can't be held at zero force.

    Returns
    -------
    ForceOvershoot (share of the change), ForceSettlingTime [s] (within 2 % of the change, from its start) and
    ForceSteadyStateError [N] (mean over the last tenth until the next change), each of the worst change; a force that
    never settles makes ForceSettlingTime nan.
    """
    time, force = loop.trajectory.time, loop.trajectory.cell_force
    overshoots, settlings, errors = [], [], []
    for change, following in zip(changes, [*(one.start for one in changes), np.inf][1:], strict=True):
        part = np.flatnonzero((time >= change.start - 1e-9) & (time < following - 1e-9))
        held = np.flatnonzero((time >= change.end - 1e-9) & (time < following - 1e-9))
        if change.after == 0.0 or part.size < 3 or held.size < 3:
            continue
        step = step_metrics(time[part], force[part], change.before, change.after)
        overshoots.append(step["Overshoot"])
        settlings.append(step["SettlingTime"])
        errors.append(abs(float(np.mean(force[held[-max(int(TAIL * held.size), 1) :]])) - change.after))
    if not errors:
        return {}
    return {
        "ForceOvershoot": float(np.max(overshoots)),
        "ForceSettlingTime": float(np.max(np.array(settlings))),
        "ForceSteadyStateError": float(np.max(errors)),
    }
