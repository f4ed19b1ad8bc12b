"""What the tests of a review share."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.protocol import MEASURED
from ..analysis.closed import INPUTS, OUTPUTS, closed_loop, law_of
from ..analysis.frequency import discrete_response
from ..analysis.loop import LoopAnalysis
from ..analysis.sampled import sampled_plant
from .finding import Known

if TYPE_CHECKING:
    import control

    from ..analysis.robustness import RobustMargins

#: Two slow frequencies, as shares of 1 / sample_time, between which a law with integral action differs by ten.
SLOW = np.array([1e-6, 1e-5])


class Case:
    """A plant, a controller and what is known of both.

    Attributes
    ----------
    system, controller, known, loop, robust: as given to `review`, and the loop's analysis.
    sample_time: s. law, closed: discrete systems, see design.closed.
    feedback: the law itself, which may have a model and a horizon.
    cured: whether the controller has a [rest], which holds the integral where the rod rests.
    integrates: whether a lasting error makes a current that grows without end.
    at_once: A per metre of error, what the law asks for within five samples of an error that appears at rest.
    """

    def __init__(
        self,
        system: control.StateSpace,
        controller: Any,
        known: Known,
        loop: LoopAnalysis,
        robust: RobustMargins | None,
        lag: int,
    ) -> None:
        self.system, self.controller, self.known, self.loop, self.robust = system, controller, known, loop, robust
        self.sample_time = float(controller.sample_time)
        self.plant = sampled_plant(system, self.sample_time, delay=lag * self.sample_time)
        self.law = law_of(controller)
        self.closed = closed_loop(self.plant, self.law)
        self.feedback = getattr(controller, "law", controller)
        self.cured = getattr(controller, "rest", None) is not None
        # A slow integral shows as a gain that grows with 1 / omega.
        slow = np.abs(discrete_response(self.law[0, 3 + MEASURED.index("position")], SLOW / self.sample_time)[:, 0, 0])
        self.integrates = bool(slow[0] > 3.0 * slow[1])
        self.at_once = float(np.max(np.abs(self.standing(5))))

    def standing(self, samples: int) -> np.ndarray:
        """Current (samples,) [A per metre of error] while the rod stands, from an error that appears at sample 0."""
        found, state = np.empty(samples), np.zeros(self.law.nstates)
        for k in range(samples):
            found[k] = self.law.C[0] @ state + self.law.D[0, 0]
            state = self.law.A @ state + self.law.B[:, 0]
        return found

    def response(self, source: str, samples: int, output: str = "position") -> np.ndarray:
        """Answer (samples,) of the closed loop to a unit step of an input."""
        b = self.closed.B[:, INPUTS.index(source)]
        c, d = self.closed.C[OUTPUTS.index(output)], self.closed.D[OUTPUTS.index(output), INPUTS.index(source)]
        found, state = np.empty(samples), np.zeros(self.closed.nstates)
        for k in range(samples):
            found[k] = c @ state + d
            state = self.closed.A @ state + b
        return found

    def entry(self, row: str, column: str) -> float:
        """An entry of the model's A; nan where it has no such states."""
        names = list(self.system.state_labels)
        if row not in names or column not in names:
            return nan
        return float(self.system.A[names.index(row), names.index(column)])

    @property
    def rise_time(self) -> float:
        """s from 10 to 90 % of a step of the reference; nan if it never gets there."""
        decay = np.max(np.abs(self.loop.poles), initial=0.0)
        samples = int(min(max(5.0 / max(-np.log(max(decay, 1e-12)), 1e-4), 50), 20_000))
        step = self.response("r_position", samples)
        if np.max(step) < 0.9:
            return nan
        return float(np.argmax(step >= 0.9) - np.argmax(step >= 0.1)) * self.sample_time

    @property
    def inverse_mass(self) -> float:
        """1 / kg that moves with the rod; nan where the model does not show it."""
        return -self.input("v", "F_D")

    def input(self, row: str, name: str) -> float:
        """An entry of the model's B; nan where it has no such state or input."""
        states, inputs = list(self.system.state_labels), list(self.system.input_labels)
        if row not in states or name not in inputs:
            return nan
        return float(self.system.B[states.index(row), inputs.index(name)])

    @property
    def stiffness(self) -> float:
        """N/m of the load's spring that the model has; nan where it does not show it."""
        return -self.entry("v", "x") / self.inverse_mass
