"""Convergence of a correction of the reference that is learnt from cycle to cycle.

    w_next = Q (w + gamma z^m e),    e_next = r - T (r + w_next)

T is the closed loop from the reference to the position, Q a low-pass filter without phase, gamma the learning gain and
m a lead in samples. From cycle to cycle the correction contracts at each frequency by

    rho = |Q (1 - gamma z^m T)|,

and where rho < 1 at all frequencies it converges without growing on the way: for iterative learning control
(D. A. Bristow, M. Tharayil, A. G. Alleyne, "A survey of iterative learning control", IEEE Control Systems Magazine
26(3), 2006), and as a sufficient condition for a repetitive controller around a stable loop (M. Tomizuka, T.-C. Tsao,
K.-K. Chew, "Analysis and synthesis of discrete-time repetitive controllers", J. Dynamic Systems, Measurement, and
Control 111(3), 1989). What Q removes is never learnt: the error that is left is (1 - Q) / (1 - Q (1 - gamma z^m T))
times that of the first cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, log, pi
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError
from .closed_loop import INPUTS, OUTPUTS, close_loop, discrete_response

if TYPE_CHECKING:
    import control

#: Frequencies of the check, up to the Nyquist frequency, and longest lead that is tried [samples].
FREQUENCIES, LONGEST_LEAD = 2000, 60


@dataclass(frozen=True)
class Learning:
    """Filter and gain of a correction, with their convergence.

    Attributes
    ----------
    gain: gamma. lead: m [samples]. taps: (2 q + 1,) of Q, symmetric. cutoff: of Q [Hz].
    contraction: largest rho over all frequencies. at: where, Hz. slow: rho at a tenth of the cutoff.
    """

    gain: float
    lead: int
    taps: np.ndarray
    cutoff: float
    contraction: float
    at: float
    slow: float

    @property
    def converges(self) -> bool:
        return self.contraction < 1.0

    def smooth(self, signal: np.ndarray) -> np.ndarray:
        """Q applied to (N,); the first and last value continue beyond the ends."""
        q = self.taps.size // 2
        return np.convolve(np.pad(signal, q, mode="edge"), self.taps, mode="valid")

    def advance(self, signal: np.ndarray) -> np.ndarray:
        """z^m applied to (N,); the last value continues."""
        return np.concatenate([signal[self.lead :], np.full(min(self.lead, signal.size), signal[-1])])

    def next_correction(self, correction: np.ndarray, error: np.ndarray) -> np.ndarray:
        """w_next (N,) [m] from the correction and the error of a cycle."""
        return self.smooth(correction + self.gain * self.advance(error))

    def __str__(self) -> str:
        return (
            f"gain {self.gain:g}, lead {self.lead} samples, Q up to {self.cutoff:.3g} Hz, contraction per cycle "
            f"{self.contraction:.3g} at {self.at:.3g} Hz, {self.slow:.2g} at a tenth of the cutoff"
        )


def binomial_taps(cutoff: float, sample_time: float) -> np.ndarray:
    """Taps (2 q + 1,) of ((z + 2 + 1 / z) / 4)^q = cos(w T / 2)^(2 q): no phase, between 0 and 1, no ripple.

    q is chosen for a gain of at most 1 / sqrt(2) from `cutoff` [Hz] on.
    """
    q = max(ceil(log(0.5) / (4.0 * log(cos(pi * cutoff * sample_time)))), 1)
    taps = np.array([1.0])
    for _ in range(q):
        taps = np.convolve(taps, [0.25, 0.5, 0.25])
    return taps


def design_learning(
    system: control.StateSpace, controller: Any, *, gain: float, cutoff: float, lead: int | None = None
) -> Learning:
    """The learning of a controller's linear loop with a model.

    Parameters
    ----------
    system, controller: as for `analyse_loop`. gain: gamma. cutoff: of Q [Hz].
    lead: m; by default the one with the least contraction.

    Raises InputError for a cutoff beyond the Nyquist frequency, an unstable loop, and a contraction of 1 or more, with
    the largest cutoff that converges.
    """
    T_s = float(controller.sample_time)
    if not 0.0 < cutoff < 0.5 / T_s:
        raise InputError(
            f"cutoff = {cutoff:g} Hz: expected more than 0 and less than {0.5 / T_s:g} Hz, half the sample rate"
        )
    _, _, closed = close_loop(system, controller)
    if np.max(np.abs(closed.poles())) >= 1.0:
        raise InputError(f"the loop with {controller.name} is unstable; a correction can't be learnt around it")
    omega = np.linspace(1e-4, 1.0, FREQUENCIES) * pi / T_s
    T = discrete_response(closed[OUTPUTS.index("position"), INPUTS.index("r_position")], omega)[:, 0, 0]
    found = _best(T, omega, gain, cutoff, lead, T_s)
    if not found.converges:
        lower = next(
            (c for c in cutoff * 0.95 ** np.arange(1, 90) if _best(T, omega, gain, c, lead, T_s).converges), None
        )
        advice = f"lower it to {lower:.3g} Hz or less" if lower is not None else "lower the gain"
        raise InputError(
            f"learning does not converge with cutoff = {cutoff:g} Hz and gain = {gain:g}: the correction grows by "
            f"{found.contraction:.3g} per cycle at {found.at:.3g} Hz; {advice}"
        )
    return found


def _best(T: np.ndarray, omega: np.ndarray, gain: float, cutoff: float, lead: int | None, T_s: float) -> Learning:
    """The learning with the least contraction over the leads."""
    taps = binomial_taps(cutoff, T_s)
    Q = np.cos(0.5 * omega * T_s) ** (taps.size - 1)
    leads = range(LONGEST_LEAD + 1) if lead is None else [lead]
    sizes = {m: np.abs(Q * (1.0 - gain * np.exp(1j * m * omega * T_s) * T)) for m in leads}
    best = min(sizes, key=lambda m: float(np.max(sizes[m])))
    k = int(np.argmax(sizes[best]))
    slow = float(np.interp(0.2 * pi * cutoff, omega, sizes[best]))
    return Learning(gain, best, taps, cutoff, float(sizes[best][k]), float(omega[k] / (2.0 * pi)), slow)
