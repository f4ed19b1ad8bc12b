"""A position loop broken at the current: exact where it is sampled, margins, sensitivities, noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError
from ...core.log import CHANNELS
from ...core.notebook import ShownAsText
from ...core.plotting import draw
from ...core.protocol import MEASURED, REFERENCE, Controller
from .closed import INPUTS, OUTPUTS, closed_loop, closed_matrix, law_of
from .frequency import discrete_response
from .margins import disk_range, frequencies, margins
from .sampled import LATEST, sampled, sampled_plant, scaled

if TYPE_CHECKING:
    import control
    import pandas
    from matplotlib.figure import Figure

#: A closed loop with a pole nearer than this to the unit circle, or outside, is not stable.
BRINK = 1e-9
#: A lasting answer to a force below this share of the largest one is rounding: integral action leaves none.
NOTHING = 1e-9
#: What a table of a loop shows, with its unit.
FIGURES = {
    "stable": "", "crossover": "rad/s", "phase_margin": "deg", "gain_margin": "", "gain_reduction": "",
    "gain_frequency": "rad/s", "delay_margin": "s", "Ms": "", "Mt": "", "disk_margin": "", "disk_frequency": "rad/s",
    "Mks": "A/m", "current_noise": "A", "compliance": "m/N", "static_compliance": "m/N", "sample_time": "s",
    "delay": "s",
}  # fmt: skip
#: Most points of a frequency grid.
MOST_POINTS = 20_000
#: Longest delay margin, in samples, that is computed from the closed loop's poles; beyond, its frequency value is kept.
LONGEST = 60


@dataclass(frozen=True)
class LoopAnalysis(ShownAsText):
    """A position loop, broken at the current, with the plant sampled exactly (zero-order hold).

    Attributes
    ----------
    controller: for the title.
    omega: (n,) rad/s up to half the sampling's; response: (n,) of the open loop.
    crossover [rad/s], phase_margin [deg], gain_margin (factor), delay_margin [s], Ms, Mt: see margins.Margins; the
        delay margin is that of the sampled loop, any fraction of a sample.
    stable: all poles of the closed sampled loop lie inside the unit circle.
    gain_reduction, disk_margin, disk_frequency, gain_frequency: see margins.Margins.
    noise_gain: channel -> A (rms) of current per unit (rms) of white noise on its readings.
    current_noise: A (rms) that the sensors' own noise makes; nan where that was not given.
    compliance: m/N, peak of the rod's answer to a force on it; static_compliance: its answer to a lasting force.
    Mks: A/m, peak from noise on the position to the current.
    sample_time, delay: s; the delay is what was added to the loop.
    poles: (m,) of the closed loop, in z.
    """

    controller: str
    omega: np.ndarray
    response: np.ndarray
    crossover: float
    phase_margin: float
    gain_margin: float
    delay_margin: float
    Ms: float
    Mt: float
    stable: bool
    gain_reduction: float = 0.0
    disk_margin: float = nan
    disk_frequency: float = nan
    gain_frequency: float = nan
    noise_gain: Mapping[str, float] = field(default_factory=dict)
    current_noise: float = nan
    compliance: float = nan
    static_compliance: float = nan
    Mks: float = nan
    sample_time: float = nan
    delay: float = 0.0
    poles: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=complex))

    @property
    def disk_gain(self) -> tuple[float, float]:
        """Lowest and highest factor on the gain that the disk margin guarantees."""
        return disk_range(self.disk_margin)[:2]

    @property
    def disk_phase(self) -> float:
        """Phase [deg] that the disk margin guarantees, lag or lead."""
        return disk_range(self.disk_margin)[2]

    @property
    def sensitivity(self) -> np.ndarray:
        """S = 1 / (1 + L), (n,)."""
        return np.asarray(1 / (1 + self.response))

    def plot(self) -> Figure:
        """Open loop over frequency with its margins; |S| and |T| with their peaks."""
        return draw(self)

    def to_dict(self) -> dict[str, Any]:
        names = (
            "crossover", "phase_margin", "gain_margin", "gain_reduction", "delay_margin", "Ms", "Mt", "disk_margin",
            "disk_frequency", "gain_frequency", "stable", "noise_gain", "current_noise", "compliance",
            "static_compliance", "Mks", "sample_time", "delay",
        )  # fmt: skip
        return {"controller": self.controller, **{name: getattr(self, name) for name in names}}

    def to_pandas(self) -> pandas.DataFrame:
        """One row a figure: value, SI unit (phase in deg)."""
        import pandas

        rows = {name: (getattr(self, name), unit) for name, unit in FIGURES.items()}
        rows |= {f"noise_gain {name}": (gain, f"A/({CHANNELS[name].unit})") for name, gain in self.noise_gain.items()}
        return pandas.DataFrame.from_dict(rows, orient="index", columns=["value", "unit"]).rename_axis("figure")

    def __str__(self) -> str:
        late = f", {1e3 * self.delay:.3g} ms late" if self.delay else ""
        head = f"loop with {self.controller}, broken at the current{late}"
        if not self.stable:
            return f"{head}\n  closed loop NOT STABLE: spectral radius {np.max(np.abs(self.poles), initial=0.0):.4g}"
        low, high = self.disk_gain
        noise = f"; current from sensor noise {1e3 * self.current_noise:.3g} mA rms" if self.current_noise >= 0 else ""
        return (
            f"{head}\n"
            f"  crossover {self.crossover:.4g} rad/s, phase margin {self.phase_margin:.3g} deg, "
            f"gain margin {self.gain_margin:.3g}, delay margin {1e3 * self.delay_margin:.3g} ms\n"
            f"  Ms {self.Ms:.3g}, Mt {self.Mt:.3g}, disk margin {self.disk_margin:.3g} "
            f"(gain x {low:.2g} to {high:.3g}, phase {self.disk_phase:.3g} deg at once), closed loop stable\n"
            f"  rod under force: at most {1e9 * self.compliance:.3g} um/kN, lasting "
            f"{1e9 * self.static_compliance:.3g} um/kN{noise}"
        )

    __repr__ = __str__


def analyse_loop(
    system: control.StateSpace,
    controller: Controller,
    *,
    lag: int = 0,
    delay: float = 0.0,
    noise: Mapping[str, float] | None = None,
    points: int = 1200,
) -> LoopAnalysis:
    """Margins, sensitivities and noise of a position loop; nothing of it is a continuous approximation.

    Parameters
    ----------
    system: continuous linear model, inputs current and F_D, outputs by name, as three_state(plant) gives it.
    controller: with a linear law `linear()`.
    lag: whole samples between a measurement and its current, as run_closed_loop has it. delay: s, any extra time.
    noise: channel -> standard deviation of the sensor's noise (SI units), for `current_noise`.
    points: of the frequency grid; peaks and crossovers are found between its points.

    Raises InputError for a controller without a linear law, or a model that does not fit (see sampled_plant).
    """
    if not 0 <= lag <= LATEST or lag != int(lag):
        raise InputError(f"lag = {lag}; expected a whole number of samples, 0 to {LATEST}")
    if not 10 <= points <= MOST_POINTS:
        raise InputError(f"points = {points}; expected 10 to {MOST_POINTS}")
    h = controller.sample_time
    late = lag * h + delay
    law = law_of(controller)
    # For the loop a late current is the same as late readings.
    plant = sampled_plant(system, h, delay=late)
    closed = closed_loop(plant, law)
    poles = np.linalg.eigvals(closed.A)
    stable = bool(np.max(np.abs(poles), initial=0.0) < 1.0 - BRINK)
    opened = np.concatenate([np.linalg.eigvals(plant.A), np.linalg.eigvals(law.A)])
    readings = law[0, len(REFERENCE) :]

    def parts(omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Answers of the law to the readings (n, 5), and of the plant (n, 5, 2)."""
        return discrete_response(readings, omega)[:, 0], discrete_response(plant, omega)

    def gain(omega: np.ndarray) -> np.ndarray:
        answer, moved = parts(omega)
        return -np.einsum("nj,nj->n", answer, moved[..., 0])

    integrates = bool(np.any(np.abs(opened - 1.0) < 1e-9))
    static = inf if integrates else float(gain(np.zeros(1))[0].real)
    fine = frequencies(h, np.concatenate([poles, opened]), points=points)
    answer, moved = parts(fine)
    response = -np.einsum("nj,nj->n", answer, moved[..., 0])
    sensitivity = 1 / (1 + response)
    found = margins(gain, fine, response, static=static, stable=stable)
    noise_gain = _noise_gain(closed, stable=stable)
    x = MEASURED.index("position")
    countered = np.einsum("nj,nj->n", answer, moved[..., 1]) * sensitivity
    under_force = np.abs(moved[:, x, 1] + moved[:, x, 0] * countered)
    compliance = float(np.max(under_force)) if stable else nan
    lasting = _static(closed, "position", "F_D") if stable else nan
    seen = fine >= 0.999 * min(0.1, fine[-1] / 10)
    return LoopAnalysis(
        controller=controller.name,
        omega=fine[seen],
        response=response[seen],
        crossover=found.crossover,
        phase_margin=found.phase_margin,
        gain_margin=found.gain_margin,
        gain_reduction=found.gain_reduction,
        delay_margin=_delay_margin(system, law, found.delay_margin, late),
        Ms=found.Ms,
        Mt=found.Mt,
        stable=stable,
        disk_margin=found.disk_margin,
        disk_frequency=found.disk_frequency,
        gain_frequency=found.gain_frequency,
        noise_gain=noise_gain,
        current_noise=_together(noise_gain, noise),
        compliance=compliance,
        static_compliance=0.0 if abs(lasting) < NOTHING * compliance else lasting,
        Mks=float(np.max(np.abs(answer[:, x] * sensitivity))) if stable else nan,
        sample_time=h,
        delay=late,
        poles=poles,
    )


def _delay_margin(system: control.StateSpace, law: control.StateSpace, guess: float, late: float) -> float:
    """The extra delay [s] at which a pole of the sampled loop reaches the unit circle, near a guess from the phase.

    A delay is e^{-s tau} only as long as sampling leaves no images; between the samples the hold makes a difference.
    """
    from scipy.optimize import brentq

    h = float(law.dt)
    if not np.isfinite(guess) or guess > LONGEST * h:
        return guess

    model = scaled(system)

    def outside(delay: float) -> float:
        poles = np.linalg.eigvals(closed_matrix(*sampled(model, h, late + delay), law))
        return float(np.max(np.abs(poles))) - 1.0

    before = 0.0
    for after in guess * np.array([0.95, 1.05, 1.2, 1.5, 2.0, 3.0]):
        if outside(float(after)) > 0.0:
            return float(brentq(outside, before, float(after), xtol=1e-5 * guess, rtol=1e-5))
        before = float(after)
    return guess


def _noise_gain(closed: control.StateSpace, *, stable: bool) -> dict[str, float]:
    """Standard deviation of the current [A] for white noise of one unit on each reading.

    From the discrete Lyapunov equation X = A X A' + B B', the variance being C X C' + D D'.
    """
    from scipy.linalg import solve_discrete_lyapunov

    gains = {}
    row = OUTPUTS.index("current")
    for channel in MEASURED:
        column = INPUTS.index(f"n_{channel}")
        if not stable:
            gains[channel] = nan
            continue
        b, d = closed.B[:, [column]], float(closed.D[row, column])
        # The current's own covariance: states of pressures and angles differ by decades, so they are scaled first.
        variance = d**2
        if np.any(b):
            a, b_s, c_s = _scaled(closed.A, b, closed.C[[row]])
            variance += float((c_s @ solve_discrete_lyapunov(a, b_s @ b_s.T) @ c_s.T)[0, 0])
        gains[channel] = float(np.sqrt(max(variance, 0.0)))
    return gains


def _scaled(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same system in states of like size."""
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(a, permute=False, separate=True)
    return a * (scale[None, :] / scale[:, None]), b / scale[:, None], c * scale[None, :]


def _together(gains: Mapping[str, float], noise: Mapping[str, float] | None) -> float:
    """Independent noises on all readings: their variances add."""
    if noise is None:
        return nan
    unknown = set(noise) - set(MEASURED)
    if unknown:
        raise InputError(f"noise of {sorted(unknown)[0]!r}: expected channels out of {', '.join(MEASURED)}")
    return float(np.sqrt(sum((gains[channel] * sd) ** 2 for channel, sd in noise.items())))


def _static(closed: control.StateSpace, output: str, source: str) -> float:
    """Answer of a stable loop to a lasting input."""
    b, c = closed.B[:, INPUTS.index(source)], closed.C[OUTPUTS.index(output)]
    a, b_s, c_s = _scaled(closed.A, b[:, None], c[None, :])
    still = np.linalg.solve(np.eye(a.shape[0]) - a, b_s)
    return float((c_s @ still)[0, 0] + closed.D[OUTPUTS.index(output), INPUTS.index(source)])
