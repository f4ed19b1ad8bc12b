"""The stationary Kalman filter for measured speed, pressure difference and position.

It estimates states and disturbances z = (x, d). White noise on the current drives the states, and each disturbance is a
random walk. White noise at the input also recovers the margins of state feedback that an observer loses (J. C. Doyle,
G. Stein, "Robustness with observers", IEEE Trans. Automatic Control 24(4), 1979).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core.definition import Definition, Drive, In, Metre, Newton, RadianPerSecond
from ...core.errors import InputError
from .model import DesignModel, full_rank

Pascal = Annotated[float, In("Pa")]


class Observer(Definition):
    """[observer]: standard deviations for the Kalman filter."""

    speed: RadianPerSecond = Field(default=0.5, gt=0, description="noise of the speed sensor")
    pressure: Pascal = Field(default=15e3, gt=0, description="noise of the pressure sensors")
    # 20 um of noise and 10 um of quantisation: sqrt(20^2 + 10^2 / 12).
    position: Metre = Field(default=20.2e-6, gt=0, description="noise of the position sensor")
    current: Drive = Field(
        default=0.1, gt=0, description="white process noise of the motor current; a larger one trusts the model less"
    )
    friction: Drive = Field(default=0.3, gt=0, description="random walk of the friction current in one second")
    load: Newton = Field(default=100.0, gt=0, description="random walk of the load force in one second")
    leak: RadianPerSecond = Field(default=1.0, gt=0, description="random walk of the leakage disturbance in one second")


@dataclass(frozen=True)
class Kalman:
    """A stationary filter for z = (x, d).

        z = z_predicted + gain (y - C z_predicted),    z_predicted+ = A z + B u

    Attributes
    ----------
    A (n + d, n + d), B (n + d,), C (m, n + d): the model with its disturbances.
    gain: (n + d, m). covariance: (n + d, n + d) of the prediction's error.
    Q (n + d, n + d), R (m, m): covariances of process and sensor noise, per sample.
    states: n.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    gain: np.ndarray
    covariance: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    states: int

    @property
    def poles(self) -> np.ndarray:
        """Poles (n + d,) of the prediction error, in z."""
        return np.linalg.eigvals(self.A - self.A @ self.gain @ self.C)

    def start(self, still: tuple[int, ...] = ()) -> np.ndarray:
        """Matrix (n + d, m) from the first measurement to the initial estimate, at rest without current.

        With as many disturbances as measurements the estimate reproduces the measurement and is in equilibrium, so that
        a law that compensates them needs no current at the target position.

        still: rows of y taken as zero, such as a speed that is only noise at the start.
        """
        n = self.states
        # Without disturbances no equilibrium has a pressure: the states only reproduce the measurement.
        rest = (self.A - np.eye(len(self.A)))[:n] if n < len(self.A) else np.zeros((0, n))
        both = np.vstack([rest, self.C])
        size = np.max(np.abs(both), axis=1)
        first = np.linalg.pinv(both / size[:, None])[:, len(rest) :] / size[len(rest) :]
        first[:, list(still)] = 0.0
        return first


def design_kalman(model: DesignModel, noise: Observer) -> Kalman:
    """The filter for a design model and noise levels, by python-control's `dlqe`.

    Raises InputError if the measurements can't distinguish the disturbances.
    """
    import control

    n, d = model.E.shape
    a = np.block([[model.A, model.E], [np.zeros((d, n)), np.eye(d)]])
    b = np.concatenate([model.B, np.zeros(d)])
    c = np.hstack([model.C, np.zeros((model.C.shape[0], d))])
    if not full_rank(np.vstack([a - np.eye(n + d), c])):
        raise InputError(
            f"the measurements {', '.join(model.signals)} can't distinguish the disturbances "
            f"{', '.join(model.disturbances)}"
        )
    walks = np.array([getattr(noise, name) for name in model.disturbances]) / model.disturbance_scale
    Q = noise.current**2 * np.outer(b, b) + np.diag(np.r_[np.zeros(n), model.sample_time * walks**2])
    sd = {"speed": noise.speed, "pressure": np.sqrt(2.0) * noise.pressure, "position": noise.position}
    R = np.diag([sd[name] ** 2 for name in model.signals])
    # Measurements in units of their standard deviation: variances in m2 and Pa2 in one equation lose digits.
    unit = np.sqrt(np.diag(R))
    _, covariance, _ = control.dlqe(a, np.eye(n + d), c / unit[:, None], Q, np.eye(unit.size), method="scipy")
    covariance = 0.5 * (covariance + covariance.T)
    scaled = c / unit[:, None]
    gain = np.linalg.solve(scaled @ covariance @ scaled.T + np.eye(unit.size), scaled @ covariance).T / unit
    return Kalman(a, b, c, gain, covariance, Q, R, n)
