"""LQR and LQI: the controller kind with state feedback from a Kalman filter, offset-free by default."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from ...core.definition import Definition, Drive, In, Metre, RadianPerSecond
from ..state_space.kalman import Observer, Pascal, design_kalman
from ..state_space.model import DesignModel, design_model
from ..state_space.mpc_problem import DrivePerSecond
from ..state_space.regulator import Cost, design_regulator, solve_target, weight_matrix
from ..state_space.state_feedback import StateFeedback
from ._kind import ControllerKind, PositionControllerFile

if TYPE_CHECKING:
    import control


class Weights(Definition):
    """[weights]: deviations that cost the same; a smaller deviation weighs more."""

    position: Metre = Field(gt=0, description="position error of the rod")
    current: Drive = Field(default=1.0, gt=0, description="current beyond that of the planned motion")
    speed: RadianPerSecond | None = Field(default=None, gt=0, description="shaft speed error; no weight if left out")
    pressure: Pascal | None = Field(
        default=None, gt=0, description="error of the pressure difference; no weight if left out"
    )
    current_rate: DrivePerSecond | None = Field(
        default=None, gt=0, description="rate of change of the current; no weight if left out"
    )
    integral: Annotated[float, In("m s")] | None = Field(
        default=None, gt=0, description='integral of the position error, only with offset_free = "integral"'
    )


class StateFeedbackFile(PositionControllerFile):
    """Keys of every controller with state feedback."""

    offset_free: Literal["disturbance", "integral", "none"] = Field(
        default="disturbance",
        description='"disturbance" estimates and compensates friction, load and leakage; "integral" integrates the '
        'position error; "none" accepts a steady-state error under load',
    )
    weights: Weights = Field(description="weights of the cost function")
    observer: Observer = Field(default=Observer(), description="noise levels of the Kalman filter")

    @model_validator(mode="after")
    def _check_weights(self) -> StateFeedbackFile:
        if (self.weights.integral is not None) != (self.offset_free == "integral"):
            raise ValueError('[weights] integral needs offset_free = "integral" and vice versa; give both or neither')
        f = self.feedforward
        if f is not None and (f.inertia, f.viscous, f.stiffness, f.preload, f.load) != (0.0,) * 5:
            raise ValueError(
                "[feedforward] of a state feedback may contain friction only (coulomb, static, stribeck): its linear "
                "model and its load estimate give the rest of the current"
            )
        return self


class LqrFile(StateFeedbackFile):
    """An LQR's TOML: the keys of every state feedback."""

    kind: Literal["lqr"] = Field(description="type of feedback law")


def cost_of(model: DesignModel, weights: Weights) -> Cost:
    """The quadratic cost with these deviations, by Bryson's rule (see `weight_matrix`)."""
    deviations = {"position": weights.position, "speed": weights.speed, "pressure": weights.pressure}
    step = None if weights.current_rate is None else weights.current_rate * model.sample_time
    return Cost(
        Q=weight_matrix(model, {name: value for name, value in deviations.items() if value is not None}),
        R=1.0 / weights.current**2,
        R_rate=0.0 if step is None else 1.0 / step**2,
        Q_integral=0.0 if weights.integral is None else 1.0 / weights.integral**2,
    )


def design_state_feedback(name: str, file: StateFeedbackFile, system: control.StateSpace) -> StateFeedback:
    """State feedback for a linear model, with a limit on the current only.

    Raises InputError for a model that is not stabilisable and detectable, and for a sample time that aliases a mode.
    """
    model = design_model(system, file.sample_time)
    if file.offset_free != "disturbance":
        model = model.without_disturbance
    regulator = design_regulator(model, cost_of(model, file.weights))
    # Back-calculation twice as fast as the integral itself, whose rate is its gain over that of the position.
    per_metre = float(model.row("position") @ regulator.K) / float(model.row("position") @ model.row("position"))
    tracking = 0.5 * per_metre / abs(regulator.integral) if regulator.integral else 1.0
    return StateFeedback(
        model,
        solve_target(model),
        design_kalman(model, file.observer),
        regulator,
        file.current_limit,
        max(tracking, file.sample_time),
    )


#: Weight of the position, and noise levels that decide how fast the disturbances are estimated.
TUNED_KEYS = {
    "weights.position": ("m", 1e-5, 1e-2),
    "observer.current": ("A", 0.01, 3.0),
    "observer.friction": ("A", 0.03, 10.0),
    "observer.load": ("N", 30.0, 3e4),
}

kind = ControllerKind(
    "lqr",
    "state feedback from a Kalman filter, LQR or LQI, offset-free",
    LqrFile,
    design_state_feedback,
    tunes=TUNED_KEYS,
)
