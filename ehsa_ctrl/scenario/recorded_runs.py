"""References and readings of scenarios with one controller, to replay the controller elsewhere."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.controller_interface import Controller
from ..core.errors import EhsaError
from ..plant.plant import Plant
from .prepare import own_drive_unit, prepare


class RecordedRun(NamedTuple):
    """What a controller got in a run: reference (N, 3), or (N, 4) with a force target, and readings (N, 5)."""

    name: str
    reference: np.ndarray
    measured: np.ndarray


def recorded_runs(
    scenarios: Iterable[str | Path], controller: Controller, plant: Plant
) -> tuple[list[RecordedRun], dict[str, str]]:
    """Simulate scenarios on a plant (its nonlinear model) with a controller, those with a drive of its unit.

    Returns the runs, and by name of the others why they do not fit this controller or plant.
    """
    runs, others = [], {}
    drive = plant.structure.system.drive_unit
    for scenario in scenarios:
        name = Path(scenario).stem
        own = own_drive_unit(scenario)
        if own not in ("", drive):
            others[name] = f"its plant's drive is in {own}, that of {plant.name} in {drive}"
            continue
        try:
            case = prepare(scenario, controller=controller, plant=plant)
            loop = case.simulate(case.nonlinear)
        except EhsaError as error:
            others[name] = str(error)
            continue
        reference = loop.reference
        if getattr(controller, "follows_force", False):
            force = np.zeros(len(loop)) if loop.force_reference is None else loop.force_reference
            reference = np.column_stack([reference, force])
        runs.append(RecordedRun(name, reference, loop.measured))
    return runs, others
