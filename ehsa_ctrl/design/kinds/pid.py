"""Position PID: controller kind, gains in three forms, design by crossover and phase margin, feedback law.

    parallel   C = k_p + k_i / s + k_d s / (1 + T_f s)
    standard   C = K (1 + 1 / (T_i s) + T_d s / (1 + T_f s))
    series     C = K (1 + 1 / (T_i s)) (1 + T_d s / (1 + T_f s))
    velocity   C = kv (kp + s / (1 + T_f s)): P on the position over P on the velocity, which is its filtered slope

The law is the parallel form with setpoint weights and anti-windup,

    u = k_p (b r - y) + k_i int (r - y) dt + k_d s / (1 + T_f s) (c r - y),    limited to +-current_limit

Forms, filter, weights and anti-windup follow K. J. Astrom, T. Hagglund, "Advanced PID Control", ISA 2006.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from ...core.definition import AngularFrequency, Definition, In, InDrive, Radian, Second
from ...core.errors import InputError
from ..analysis.closed_loop import law_state_space
from ..tuning.constraints import Tuning, position_plant
from ..words import WordsByUnit
from ._kind import ControllerKind, PositionControllerFile

if TYPE_CHECKING:
    import control


def _check_phase_margin(margin: float) -> float:
    if not 0 < margin < np.pi:
        raise ValueError(f"{np.degrees(margin):.4g} deg; expected a phase margin between 0 and 180 deg")
    return margin


DrivePerMetre = Annotated[float, InDrive("A/m")]
DriveSecondPerMetre = Annotated[float, InDrive("A s/m")]
PhaseMargin = Annotated[Radian, AfterValidator(_check_phase_margin)]
Weight = Annotated[float, Field(ge=0, le=1)]

#: Keys of each form, besides T_f.
FORMS = {
    "parallel": ("k_p", "k_i", "k_d"),
    "standard": ("K", "T_i", "T_d"),
    "series": ("K", "T_i", "T_d"),
    "velocity": ("kp", "kv"),
}


@dataclass(frozen=True)
class Gains(WordsByUnit):
    """Parallel form: k_p [A/m], k_i [A/(m s)], k_d [A s/m], filter time constant T_f [s]."""

    k_p: float
    k_i: float = 0.0
    k_d: float = 0.0
    T_f: float = 0.0

    def words(self, unit: str) -> str:
        """The gains with the drive's unit."""
        return (
            f"k_p = {self.k_p:.4g} {unit}/m, k_i = {self.k_i:.4g} {unit}/(m s), k_d = {self.k_d:.4g} {unit} s/m, "
            f"T_f = {self.T_f:.3g} s"
        )

    def response(self, z: Any, sample_time: float) -> Any:
        """Frequency response C(z) [A/m] of the sampled law at points z (n,) of the unit circle.

        Forward differences for the integral, backward differences for the derivative: the filter stays stable and well
        damped for any ratio of T_f and sample time.
        """
        integral = self.k_i * sample_time / (z - 1.0) if self.k_i else 0.0 * z
        derivative = self.k_d * (z - 1.0) / ((self.T_f + sample_time) * z - self.T_f) if self.k_d else 0.0
        return self.k_p + integral + derivative


class PidGains(Definition):
    """[gains]: gains instead of a design, none negative; terms that are left out are zero."""

    form: Literal["parallel", "standard", "series", "velocity"] = Field(
        default="parallel",
        description="parallel has k_p, k_i, k_d; standard and series have K, T_i, T_d; velocity has kp, kv",
    )
    k_p: DrivePerMetre | None = Field(default=None, description="proportional gain of the parallel form")
    k_i: Annotated[float, InDrive("A/(m s)")] | None = Field(
        default=None, description="integral gain of the parallel form"
    )
    k_d: DriveSecondPerMetre | None = Field(default=None, description="derivative gain of the parallel form")
    K: DrivePerMetre | None = Field(default=None, description="gain of the standard and series forms")
    T_i: Second | None = Field(default=None, description="integral time")
    T_d: Second | None = Field(default=None, description="derivative time")
    kp: Annotated[float, In("1/s")] | None = Field(
        default=None, description="velocity per position error, of the velocity form"
    )
    kv: DriveSecondPerMetre | None = Field(default=None, description="drive per velocity error, of the velocity form")
    T_f: Second = Field(default=0.0, description="time constant of the derivative filter")

    @model_validator(mode="after")
    def _check_form(self) -> PidGains:
        keys = FORMS[self.form]
        given = [
            name for name in ("k_p", "k_i", "k_d", "K", "T_i", "T_d", "kp", "kv") if getattr(self, name) is not None
        ]
        foreign = [name for name in given if name not in keys]
        if foreign or not given:
            got = f"got {', '.join(foreign)}" if foreign else "got none of them"
            raise ValueError(f"form = {self.form!r} has the keys {', '.join(keys)} and T_f; {got}")
        for name in [*given, "T_f"]:
            value = getattr(self, name)
            if not 0 <= value < np.inf or (name == "T_i" and value == 0):
                raise ValueError(
                    f"{name} = {value:g}; expected {'more than' if name == 'T_i' else 'at least'} 0: a positive "
                    "current extends the rod, so that a negative gain drives it away from its target"
                )
        return self

    def parallel(self) -> Gains:
        """These gains in the parallel form."""
        if self.form == "parallel":
            return Gains(self.k_p or 0.0, self.k_i or 0.0, self.k_d or 0.0, self.T_f)
        if self.form == "velocity":
            kp, kv = self.kp or 0.0, self.kv or 0.0
            return Gains(kp * kv, 0.0, kv, self.T_f)
        K, T_d, T_f = self.K or 0.0, self.T_d or 0.0, self.T_f
        T_i = inf if self.T_i is None else self.T_i
        if self.form == "standard":
            return Gains(K, K / T_i, K * T_d, T_f)
        return Gains(K * (1.0 + T_d / T_i), K / T_i, K * T_d * (1.0 - T_f / T_i), T_f)


class PidDesign(Definition):
    """[design]: crossover and phase margin of the loop, broken at the current."""

    crossover: AngularFrequency = Field(description="gain crossover frequency")
    phase_margin: PhaseMargin = Field(description="phase margin at the crossover")
    integral_ratio: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.1,
        description="corner frequency of the integral action over the crossover; 0.1 costs some 6 deg of phase",
    )
    filter_ratio: Annotated[float, Field(gt=1, le=1e6)] = Field(
        default=10.0, description="corner frequency of the derivative filter over the crossover"
    )


def classic_gains(design: PidDesign, system: control.StateSpace, sample_time: float) -> Gains:
    """Solve C(z) G(z) = -exp(i margin) at the crossover for k_p and k_d, with k_i = integral_ratio crossover k_p.

    Exact for the sampled loop: the plant with zero-order hold, the law as a difference equation.

    Raises InputError for a crossover beyond the Nyquist frequency, and for a margin that no PID with these ratios
    reaches.
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


class PidLoopFile(PositionControllerFile):
    """Keys of every PID controller."""

    reference_weight: Weight = Field(
        default=1.0, description="b, setpoint weight of the proportional part; below 1 reduces overshoot"
    )
    derivative_reference_weight: Weight = Field(default=0.0, description="c, setpoint weight of the derivative part")
    anti_windup: Literal["back_calculation", "conditional", "none"] = Field(
        default="back_calculation",
        description="back_calculation discharges the integral with the time constant tracking_time while the current "
        "is limited; conditional stops integrating further into the limit; none",
    )
    tracking_time: Second | None = Field(
        default=None,
        description="time constant of back_calculation; by default sqrt(T_i T_d), or T_i without a derivative",
    )

    @model_validator(mode="after")
    def _check_tracking_time(self) -> PidLoopFile:
        if self.tracking_time is not None:
            if self.anti_windup != "back_calculation":
                raise ValueError(f"tracking_time needs anti_windup = 'back_calculation'; got {self.anti_windup!r}")
            if not self.sample_time <= self.tracking_time < np.inf:
                raise ValueError(
                    f"tracking_time = {self.tracking_time:g} s; expected at least sample_time = {self.sample_time:g} s"
                )
        return self

    def law(self, gains: Gains) -> Pid:
        """The law with these gains. Raises InputError for a setpoint weight without integral action."""
        if gains.k_i == 0.0 and self.reference_weight != 1.0:
            raise InputError(
                f"reference_weight = {self.reference_weight:g} without integral action would leave the rod short "
                "of its target; add integral action or keep the weight at 1"
            )
        return Pid(
            gains,
            self.reference_weight,
            self.derivative_reference_weight,
            self.current_limit,
            self._tracking(gains),
            self.anti_windup == "conditional",
            self.sample_time,
        )

    def _tracking(self, gains: Gains) -> float:
        """Time constant of back-calculation [s]; inf for none."""
        if self.anti_windup != "back_calculation" or gains.k_i == 0.0:
            return float("inf")
        if self.tracking_time is not None:
            return self.tracking_time
        T_i = gains.k_p / gains.k_i
        T_t = np.sqrt(gains.k_d / gains.k_i) if gains.k_d > 0 else T_i
        return float(max(T_t, self.sample_time))


class PidFile(PidLoopFile):
    """A PID's TOML, with one of [design], [tuning] and [gains]."""

    kind: Literal["pid"] = Field(description="type of feedback law")
    design: PidDesign | None = Field(
        default=None, description="crossover and phase margin; exactly one of [design], [tuning] and [gains]"
    )
    tuning: Tuning | None = Field(
        default=None, description="optimised gains; exactly one of [design], [tuning] and [gains]"
    )
    gains: PidGains | None = Field(
        default=None, description="given gains; exactly one of [design], [tuning] and [gains]"
    )

    @model_validator(mode="after")
    def _check_one_table(self) -> PidFile:
        given = [name for name in ("design", "tuning", "gains") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "expected one of the tables [design], [tuning] and [gains]; got " + (" and ".join(given) or "none")
            )
        return self


def pid_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: k_p, k_i, k_d, T_f, b, c, current_limit, back-calculation rate [1/s], 1 for conditional integration,
    sample time. memory: integral part [A], filtered derivative part [A], c r - y of the last sample, 1 after the first
    sample, integral part at the end of the last motion [A].
    """
    k_p, k_i, k_d, T_f, b, c, limit, back, conditional, T_s = settings
    r, y = reference[0], measured[3]
    if memory[3] == 0.0:
        # Bumpless start: the loop begins at rest at y, so that the weight b causes no step if r = y.
        memory[0] = k_p * (1.0 - b) * y if k_i != 0.0 else 0.0
        memory[2] = c * r - y
        memory[3] = 1.0
    if hold < 0.0:
        memory[0] = memory[4]
    # Backward differences: the filter stays stable and well damped for any ratio of T_f and sample time.
    memory[1] = (T_f * memory[1] + k_d * (c * r - y - memory[2])) / (T_f + T_s)
    memory[2] = c * r - y
    wanted = k_p * (b * r - y) + memory[0] + memory[1] + extra
    current = min(max(wanted, -limit), limit)
    if hold == 0.0:
        rate = k_i * (r - y)
        if conditional == 0.0 or (wanted - current) * rate <= 0.0:
            memory[0] += T_s * rate
        memory[0] += T_s * back * (current - wanted)
    if reference[1] != 0.0:
        memory[4] = memory[0]
    return current


@dataclass(frozen=True)
class Pid(WordsByUnit):
    """Feedback law of a position PID, a design.controller.Law.

    Attributes
    ----------
    gains: parallel form.
    b, c: setpoint weights of the proportional and the derivative part.
    current_limit: A. sample_time: s.
    T_t: time constant of back-calculation [s]; inf for none.
    conditional: whether integration further into the limit stops while the current is limited.
    """

    gains: Gains
    b: float
    c: float
    current_limit: float
    T_t: float
    conditional: bool
    sample_time: float
    function = staticmethod(pid_law)
    uses = ()
    compiles = True
    reads = ("position",)
    traces = {"integral": 0}

    def settings(self) -> np.ndarray:
        g, conditional = self.gains, float(self.conditional)
        limits = self.current_limit, 1.0 / self.T_t, conditional, self.sample_time
        return np.array([g.k_p, g.k_i, g.k_d, g.T_f, self.b, self.c, *limits])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(5)

    def linear(self) -> control.StateSpace:
        return law_state_space(replace(self, current_limit=inf), self.sample_time)

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        return f"parallel PID, {self.gains.words(unit)}"


def designed_gains(file: Any, system: control.StateSpace) -> Gains:
    """Gains by [design] or [tuning] of a PidLoopFile. Raises InputError if that is infeasible for this model."""
    if file.design is not None:
        return classic_gains(file.design, system, file.sample_time)
    # Imported here, because the tuner imports this module for its loop analysis.
    from ..tuning.tune import tune_once

    weights = file.reference_weight, file.derivative_reference_weight
    return tune_once(system, file.tuning, file.sample_time, *weights).gains


def design_pid(name: str, file: PidFile, system: control.StateSpace) -> Pid:
    """A PID for the linear model `system` (first input the current, an output x).

    Raises InputError for a [design] or [tuning] that is infeasible for this model, with the nearest values.
    """
    return file.law(file.gains.parallel() if file.gains is not None else designed_gains(file, system))


kind = ControllerKind(
    "pid",
    "position PID with filtered derivative and anti-windup",
    PidFile,
    design_pid,
    tunes={
        "design.crossover": ("rad/s", 5.0, 150.0),
        "design.phase_margin": ("rad", 0.5, 1.4),
        "design.integral_ratio": ("1", 0.01, 0.5),
        "design.filter_ratio": ("1", 1.5, 50.0),
    },
)
