"""What the TOML of LQR and MPC have in common: weights, observer, and how they get rid of a standing error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import model_validator

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
    """[weights]: for each quantity the deviation that costs as much as any other of them; smaller is stricter.

    position: error of the rod. current: beyond what the planned motion needs.
    speed, pressure: errors of shaft speed and pressure difference; left out, they cost nothing.
    current_rate: change of the current, for a calm one.
    integral: of the position's error, only with offset_free = "integral".
    """

    position: Metre
    current: Ampere = 1.0
    speed: RadianPerSecond | None = None
    pressure: Pascal | None = None
    current_rate: AmperePerSecond | None = None
    integral: Annotated[float, In("m s")] | None = None

    @model_validator(mode="after")
    def _positive(self) -> Weights:
        for name, value in self:
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} = {value:g}; expected a deviation greater than 0")
        return self


class Observer(Definition):
    """[observer]: standard deviations for the Kalman filter.

    speed, pressure, position: of the sensors. current: white, at the motor; larger trusts the model less.
    friction, load, leak: by how much each disturbance may wander in one second.
    """

    speed: RadianPerSecond = Noise.speed
    pressure: Pascal = Noise.pressure
    position: Metre = Noise.position
    current: Ampere = Noise.current
    friction: Ampere = Noise.friction
    load: Newton = Noise.load
    leak: RadianPerSecond = Noise.leak

    @model_validator(mode="after")
    def _positive(self) -> Observer:
        for name, value in self:
            if not 0 < value < np.inf:
                raise ValueError(f"{name} = {value:g}; expected a standard deviation greater than 0")
        return self


class StateFeedbackFile(ControllerFile):
    """Keys of every controller that feeds estimated states back.

    offset_free: "disturbance" estimates friction, load and leakage and pays for them; "integral" integrates the
        position's error; "none" leaves the error that a load makes.
    [weights]: what deviations cost. [observer]: of the Kalman filter.
    """

    offset_free: Literal["disturbance", "integral", "none"] = "disturbance"
    weights: Weights
    observer: Observer = Observer()

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
