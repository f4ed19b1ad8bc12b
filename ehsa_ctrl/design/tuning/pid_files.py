"""Tables of a PID's TOML: gains in one of three forms, the classic design, and what becomes of either."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from ...core.definition import Definition, In, Radian, RadianPerSecond, Second
from ...core.errors import InputError
from ..laws.pid_forms import Gains, Series, Standard
from .loop import position_plant

if TYPE_CHECKING:
    import control

AmperePerMetre = Annotated[float, In("A/m")]


def _between(margin: float) -> float:
    if not 0 < margin < np.pi:
        raise ValueError(f"{np.degrees(margin):.4g} deg; expected a phase margin between 0 and 180 deg")
    return margin


PhaseMargin = Annotated[Radian, AfterValidator(_between)]

#: Keys that each form has beside T_f.
FORMS = {"parallel": ("k_p", "k_i", "k_d"), "standard": ("K", "T_i", "T_d"), "series": ("K", "T_i", "T_d")}


class PidGains(Definition):
    """[gains]: given gains instead of a design, all of them positive; what is left out is not there."""

    form: Literal["parallel", "standard", "series"] = Field(
        default="parallel",
        description="parallel has k_p, k_i, k_d; standard and series have K, T_i, T_d",
    )
    k_p: AmperePerMetre | None = Field(default=None, description="proportional gain of the parallel form")
    k_i: Annotated[float, In("A/(m s)")] | None = Field(default=None, description="integral gain of the parallel form")
    k_d: Annotated[float, In("A s/m")] | None = Field(default=None, description="derivative gain of the parallel form")
    K: AmperePerMetre | None = Field(default=None, description="gain of the standard and series forms")
    T_i: Second | None = Field(default=None, description="integral time")
    T_d: Second | None = Field(default=None, description="derivative time")
    T_f: Second = Field(default=0.0, description="time constant of the derivative filter")

    @model_validator(mode="after")
    def _fit(self) -> PidGains:
        mine = FORMS[self.form]
        given = [name for name in ("k_p", "k_i", "k_d", "K", "T_i", "T_d") if getattr(self, name) is not None]
        strange = [name for name in given if name not in mine]
        if strange or not given:
            got = f"got {', '.join(strange)}" if strange else "got none of them"
            raise ValueError(f"form = {self.form!r} has the keys {', '.join(mine)} and T_f; {got}")
        for name in [*given, "T_f"]:
            value = getattr(self, name)
            if not 0 <= value < np.inf or (name == "T_i" and value == 0):
                raise ValueError(
                    f"{name} = {value:g}; expected {'more than' if name == 'T_i' else 'at least'} 0: a positive "
                    "current extends the rod, so that gains of the other sign drive it away from its target"
                )
        return self

    def parallel(self) -> Gains:
        """These gains in the parallel form."""
        if self.form == "parallel":
            return Gains(self.k_p or 0.0, self.k_i or 0.0, self.k_d or 0.0, self.T_f)
        form = Standard if self.form == "standard" else Series
        return form(self.K or 0.0, np.inf if self.T_i is None else self.T_i, self.T_d or 0.0, self.T_f).parallel()


class PidDesign(Definition):
    """[design]: the classic target of the loop, broken at the current."""

    crossover: RadianPerSecond = Field(description="gain crossover frequency")
    phase_margin: PhaseMargin = Field(description="phase margin at the crossover")
    integral_ratio: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.1,
        description="corner frequency of the integral action over the crossover; small values cost little phase",
    )
    filter_ratio: Annotated[float, Field(gt=1, le=1e6)] = Field(
        default=10.0,
        description="corner frequency of the derivative filter over the crossover",
    )


def classic_gains(design: PidDesign, system: control.StateSpace, sample_time: float) -> Gains:
    """Solve C(z) G(z) = -exp(i margin) at the crossover for k_p and k_d, with k_i = ratio crossover k_p.

    Exact for the loop that runs: the plant behind its hold, the law as difference equation.

    Raises InputError for a crossover beyond the Nyquist frequency, and for a margin that no PID with this filter and
    integral reaches there.
    """
    w = design.crossover
    if not 0 < w < np.pi / sample_time:
        raise InputError(
            f"crossover = {w:g} rad/s must lie between 0 and the Nyquist frequency "
            f"{np.pi / sample_time:.4g} rad/s of sample_time = {sample_time:g} s"
        )
    z = np.exp(1j * np.array([w * sample_time]))
    needed = -np.exp(1j * design.phase_margin) / position_plant(system, sample_time).response(z)[0]
    T_f = 1.0 / (design.filter_ratio * w)
    proportional = Gains(1.0, design.integral_ratio * w).response(z, sample_time)[0]
    derivative = Gains(0.0, 0.0, 1.0, T_f).response(z, sample_time)[0]
    k_p, k_d = np.linalg.solve(
        [[proportional.real, derivative.real], [proportional.imag, derivative.imag]], [needed.real, needed.imag]
    )
    if k_p <= 0 or k_d < 0:
        raise InputError(
            f"a phase margin of {np.degrees(design.phase_margin):.3g} deg at {w:.4g} rad/s needs "
            f"{np.degrees(np.angle(needed)):.3g} deg from the controller, which a PID with "
            f"filter_ratio = {design.filter_ratio:g} and integral_ratio = {design.integral_ratio:g} can't give; "
            "lower the crossover or the margin"
        )
    return Gains(float(k_p), float(design.integral_ratio * w * k_p), float(k_d), T_f)
