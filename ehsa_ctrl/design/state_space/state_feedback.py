"""The state feedback law with its observer: LQR with estimated disturbances, or LQI.

Each sample corrects the estimate z = (x, d) by the measurement, then

    u = Gamma w - K (x - Pi w) - K_before mu_before - K_integral q,    w = (planned motion, d),

and the prediction for the next sample uses the limited current without `extra`, the current of feedforward and friction
compensation: that balances friction, which the linear model lacks, so that the model would predict motion from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from ...core.controller_interface import MEASURED
from ..analysis.closed_loop import law_state_space
from .kalman import Kalman
from .model import DesignModel
from .regulator import MOTION, Regulator, Target

if TYPE_CHECKING:
    import control

#: Numbers before the matrices in settings, and before the estimates in memory.
HEAD, STATE = 18, 4


def estimate(measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, hold: float) -> None:
    """Correct the prediction in memory by the readings (5,); memory and settings as in `state_feedback`."""
    n, m, free = int(settings[0]), int(settings[1]), int(settings[2])
    c, g, pick, start = int(settings[10]), int(settings[11]), int(settings[16]), int(settings[17])
    predicted, z = 4, 4 + n
    first = memory[0] == 0.0
    for i in range(n):
        memory[z + i] = memory[predicted + i]
    for j in range(m):
        innovation = 0.0
        for i in range(5):
            if settings[pick + 5 * j + i] != 0.0:
                innovation += settings[pick + 5 * j + i] * measured[i]
        if not isfinite(innovation):
            continue  # a lost reading: nan would stay in the estimate for ever
        if first:
            for i in range(n):
                memory[z + i] += settings[start + i * m + j] * innovation
            continue
        for i in range(n):
            innovation -= settings[c + j * n + i] * memory[predicted + i]
        for i in range(n):
            if i < free or hold == 0.0:
                memory[z + i] += settings[g + i * m + j] * innovation
    if first:
        memory[0] = 1.0
        y = measured[3] if isfinite(measured[3]) else 0.0
        # At rest no current is needed yet: the integral starts where it cancels the current of the gains.
        memory[2] = -target_current(y, 0.0, 0.0, memory, settings)
        if settings[6] != 0.0:
            memory[1] = regulator_current(y, 0.0, 0.0, memory, settings) / settings[6]


def target_current(
    position: float, velocity: float, acceleration: float, memory: np.ndarray, settings: np.ndarray
) -> float:
    """Gamma w: the current [A] for the planned motion and the disturbances."""
    n, f_z, f_r = int(settings[0]), int(settings[14]), int(settings[15])
    current = settings[f_r] * position + settings[f_r + 1] * velocity + settings[f_r + 2] * acceleration
    for i in range(n):
        current += settings[f_z + i] * memory[4 + n + i]
    return current


def regulator_current(
    position: float, velocity: float, acceleration: float, memory: np.ndarray, settings: np.ndarray
) -> float:
    """Current u [A] of the law above, without limits."""
    n, k_z, k_r = int(settings[0]), int(settings[12]), int(settings[13])
    current = settings[k_r] * position + settings[k_r + 1] * velocity + settings[k_r + 2] * acceleration
    for i in range(n):
        current -= settings[k_z + i] * memory[4 + n + i]
    return current - settings[5] * memory[2] - settings[6] * memory[1]


def predict(used: float, target: float, memory: np.ndarray, settings: np.ndarray) -> None:
    """Predict the next sample from the current `used` [A] of the model; `target` is Gamma w [A]."""
    n, a, b = int(settings[0]), int(settings[8]), int(settings[9])
    memory[2], memory[3] = used - target, used
    for i in range(n):
        predicted = settings[b + i] * used
        for k in range(n):
            predicted += settings[a + i * n + k] * memory[4 + n + k]
        memory[4 + i] = predicted


def state_feedback(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample of the law above.

    settings: sizes of z, of y and of x in z; current limit, sample time, K_before, K_integral, fraction of a saturation
    that back-calculation removes from the integral per sample; first indices of A, B, C, gain, K_z, K_r, F_z, F_r,
    pick and start, then these matrices (see `StateFeedback.matrices`).
    memory: 1 after the first sample, q, mu_before, the feedback's current, predicted z (n), z (n).
    """
    limit, T_s, integral, share = settings[3], settings[4], settings[6], settings[7]
    estimate(measured, memory, settings, hold)
    target = target_current(reference[0], reference[1], reference[2], memory, settings)
    wanted = regulator_current(reference[0], reference[1], reference[2], memory, settings)
    current = min(max(wanted + extra, -limit), limit)
    used = current - extra
    if integral != 0.0 and hold == 0.0 and isfinite(measured[3]):
        memory[1] += T_s * (reference[0] - measured[3]) - share * (used - wanted) / integral
    predict(used, target, memory, settings)
    return current


@dataclass(frozen=True)
class StateFeedback:
    """State feedback with its observer, a design.controller.Law.

    Attributes
    ----------
    model, target, kalman, regulator: results of the design steps.
    current_limit: A.
    tracking_time: s, time constant of back-calculation of an LQI's integral.
    """

    model: DesignModel
    target: Target
    kalman: Kalman
    regulator: Regulator
    current_limit: float
    tracking_time: float = 0.1
    function = staticmethod(state_feedback)
    uses = (target_current, regulator_current, estimate, predict)
    compiles = True

    @property
    def K(self) -> np.ndarray:
        """Gains (n,) per SI state: A s/rad, A/Pa, A s/m, A/m."""
        return self.regulator.K / self.model.scale

    @property
    def L(self) -> np.ndarray:
        """Gains (n + d, m) of the filter, SI, from a measurement's innovation to states and disturbances."""
        return self._scale[:, None] * self.kalman.gain

    @cached_property
    def reads(self) -> tuple[str, ...]:
        used = np.any(self.model.pick != 0.0, axis=0)
        return tuple(channel for channel, needed in zip(MEASURED, used, strict=True) if needed)

    @property
    def traces(self) -> Mapping[str, int]:
        names = (*self.model.states, *self.model.disturbances)
        return {f"estimate_{name}": STATE + len(names) + i for i, name in enumerate(names)}

    @property
    def _scale(self) -> np.ndarray:
        return np.r_[self.model.scale, self.model.disturbance_scale]

    @cached_property
    def matrices(self) -> dict[str, np.ndarray]:
        """Matrices of the law by name, in SI units, in the order of the settings.

        A (n, n), B (n,), C (m, n), gain (n, m) of z; u = -K_z z + K_r motion - ...; F_z z + F_r motion = Gamma w;
        pick (m, 5); start (n, m). n counts states and disturbances here.
        """
        scale, x = self._scale, self.model.A.shape[0]
        Pi, Gamma, K = self.target.Pi, self.target.Gamma, self.regulator.K
        speed = tuple(i for i, name in enumerate(self.model.signals) if name == "speed")
        return {
            "A": self.kalman.A * scale[:, None] / scale[None, :],
            "B": self.kalman.B * scale,
            "C": self.kalman.C / scale[None, :],
            "gain": self.L,
            "K_z": np.r_[K, -(Gamma[MOTION:] + K @ Pi[:, MOTION:])] / scale,
            "K_r": Gamma[:MOTION] + K @ Pi[:, :MOTION],
            "F_z": np.r_[np.zeros(x), Gamma[MOTION:]] / scale,
            "F_r": Gamma[:MOTION],
            "pick": self.model.pick,
            "start": scale[:, None] * self.kalman.start(still=speed),
        }

    @cached_property
    def _settings(self) -> np.ndarray:
        z, x, m = self._scale.size, self.model.scale.size, self.model.C.shape[0]
        share = min(self.model.sample_time / self.tracking_time, 1.0)
        gains = self.regulator.before, self.regulator.integral, share
        parts = [part.ravel() for part in self.matrices.values()]
        begins = HEAD + np.cumsum([0, *(part.size for part in parts[:-1])])
        head = [z, m, x, self.current_limit, self.model.sample_time, *gains, *begins]
        return np.concatenate([np.array(head, dtype=float), *parts])

    def settings(self) -> np.ndarray:
        return self._settings

    def initial_memory(self) -> np.ndarray:
        return np.zeros(STATE + 2 * self._scale.size)

    def linear(self) -> control.StateSpace:
        return law_state_space(replace(self, current_limit=inf), self.model.sample_time)

    def __str__(self) -> str:
        gains = ", ".join(f"{gain:.4g}" for gain in self.K)
        free = ", ".join(self.model.disturbances)
        how = "an integral" if self.regulator.integral else "a steady-state error"
        how = f"disturbances {free} estimated" if free else how
        return f"state feedback K = [{gains}] of {', '.join(self.model.states)} with a Kalman filter and {how}"
