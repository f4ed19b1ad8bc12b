"""What the TOML of LQR and MPC have in common: weights, observer, and how they get rid of a standing error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Ampere, Definition, In, Metre, Newton, RadianPerSecond
from ..laws.state_feedback import StateFeedback
from ..synthesis.kalman import Noise, design_kalman
from ..synthesis.model import DesignModel, design_model
from ..synthesis.regulator import Cost, design_regulator, weighted
from ..synthesis.target import target
from ._kind import ControllerFile

if TYPE_CHECKING:
    import control

Pascal = Annotated[float, In("Pa")]
AmperePerSecond = Annotated[float, In("A/s")]


class Weights(Definition):
    """[weights]: for each quantity the deviation that costs as much as any other of them; smaller is stricter."""

    position: Metre = Field(description="position error of the rod")
    current: Ampere = Field(default=1.0, description="current beyond that of the planned motion")
    speed: RadianPerSecond | None = Field(default=None, description="shaft speed error; left out, it has no weight")
    pressure: Pascal | None = Field(
        default=None, description="error of the pressure difference; left out, it has no weight"
    )
    current_rate: AmperePerSecond | None = Field(
        default=None,
        description="rate of change of the current; left out, it has no weight",
    )
    integral: Annotated[float, In("m s")] | None = Field(
        default=None,
        description='integral of the position error, only with offset_free = "integral"',
    )

    @model_validator(mode="after")
    def _positive(self) -> Weights:
        for name, value in self:
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} = {value:g}; expected a deviation greater than 0")
        return self


class Observer(Definition):
    """[observer]: standard deviations for the Kalman filter."""

    speed: RadianPerSecond = Field(default=Noise.speed, description="noise of the speed sensor")
    pressure: Pascal = Field(default=Noise.pressure, description="noise of the pressure sensors")
    position: Metre = Field(default=Noise.position, description="noise of the position sensor")
    current: Ampere = Field(
        default=Noise.current,
        description="white process noise of the motor current; larger trusts the model less",
    )
    friction: Ampere = Field(
        default=Noise.friction, description="random walk of the friction disturbance in one second"
    )
    load: Newton = Field(default=Noise.load, description="random walk of the load force in one second")
    leak: RadianPerSecond = Field(
        default=Noise.leak, description="random walk of the leakage disturbance in one second"
    )

    @model_validator(mode="after")
    def _positive(self) -> Observer:
        for name, value in self:
            if not 0 < value < np.inf:
                raise ValueError(f"{name} = {value:g}; expected a standard deviation greater than 0")
        return self


class StateFeedbackFile(ControllerFile):
    """Keys of every controller that feeds estimated states back."""

    offset_free: Literal["disturbance", "integral", "none"] = Field(
        default="disturbance",
        description='"disturbance" estimates friction, load and leakage and compensates them; "integral" integrates '
        'the position error; "none" accepts the steady-state error under load',
    )
    weights: Weights = Field(description="weights of the cost function")
    observer: Observer = Field(default=Observer(), description="noise levels of the Kalman filter")

    @model_validator(mode="after")
    def _fitting(self) -> StateFeedbackFile:
        if (self.weights.integral is not None) != (self.offset_free == "integral"):
            raise ValueError('[weights] integral and offset_free = "integral" belong together; give both or neither')
        own = self.feedforward
        if own is not None and (own.inertia, own.viscous, own.stiffness, own.preload, own.load) != (0.0,) * 5:
            raise ValueError(
                "[feedforward] of a state feedback holds friction alone (coulomb, static, stribeck): the current for "
                "the rest comes from its linear model and its estimate of the load"
            )
        return self


def cost_of(model: DesignModel, weights: Weights) -> Cost:
    """The cost that the deviations stand for."""
    deviations = {
        name: value
        for name, value in (
            ("position", weights.position),
            ("speed", weights.speed),
            ("pressure", weights.pressure),
        )
        if value is not None
    }
    step = None if weights.current_rate is None else weights.current_rate * model.sample_time
    return Cost(
        Q=weighted(model, deviations),
        R=1.0 / weights.current**2,
        R_rate=0.0 if step is None else 1.0 / step**2,
        Q_integral=0.0 if weights.integral is None else 1.0 / weights.integral**2,
    )


def design_state_feedback(file: StateFeedbackFile, system: control.StateSpace) -> StateFeedback:
    """The law without constraints but the current's, from a definition and the linear model."""
    model = design_model(system, file.sample_time)
    if file.offset_free != "disturbance":
        model = model.without_disturbance
    regulator = design_regulator(model, cost_of(model, file.weights))
    # Twice as fast as the integral itself acts: its gain over that of the position is its rate.
    per_metre = float(model.row("position") @ regulator.K) / float(model.row("position") @ model.row("position"))
    tracking = 0.5 * per_metre / abs(regulator.integral) if regulator.integral else 1.0
    return StateFeedback(
        model,
        target(model),
        design_kalman(model, Noise(**dict(file.observer))),
        regulator,
        file.current_limit,
        max(tracking, file.sample_time),
    )
