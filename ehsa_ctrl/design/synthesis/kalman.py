"""The stationary Kalman filter on the measured speed, pressure difference and position.

States and disturbances z = (x, d) together: the states are driven by white noise of the current, each disturbance is a
random walk. White noise at the input is also what gives the loop back the margins of state feedback that an observer
takes (J. C. Doyle, G. Stein, "Robustness with observers", IEEE Trans. Automatic Control 24(4), 1979).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.errors import InputError
from .model import DesignModel, full_rank


@dataclass(frozen=True)
class Noise:
    """What the filter is told of noise and disturbances; one standard deviation each.

    Attributes
    ----------
    speed [rad/s], pressure [Pa] (of each of p1 and p2), position [m]: noise of the sensors, each sample.
    current: A, white noise at the motor, each sample; larger trusts the model less and the measurements more.
    friction [A], load [N], leak [rad/s]: by how much each disturbance may wander in one second.
    """

    speed: float = 0.5
    pressure: float = 15e3
    position: float = 20.2e-6  # 20 um, and the converter's steps of 10 um
    current: float = 0.1
    friction: float = 0.3
    load: float = 100.0
    leak: float = 1.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < np.inf:
                raise InputError(f"observer: {name} = {value:g}; expected a standard deviation greater than 0")


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
        """Of the prediction's error, in z."""
        return np.linalg.eigvals(self.A - self.A @ self.gain @ self.C)

    def start(self, still: tuple[int, ...] = ()) -> np.ndarray:
        """Matrix (n + d, m) from the first measurement to a first estimate that is at rest without current.

        With as many disturbances as measurements it shows that measurement exactly and stays: a law with these
        disturbances in its target asks for no current where the position is the one wanted.

        still: rows of y that are taken for zero, such as a speed that is only noise at a start.
        """
        n = self.states
        # Without disturbances nothing could explain a pressure at rest: the states show the measurement, no more.
        rest = (self.A - np.eye(len(self.A)))[:n] if n < len(self.A) else np.zeros((0, n))
        both = np.vstack([rest, self.C])
        size = np.max(np.abs(both), axis=1)
        first = np.linalg.pinv(both / size[:, None])[:, len(rest) :] / size[len(rest) :]
        first[:, list(still)] = 0.0
        return first


def design_kalman(model: DesignModel, noise: Noise) -> Kalman:
    """The filter for a design model and its noise, through python-control's `dlqe`.

    Raises InputError if the disturbances can't be told apart by what is measured.
    """
    import control

    n, d = model.E.shape
    a = np.block([[model.A, model.E], [np.zeros((d, n)), np.eye(d)]])
    b = np.concatenate([model.B, np.zeros(d)])
    c = np.hstack([model.C, np.zeros((model.C.shape[0], d))])
    if not full_rank(np.vstack([a - np.eye(n + d), c])):
        raise InputError(
            f"the measurements {', '.join(model.signals)} can't tell the disturbances "
            f"{', '.join(model.disturbances)} apart"
        )
    walks = np.array([getattr(noise, name) for name in model.disturbances]) / model.disturbance_scale
    Q = noise.current**2 * np.outer(b, b) + np.diag(np.r_[np.zeros(n), model.sample_time * walks**2])
    sd = {"speed": noise.speed, "pressure": np.sqrt(2.0) * noise.pressure, "position": noise.position}
    R = np.diag([sd[name] ** 2 for name in model.signals])
    # Measured in standard deviations: variances of metres and of pascals stand in one equation.
    unit = np.sqrt(np.diag(R))
    _, covariance, _ = control.dlqe(a, np.eye(n + d), c / unit[:, None], Q, np.eye(unit.size))
    covariance = 0.5 * (covariance + covariance.T)
    scaled = c / unit[:, None]
    gain = np.linalg.solve(scaled @ covariance @ scaled.T + np.eye(unit.size), scaled @ covariance).T / unit
    return Kalman(a, b, c, gain, covariance, Q, R, n)
