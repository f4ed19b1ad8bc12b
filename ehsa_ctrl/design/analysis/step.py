"""What the linear sampled loop does after a step of the reference and of the force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import InputError
from ...core.protocol import Controller
from .closed import INPUTS, OUTPUTS, closed_loop, law_of
from .sampled import sampled_plant

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class StepResponse:
    """Steps of a linear loop: no limit, no friction, no other stage than the law.

    Attributes
    ----------
    controller: for the title. time: (N,) s.
    position, current: "reference" -> (N,) after 1 m of reference, "force" -> (N,) after 1 N on the rod; m and A.
    """

    controller: str
    time: np.ndarray
    position: dict[str, np.ndarray]
    current: dict[str, np.ndarray]

    @property
    def overshoot(self) -> float:
        """Share of the reference step by which the position passes it."""
        return float(max(np.max(self.position["reference"]) - 1.0, 0.0))

    @property
    def settling_time(self) -> float:
        """Time after which the position stays within 2 % of the reference step [s]; inf if it does not."""
        outside = np.flatnonzero(np.abs(self.position["reference"] - 1.0) > 0.02)
        last = -1 if outside.size == 0 else int(outside[-1])
        return float(self.time[last + 1]) if last + 1 < self.time.size else float("inf")


def step_response(system: control.StateSpace, controller: Controller, duration: float = 1.0) -> StepResponse:
    """Step responses (duration [s]) of a linear model with the controller's linear law.

    Raises InputError for a loop that is not stable, and as `sampled_plant` and `law_of` do.
    """
    closed = closed_loop(sampled_plant(system, controller.sample_time), law_of(controller))
    if np.max(np.abs(np.linalg.eigvals(closed.A)), initial=0.0) >= 1.0:
        raise InputError(f"the loop with {controller.name} is not stable; its step response has no end")
    samples = max(round(duration / controller.sample_time), 1) + 1
    rows = [OUTPUTS.index("position"), OUTPUTS.index("current")]
    found = {}
    for name, column in (("reference", INPUTS.index("r_position")), ("force", INPUTS.index("F_D"))):
        x, y = np.zeros(closed.nstates), np.empty((samples, 2))
        push, through = closed.B[:, column], closed.D[rows, column]
        for k in range(samples):
            y[k] = closed.C[rows] @ x + through
            x = closed.A @ x + push
        found[name] = y
    return StepResponse(
        controller.name,
        controller.sample_time * np.arange(samples),
        {name: y[:, 0] for name, y in found.items()},
        {name: y[:, 1] for name, y in found.items()},
    )
