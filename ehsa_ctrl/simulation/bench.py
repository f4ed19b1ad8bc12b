"""The virtual bench: a plant with sensors, driven by an excitation and logged as on a real bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..core.errors import InputError
from ..core.log import Log, check_time
from ..plant.plant import Plant
from .closed_loop import run_closed_loop
from .engine import checked_input, simulate
from .sensors import Sensors
from .trajectory import Trajectory

#: Time constant [s] of the filter of the centring loop. Engineering judgement: slow against the excitation. Gain and
#: limit are the system's.
CENTRING_TIME = 0.5


def centring_step(reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> float:
    """Excitation (in place of the position reference) plus a slow feedback towards x = 0, to stay within the stroke."""
    gain, time_constant, limit, sample_time = settings
    memory[0] += sample_time / time_constant * (measured[3] - memory[0])
    return reference[0] - min(max(gain * memory[0], -limit), limit)


@lru_cache(maxsize=1)
def _compiled() -> Callable[..., float]:
    from ..core.compiled import cached_njit
    from .closed_loop_kernel import CONTROLLER

    return cached_njit(CONTROLLER)(centring_step)


@dataclass(frozen=True)
class _Centring:
    """The centring loop of the bench, as a controller."""

    sample_time: float
    gain: float
    limit: float
    name: str = "centring"

    @property
    def compiled(self) -> Callable[..., float]:
        return _compiled()

    @property
    def traces(self) -> dict[str, int]:
        return {}

    def settings(self) -> np.ndarray:
        return np.array([self.gain, CENTRING_TIME, self.limit, self.sample_time])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(1)

    def step(self, reference: np.ndarray, measured: np.ndarray, memory: np.ndarray) -> float:
        return float(centring_step(reference, measured, memory, self.settings()))


def record(
    plant: Plant,
    time: np.ndarray,
    current: np.ndarray,
    *,
    seed: int = 0,
    sensor_noise: bool = True,
    centre: bool = False,
    tolerance: float = 1e-6,
    force: np.ndarray | None = None,
) -> tuple[Log, Trajectory]:
    """Drive the bench with a current, or the first input of another system, and log it.

    Parameters
    ----------
    time, current: (N,) s and A, uniformly sampled; the current is held over each sample.
    seed: of the sensor noise.
    sensor_noise: False logs without noise, but with quantisation and delays.
    centre: add the slow loop that keeps the rod within its stroke; the current in the log is the sum.
    tolerance: as for `simulate`.
    force: (N,) external force [N], or the second input of another system; zero by default.

    Returns
    -------
    The log in the format of a measured one, and the true trajectory. If the rod is driven so far beyond its stroke that
    the equations no longer hold, both end there, and `stopped` of the trajectory gives the reason.

    Raises
    ------
    SimulationError: the run stopped early within all limits of the plant.
    InputError: centre, for a system without a centring loop.
    """
    gain, limit = plant.structure.system.centring
    if centre and not gain:
        raise InputError(f"{plant.name}: has no channel position to centre; leave out --centre")
    time, current = checked_input(time, "time"), checked_input(current, "current", time.size)
    check_time("time", time, first_row=0)
    dt = float((time[-1] - time[0]) / (time.size - 1))
    sensors = Sensors.of(plant, seed=seed, noise=sensor_noise)
    if centre:
        reference = np.zeros((time.size, 3))
        reference[:, 0] = current
        loop = run_closed_loop(
            plant, _Centring(dt, gain, limit), reference, sensors=sensors, tolerance=tolerance, raise_on_failure=False
        )
        run = loop.trajectory
    else:
        hold = plant.structure.system.hold
        run = simulate(
            plant, current, force=force, hold=hold, sample_time=dt, tolerance=tolerance, raise_on_failure=False
        )
    run.explained()
    return Log(time[: len(run)], sensors.log(run)), run
