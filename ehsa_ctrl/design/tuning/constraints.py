"""The tuner's specification, the sampled PID loop, and bounds on it as smooth constraints.

The loop, broken at the current, is exact (zero-order hold of the plant, difference equation of the law) and fast enough
for thousands of evaluations.

Every bound becomes constraints log(allowed / actual) >= 0. There is one for the peak in each band of frequencies, so
that the optimiser sees all peaks of a loop, not only the largest; a parabola refines each peak between grid points, so
that its derivative is that of the true peak.

The disk margin is the balanced one, 2 / max |S - T| (P. Seiler, A. Packard, P. Gahinet, "An Introduction to Disk
Margins", IEEE Control Systems Magazine 40(5), 2020).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.controller_interface import MEASURED
from ...core.definition import AngularFrequency, Definition, InDrive
from ..analysis.closed_loop import spectral_radius, transfer
from ..analysis.sampled import sampled_plant

if TYPE_CHECKING:
    import control

    from ..kinds.pid import Gains

#: Points of the frequency grid, its decades below the Nyquist frequency, and bands. Engineering judgement.
POINTS, DECADES, BANDS = 360, 5.0, 9
#: Lower bounds; all others are upper bounds.
LOWER_BOUNDS = ("disk_margin", "crossover")


class Tuning(Definition):
    """[tuning]: the criterion that is minimised, and bounds on the loop, broken at the current."""

    minimise: Literal["IE", "IAE", "ITAE"] = Field(
        default="ITAE",
        description="IE (integrated error, 1 / k_i), IAE (integrated absolute error) or ITAE (time-weighted IAE) of "
        "a step response",
    )
    response: Literal["load", "reference"] = Field(
        default="load", description="step of the load (a current added at the plant's input) or of the reference"
    )
    terms: Literal["P", "PI", "PD", "PID"] = Field(default="PID", description="terms of the controller")
    Ms: Annotated[float, Field(gt=1, allow_inf_nan=False)] | None = Field(
        default=1.5, description="largest sensitivity |S|"
    )
    Mt: Annotated[float, Field(gt=1)] | None = Field(default=1.4, description="largest complementary sensitivity |T|")
    disk_margin: Annotated[float, Field(gt=0, lt=2)] | None = Field(default=0.7, description="least disk margin")
    noise_gain: Annotated[float, InDrive("A/m")] | None = Field(
        default=1e4, gt=0, description="largest RMS current per RMS of white position noise"
    )
    crossover: AngularFrequency | None = Field(default=None, description="least gain crossover frequency")
    lag: Annotated[int, Field(ge=0)] = Field(default=0, description="samples of delay between measurement and current")

    @model_validator(mode="after")
    def _check_criterion(self) -> Tuning:
        if "I" not in self.terms and (self.minimise == "IE" or self.response == "load"):
            raise ValueError(
                f"terms = {self.terms!r} leaves a steady-state error after a load step, so that its integral is "
                "infinite; use PI or PID, or minimise IAE or ITAE with response = 'reference'"
            )
        if self.minimise == "IE" and self.response == "reference":
            raise ValueError("minimise = 'IE' is the integrated error of a load step; take response = 'load' or ITAE")
        if self.Ms is None and self.disk_margin is None:
            raise ValueError("give a bound on Ms or on the disk margin; without one the gains grow without bound")
        return self

    def bounds(self) -> dict[str, float]:
        """The given bounds by name."""
        names = ("Ms", "Mt", "disk_margin", "noise_gain", "crossover")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}


@dataclass(frozen=True)
class SampledPlant:
    """The plant from current to position, with the current held over each sample.

    Attributes
    ----------
    a, b, c: (n, n), (n,), (n,) of the difference equation.
    sample_time: s.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    sample_time: float

    def response(self, z: np.ndarray) -> np.ndarray:
        """G(z) (m,) at the points z (m,)."""
        return transfer(self.a, self.b[:, None], self.c[None, :], z)[:, 0, 0]


def position_plant(system: control.StateSpace, sample_time: float, *, lag: int = 0) -> SampledPlant:
    """The plant from current to position, with `lag` whole samples of delay. Raises InputError as `sampled_plant`."""
    plant = sampled_plant(system, sample_time, delay=lag * sample_time)
    return SampledPlant(plant.A, plant.B[:, 0], plant.C[MEASURED.index("position")], sample_time)


@dataclass(frozen=True)
class PidLoop:
    """A plant with a PID.

    Attributes
    ----------
    plant, gains: plant and controller.
    b, c: setpoint weights of the proportional and the derivative part.
    """

    plant: SampledPlant
    gains: Gains
    b: float = 1.0
    c: float = 0.0

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, B, C, D of the closed loop from w = (reference, load current, noise) to (position, current).

        States: the plant's, integral part, memory of the derivative part.
        """
        p, g, T_s = self.plant, self.gains, self.plant.sample_time
        n = p.b.size
        keep = g.T_f / (g.T_f + T_s)
        slope = g.k_d / (g.T_f + T_s)
        # The law's current as rows over the states and over w.
        u_x = np.concatenate([-(g.k_p + slope) * p.c, [1.0, 1.0]])
        u_w = np.array([g.k_p * self.b + slope * self.c, 0.0, -(g.k_p + slope)])
        a, b = np.zeros((n + 2, n + 2)), np.zeros((n + 2, 3))
        a[:n, :n] = p.a
        a[:n] += np.outer(p.b, u_x)
        b[:n] = np.outer(p.b, u_w + [0.0, 1.0, 0.0])
        a[n, :n], a[n, n], b[n] = -T_s * g.k_i * p.c, 1.0, [T_s * g.k_i, 0.0, -T_s * g.k_i]
        change = (keep - 1.0) * slope
        a[n + 1, :n], a[n + 1, n + 1], b[n + 1] = -change * p.c, keep, [change * self.c, 0.0, -change]
        used = np.array([True] * n + [g.k_i != 0.0, g.k_d != 0.0])
        outputs = np.stack([np.concatenate([p.c, [0.0, 0.0]]), u_x])[:, used]
        return a[np.ix_(used, used)], b[used], outputs, np.stack([np.zeros(3), u_w])

    def radius(self) -> float:
        """Largest |pole| of the closed loop; stable below 1."""
        return spectral_radius(self.matrices()[0])

    def error(self, samples: int, kind: str) -> np.ndarray:
        """r - y (samples,) after a step of the reference by 1 m ("reference") or of the load by 1 A ("load")."""
        a, b, c, _ = self.matrices()
        column = {"reference": 0, "load": 1}[kind]
        n = a.shape[0]
        # The step is a constant state: free response of the extended system, whose rows double in each pass.
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n], whole[n, n] = a, b[:, column], 1.0
        rows, power = np.append(c[0], 0.0)[None, :], whole
        while rows.shape[0] < samples:
            rows = np.concatenate([rows, rows @ power])
            power = power @ power
        y = rows[:samples, n]
        return (1.0 if column == 0 else 0.0) - y


@dataclass(frozen=True)
class LoopConstraints:
    """Bounds on the loop with one plant as constraints on the gains; `bounds` as from `Tuning.bounds`."""

    plant: SampledPlant
    bounds: Mapping[str, float]

    @cached_property
    def grid(self) -> np.ndarray:
        return frequency_points(self.plant.sample_time)

    @cached_property
    def z(self) -> np.ndarray:
        return np.exp(1j * self.grid * self.plant.sample_time)

    @cached_property
    def G(self) -> np.ndarray:
        return self.plant.response(self.z)

    @cached_property
    def at_crossover(self) -> tuple[np.ndarray, np.ndarray]:
        z = np.exp(1j * np.array([self.bounds["crossover"]]) * self.plant.sample_time)
        return z, self.plant.response(z)

    def slack(self, gains: Gains) -> np.ndarray:
        """log(allowed / actual) of all bounds, for the peaks one per band, and last the distance to instability."""
        C = gains.response(self.z, self.plant.sample_time)
        crossover = 0.0
        if "crossover" in self.bounds:
            z, G = self.at_crossover
            crossover = float(np.abs(gains.response(z, self.plant.sample_time) * G)[0])
        return bound_slack(self.bounds, self.grid, C * self.G, C, crossover, PidLoop(self.plant, gains).radius())


def frequency_points(sample_time: float) -> np.ndarray:
    """Frequencies (m,) [rad/s] on which the bounds are evaluated, up to the Nyquist frequency."""
    return np.asarray(np.pi / sample_time * np.logspace(-DECADES, 0.0, POINTS))


def bound_slack(
    bounds: Mapping[str, float], grid: np.ndarray, L: np.ndarray, C: np.ndarray, crossover: float, radius: float
) -> np.ndarray:
    """log(allowed / actual) of all bounds, for the peaks one per band, and last the distance to instability.

    Parameters
    ----------
    grid: (m,) of `frequency_points`. L, C: (m,) open loop, and law from the position to the current [A/m].
    crossover: |L| at the frequency of that bound. radius: largest |pole| of the closed loop.
    """
    S = 1.0 / (1.0 + L)
    sizes, allowed = [], []
    if "Ms" in bounds:
        sizes.append(np.abs(S))
        allowed.append(bounds["Ms"])
    if "Mt" in bounds:
        sizes.append(np.abs(1.0 - S))
        allowed.append(bounds["Mt"])
    if "disk_margin" in bounds:
        sizes.append(np.abs(2.0 * S - 1.0))
        allowed.append(2.0 / bounds["disk_margin"])
    peaks = band_peaks(np.log(np.array(sizes) + 1e-9))
    rows = [(np.log(allowed)[:, None] - peaks).ravel()]
    if "noise_gain" in bounds:
        # The grid ends at the Nyquist frequency, where grid times sample time is pi.
        mean = np.trapezoid(np.abs(C * S) ** 2, grid) / grid[-1]
        rows.append(np.array([np.log(bounds["noise_gain"]) - 0.5 * np.log(max(mean, 1e-300))]))
    if "crossover" in bounds:
        rows.append(np.array([np.log(max(crossover, 1e-300))]))
    rows.append(np.array([10.0 * (1.0 - radius)]))
    return np.concatenate(rows)


def band_peaks(values: np.ndarray) -> np.ndarray:
    """Largest value (..., BANDS) of each band of a grid (..., POINTS), refined between points by a parabola."""
    flat = values.reshape(-1, POINTS)
    width = POINTS // BANDS
    inside = np.argmax(flat.reshape(-1, BANDS, width), axis=2)
    k = inside + width * np.arange(BANDS)
    rows = np.arange(flat.shape[0])[:, None]
    middle = np.clip(k, 1, POINTS - 2)
    left, peak, right = flat[rows, middle - 1], flat[rows, middle], flat[rows, middle + 1]
    bend = left - 2.0 * peak + right
    smooth = (middle == k) & (left <= peak) & (peak >= right) & (bend < 0.0)
    refined = peak - np.where(smooth, (right - left) ** 2 / (8.0 * np.where(smooth, bend, -1.0)), 0.0)
    return np.where(smooth, refined, flat[rows, k]).reshape(*values.shape[:-1], BANDS)
