"""Sliding mode with a boundary layer: the controller kind that bounds what an uncertain plant can do.

    e = x - r,   s = de/dt + 2 lambda e + lambda^2 int e dt
    u_hat = (a_r + c v - 2 lambda de/dt - lambda^2 e) / b_0
    u = u_hat - k sat(s / phi),    k = beta (F + eta) + (beta - 1) |u_hat|,    limited to +-current_limit

The plant is dv/dt = b_0 u - c v + disturbance with a gain between b_0 / beta and beta b_0 and a disturbance of at most
F in amperes; outside the boundary layer |s| <= phi the law then drives s into it, at b_0 eta / beta or faster (J.-J.
E. Slotine, W. Li, "Applied Nonlinear Control", Prentice Hall 1991, chapter 7). The thickness phi = k b_0 / lambda_phi
follows k, so that within the layer the law is linear and its margins are those of a loop with poles at -lambda,
-lambda and -lambda_phi. The integral acts within the layer alone, so that it does not wind up (S. Seshagiri, H. K.
Khalil, "Robust output feedback regulation of minimum-phase nonlinear systems using conditional integrators",
Automatica 41, 2005). The velocity is that of the shaft.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Ampere, AngularFrequency, Definition
from ...core.errors import InputError
from ..analysis.closed_loop import law_state_space
from ..analysis.rigid_body import rigid_body
from ..controller import SampledController
from ..review_checks import ReviewContext, ReviewFinding
from ._kind import ControllerKind, PositionControllerFile, require_stable

if TYPE_CHECKING:
    import control


class SlidingSurface(Definition):
    """[sliding_mode]: surface, boundary layer, and the uncertainty that it must bear."""

    bandwidth: AngularFrequency = Field(
        gt=0, description="lambda, magnitude of both poles of the motion on the surface"
    )
    layer_ratio: Annotated[float, Field(gt=0, le=20)] = Field(
        default=1.0,
        description="lambda_phi / lambda, bandwidth of s within the boundary layer over that of the surface",
    )
    disturbance: Ampere = Field(
        gt=0, description="F, largest disturbance as a current: friction and load that nothing feeds forward"
    )
    gain_margin: Annotated[float, Field(ge=1, le=5)] = Field(
        default=1.2, description="beta, largest factor on the plant's gain to either side"
    )
    reaching: Ampere = Field(
        default=0.2,
        gt=0,
        description="eta, current left over for reaching the boundary layer at the largest disturbance",
    )


class SlidingModeFile(PositionControllerFile):
    """A sliding-mode controller's TOML."""

    kind: Literal["sliding_mode"] = Field(description="type of feedback law")
    sliding_mode: SlidingSurface = Field(description="surface, boundary layer and uncertainty")

    @model_validator(mode="after")
    def _check_sliding_mode(self) -> SlidingModeFile:
        surface, nyquist = self.sliding_mode, np.pi / self.sample_time
        fastest = max(1.0, surface.layer_ratio) * surface.bandwidth
        if fastest >= nyquist:
            raise ValueError(
                f"[sliding_mode] bandwidth with layer_ratio is {fastest:.4g} rad/s; expected less than "
                f"{nyquist:.4g} rad/s, the Nyquist frequency"
            )
        self.refuse_inertia("a sliding mode", ", by 1 / b_0")
        return self


def sliding_mode_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: b_0, c, n, lambda, lambda_phi, beta (F + eta) [A], beta - 1, current_limit, sample time.
    memory: int e dt [m s], s [m/s], k sat(s / phi) [A], the integral at the end of the last motion.
    """
    b_0, c, n, bandwidth, layer, least, share, limit, T_s = settings
    e, v = measured[3] - reference[0], n * measured[0]
    slope = v - reference[1]
    if hold < 0.0:
        memory[0] = memory[3]
    s = slope + 2.0 * bandwidth * e + bandwidth * bandwidth * memory[0]
    estimate = (reference[2] + c * v - 2.0 * bandwidth * slope - bandwidth * bandwidth * e) / b_0
    k = least + share * abs(estimate)
    pushed = layer * s / b_0
    switching = min(max(pushed, -k), k)
    wanted = estimate - switching + extra
    current = min(max(wanted, -limit), limit)
    # Where law or drive saturates, the integral only moves back.
    if hold == 0.0 and ((switching == pushed and current == wanted) or s * e < 0.0):
        memory[0] += T_s * e
    if reference[1] != 0.0:
        memory[3] = memory[0]
    memory[1], memory[2] = s, switching
    return current


@dataclass(frozen=True)
class SlidingMode:
    """Feedback law of a sliding mode, a design.controller.Law.

    Attributes
    ----------
    b_0 [m/(s2 A)], c [1/s], n [m]: of the rigid body. bandwidth, layer: lambda and lambda_phi [rad/s].
    disturbance, reaching: F, eta [A]. gain_margin: beta. current_limit: A. sample_time: s.
    """

    b_0: float
    c: float
    n: float
    bandwidth: float
    layer: float
    disturbance: float
    reaching: float
    gain_margin: float
    current_limit: float
    sample_time: float
    function = staticmethod(sliding_mode_law)
    uses = ()
    compiles = True
    reads = ("position", "speed")
    traces = {"integral": 0, "s": 1, "switching": 2}

    @property
    def k(self) -> float:
        """k at rest on the target [A]."""
        return self.gain_margin * (self.disturbance + self.reaching)

    @property
    def layer_error(self) -> float:
        """Position error [m] at the edge of the boundary layer, at rest and without integral."""
        return self.k * self.b_0 / (2.0 * self.bandwidth * self.layer)

    def settings(self) -> np.ndarray:
        body = [self.b_0, self.c, self.n]
        surface = [self.bandwidth, self.layer, self.k, self.gain_margin - 1.0]
        return np.array([*body, *surface, self.current_limit, self.sample_time])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(4)

    def linear(self) -> control.StateSpace:
        """The law within its boundary layer."""
        return law_state_space(replace(self, disturbance=inf, current_limit=inf), self.sample_time)

    def findings(self, case: ReviewContext) -> Iterator[ReviewFinding]:
        """What a design review says of a sliding mode; margins are those within the boundary layer."""
        yield ReviewFinding(
            "boundary layer",
            f"k = {self.k:.3g} A at rest; linear for errors up to {1e3 * self.layer_error:.3g} mm, beyond them the "
            "switching part is constant",
            "good",
        )
        if not isfinite(case.known.static):
            return
        given = case.controller.feedforward
        fed = given.coulomb if given is not None else 0.0
        left = max(case.known.static - fed, 0.0)
        yield ReviewFinding(
            "disturbance",
            f"F = {self.disturbance:.3g} A; breakaway needs {case.known.static:.3g} A, {fed:.3g} A of it fed forward",
            "good" if self.disturbance >= left else "warning",
            f"raise [sliding_mode] disturbance to {left:.2g} A or more, or feed friction forward",
        )

    def __str__(self) -> str:
        return (
            f"sliding mode, lambda = {self.bandwidth:.4g} rad/s, lambda_phi = {self.layer:.4g} rad/s, "
            f"k = {self.k:.4g} A at rest, b_0 = {self.b_0:.4g} m/(s2 A), c = {self.c:.3g} 1/s"
        )


def design_sliding_mode(name: str, file: SlidingModeFile, system: control.StateSpace) -> SlidingMode:
    """A sliding mode for the linear model `system` (first input the current, outputs omega and x).

    Raises InputError for a model without the shaft's speed, for a switching gain beyond the current limit, and where
    the loop within the boundary layer is unstable.
    """
    surface = file.sliding_mode
    body = rigid_body(system, surface.bandwidth)
    if body.n == 0.0:
        raise InputError(f"the model {system.name} has no output omega; a sliding mode needs the shaft's speed")
    law = SlidingMode(
        b_0=body.b_0,
        c=body.c,
        n=body.n,
        bandwidth=surface.bandwidth,
        layer=surface.layer_ratio * surface.bandwidth,
        disturbance=surface.disturbance,
        reaching=surface.reaching,
        gain_margin=surface.gain_margin,
        current_limit=file.current_limit,
        sample_time=file.sample_time,
    )
    if law.k >= law.current_limit:
        raise InputError(
            f"[sliding_mode] k = beta (F + eta) = {law.k:.4g} A is beyond current_limit = {law.current_limit:g} A; "
            "lower disturbance, reaching or gain_margin, or raise current_limit"
        )
    controller = SampledController(name, "sliding_mode", law.sample_time, law.current_limit, law)
    require_stable(system, controller, "lower [sliding_mode] bandwidth or layer_ratio")
    return law


kind = ControllerKind(
    "sliding_mode",
    "sliding mode with a boundary layer and an integral within it",
    SlidingModeFile,
    design_sliding_mode,
    tunes={"sliding_mode.bandwidth": ("rad/s", 5.0, 150.0), "sliding_mode.layer_ratio": ("1", 0.1, 10.0)},
)
