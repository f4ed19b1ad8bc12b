"""States that follow the pressures of both chambers behind a first-order lag, and their course along a log."""

from collections.abc import Callable, Mapping

import numpy as np

from ...core.log import Log
from ._effect import EffectState


def late_pressures(name: str, lag: str, typical: float) -> tuple[EffectState, EffectState]:
    """States NAME1 and NAME2: the rise of P_1 and P_2 above P_0 [Pa] behind a lag.

    lag: the effect's parameter with the time constant [s]. typical: for a plant without the effect: what a wrong one
    leaves at the start of a run decays with the effect's own.
    """
    return (
        EffectState(f"{name}1", "Pa", 5e5, along=_late_rise("p1", lag, typical)),
        EffectState(f"{name}2", "Pa", 5e5, along=_late_rise("p2", lag, typical)),
    )


def _late_rise(channel: str, lag: str, typical: float) -> Callable[[Log, Mapping[str, float]], np.ndarray]:
    """(log, plant's parameters) -> (N,) rise of a pressure above P_0 [Pa] behind the lag; zero if it is not logged."""

    def along(log: Log, plant: Mapping[str, float]) -> np.ndarray:
        # Here, as scipy.signal imports for half a second, and every command imports the effects.
        from scipy.signal import lfilter, lfiltic

        if channel not in log.channels:
            return np.zeros(len(log))
        rise = log[channel] - plant["P_0"]
        kept = float(np.exp(-log.sample_time / plant.get(lag, typical)))
        late, _ = lfilter([1.0 - kept], [1.0, -kept], rise, zi=lfiltic([1.0 - kept], [1.0, -kept], rise[:1], rise[:1]))
        return np.asarray(late)

    return along
