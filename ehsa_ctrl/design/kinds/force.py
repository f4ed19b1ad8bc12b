"""Force: the controller kind that presses with a given force, and approaches under position control before contact.

The law is in _force_law.py. Its shaft speed damps both loops instead of the derivative of force or position: it is less
noisy, and its share of the loop hardly depends on the stiffness of the environment.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.controller_interface import MEASURED
from ...core.definition import AngularFrequency, Definition, In, Newton, Second
from ...core.errors import InputError
from ..analysis.closed_loop import discrete_response
from ..analysis.contact import in_contact
from ..analysis.robustness import RobustMargins, robust_margins
from ..analysis.sampled import sampled_plant
from ..controller import SampledController
from ._force_law import NO_LOOP, ForceLaw, LoopGains
from ._kind import ControllerFile, ControllerKind
from .pid import PhaseMargin

if TYPE_CHECKING:
    import control

NewtonPerMetre = Annotated[float, In("N/m")]
#: Stiffnesses of the environment for which the margins are computed, evenly in the logarithm.
STIFFNESSES = 7


class Environment(Definition):
    """[environment]: what the rod presses against."""

    stiffness: NewtonPerMetre = Field(gt=0, description="stiffness for which the force loop is designed")
    softest: NewtonPerMetre = Field(default=1e4, gt=0, description="smallest stiffness for which margins are computed")
    stiffest: NewtonPerMetre = Field(default=1e7, gt=0, description="largest stiffness for which margins are computed")

    @model_validator(mode="after")
    def _check_order(self) -> Environment:
        if not self.softest < self.stiffest:
            raise ValueError(f"softest = {self.softest:g} N/m must be less than stiffest = {self.stiffest:g} N/m")
        return self


class LoopSpecification(Definition):
    """Keys of a loop, broken at the current."""

    crossover: AngularFrequency = Field(description="gain crossover frequency")
    phase_margin: PhaseMargin = Field(description="phase margin at the crossover")
    integral_ratio: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.1, description="corner frequency of the integral action over the crossover"
    )

    def check(self, table: str, sample_time: float) -> None:
        """Raise ValueError for a crossover beyond the Nyquist frequency."""
        nyquist = np.pi / sample_time
        if not 0 < self.crossover < nyquist:
            raise ValueError(
                f"[{table}] crossover = {self.crossover:g} rad/s: expected more than 0 and less than "
                f"{nyquist:.4g} rad/s, the Nyquist frequency"
            )


class ForceLoop(LoopSpecification):
    """[force]: the loop in contact."""

    limit: Newton = Field(gt=0, description="largest magnitude of the force target")
    rate: Annotated[float, In("N/s")] = Field(gt=0, description="largest rate at which the force target is followed")
    measurement: Literal["load_cell", "pressures"] = Field(
        default="load_cell",
        description="load_cell measures the force on the load; pressures is A (P_1 - P_2), which contains the friction "
        "of the rod",
    )
    deadband: Newton = Field(
        default=0.0, ge=0, description="error within which the integral pauses at a constant target"
    )
    friction_time: Second = Field(
        default=0.3,
        gt=0,
        description="time in which the current of [feedforward] coulomb is built up against an error beyond the "
        "deadband at a constant target",
    )


class Approach(LoopSpecification):
    """[position]: the loop before contact."""

    contact: Newton = Field(gt=0, description="measured force from which on the force is controlled")


class ForceFile(ControllerFile):
    """A force controller's TOML."""

    kind: Literal["force"] = Field(description="type of feedback law")
    environment: Environment = Field(description="stiffness of the environment")
    force: ForceLoop = Field(description="force loop")
    position: Approach | None = Field(
        default=None, description="position loop before contact; left out, the force is controlled all the time"
    )

    @model_validator(mode="after")
    def _check_loops(self) -> ForceFile:
        for name, loop in (("force", self.force), ("position", self.position)):
            if loop is not None:
                loop.check(name, self.sample_time)
        if self.position is not None and self.position.contact >= self.force.limit:
            raise ValueError(
                f"[position] contact = {self.position.contact:g} N must be less than [force] limit = "
                f"{self.force.limit:g} N"
            )
        return self


def loop_gains(
    specified: LoopSpecification, response: complex, speed: complex, sample_time: float, name: str
) -> LoopGains:
    """Solve (k + k_i / s) response + k_w speed = -exp(i margin) at the crossover; k_i is integral_ratio crossover k.

    response, speed: of the sampled plant from the current to the controlled variable and to the shaft speed.

    Raises InputError where a gain would be negative.
    """
    w = specified.crossover
    ratio = specified.integral_ratio * w
    integral = 1.0 + ratio * sample_time / (np.exp(1j * w * sample_time) - 1.0)
    needed, part = -np.exp(1j * specified.phase_margin), integral * response
    k, k_w = np.linalg.solve([[part.real, speed.real], [part.imag, speed.imag]], [needed.real, needed.imag])
    if k <= 0 or k_w < 0:
        raise InputError(
            f"[{name}] a phase margin of {np.degrees(specified.phase_margin):.3g} deg at {w:.4g} rad/s is infeasible "
            "with damping by the shaft speed; "
            + ("lower the margin" if k <= 0 else "lower the crossover or raise the margin")
        )
    return LoopGains(float(k), float(ratio * k), float(k_w), w)


def travel_per_radian(position: complex, speed: complex, omega: float, sample_time: float) -> float:
    """Travel of the rod per radian of the shaft [m], from the responses of both at a frequency [rad/s]."""
    return float(abs((np.exp(1j * omega * sample_time) - 1.0) / sample_time * position / speed))


def require_shaft_and_cell(system: control.StateSpace, law: str) -> None:
    """Raise InputError for a model of a plant that cannot press: without a shaft whose speed damps the loop."""
    if "omega" not in system.output_labels:
        raise InputError(
            f"the model {system.name} has no shaft speed omega, and its plant no load cell and no pressures: {law} has "
            "nothing to measure the force of the environment with, and nothing to damp its loop; take a position "
            "controller such as pid or cascade, or a plant with pump and load cell such as ehsa"
        )


def design_force(name: str, file: ForceFile, system: control.StateSpace) -> ForceLaw:
    """Both loops for the linear model `system` (inputs current and F_D, outputs omega, dP and x), exactly sampled.

    The force loop is designed in contact with the environment's stiffness, the position loop without it.

    Raises InputError for a model that lacks one of these, for infeasible margins, for a force beyond what the current
    gives, and for a loop that some stiffness in the range makes unstable.
    """
    import control

    require_shaft_and_cell(system, "a force controller")
    T_s, specified = file.sample_time, file.force
    model = in_contact(system, file.environment.stiffness)
    static = dict(zip(model.output_labels, np.asarray(control.dcgain(model))[:, 0].real, strict=True))
    G_0 = float(static["force"])
    friction = file.feedforward.coulomb if file.feedforward is not None else 0.0
    reachable = G_0 * (file.current_limit - friction)
    if specified.limit > reachable:
        raise InputError(
            f"[force] limit = {specified.limit:.4g} N is beyond the {max(reachable, 0.0):.4g} N that "
            f"{file.current_limit:g} A gives ({G_0:.4g} N/A{', less friction' if friction else ''}); "
            "lower it or raise current_limit"
        )
    area = 0.0
    if specified.measurement == "pressures":
        if "dP" not in static:
            raise InputError(f"the model {system.name} has no output dP; measure the force by load_cell")
        area = G_0 / float(static["dP"])
    at = discrete_response(sampled_plant(model, T_s), specified.crossover)[0, :, 0]
    reading = area * (at[MEASURED.index("p1")] - at[MEASURED.index("p2")]) if area else at[MEASURED.index("force")]
    force = loop_gains(specified, reading, at[MEASURED.index("speed")], T_s, "force")
    position, n = NO_LOOP, 1.0
    if file.position is not None:
        w = file.position.crossover
        free = discrete_response(sampled_plant(system, T_s), w)[0, :, 0]
        x, omega = free[MEASURED.index("position")], free[MEASURED.index("speed")]
        n = travel_per_radian(x, omega, w, T_s)
        position = loop_gains(file.position, x, omega, T_s, "position")
    law = ForceLaw(
        force=force,
        position=position,
        stiffness=file.environment.stiffness,
        G_0=G_0,
        n=n,
        area=area,
        contact=file.position.contact if file.position is not None else 0.0,
        limit=specified.limit,
        rate=specified.rate,
        deadband=specified.deadband,
        friction=friction,
        friction_time=specified.friction_time,
        current_limit=file.current_limit,
        sample_time=T_s,
    )
    advice = "lower [force] crossover, design it for a stiffer environment"
    return replace(law, margins=margins_over_stiffness(name, "force", law, system, file.environment, advice))


def margins_over_stiffness(
    name: str, kind: str, law: Any, system: control.StateSpace, environment: Environment, advice: str
) -> RobustMargins:
    """Margins of a law from the softest to the stiffest environment, broken at the current.

    advice: what makes the loop stable, for the message.

    Raises InputError if a loop is unstable.
    """
    stiffnesses = np.geomspace(environment.softest, environment.stiffest, STIFFNESSES)
    models = {f"{1e-3 * K:.5g} kN/m": in_contact(system, K) for K in stiffnesses}
    found = robust_margins(models, SampledController(name, kind, law.sample_time, law.current_limit, law))
    if not found.stable:
        raise InputError(
            f"the {kind} loop is unstable against {', '.join(found.unstable)}; {advice}, or narrow the range from "
            "softest to stiffest"
        )
    return found


kind = ControllerKind(
    "force", "force in contact, position before it, without a bump between them", ForceFile, design_force
)
