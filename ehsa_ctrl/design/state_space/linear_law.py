"""A linear feedback law that the user gives: x+ = A x + B w, current = C x + D w, with anti-windup.

w are reference and measurements of a sample. While the current is limited, the state follows
x+ = A x + B w + L (limited - unlimited), so that an integrator does not wind up (K. J. Astrom, B. Wittenmark,
"Computer-Controlled Systems", 3rd ed., 1997, 9.4: observer-based anti-windup).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.controller_interface import INPUTS, MEASURED, REFERENCE
from ...core.errors import InputError

if TYPE_CHECKING:
    import control

#: Share of the direct gain that the design of L takes as uncertain. Without it a zero at -1, which Tustin's rule gives
#: every strictly proper law, would become an oscillation that does not decay (engineering judgement).
ZERO_MARGIN = 0.1


def linear_feedback(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample. settings: n, limit [A], then A (n n), B (8 n, by input), C (n), D (8), L (n). memory: x, next x (n).

    `hold` 1.0 keeps the state. An input without gain is not read, because its channel may be missing.
    """
    n = int(settings[0])
    b = 2 + n * n
    c = b + 8 * n
    d = c + n
    gain = d + 8
    current = 0.0
    for i in range(n):
        current += settings[c + i] * memory[i]
        memory[n + i] = 0.0
        for k in range(n):
            memory[n + i] += settings[2 + n * i + k] * memory[k]
    for j in range(8):
        signal = reference[j] if j < 3 else measured[j - 3]
        if settings[d + j] != 0.0:
            current += settings[d + j] * signal
        for i in range(n):
            if settings[b + n * j + i] != 0.0:
                memory[n + i] += settings[b + n * j + i] * signal
    current += extra
    limited = min(max(current, -settings[1]), settings[1])
    if hold != 1.0:
        for i in range(n):
            memory[i] = memory[n + i] + settings[gain + i] * (limited - current)
    return limited


@dataclass(frozen=True)
class LinearLaw:
    """A linear feedback law, a design.controller.Law.

    Attributes
    ----------
    A (n, n), B (n, 8), C (1, n), D (1, 8): discrete; inputs as in core.controller_interface.INPUTS.
    anti_windup: L (n,). current_limit: A. sample_time: s. text: what it was made from, for tables.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    anti_windup: np.ndarray
    current_limit: float
    sample_time: float
    text: str
    function = staticmethod(linear_feedback)
    uses: tuple[Callable[..., Any], ...] = ()
    compiles = True
    traces = dict[str, int]()

    @property
    def reads(self) -> tuple[str, ...]:
        used = np.any(np.vstack([self.B, self.D]) != 0.0, axis=0)[len(REFERENCE) :]
        return tuple(name for name, there in zip(MEASURED, used, strict=True) if there)

    def settings(self) -> np.ndarray:
        parts = (self.A.ravel(), self.B.T.ravel(), self.C.ravel(), self.D.ravel(), self.anti_windup)
        return np.concatenate([[float(self.A.shape[0]), self.current_limit], *parts])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(2 * self.A.shape[0])

    def linear(self) -> control.StateSpace:
        import control

        return control.ss(self.A, self.B, self.C, self.D, self.sample_time, inputs=list(INPUTS), outputs=["current"])

    def __str__(self) -> str:
        return self.text


def anti_windup_gain(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """L (n,) of the law x+ = a x + b w, u = c x + d w, for the saturated current.

    L is the stationary Kalman gain of the law with white w. For a law with direct gain and zeros inside the unit circle
    it is close to b / d, the conditioning technique (R. Hanus, M. Kinnaert, J.-L. Henrotte, Automatica 23(6), 1987);
    other zeros are mirrored into the circle.

    Raises InputError for a law with a mode that does not decay and does not act on the current.
    """
    from scipy.linalg import solve_discrete_are

    if a.shape[0] == 0:
        return np.zeros(0)
    noise = float(np.sum(d**2)) + ZERO_MARGIN**2 * float(np.sum(d**2) + np.sum((c @ b) ** 2))
    joint = b @ d.T
    try:
        p = solve_discrete_are(a.T, c.T, b @ b.T, [[noise or 1.0]], s=joint)
        gain = (a @ p @ c.T + joint) / float((c @ p @ c.T).item() + (noise or 1.0))
    except (np.linalg.LinAlgError, ValueError):
        gain = np.full((a.shape[0], 1), np.nan)
    if not np.isfinite(gain).all() or np.max(np.abs(np.linalg.eigvals(a - gain @ c))) >= 1.0:
        if np.max(np.abs(np.linalg.eigvals(a))) < 1.0:
            return np.zeros(a.shape[0])
        raise InputError(
            "the law has a mode that does not decay and that its input does not reach or its output does not show; "
            "reduce it first, for instance with control.minreal"
        )
    return np.asarray(gain[:, 0])
