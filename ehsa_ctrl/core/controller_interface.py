"""What a controller is to the house: the simulator runs anything of this shape, and knows nothing else of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import numpy as np

#: What a controller is given each sample, in this order (SI units).
MEASURED = ("speed", "p1", "p2", "position", "force")
#: The reference row a controller is given each sample: position, its speed and its acceleration.
REFERENCE = ("position", "velocity", "acceleration")
#: Names of the inputs of a controller's linear law: reference and measured values can't be told apart by name alone.
INPUTS = (*(f"reference_{name}" for name in REFERENCE), *MEASURED)


@runtime_checkable
class Controller(Protocol):
    """A sampled controller: from a reference row and measured values to the motor's current.

    Attributes
    ----------
    name: for tables.
    sample_time: s, the period for which it was designed.
    compiled: the step as a numba-compiled function with the signature
        float64(float64[::1], float64[::1], float64[::1], float64[::1]), arguments as in `step` and the settings last;
        None if it has only the plain step.
    traces: what of its memory is worth recording at each sample, name -> index.
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
        """Numbers (k,) that the compiled step gets as its last argument; they don't change during a run."""
        ...

    def initial_memory(self) -> np.ndarray:
        """Fresh state (m,) of the controller; `step` changes it in place."""
        ...

    def step(self, reference: np.ndarray, measured: np.ndarray, memory: np.ndarray) -> float:
        """Current [A] for this sample, from `reference` (3,), `measured` (5,) and the controller's memory."""
        ...
