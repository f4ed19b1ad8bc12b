"""Metric of the impedance that a closed loop has towards the force on the rod."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..simulation.closed_loop import ClosedLoop


class TargetImpedance(Protocol):
    """Mass [kg], damping [N s/m] and stiffness [N/m] that a controller gives the rod."""

    @property
    def mass(self) -> float: ...

    @property
    def damping(self) -> float: ...

    @property
    def stiffness(self) -> float: ...


def impedance_metrics(loop: ClosedLoop, target: TargetImpedance | None) -> dict[str, float]:
    """ImpedanceError: how far the rod is from where the mass-damper-spring would be, over how far that yields.

    Root mean squares over the run of x - (r + d) and of d, with M d'' + B d' + K d = -F for the true force F, linear
    between samples. Empty without a target or without a force.
    """
    if target is None:
        return {}
    from scipy.signal import lsim

    run = loop.trajectory
    system = ([-1.0], [target.mass, target.damping, target.stiffness])
    yields = lsim(system, run.cell_force, run.time)[1]
    size = float(np.sqrt(np.mean(yields**2)))
    if size == 0.0:
        return {}
    error = run["x"] - loop.reference[:, 0] - yields
    return {"ImpedanceError": float(np.sqrt(np.mean(error**2))) / size}
