"""MPC: the controller kind that solves the LQR problem under limits in each sample."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, field_validator, model_validator

from ...core.definition import Definition, Second
from ...core.errors import InputError, choices
from ..analysis.sampled import drive_unit_of
from ..qp import QP_SOLVERS
from ..state_space.mpc import Mpc
from ..state_space.mpc_problem import Limits, MpcProblem
from ..state_space.state_feedback import StateFeedback
from ._kind import ControllerKind
from .lqr import TUNED_KEYS, StateFeedbackFile, cost_of, design_state_feedback

if TYPE_CHECKING:
    import control


class SolverOptions(Definition):
    """[solver]: the QP solver and its limits per sample."""

    name: str = Field(default="daqp", description="daqp or osqp")
    iteration_limit: Annotated[int, Field(ge=1)] = Field(
        default=200, description="largest number of iterations per sample, counted as those of an active-set method"
    )
    deadline: Second | None = Field(
        default=None,
        description="time limit per sample; left out, the solver finishes and runs are reproducible",
    )

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if name not in QP_SOLVERS:
            raise ValueError(f"no solver {name!r}; {choices(name, QP_SOLVERS)}")
        return name


class MpcLoopFile(StateFeedbackFile):
    """Keys of every MPC: those of every state feedback, a horizon, limits and a solver."""

    horizon: Annotated[int, Field(ge=2, le=500)] = Field(
        default=20, description="prediction horizon in samples; should cover the decay of the hydraulic mode"
    )
    limits: Limits = Field(default=Limits(), description="constraints on speed, pressure, stroke and current rate")
    solver: SolverOptions = Field(default=SolverOptions(), description="solver of the quadratic programme")

    @field_validator("offset_free")
    @classmethod
    def _check_offset_free(cls, word: str) -> str:
        if word == "integral":
            raise ValueError('offset_free = "integral" is for kind = "lqr"; an MPC takes "disturbance" or "none"')
        return word

    @model_validator(mode="after")
    def _check_solver(self) -> MpcLoopFile:
        if self.solver.deadline is not None and not 0 < self.solver.deadline <= self.sample_time:
            raise ValueError(
                f"[solver] deadline = {self.solver.deadline:g} s; expected more than 0 and at most sample_time"
            )
        return self


class MpcFile(MpcLoopFile):
    """An MPC's TOML."""

    kind: Literal["mpc"] = Field(description="type of feedback law")


def design_mpc(name: str, file: MpcFile, system: control.StateSpace) -> Mpc:
    """An MPC for a linear model.

    Raises InputError as `design_state_feedback` does, and for limits below what the planned motion needs.
    """
    return with_limits(design_state_feedback(name, file, system), file, drive_unit_of(system))


def with_limits(feedback: StateFeedback, file: MpcLoopFile, unit: str) -> Mpc:
    """The MPC around a state feedback; unit: of the drive.

    Raises InputError for limits below what the planned motion needs.
    """
    problem = MpcProblem(
        model=feedback.model,
        target=feedback.target,
        cost=cost_of(feedback.model, file.weights),
        regulator=feedback.regulator,
        horizon=file.horizon,
        current_limit=file.current_limit,
        limits=file.limits,
    )
    if file.trajectory is not None:
        _require_feasible_speed(feedback, file.limits, file.current_limit, file.trajectory.speed, unit)
    return Mpc(feedback, problem, file.solver.name, file.solver.iteration_limit, file.solver.deadline)


def _require_feasible_speed(
    feedback: StateFeedback, limits: Limits, current_limit: float, speed: float, unit: str
) -> None:
    """Require that the model can follow the speed [m/s] of [trajectory] within the limits. unit: of the drive."""
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
            f"[trajectory] speed = {speed:g} m/s needs {current:.4g} {unit}, beyond current_limit = "
            f"{current_limit:g} {unit}: lower the one or raise the other"
        )


kind = ControllerKind("mpc", "model predictive control with limits, offset-free", MpcFile, design_mpc, tunes=TUNED_KEYS)
