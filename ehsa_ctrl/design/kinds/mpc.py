"""MPC: state feedback that knows its limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from ...core.definition import Definition, In, Metre, RadianPerSecond, Second
from ...core.errors import InputError, choices
from ..laws.mpc import Mpc
from ..laws.mpc_problem import Limits, MpcProblem
from ..laws.state_feedback import StateFeedback
from ..qp import QP_SOLVERS
from ._kind import ControllerKind
from ._state_feedback import AmperePerSecond, Pascal, StateFeedbackFile, cost_of, design_state_feedback

if TYPE_CHECKING:
    import control


class MpcLimits(Definition):
    """[limits] beside current_limit; one that is left out does not hold."""

    current_rate: AmperePerSecond | None = Field(
        default=None, description="rate of change of the current; a hard limit"
    )
    speed: RadianPerSecond | None = Field(
        default=None,
        description="shaft speed; a soft limit: exceeding it by its own size costs `penalty` times as much as a "
        "position error of 0.1 m",
    )
    pressure: Pascal | None = Field(default=None, description="pressure difference p1 - p2; a soft limit as speed")
    stroke: Metre | None = Field(default=None, description="rod position, to either side of 0; a soft limit as speed")
    penalty: Annotated[float, In("1")] = Field(default=Limits.penalty, description="weight of soft limits, see speed")

    @model_validator(mode="after")
    def _room(self) -> MpcLimits:
        for name, value in self:
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} = {value:g} leaves no room; expected a limit greater than 0")
        return self


class Solver(Definition):
    """[solver]: which, and when a sample is given up."""

    name: str = Field(default="daqp", description="daqp or osqp")
    iteration_limit: Annotated[int, Field(ge=1)] = Field(
        default=200,
        description="iterations per sample, in those of an active-set method",
    )
    deadline: Second | None = Field(
        default=None,
        description="time limit per sample; left out, the solver runs to the end and runs are reproducible",
    )

    @field_validator("name")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in QP_SOLVERS:
            raise ValueError(f"no solver {name!r}; {choices(name, QP_SOLVERS)}")
        return name


class MpcFile(StateFeedbackFile):
    """An MPC's TOML: the keys of every state feedback, a horizon, limits and a solver."""

    kind: Literal["mpc"] = Field(description="type of feedback law")
    horizon: Annotated[int, Field(ge=2, le=500)] = Field(
        default=20,
        description="prediction horizon in samples; long enough for the hydraulic mode to decay",
    )
    limits: MpcLimits = Field(
        default=MpcLimits(), description="constraints on speed, pressure, stroke and current rate"
    )
    solver: Solver = Field(default=Solver(), description="solver of the quadratic programme")

    @model_validator(mode="after")
    def _possible(self) -> MpcFile:
        if self.offset_free == "integral":
            raise ValueError('offset_free = "integral" is for kind = "lqr"; an MPC estimates disturbances')
        if self.solver.deadline is not None and not 0 < self.solver.deadline <= self.sample_time:
            raise ValueError(
                f"[solver] deadline = {self.solver.deadline:g} s; expected more than 0 and at most sample_time"
            )
        return self


def design_mpc(name: str, file: MpcFile, system: control.StateSpace) -> Mpc:
    """An MPC for a linear model.

    Raises
    ------
    InputError: as an LQR, or limits that forbid what [trajectory] plans.
    """
    feedback = design_state_feedback(file, system)
    limits = Limits(**dict(file.limits))
    problem = MpcProblem(
        model=feedback.model,
        target=feedback.target,
        cost=cost_of(feedback.model, file.weights),
        regulator=feedback.regulator,
        horizon=file.horizon,
        current_limit=file.current_limit,
        limits=limits,
    )
    if file.trajectory is not None:
        _require_room(feedback, limits, file.current_limit, file.trajectory.speed)
    return Mpc(feedback, problem, file.solver.name, file.solver.iteration_limit, file.solver.deadline)


def _require_room(feedback: StateFeedback, limits: Limits, current_limit: float, speed: float) -> None:
    """The planned speed must be possible within the limits, on the model."""
    needs = {signal: abs(feedback.model.row(signal) @ feedback.target.Pi[:, 1]) * speed for signal in limits.soft}
    for signal, limit in limits.soft.items():
        if signal != "position" and needs[signal] > limit:
            raise InputError(
                f"[trajectory] speed = {speed:g} m/s needs a {signal} of {needs[signal]:.4g}, beyond [limits] "
                f"{signal} = {limit:g} (SI units): lower the one or raise the other"
            )
    current = abs(feedback.target.Gamma[1]) * speed
    if current > current_limit:
        raise InputError(
            f"[trajectory] speed = {speed:g} m/s needs {current:.4g} A, beyond current_limit = {current_limit:g} A: "
            "lower the one or raise the other"
        )


kind = ControllerKind("mpc", "model predictive control with limits, offset-free", MpcFile, design_mpc)
