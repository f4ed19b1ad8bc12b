"""What a kind of controller contributes: its feedback law."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    import control


class Law(Protocol):
    """A sampled feedback law.

    Attributes
    ----------
    function: law(reference, measured, memory, settings, extra, hold) -> current. `reference` (3,) is the planned
        motion, `measured` (5,) the trusted readings, in the orders of core.controller_interface; `extra` [A] is
        what feed-forward and friction cures add, `hold` 1.0 while integral action is to stand still and -1.0 where a
        motion begins and what integral action gathered at rest is to be forgotten (a law may ignore that). It returns
        feedback + extra, limited to the current that the drive can give, and its own anti-windup knows what was given.
        A plain function of a module, whose text is compiled; it may call those in `uses`, sqrt, exp, sin and the
        numpy that numba knows.
    uses: functions that `function` calls.
    compiles: False for a law that only runs as plain Python (a solver inside); `function` may be any callable then.
    reads: the channels without which it can't work.
    traces: what of its memory is worth keeping of each sample, name -> index.
    """

    @property
    def function(self) -> Callable[..., float]: ...

    @property
    def uses(self) -> tuple[Callable[..., Any], ...]: ...

    @property
    def compiles(self) -> bool: ...

    @property
    def reads(self) -> tuple[str, ...]: ...

    @property
    def traces(self) -> Mapping[str, int]: ...

    def settings(self) -> np.ndarray:
        """Numbers (k,) that `function` gets."""
        ...

    def initial_memory(self) -> np.ndarray:
        """Fresh memory (m,)."""
        ...

    def linear(self) -> control.StateSpace:
        """The law without limits: discrete, inputs [*REFERENCE, *MEASURED], output current."""
        ...
