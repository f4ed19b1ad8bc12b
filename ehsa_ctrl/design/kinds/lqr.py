"""LQR and LQI: state feedback on a Kalman filter's estimates, free of standing errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from ..laws.state_feedback import StateFeedback
from ._kind import ControllerKind
from ._state_feedback import StateFeedbackFile, design_state_feedback

if TYPE_CHECKING:
    import control


class LqrFile(StateFeedbackFile):
    """An LQR's TOML: the keys of every state feedback, no more."""

    kind: Literal["lqr"] = Field(description="type of feedback law")


def design_lqr(name: str, file: LqrFile, system: control.StateSpace) -> StateFeedback:
    """State feedback for a linear model.

    Raises InputError for a model that can't be stabilised or observed, or a sample time that does not fit it.
    """
    return design_state_feedback(file, system)


kind = ControllerKind("lqr", "state feedback on a Kalman filter, LQR or LQI, offset-free", LqrFile, design_lqr)
