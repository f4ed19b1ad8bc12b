"""The controller interface: the simulator runs any object with these members."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

#: Measurements of each sample in this order, SI units.
MEASURED = ("speed", "p1", "p2", "position", "force")
#: Reference of each sample: position, velocity and acceleration.
REFERENCE = ("position", "velocity", "acceleration")
#: Index of the force target [N] in a row of the reference: a fourth number, for controllers that follow a force.
REFERENCE_FORCE = len(REFERENCE)
#: Inputs of a controller's linear law; the prefix separates references from measurements of the same name.
INPUTS = (*(f"reference_{name}" for name in REFERENCE), *MEASURED)


class Readings(NamedTuple):
    """Measurements of a sample, as MEASURED."""

    speed: float  # shaft, rad/s
    p1: float  # Pa
    p2: float  # Pa
    position: float  # m
    force: float  # N


class Setpoint(NamedTuple):
    """Reference of a sample, as REFERENCE."""

    position: float  # m
    velocity: float  # m/s
    acceleration: float  # m/s2
    force: float = 0.0  # N, target of a force controller; 0 asks for none


@runtime_checkable
class Controller(Protocol):
    """A sampled controller: computes the motor current from the reference and the measurements of each sample.

    Attributes
    ----------
    name: name in tables and files.
    sample_time: the sample time that it is designed for [s].
    compiled: the step as a function of numba.njit for the signature
        float64(float64[::1], float64[::1], float64[::1], float64[::1]), arguments as in `step` and the settings last;
        None if it has only a step in Python.
    traces: name -> index of the entries of its memory that are recorded at each sample.
    """

    @property
    def name(self) -> str: ...

    @property
    def sample_time(self) -> float: ...

    @property
    def compiled(self) -> Callable[..., float] | None: ...

    @property
    def traces(self) -> Mapping[str, int]: ...

    def settings(self) -> np.ndarray:
        """Constants (k,) for the last argument of the compiled step."""
        ...

    def initial_memory(self) -> np.ndarray:
        """Initial state (m,) of the controller; `step` updates it in place."""
        ...

    def step(self, reference: np.ndarray, measured: np.ndarray, memory: np.ndarray) -> float:
        """Current [A] of this sample.

        reference: (3,) as in REFERENCE, or (4,) with the force target [N]. measured: (5,) as in MEASURED.
        memory: (m,), updated in place.
        """
        ...
