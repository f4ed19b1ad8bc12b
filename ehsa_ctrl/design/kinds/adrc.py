"""ADRC: active disturbance rejection control with a linear extended state observer.

The plant is taken as dv/dt = f + b_0 u, where f, all that is unknown, is a state of the observer and is cancelled:

    u = (w_c^2 (r - x) + 2 w_c (v_r - v) + a_r - f) / b_0,    limited to +-current_limit

Both poles of the loop are placed at -w_c and those of the observer at -w_o (Z. Gao, "Scaling and bandwidth-
parameterization based controller tuning", American Control Conference 2003). The observer is the discrete one that uses
the latest measurement (R. Miklosovic, A. Radke, Z. Gao, "Discrete implementation and generalization of the extended
state observer", American Control Conference 2006; G. Herbst, "A simulative study on active disturbance rejection
control (ADRC) as a control tool for practitioners", Electronics 2, 2013). It measures the position (three states), or
the shaft speed (two states), which is far less noisy than a differentiated position.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import AngularFrequency, Definition, InDrive
from ...core.errors import InputError
from ..analysis.closed_loop import law_state_space
from ..analysis.rigid_body import rigid_body
from ..controller import SampledController
from ..words import WordsByUnit
from ._kind import ControllerKind, PositionControllerFile, require_stable

if TYPE_CHECKING:
    import control


class AdrcLoop(Definition):
    """[adrc]: bandwidths of loop and observer."""

    bandwidth: AngularFrequency = Field(gt=0, description="w_c, magnitude of both poles of the position loop")
    observer_ratio: Annotated[float, Field(gt=1, le=100)] = Field(
        default=4.0,
        description="w_o / w_c, the observer's poles over those of the loop; usually 3 to 10. A larger one rejects "
        "disturbances better and passes more noise",
    )
    measurement: Literal["speed", "position"] | None = Field(
        default=None,
        description="what the observer measures: the shaft's speed, or the rod's position alone; by default the speed, "
        "where the plant has a shaft",
    )
    b_0: Annotated[float, InDrive("m/(s2 A)")] | None = Field(
        default=None, gt=0, description="acceleration per current; by default that of the linear model at the bandwidth"
    )


class AdrcFile(PositionControllerFile):
    """An ADRC's TOML."""

    kind: Literal["adrc"] = Field(description="type of feedback law")
    adrc: AdrcLoop = Field(description="bandwidths of loop and observer")

    @model_validator(mode="after")
    def _check_adrc(self) -> AdrcFile:
        nyquist = np.pi / self.sample_time
        w_o = self.adrc.observer_ratio * self.adrc.bandwidth
        if w_o >= nyquist:
            raise ValueError(
                f"[adrc] bandwidth times observer_ratio is {w_o:.4g} rad/s; expected less than {nyquist:.4g} rad/s, "
                "the Nyquist frequency"
            )
        self.refuse_inertia("an adrc", ", by 1 / b_0")
        return self


def adrc_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: b_0, w_c, observer gains l_x, l_v, l_f, travel per radian n where the speed is measured, else 0,
    current_limit, sample time. memory: 1 after the first sample, estimates of x, v, f, last current without `extra`,
    f at the end of the last motion.
    """
    b_0, w_c, l_x, l_v, l_f, n, limit, T_s = settings
    y = measured[3]
    if memory[0] == 0.0:
        memory[0], memory[1] = 1.0, y
    elif hold == 1.0:
        # Friction holds the rod: the model would take the current that does not move it for a disturbance.
        memory[1], memory[2] = y, 0.0
    else:
        if hold < 0.0:
            memory[3] = memory[5]
        pushed = memory[3] + b_0 * memory[4]
        x = memory[1] + T_s * memory[2] + 0.5 * T_s * T_s * pushed
        v = memory[2] + T_s * pushed
        if n > 0.0:
            innovation = n * measured[0] - v
            memory[1] = y
        else:
            innovation = y - x
            memory[1] = x + l_x * innovation
        memory[2] = v + l_v * innovation
        memory[3] += l_f * innovation
    if reference[1] != 0.0:
        memory[5] = memory[3]
    wanted = w_c * w_c * (reference[0] - memory[1]) + 2.0 * w_c * (reference[1] - memory[2]) + reference[2] - memory[3]
    current = min(max(wanted / b_0 + extra, -limit), limit)
    # `extra` balances friction, which is then no part of f.
    memory[4] = current - extra
    return current


def observer_gains(w_o: float, sample_time: float, *, measures_speed: bool) -> tuple[float, float, float]:
    """Gains l_x, l_v [1/s], l_f [1/s2] that place all poles of the sampled observer at exp(-w_o T).

    With the speed, l_x is 0 and l_v [1], l_f [1/s] belong to its error.
    """
    beta, T = exp(-w_o * sample_time), sample_time
    if measures_speed:
        return 0.0, 1.0 - beta**2, (1.0 - beta) ** 2 / T
    return 1.0 - beta**3, 1.5 * (1.0 - beta) ** 2 * (1.0 + beta) / T, (1.0 - beta) ** 3 / T**2


@dataclass(frozen=True)
class Adrc(WordsByUnit):
    """Feedback law of an ADRC, a design.controller.Law.

    Attributes
    ----------
    b_0: m/(s2 A). w_c, w_o: rad/s. n: rod travel per radian of the shaft [m], 0 where the position is measured.
    current_limit: A. sample_time: s.
    """

    b_0: float
    w_c: float
    w_o: float
    n: float
    current_limit: float
    sample_time: float
    function = staticmethod(adrc_law)
    uses = ()
    compiles = True
    traces = {"estimate_x": 1, "estimate_v": 2, "estimate_f": 3}

    @property
    def reads(self) -> tuple[str, ...]:
        return ("position", "speed") if self.n > 0.0 else ("position",)

    def settings(self) -> np.ndarray:
        gains = observer_gains(self.w_o, self.sample_time, measures_speed=self.n > 0.0)
        return np.array([self.b_0, self.w_c, *gains, self.n, self.current_limit, self.sample_time])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(6)

    def linear(self) -> control.StateSpace:
        return law_state_space(replace(self, current_limit=inf), self.sample_time)

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        return (
            f"ADRC, w_c = {self.w_c:.4g} rad/s, w_o = {self.w_o:.4g} rad/s on the "
            f"{'shaft speed' if self.n > 0.0 else 'position'}, b_0 = {self.b_0:.4g} m/(s2 {unit})"
        )


def design_adrc(name: str, file: AdrcFile, system: control.StateSpace) -> Adrc:
    """An ADRC for the linear model `system` (first input the current, outputs x and, for the speed, omega).

    Raises InputError for a model without the shaft's speed where it is measured, and for an unstable loop.
    """
    loop = file.adrc
    body = rigid_body(system, loop.bandwidth)
    if loop.measurement == "speed" and body.n == 0.0:
        raise InputError(f"the model {system.name} has no output omega; take [adrc] measurement = 'position'")
    n = 0.0 if loop.measurement == "position" else body.n
    law = Adrc(
        b_0=body.b_0 if loop.b_0 is None else loop.b_0,
        w_c=loop.bandwidth,
        w_o=loop.observer_ratio * loop.bandwidth,
        n=n,
        current_limit=file.current_limit,
        sample_time=file.sample_time,
    )
    controller = SampledController(name, "adrc", law.sample_time, law.current_limit, law)
    require_stable(system, controller, "lower [adrc] bandwidth or observer_ratio, or raise b_0")
    return law


kind = ControllerKind(
    "adrc",
    "active disturbance rejection with a linear extended state observer",
    AdrcFile,
    design_adrc,
    tunes={"adrc.bandwidth": ("rad/s", 5.0, 150.0), "adrc.observer_ratio": ("1", 1.2, 30.0)},
)
