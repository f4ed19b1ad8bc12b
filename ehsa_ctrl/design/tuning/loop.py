"""The sampled PID position loop for the tuner: exact, and fast enough for thousands of evaluations.

Zero-order hold of the plant, difference equation of the law; broken at the current.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.controller_interface import MEASURED
from ..analysis.closed_loop import spectral_radius, transfer
from ..analysis.sampled import sampled_plant

if TYPE_CHECKING:
    import control

    from ..kinds.pid import Gains


@dataclass(frozen=True)
class SampledPlant:
    """Current to position, with the current held over each sample.

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
    """Current to position, the current `lag` whole samples late.

    Raises InputError for a model that does not fit (see sampled.sampled_plant).
    """
    plant = sampled_plant(system, sample_time, delay=lag * sample_time)
    return SampledPlant(plant.A, plant.B[:, 0], plant.C[MEASURED.index("position")], sample_time)


@dataclass(frozen=True)
class PidLoop:
    """A plant under PID control.

    Attributes
    ----------
    plant, gains: the open loop.
    b, c: setpoint weights of the proportional and the derivative part.
    """

    plant: SampledPlant
    gains: Gains
    b: float = 1.0
    c: float = 0.0

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Closed loop x+ = A x + B w, (y, u) = C x + D w with w = (reference, current from outside, noise).

        States: the plant's, the integral part and the memory of the derivative.
        """
        p, g, T_s = self.plant, self.gains, self.plant.sample_time
        n = p.b.size
        keep = g.T_f / (g.T_f + T_s)
        slope = g.k_d / (g.T_f + T_s)
        # The law's current from (x, integral, memory) and from (reference, current, noise).
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
        """r - y (samples,) after a step of 1 m of the reference ("reference") or of 1 A from outside ("load")."""
        a, b, c, _ = self.matrices()
        column = {"reference": 0, "load": 1}[kind]
        n = a.shape[0]
        # The step as a constant state: free response of the extended system, its rows by doubling.
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n], whole[n, n] = a, b[:, column], 1.0
        rows, power = np.append(c[0], 0.0)[None, :], whole
        while rows.shape[0] < samples:
            rows = np.concatenate([rows, rows @ power])
            power = power @ power
        y = rows[:samples, n]
        return (1.0 if column == 0 else 0.0) - y
