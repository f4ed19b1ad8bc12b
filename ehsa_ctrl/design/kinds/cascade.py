"""Cascade: position over speed, both loops designed on the linear model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.controller_interface import MEASURED
from ...core.definition import Definition, RadianPerSecond
from ...core.errors import InputError
from ..analysis.closed_loop import discrete_response
from ..analysis.sampled import sampled_plant
from ..laws.cascade import Cascade
from ..laws.pid_forms import Gains
from ..tuning.pid_files import PhaseMargin
from ._kind import ControllerFile, ControllerKind

if TYPE_CHECKING:
    import control


class SpeedLoop(Definition):
    """[speed]: the inner loop, PI on the shaft's speed."""

    crossover: RadianPerSecond = Field(
        description="gain crossover frequency of this loop alone; three to five times that of the position loop",
    )
    phase_margin: PhaseMargin = Field(description="phase margin at the crossover")


class PositionLoop(Definition):
    """[position]: the outer loop, broken at the speed that it asks for."""

    crossover: RadianPerSecond = Field(description="gain crossover frequency")
    phase_margin: PhaseMargin = Field(
        default=float(np.radians(60.0)), description="least phase margin at the crossover"
    )
    integral_ratio: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.0,
        description="corner frequency of the integral action over the crossover; 0: no integral, the speed loop has "
        "one",
    )
    speed_limit: RadianPerSecond = Field(description="largest shaft speed reference")
    velocity_feedforward: Annotated[float, Field(ge=0, le=1)] = Field(
        default=1.0,
        description="share of the planned velocity that is fed forward",
    )


class CascadeFile(ControllerFile):
    """A cascade's TOML."""

    kind: Literal["cascade"] = Field(description="type of feedback law")
    speed: SpeedLoop = Field(description="inner loop")
    position: PositionLoop = Field(description="outer loop")

    @model_validator(mode="after")
    def _fit(self) -> CascadeFile:
        nyquist = np.pi / self.sample_time
        if not 0 < self.position.crossover < self.speed.crossover < nyquist:
            raise ValueError(
                f"crossovers {self.position.crossover:g} (position) and {self.speed.crossover:g} rad/s (speed): "
                f"expected 0 < position < speed < {nyquist:.4g} rad/s, half the sampling's"
            )
        if not 0 < self.position.speed_limit < np.inf:
            raise ValueError(
                f"[position] speed_limit = {self.position.speed_limit:g} rad/s; expected more than 0 rad/s"
            )
        return self


def design_cascade(name: str, file: CascadeFile, system: control.StateSpace) -> Cascade:
    """Both loops for the linear model `system` (first input the current, outputs omega and x), exactly sampled.

    Raises
    ------
    InputError: a margin that the loops can't have at these crossovers; says what they have.
    """
    if "omega" not in system.output_labels:
        raise InputError(f"the model {system.name} has no output omega; a cascade needs the shaft's speed")
    T_s = file.sample_time
    plant = sampled_plant(system, T_s)
    k_w, k_iw = _speed_gains(file.speed, plant, T_s)
    w = file.position.crossover
    z = np.exp(1j * w * T_s)
    at = discrete_response(plant, w)[0, :, 0]
    G_w, G_x = at[MEASURED.index("speed")], at[MEASURED.index("position")]
    # The rod's way per radian where the outer loop works: the oil's leak and compression are part of it.
    n = float(abs((z - 1.0) / T_s * G_x / G_w))
    inner = k_w + k_iw * T_s / (z - 1.0)
    loop = (1.0 + file.position.integral_ratio * w * T_s / (z - 1.0)) / n * inner * G_x / (1.0 + inner * G_w)
    margin = float(np.pi + np.angle(loop))
    margin = margin if margin <= np.pi else margin - 2 * np.pi
    if margin < file.position.phase_margin:
        raise InputError(
            f"the position loop has a phase margin of {np.degrees(margin):.3g} deg at {w:.4g} rad/s, less than the "
            f"{np.degrees(file.position.phase_margin):.3g} deg asked for; lower its crossover or integral_ratio, "
            "or make the speed loop faster"
        )
    k_x = float(1.0 / abs(loop))
    return Cascade(
        k_x=k_x,
        k_ix=file.position.integral_ratio * w * k_x,
        k_w=k_w,
        k_iw=k_iw,
        n=n,
        f=file.position.velocity_feedforward,
        speed_limit=file.position.speed_limit,
        current_limit=file.current_limit,
        sample_time=T_s,
    )


def _speed_gains(asked: SpeedLoop, plant: control.StateSpace, sample_time: float) -> tuple[float, float]:
    """k_w, k_iw of the inner PI that has the crossover and the phase margin asked for, exactly."""
    z = np.exp(1j * np.array([asked.crossover * sample_time]))
    G = discrete_response(plant, asked.crossover)[0, MEASURED.index("speed"), 0]
    needed = -np.exp(1j * asked.phase_margin) / G
    integral = Gains(0.0, 1.0).response(z, sample_time)[0]
    k_i = float(needed.imag / integral.imag)
    k_p = float(needed.real - k_i * integral.real)
    if k_p <= 0 or k_i < 0:
        most = np.degrees(np.angle(-G))
        raise InputError(
            f"a phase margin of {np.degrees(asked.phase_margin):.3g} deg at {asked.crossover:.4g} rad/s can't be had "
            f"in the speed loop, which has {most:.3g} deg there without integral action; "
            + ("lower the crossover or the margin" if k_i < 0 else "ask for a larger margin")
        )
    return k_p, k_i


kind = ControllerKind(
    "cascade", "position over speed: PI on the shaft under P or PI on the rod", CascadeFile, design_cascade
)
