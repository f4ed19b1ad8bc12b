"""The pressures of a log behind a first-order lag: where states start that follow a chamber's pressure late."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.signal import lfilter, lfiltic

from ...core.log import Log


def late_rise(channel: str, tau: float) -> Callable[[Log, Mapping[str, float]], np.ndarray]:
    """(log, plant's parameters) -> (N,) rise of a pressure above P_0 [Pa], behind a lag tau [s]; zero if not logged.

    tau is typical of the effect: what a wrong one leaves at the start of a run decays with the effect's own.
    """

    def along(log: Log, plant: Mapping[str, float]) -> np.ndarray:
        if channel not in log.channels:
            return np.zeros(len(log))
        rise = log[channel] - plant["P_0"]
        kept = float(np.exp(-log.sample_time / tau))
        late, _ = lfilter([1.0 - kept], [1.0, -kept], rise, zi=lfiltic([1.0 - kept], [1.0, -kept], rise[:1], rise[:1]))
        return np.asarray(late)

    return along
