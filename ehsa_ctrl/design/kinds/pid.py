"""Position PID: a sampled controller with filtered derivative, two degrees of freedom and anti-windup.

Parallel form

    u = k_p (b r - y) + k_i int (r - y) dt + k_d s / (1 + T_f s) (c r - y),    then limited to +-current_limit,

and back-calculation: while the current is limited, the integral is drawn back with the time constant T_t. After
K. J. Astrom, T. Hagglund, "Advanced PID Control", ISA 2006 (form, filter, weights, back-calculation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from ...core.definition import Ampere, Definition, Radian, RadianPerSecond, Second
from ...core.errors import InputError
from ..frequency import sampled_response
from ._kind import ControllerKind

if TYPE_CHECKING:
    import control


def pid_step(reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> float:
    """One sample of the law above; the same text is run plain and compiled.

    settings: k_p, k_i, k_d, T_f, b, c, current_limit, T_t, sample time. memory: integral part [A], filtered derivative
    part [A], b r and y and c r - y of the last sample, and whether there was one.
    """
    k_p, k_i, k_d, T_f, b, c, limit, T_t, T_s = settings
    r, y = reference[0], measured[3]
    if memory[3] == 0.0:
        memory[2] = c * r - y
        memory[3] = 1.0
    # Backward differences: the filter stays stable and well damped for any ratio of T_f and sample time.
    memory[1] = (T_f * memory[1] + k_d * (c * r - y - memory[2])) / (T_f + T_s)
    memory[2] = c * r - y
    wanted = k_p * (b * r - y) + memory[0] + memory[1]
    current = min(max(wanted, -limit), limit)
    memory[0] += T_s * (k_i * (r - y) + (current - wanted) / T_t)
    return current


@lru_cache(maxsize=1)
def _compiled() -> Callable[..., float]:
    import numba

    vector = numba.float64[::1]
    return numba.njit(numba.float64(vector, vector, vector, vector), cache=True)(pid_step)


@dataclass(frozen=True)
class Pid:
    """A tuned position PID; gains in A/m, A/(m s), A s/m.

    Attributes
    ----------
    name: for tables.
    k_p, k_i, k_d: parallel form.
    T_f: filter time constant of the derivative [s].
    b, c: weights of the reference in the proportional and the derivative part.
    current_limit: A.
    T_t: time constant of back-calculation [s].
    sample_time: s.
    """

    name: str
    k_p: float
    k_i: float
    k_d: float
    T_f: float
    b: float
    c: float
    current_limit: float
    T_t: float
    sample_time: float

    @property
    def compiled(self) -> Callable[..., float]:
        return _compiled()

    def settings(self) -> np.ndarray:
        return np.array(
            [self.k_p, self.k_i, self.k_d, self.T_f, self.b, self.c, self.current_limit, self.T_t, self.sample_time]
        )

    def initial_memory(self) -> np.ndarray:
        return np.zeros(4)

    def step(self, reference: np.ndarray, measured: np.ndarray, memory: np.ndarray) -> float:
        return float(pid_step(reference, measured, memory, self.settings()))

    def feedback(self) -> control.TransferFunction:
        """Continuous transfer function from e = r - y to the current (no limit, b = c = 1)."""
        import control

        s = control.tf("s")
        return self.k_p + self.k_i / s + self.k_d * s / (1 + self.T_f * s)

    def __str__(self) -> str:
        return (
            f"{self.name}: parallel PID, k_p = {self.k_p:.4g} A/m, k_i = {self.k_i:.4g} A/(m s), "
            f"k_d = {self.k_d:.4g} A s/m, T_f = {self.T_f:.3g} s, |current| <= {self.current_limit:g} A, "
            f"every {self.sample_time:g} s"
        )


class PidDesign(Definition):
    """What is asked of the loop, broken at the current.

    crossover: frequency at which the loop gain is 1.
    phase_margin: there.
    integral_ratio: corner of the integral action over the crossover; small keeps its phase lag small.
    filter_ratio: corner of the derivative's filter over the crossover.
    """

    crossover: RadianPerSecond
    phase_margin: Radian
    integral_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.1
    filter_ratio: Annotated[float, Field(gt=1)] = 10.0


class PidGains(Definition):
    """Given gains instead of a design, parallel form in SI units (A/m, A/(m s), A s/m, s)."""

    k_p: float
    k_i: float = 0.0
    k_d: float = 0.0
    T_f: float = 0.0


class PidFile(Definition):
    """A PID's TOML."""

    schema_version: Literal[1] = Field(alias="schema")
    kind: Literal["pid"]
    title: str
    note: str = ""
    sample_time: Second = 0.004
    current_limit: Ampere
    reference_weight: float = 1.0
    derivative_reference_weight: float = 0.0
    tracking_time: Second | None = None
    design: PidDesign | None = None
    gains: PidGains | None = None


def design_pid(name: str, file: PidFile, system: control.StateSpace) -> Pid:
    """A PID from its definition, tuned on the linear model `system` (input 0: current, an output named x).

    With a [design] table: gains that give the crossover and the phase margin asked for, exactly, on the model with
    its hold. With a [gains] table: those gains.

    Raises
    ------
    InputError: neither or both tables, or a phase margin that no PID with this filter reaches at this crossover.
    """
    if (file.design is None) == (file.gains is None):
        raise InputError(f"controller {name}: give either a [design] table or a [gains] table")
    if file.sample_time <= 0 or file.current_limit <= 0:
        raise InputError(f"controller {name}: sample_time and current_limit must be greater than zero")
    if file.gains is not None:
        k_p, k_i, k_d, T_f = file.gains.k_p, file.gains.k_i, file.gains.k_d, file.gains.T_f
    else:
        assert file.design is not None
        k_p, k_i, k_d, T_f = _gains(name, file.design, system, file.sample_time)
    T_i = k_p / k_i if k_i else np.inf
    T_d = k_d / k_p if k_p else 0.0
    default = np.sqrt(T_i * T_d) if T_d > 0 and np.isfinite(T_i) else T_i
    T_t = file.tracking_time or (default if np.isfinite(default) else 1.0)
    if T_t < file.sample_time:
        raise InputError(f"controller {name}: tracking_time = {T_t:g} s is shorter than the sample time")
    return Pid(
        name,
        k_p,
        k_i,
        k_d,
        T_f,
        file.reference_weight,
        file.derivative_reference_weight,
        file.current_limit,
        float(T_t),
        file.sample_time,
    )


def _gains(
    name: str, design: PidDesign, system: control.StateSpace, sample_time: float
) -> tuple[float, float, float, float]:
    """Solve C(i w_c) G(i w_c) = -exp(i margin) for k_p and k_d with k_i = ratio w_c k_p."""
    w = design.crossover
    if not 0 < w < np.pi / sample_time:
        raise InputError(
            f"controller {name}: crossover = {w:g} rad/s must lie between 0 and the Nyquist frequency "
            f"{np.pi / sample_time:.4g} rad/s of its sample time"
        )
    needed = -np.exp(1j * design.phase_margin) / sampled_response(system, "x", w, sample_time)
    T_f = 1.0 / (design.filter_ratio * w)
    proportional = 1.0 + design.integral_ratio / 1j
    derivative = 1j * w / (1.0 + 1j * w * T_f)
    k_p, k_d = np.linalg.solve(
        [[proportional.real, derivative.real], [proportional.imag, derivative.imag]], [needed.real, needed.imag]
    )
    if k_p <= 0 or k_d < 0:
        phase = np.degrees(np.angle(needed))
        raise InputError(
            f"controller {name}: a phase margin of {np.degrees(design.phase_margin):.3g} deg at {w:.4g} rad/s needs "
            f"{phase:.3g} deg from the controller, which a PID with filter_ratio = {design.filter_ratio:g} and "
            f"integral_ratio = {design.integral_ratio:g} can't give; lower the crossover or the margin"
        )
    return float(k_p), float(design.integral_ratio * w * k_p), float(k_d), T_f


kind = ControllerKind("pid", "position PID with filtered derivative and anti-windup", PidFile, design_pid)
