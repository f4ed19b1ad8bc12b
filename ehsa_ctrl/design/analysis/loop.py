"""Loop analysis: the sampled position loop, broken at the current; margins, sensitivities, noise, compliance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.controller_interface import MEASURED, REFERENCE, Controller
from ...core.errors import InputError
from ...core.log import CHANNELS
from ...core.plotting import draw
from ...core.result import Result, as_dict
from .closed_loop import INPUTS, OUTPUTS, close_loop, closed_loop_matrix, discrete_response, spectral_radius
from .contact import loop_model
from .margins import Margins, disk_range, frequency_grid, margins
from .sampled import DRIVES, LATEST, drive_of, sample, scale_model, scaled_matrices

if TYPE_CHECKING:
    import control
    import pandas
    from matplotlib.figure import Figure

#: A closed loop with a pole nearer to the unit circle than this counts as unstable: rounding of eigenvalues.
STABILITY_TOLERANCE = 1e-9
#: Static compliance over its peak below which it is rounding, and integral action makes it zero.
NEGLIGIBLE = 1e-9
#: Scalar results with their units, as tables show them.
FIGURES = {
    "stable": "", "crossover": "rad/s", "phase_margin": "deg", "gain_margin": "", "gain_reduction": "",
    "gain_frequency": "rad/s", "delay_margin": "s", "Ms": "", "Mt": "", "disk_margin": "", "disk_frequency": "rad/s",
    "Mks": "A/m", "current_noise": "A", "compliance": "m/N", "static_compliance": "m/N", "sample_time": "s",
    "delay": "s",
}  # fmt: skip
#: Largest number of points of a frequency grid, a limit on memory and time. Engineering judgement.
MOST_POINTS = 20_000
#: Longest delay margin [samples] computed from the poles of the closed loop, whose delay line grows with it; a longer
#: one follows from the phase, which is accurate there.
LONGEST = 60


@dataclass(frozen=True, repr=False, kw_only=True)
class LoopAnalysis(Result, Margins):
    """A position loop, broken at the current, with the plant sampled exactly (zero-order hold).

    Attributes
    ----------
    those of Margins, with the delay margin exact for the sampled loop, and
    controller: its name.
    omega: (n,) rad/s up to the Nyquist frequency. response: (n,) of the open loop.
    stable: all poles of the closed sampled loop lie inside the unit circle.
    noise_gain: channel -> RMS current per RMS of white noise on its readings [A per SI unit].
    current_noise: RMS current from the sensors' noise [A]; nan if that is unknown.
    drive: input of the model; for a force (F_M) N takes the place of A in all units.
    compliance: m/N, peak of |position / force|; static_compliance: its steady-state value.
    Mks: A/m, peak from noise on the position to the current.
    sample_time: s. delay: s, added to the loop.
    poles: (m,) of the closed loop, in z.
    """

    controller: str
    omega: np.ndarray
    response: np.ndarray
    stable: bool
    noise_gain: Mapping[str, float] = field(default_factory=dict)
    current_noise: float = nan
    drive: str = "current"
    compliance: float = nan
    static_compliance: float = nan
    Mks: float = nan
    sample_time: float = nan
    delay: float = 0.0
    poles: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=complex))

    @property
    def disk_gain(self) -> tuple[float, float]:
        """Smallest and largest factor on the gain that the disk margin guarantees."""
        return disk_range(self.disk_margin)[:2]

    @property
    def disk_phase(self) -> float:
        """Phase [deg] that the disk margin guarantees, lag or lead."""
        return disk_range(self.disk_margin)[2]

    def figure(self, name: str) -> float:
        """A scalar result by name; noise_gain means that of the position."""
        return self.noise_gain["position"] if name == "noise_gain" else float(getattr(self, name))

    @property
    def sensitivity(self) -> np.ndarray:
        """S = 1 / (1 + L), (n,)."""
        return np.asarray(1 / (1 + self.response))

    def plot(self) -> Figure:
        """Open loop over frequency with its margins; |S| and |T| with their peaks."""
        return draw(self)

    def to_dict(self) -> dict[str, Any]:
        """One of `loops` in analysis.json, SI units (phase in deg)."""
        return as_dict(self, " ".join(["controller", *FIGURES, "noise_gain"]))

    def to_pandas(self) -> pandas.DataFrame:
        """One row per figure: value, SI unit (phase in deg)."""
        import pandas

        own = DRIVES[self.drive]
        rows = {name: (getattr(self, name), unit.replace("A", own)) for name, unit in FIGURES.items()}
        for name, gain in self.noise_gain.items():
            rows[f"noise_gain {name}"] = (gain, f"{own}/({CHANNELS[name].unit})")
        return pandas.DataFrame.from_dict(rows, orient="index", columns=["value", "unit"]).rename_axis("figure")

    @property
    def drive_noise(self) -> str:
        """RMS of the drive by sensor noise in words."""
        if self.drive == "current":
            return f"{1e3 * self.current_noise:.3g} mA"
        return f"{self.current_noise:.3g} {DRIVES[self.drive]}"

    def __str__(self) -> str:
        late = f", {1e3 * self.delay:.3g} ms late" if self.delay else ""
        where = "the current" if self.drive == "current" else self.drive
        head = f"loop with {self.controller}, broken at {where}{late}"
        if not self.stable:
            return f"{head}\n  closed loop NOT STABLE: spectral radius {np.max(np.abs(self.poles), initial=0.0):.4g}"
        low, high = self.disk_gain
        source = where.removeprefix("the ")
        noise = f"; {source} from sensor noise {self.drive_noise} rms" if self.current_noise >= 0 else ""
        return (
            f"{head}\n"
            f"  crossover {self.crossover / (2 * np.pi):.3g} Hz ({self.crossover:.4g} rad/s), "
            f"phase margin {self.phase_margin:.3g} deg, "
            f"gain margin {self.gain_margin:.3g}, delay margin {1e3 * self.delay_margin:.3g} ms\n"
            f"  Ms {self.Ms:.3g}, Mt {self.Mt:.3g}, disk margin {self.disk_margin:.3g} "
            f"(gain x {low:.2g} to {high:.3g}, phase {self.disk_phase:.3g} deg simultaneously), closed loop stable\n"
            f"  compliance under force: peak {1e9 * self.compliance:.3g} um/kN, static "
            f"{1e9 * self.static_compliance:.3g} um/kN{noise}"
        )


def analyse_loop(
    system: control.StateSpace,
    controller: Controller,
    *,
    lag: int = 0,
    delay: float = 0.0,
    noise: Mapping[str, float] | None = None,
    points: int = 1200,
) -> LoopAnalysis:
    """Margins, sensitivities and noise of a position loop, exact for the sampled loop.

    Parameters
    ----------
    system: continuous linear model, inputs current and F_D, outputs by name, as three_state(plant) returns it.
    controller: with a linear law `linear()`.
    lag: whole samples between a measurement and its current, as in run_closed_loop. delay: s, in addition.
    noise: channel -> standard deviation of the sensor's noise (SI units), for `current_noise`.
    points: of the frequency grid, between which peaks and crossovers are refined.

    Raises InputError for a controller without a linear law, or a model that does not fit (see sampled_plant).
    """
    if not 0 <= lag <= LATEST or lag != int(lag):
        raise InputError(f"lag = {lag}; expected a whole number of samples, 0 to {LATEST}")
    if not 10 <= points <= MOST_POINTS:
        raise InputError(f"points = {points}; expected 10 to {MOST_POINTS}")
    system = loop_model(system, controller)
    h = controller.sample_time
    late = lag * h + delay
    plant, law, closed = close_loop(system, controller, late)
    poles = np.linalg.eigvals(closed.A)
    stable = bool(np.max(np.abs(poles), initial=0.0) < 1.0 - STABILITY_TOLERANCE)
    open_poles = np.concatenate([np.linalg.eigvals(plant.A), np.linalg.eigvals(law.A)])
    feedback = law[0, len(REFERENCE) :]

    def gain(omega: np.ndarray) -> np.ndarray:
        c, g = discrete_response(feedback, omega)[:, 0], discrete_response(plant, omega)
        return -np.einsum("nj,nj->n", c, g[..., 0])

    integrates = bool(np.any(np.abs(open_poles - 1.0) < 1e-9))
    static = inf if integrates else float(gain(np.zeros(1))[0].real)
    omega = frequency_grid(h, np.concatenate([poles, open_poles]), points=points)
    # Law from the readings (n, 5), and plant from current and force (n, 5, 2).
    C, G = discrete_response(feedback, omega)[:, 0], discrete_response(plant, omega)
    response = -np.einsum("nj,nj->n", C, G[..., 0])
    sensitivity = 1 / (1 + response)
    found = margins(gain, omega, response, static=static, stable=stable)
    found = replace(found, delay_margin=_delay_margin(system, law, found.delay_margin, late))
    noise_gain = _noise_gain(closed, stable=stable)
    x = MEASURED.index("position")
    under_force = np.abs(G[:, x, 1] + G[:, x, 0] * (np.einsum("nj,nj->n", C, G[..., 1]) * sensitivity))
    compliance = float(np.max(under_force)) if stable else nan
    lasting = _static_gain(closed, "position", "F_D") if stable else nan
    shown = omega >= 0.999 * min(0.1, omega[-1] / 10)
    return LoopAnalysis(
        **vars(found),
        controller=controller.name,
        omega=omega[shown],
        response=response[shown],
        stable=stable,
        noise_gain=noise_gain,
        current_noise=_total_noise(noise_gain, noise),
        drive=drive_of(system),
        compliance=compliance,
        static_compliance=0.0 if abs(lasting) < NEGLIGIBLE * compliance else lasting,
        Mks=float(np.max(np.abs(C[:, x] * sensitivity))) if stable else nan,
        sample_time=h,
        delay=late,
        poles=poles,
    )


def _delay_margin(system: control.StateSpace, law: control.StateSpace, guess: float, late: float) -> float:
    """Additional delay [s] at which a pole of the sampled loop reaches the unit circle.

    guess: from the phase margin; not exact, as a delay of a fraction of a sample has a phase other than -w tau.
    """
    from scipy.optimize import brentq

    h = float(law.dt)
    if not np.isfinite(guess) or guess > LONGEST * h:
        return guess

    model = scale_model(system)

    def instability(delay: float) -> float:
        return spectral_radius(closed_loop_matrix(*sample(model, h, late + delay), law)) - 1.0

    before = 0.0
    for after in guess * np.array([0.95, 1.05, 1.2, 1.5, 2.0, 3.0]):
        if instability(float(after)) > 0.0:
            return float(brentq(instability, before, float(after), xtol=1e-5 * guess, rtol=1e-5))
        before = float(after)
    return guess


def _noise_gain(closed: control.StateSpace, *, stable: bool) -> dict[str, float]:
    """Standard deviation of the current [A] for white noise of one unit on each reading.

    From the discrete Lyapunov equation X = A X A' + B B'; the variance is C X C' + D D'.
    """
    from scipy.linalg import solve_discrete_lyapunov

    if not stable:
        return dict.fromkeys(MEASURED, nan)
    gains = {}
    for channel in MEASURED:
        a, b, c, d = _balanced_channel(closed, "current", f"n_{channel}")
        variance = d**2
        if np.any(b):
            variance += float((c @ solve_discrete_lyapunov(a, b @ b.T) @ c.T)[0, 0])
        gains[channel] = float(np.sqrt(max(variance, 0.0)))
    return gains


def _static_gain(closed: control.StateSpace, output: str, source: str) -> float:
    """Steady-state gain of a stable loop."""
    a, b, c, d = _balanced_channel(closed, output, source)
    return float((c @ np.linalg.solve(np.eye(a.shape[0]) - a, b))[0, 0] + d)


def _balanced_channel(
    closed: control.StateSpace, output: str, source: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """A (n, n), B (n, 1), C (1, n) and D of one channel, in balanced states."""
    from scipy.linalg import matrix_balance

    row, column = OUTPUTS.index(output), INPUTS.index(source)
    _, (scale, _) = matrix_balance(closed.A, permute=False, separate=True)
    a, b, c = scaled_matrices(closed, scale)
    return a, b[:, [column]], c[[row]], float(closed.D[row, column])


def _total_noise(gains: Mapping[str, float], noise: Mapping[str, float] | None) -> float:
    """RMS current [A] of independent noise on all readings, whose variances add."""
    if noise is None:
        return nan
    unknown = set(noise) - set(MEASURED)
    if unknown:
        raise InputError(f"noise of {sorted(unknown)[0]!r}: expected channels out of {', '.join(MEASURED)}")
    return float(np.sqrt(sum((gains[channel] * sd) ** 2 for channel, sd in noise.items())))
