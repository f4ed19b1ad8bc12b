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
Automatica 41, 2005). The velocity is that of the shaft; where the plant has none, filtered differences of the rod's
position, with n = 1. For a plant whose drive is a force all amperes are newtons.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import AngularFrequency, Definition, Drive
from ...core.errors import InputError
from ..analysis.closed_loop import law_state_space
from ..analysis.rigid_body import rigid_body
from ..analysis.sampled import DRIVES, drive_unit_of
from ..controller import SampledController
from ..review_checks import ReviewContext, ReviewFinding
from ..words import WordsByUnit
from ._kind import ControllerKind, PositionControllerFile, require_stable
from ._rod_speed import MEMORY, take_rod_speed

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
    disturbance: Drive = Field(
        gt=0, description="F, largest disturbance as a current: friction and load that nothing feeds forward"
    )
    gain_margin: Annotated[float, Field(ge=1, le=5)] = Field(
        default=1.2, description="beta, largest factor on the plant's gain to either side"
    )
    reaching: Drive | None = Field(
        default=None,
        gt=0,
        description="eta, current left over for reaching the boundary layer at the largest disturbance; by default a "
        "third of it",
    )
    filter_ratio: Annotated[float, Field(gt=1, le=1e6)] = Field(
        default=10.0,
        description="corner frequency of the filter of the rod's speed over the larger bandwidth, where the plant has "
        "no shaft and the speed is taken from the position",
    )

    @property
    def fastest(self) -> float:
        """The larger of the bandwidths of surface and boundary layer [rad/s]."""
        return max(1.0, self.layer_ratio) * self.bandwidth


class SlidingModeFile(PositionControllerFile):
    """A sliding-mode controller's TOML."""

    kind: Literal["sliding_mode"] = Field(description="type of feedback law")
    sliding_mode: SlidingSurface = Field(description="surface, boundary layer and uncertainty")

    @model_validator(mode="after")
    def _check_sliding_mode(self) -> SlidingModeFile:
        fastest, nyquist = self.sliding_mode.fastest, np.pi / self.sample_time
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


def rod_sliding_mode_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above with the rod's speed in place of the shaft's.

    settings: filter time constant, those of `sliding_mode_law`. memory: that of `sliding_mode_law`, that of
    `take_rod_speed`.
    """
    take_rod_speed(measured, memory[4:], settings[0], settings[9])
    return sliding_mode_law(reference, memory[6:], memory, settings[1:], extra, hold)


@dataclass(frozen=True)
class SlidingMode(WordsByUnit):
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
    uses: ClassVar[tuple[Callable[..., Any], ...]] = ()
    compiles = True
    reads: ClassVar[tuple[str, ...]] = ("position", "speed")
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
        unit = DRIVES[case.loop.drive]
        yield ReviewFinding(
            "boundary layer",
            f"k = {self.k:.3g} {unit} at rest; linear for errors up to {1e3 * self.layer_error:.3g} mm, beyond them "
            "the switching part is constant",
            "good",
        )
        if not isfinite(case.known.static):
            return
        given = case.controller.feedforward
        fed = given.coulomb if given is not None else 0.0
        left = max(case.known.static - fed, 0.0)
        yield ReviewFinding(
            "disturbance",
            f"F = {self.disturbance:.3g} {unit}; breakaway needs {case.known.static:.3g} {unit}, {fed:.3g} {unit} of "
            "it fed forward",
            "good" if self.disturbance >= left else "warning",
            f"raise [sliding_mode] disturbance to {left:.2g} {unit} or more, or feed friction forward",
        )

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        return (
            f"sliding mode, lambda = {self.bandwidth:.4g} rad/s, lambda_phi = {self.layer:.4g} rad/s, "
            f"k = {self.k:.4g} {unit} at rest, b_0 = {self.b_0:.4g} m/(s2 {unit}), c = {self.c:.3g} 1/s"
        )


@dataclass(frozen=True)
class RodSlidingMode(SlidingMode):
    """A sliding mode that takes the rod's speed from the position, a design.controller.Law.

    Attributes
    ----------
    those of SlidingMode with n = 1, and
    T_f: time constant of the speed's filter [s].
    """

    T_f: float = 0.0
    function = staticmethod(rod_sliding_mode_law)
    uses = (take_rod_speed, sliding_mode_law)
    reads = ("position",)

    def settings(self) -> np.ndarray:
        return np.append(self.T_f, super().settings())

    def initial_memory(self) -> np.ndarray:
        return np.zeros(4 + MEMORY)

    def words(self, unit: str) -> str:
        return f"{super().words(unit)}, the rod's speed from its position with T_f = {self.T_f:.3g} s"


def design_sliding_mode(name: str, file: SlidingModeFile, system: control.StateSpace) -> SlidingMode:
    """A sliding mode for the linear model `system` (first input the current, outputs x and that of a shaft, omega).

    Raises InputError for a switching gain beyond the current limit, and where the loop within the boundary layer is
    unstable.
    """
    surface, unit = file.sliding_mode, drive_unit_of(system)
    body = rigid_body(system, surface.bandwidth)
    law = SlidingMode(
        b_0=body.b_0,
        c=body.c,
        n=body.n or 1.0,
        bandwidth=surface.bandwidth,
        layer=surface.layer_ratio * surface.bandwidth,
        disturbance=surface.disturbance,
        reaching=surface.disturbance / 3.0 if surface.reaching is None else surface.reaching,
        gain_margin=surface.gain_margin,
        current_limit=file.current_limit,
        sample_time=file.sample_time,
    )
    if law.k >= law.current_limit:
        raise InputError(
            f"[sliding_mode] k = beta (F + eta) = {law.k:.4g} {unit} is beyond current_limit = "
            f"{law.current_limit:g} {unit}; "
            "lower disturbance, reaching or gain_margin, or raise current_limit"
        )
    if body.n == 0.0:
        law = RodSlidingMode(**vars(law), T_f=1.0 / (surface.filter_ratio * surface.fastest))
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
