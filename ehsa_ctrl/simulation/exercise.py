"""A closed-loop run for a controller's test vector: limits, steps, disturbances and lost readings."""

from __future__ import annotations

import numpy as np

from ..core.controller_interface import MEASURED, Controller
from ..plant.plant import Plant
from .closed_loop import run_closed_loop
from .faults import Faults, SensorFault
from .sensors import Sensors

#: Force pulses to try [N]; the smallest one that drives the current to its limit is used. Engineering judgement.
FORCE_PULSES = (0.0, 10e3, 20e3, 40e3)


def exercise_controller(
    plant: Plant, controller: Controller, current_limit: float, seed: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Reference (N, 3), or (N, 4) with a force target, readings (N, 5), and the number of samples at the current limit.

    The run has two steps and a ramp of the reference, a force pulse, and lost readings: briefly, and for the last
    0.2 s.
    """
    time = controller.sample_time * np.arange(round(3.0 / controller.sample_time))
    reference = np.zeros((time.size, 3))
    # A tenth of the stroke, at most 20 mm: small enough for any plant.
    size = min(0.02, 0.1 * plant.limits["stroke"].value) if "stroke" in plant.limits else 0.02
    reference[:, 0] = np.select([time < 0.2, time < 1.2, time < 1.6], [0.0, size, 0.0], 0.0)
    ramp = (time >= 1.8) & (time < 2.2)
    reference[ramp, 1] = size
    reference[:, 0] += size * np.clip(time - 1.8, 0.0, 0.4)
    if getattr(controller, "follows_force", False):
        # Press in both directions, then release.
        reference = np.column_stack([reference, np.select([time < 0.6, time < 1.4, time < 2.2], [0.0, 2e3, -1e3], 0.0)])
    end = float(time[-1])
    faults = Faults(
        [
            *(SensorFault(channel, "lost", 0.3, 5 * controller.sample_time) for channel in MEASURED),
            *(SensorFault(channel, "lost", end - 0.2) for channel in MEASURED),
        ]
    )
    for pulse in FORCE_PULSES:
        force = np.where((time >= 2.4) & (time < 2.5), pulse, 0.0)
        loop = run_closed_loop(
            plant, controller, reference, force=force, sensors=Sensors.of(plant, seed=seed), faults=faults,
            raise_on_failure=False,
        )  # fmt: skip
        limited = int(np.count_nonzero(np.abs(loop.asked) >= current_limit))
        if limited:
            break
    return reference[: len(loop)], loop.measured, limited
