"""Cascade: the controller kind with an outer P or PI loop on the rod's position over a PI loop on the shaft speed.

    omega_r = (f v_r + k_x (r - x) + k_ix int (r - x) dt) / n,    limited to +-speed_limit
    u = k_w (omega_r - omega) + k_iw int (omega_r - omega) dt,    limited to +-current_limit

n is the rod's travel per radian of the shaft, f the velocity feedforward factor. The usual structure of servo drives
(e.g. W. Leonhard, "Control of Electrical Drives", 3rd ed. 2001, chapter 7). Where the plant has no shaft, the rod's own
speed takes its place, from filtered differences of the position, with n = 1 and m/s for rad/s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.controller_interface import MEASURED
from ...core.definition import AngularFrequency, Definition, In, RadianPerSecond
from ...core.errors import InputError
from ..analysis.closed_loop import discrete_response, law_state_space
from ..analysis.sampled import sampled_plant
from ..words import WordsByUnit
from ._kind import ControllerKind, PositionControllerFile
from ._rod_speed import MEMORY, take_rod_speed
from .pid import Gains, PhaseMargin

if TYPE_CHECKING:
    import control


class SpeedLoop(Definition):
    """[speed]: the inner loop, PI on the shaft's speed."""

    crossover: AngularFrequency = Field(
        description="gain crossover frequency of this loop alone; usually three to five times that of the position loop"
    )
    phase_margin: PhaseMargin = Field(description="phase margin at the crossover")
    filter_ratio: Annotated[float, Field(gt=1, le=1e6)] = Field(
        default=10.0,
        description="corner frequency of the filter of the rod's speed over the crossover, where the plant has no "
        "shaft and the speed is taken from the position",
    )


class PositionLoop(Definition):
    """[position]: the outer loop, broken at the speed reference."""

    crossover: AngularFrequency = Field(description="gain crossover frequency")
    phase_margin: PhaseMargin = Field(
        default=float(np.radians(60.0)), description="smallest phase margin at the crossover"
    )
    integral_ratio: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.0,
        description="corner frequency of the integral action over the crossover; 0 for none, as the speed loop "
        "integrates",
    )
    speed_limit: RadianPerSecond | None = Field(
        default=None, gt=0, description="largest shaft speed reference; required where the plant has a shaft"
    )
    velocity_limit: Annotated[float, In("m/s")] | None = Field(
        default=None, gt=0, description="largest reference of the rod's speed; required where the plant has no shaft"
    )
    velocity_feedforward: Annotated[float, Field(ge=0, le=1)] = Field(
        default=1.0, description="fraction of the planned velocity that is fed forward"
    )


class CascadeFile(PositionControllerFile):
    """A cascade's TOML."""

    kind: Literal["cascade"] = Field(description="type of feedback law")
    speed: SpeedLoop = Field(description="inner loop")
    position: PositionLoop = Field(description="outer loop")

    @model_validator(mode="after")
    def _check_crossovers(self) -> CascadeFile:
        nyquist = np.pi / self.sample_time
        if not 0 < self.position.crossover < self.speed.crossover < nyquist:
            raise ValueError(
                f"crossovers {self.position.crossover:g} (position) and {self.speed.crossover:g} rad/s (speed): "
                f"expected 0 < position < speed < {nyquist:.4g} rad/s, the Nyquist frequency"
            )
        return self


def cascade_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: k_x, k_ix, 1 / n, f, speed_limit, k_w, k_iw, current_limit, back-calculation rate [1/s], sample time.
    memory: integral of the speed loop [A], integral of the position loop [m/s], speed reference [rad/s].
    """
    k_x, k_ix, per_metre, f, fastest, k_w, k_iw, limit, back, T_s = settings
    error = reference[0] - measured[3]
    unlimited = per_metre * (f * reference[1] + k_x * error + memory[1])
    memory[2] = min(max(unlimited, -fastest), fastest)
    wanted = k_w * (memory[2] - measured[0]) + memory[0] + extra
    current = min(max(wanted, -limit), limit)
    if hold == 0.0:
        # While speed reference or current is limited, the outer loop does not integrate further into the limit.
        if (unlimited - memory[2]) * error <= 0.0 and (wanted - current) * error <= 0.0:
            memory[1] += T_s * k_ix * error
        memory[0] += T_s * (k_iw * (memory[2] - measured[0]) + back * (current - wanted))
    return current


def rod_cascade_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above with the rod's speed in place of the shaft's.

    settings: filter time constant, those of `cascade_law`. memory: that of `cascade_law`, that of `take_rod_speed`.
    """
    take_rod_speed(measured, memory[3:], settings[0], settings[10])
    return cascade_law(reference, memory[5:], memory, settings[1:], extra, hold)


@dataclass(frozen=True)
class Cascade(WordsByUnit):
    """Feedback law of a cascade, a design.controller.Law.

    Attributes
    ----------
    k_x [1/s], k_ix [1/s2]: position loop. k_w [A s/rad], k_iw [A/rad]: speed loop.
    n: rod travel per radian of the shaft [m]. f: velocity feedforward factor.
    speed_limit: rad/s. current_limit: A. sample_time: s.
    """

    k_x: float
    k_ix: float
    k_w: float
    k_iw: float
    n: float
    f: float
    speed_limit: float
    current_limit: float
    sample_time: float
    function = staticmethod(cascade_law)
    uses: ClassVar[tuple[Callable[..., Any], ...]] = ()
    compiles = True
    reads: ClassVar[tuple[str, ...]] = ("position", "speed")
    traces = {"integral": 0, "speed_reference": 2}

    def settings(self) -> np.ndarray:
        # Back-calculation with the integral time of the speed loop, but no faster than one sample.
        back = min(self.k_iw / self.k_w, 1.0 / self.sample_time)
        outer = [self.k_x, self.k_ix, 1.0 / self.n, self.f, self.speed_limit]
        return np.array([*outer, self.k_w, self.k_iw, self.current_limit, back, self.sample_time])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(3)

    def linear(self) -> control.StateSpace:
        return law_state_space(replace(self, speed_limit=inf, current_limit=inf), self.sample_time)

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        return (
            f"position over speed, k_x = {self.k_x:.4g} 1/s, k_ix = {self.k_ix:.4g} 1/s2, "
            f"k_w = {self.k_w:.4g} {unit} s/rad, k_iw = {self.k_iw:.4g} {unit}/rad"
        )


@dataclass(frozen=True)
class RodCascade(Cascade):
    """A cascade whose inner loop takes the rod's speed from the position, a design.controller.Law.

    Attributes
    ----------
    those of Cascade with m for rad, n = 1, and
    T_f: time constant of the speed's filter [s].
    """

    T_f: float = 0.0
    function = staticmethod(rod_cascade_law)
    uses = (take_rod_speed, cascade_law)
    reads = ("position",)

    def settings(self) -> np.ndarray:
        return np.append(self.T_f, super().settings())

    def initial_memory(self) -> np.ndarray:
        return np.zeros(3 + MEMORY)

    def words(self, unit: str) -> str:
        return (
            f"position over the rod's speed, k_x = {self.k_x:.4g} 1/s, k_ix = {self.k_ix:.4g} 1/s2, "
            f"k_w = {self.k_w:.4g} {unit} s/m, k_iw = {self.k_iw:.4g} {unit}/m, T_f = {self.T_f:.3g} s"
        )


def design_cascade(name: str, file: CascadeFile, system: control.StateSpace) -> Cascade:
    """Both loops for the linear model `system` (first input the current, outputs x and that of a shaft, omega), exactly
    sampled.

    Raises InputError for a limit that the plant has no speed for, and for an infeasible phase margin, with the feasible
    one.
    """
    T_s, has_shaft = file.sample_time, "omega" in system.output_labels
    limit = _speed_limit(file.position, system.name, has_shaft=has_shaft)
    plant = sampled_plant(system, T_s)
    T_f = 1.0 / (file.speed.filter_ratio * file.speed.crossover)

    def responses(w: float) -> tuple[complex, complex]:
        """From the current to the inner loop's speed and to the position."""
        at = discrete_response(plant, w)[0, :, 0]
        G_x = at[MEASURED.index("position")]
        derivative = Gains(0.0, 0.0, 1.0, T_f).response(np.exp(1j * np.array([w * T_s])), T_s)[0]
        return (at[MEASURED.index("speed")] if has_shaft else derivative * G_x), G_x

    k_w, k_iw = _speed_gains(file.speed, responses(file.speed.crossover)[0], T_s)
    w = file.position.crossover
    z = np.exp(1j * w * T_s)
    G_w, G_x = responses(w)
    # Rod travel per radian at the outer crossover, leakage and compressibility included.
    n = float(abs((z - 1.0) / T_s * G_x / G_w)) if has_shaft else 1.0
    inner = k_w + k_iw * T_s / (z - 1.0)
    loop = (1.0 + file.position.integral_ratio * w * T_s / (z - 1.0)) / n * inner * G_x / (1.0 + inner * G_w)
    margin = float(np.pi + np.angle(loop))
    margin = margin if margin <= np.pi else margin - 2 * np.pi
    if margin < file.position.phase_margin:
        raise InputError(
            f"the position loop has a phase margin of {np.degrees(margin):.3g} deg at {w:.4g} rad/s, less than the "
            f"specified {np.degrees(file.position.phase_margin):.3g} deg; lower its crossover or integral_ratio, "
            "or make the speed loop faster"
        )
    k_x = float(1.0 / abs(loop))
    law = Cascade(
        k_x=k_x,
        k_ix=file.position.integral_ratio * w * k_x,
        k_w=k_w,
        k_iw=k_iw,
        n=n,
        f=file.position.velocity_feedforward,
        speed_limit=limit,
        current_limit=file.current_limit,
        sample_time=T_s,
    )
    return law if has_shaft else RodCascade(**vars(law), T_f=T_f)


def _speed_limit(position: PositionLoop, name: str, *, has_shaft: bool) -> float:
    """The limit of the speed reference [rad/s], or of the rod's [m/s] without a shaft. name: of the model."""
    key, other = ("speed_limit", "velocity_limit") if has_shaft else ("velocity_limit", "speed_limit")
    limit = getattr(position, key)
    if limit is None or getattr(position, other) is not None:
        has, unit = ("a shaft", "rad/s") if has_shaft else ("no shaft", "m/s")
        raise InputError(
            f"the model {name} has {has}: expected [position] {key} in {unit}, such as --spec "
            f"position.{key}='{'400' if has_shaft else '0.5'} {unit}', and no {other}"
        )
    return float(limit)


def _speed_gains(specified: SpeedLoop, G: complex, sample_time: float) -> tuple[float, float]:
    """k_w, k_iw of the inner PI for the specified crossover and phase margin; G: response of the speed there."""
    z = np.exp(1j * np.array([specified.crossover * sample_time]))
    needed = -np.exp(1j * specified.phase_margin) / G
    integral = Gains(0.0, 1.0).response(z, sample_time)[0]
    k_i = float(needed.imag / integral.imag)
    k_p = float(needed.real - k_i * integral.real)
    if k_p <= 0 or k_i < 0:
        most = np.degrees(np.angle(-G))
        raise InputError(
            f"a phase margin of {np.degrees(specified.phase_margin):.3g} deg at {specified.crossover:.4g} rad/s is "
            f"infeasible in the speed loop, which has {most:.3g} deg there without integral action; "
            + ("lower the crossover or the margin" if k_i < 0 else "specify a larger margin")
        )
    return k_p, k_i


kind = ControllerKind(
    "cascade",
    "position over speed: PI on the shaft under P or PI on the rod",
    CascadeFile,
    design_cascade,
    tunes={
        "speed.crossover": ("rad/s", 20.0, 400.0),
        "speed.phase_margin": ("rad", 0.5, 1.5),
        "position.crossover": ("rad/s", 5.0, 150.0),
    },
)
