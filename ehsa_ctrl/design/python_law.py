"""A feedback law in plain Python: a function u = f(t, y, r), or an object with such a method `step`."""

from __future__ import annotations

import copy
import inspect
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.controller_interface import Readings, Setpoint
from ..core.errors import InputError, shown

if TYPE_CHECKING:
    import control

#: Numbers of the runs, in the memory of each: a run finds its own copy of the user's object by it.
_NUMBERS = count(1)


@dataclass(frozen=True)
class PythonLaw:
    """A design.controller.Law around the user's Python; stages, supervision and the current limit act as for any law.

    Each run gets its own copy of `given`, so that the state which an object keeps in its attributes begins anew.

    Attributes
    ----------
    given: a function f(t, y, r) -> current [A], or an object with a method step(t, y, r). t: s since the run's start;
        y: Readings; r: Setpoint.
    name: for messages. sample_time: s. current_limit: A.
    """

    given: Any
    name: str
    sample_time: float
    current_limit: float
    uses: tuple[Callable[..., Any], ...] = ()
    compiles = False
    follows_force = True
    reads = ("position",)
    traces = dict[str, int]()
    _running: dict[float, Callable[..., Any]] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        step = getattr(self.given, "step", self.given)
        try:
            inspect.signature(step).bind(0.0, None, None)
        except TypeError:
            raise InputError(
                f"controller {self.name}: {'step' if step is not self.given else 'the function'}"
                f"{inspect.signature(step)} can't be called with three arguments; expected (t, y, r): time, "
                "measurements, reference"
            ) from None
        except ValueError:
            pass  # A built-in function has no signature; its call will tell.

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_running": {}}

    def settings(self) -> np.ndarray:
        return np.zeros(0)

    def initial_memory(self) -> np.ndarray:
        """Number of the run, 0 before its first sample, and samples so far."""
        return np.zeros(2)

    def function(
        self,
        reference: np.ndarray,
        measured: np.ndarray,
        memory: np.ndarray,
        settings: np.ndarray,
        extra: float,
        hold: float,
    ) -> float:
        """One sample: the user's current plus `extra`, limited. Raises InputError for a step that returns no number."""
        if memory[0] == 0.0:
            memory[0] = self._start(memory if memory.base is None else memory.base)
        time = memory[1] * self.sample_time
        memory[1] += 1.0
        current = self._running[memory[0]](time, Readings(*measured.tolist()), Setpoint(*reference.tolist()))
        try:
            number = float(current)
        except (TypeError, ValueError):
            raise InputError(
                f"controller {self.name} returned {shown(current)} at t = {time:.4g} s; expected the current, a number"
            ) from None
        return min(max(number + extra, -self.current_limit), self.current_limit)

    def _start(self, owner: Any) -> float:
        """Copy the user's object for a run, until the run's memory is gone; return the run's number."""
        number = float(next(_NUMBERS))
        try:
            own = copy.deepcopy(self.given)
        except Exception as error:
            raise InputError(
                f"controller {self.name}: can't be copied for a new run ({error}); leave files, connections and locks "
                "out of its attributes, or define __deepcopy__"
            ) from None
        self._running[number] = getattr(own, "step", own)
        weakref.finalize(owner, self._running.pop, number, None)
        return number

    def linear(self) -> control.StateSpace:
        raise InputError(f"controller {self.name} is Python code: it has no linear law to analyse")

    @property
    def identity(self) -> str:
        """Source and attributes as text: what tells two laws apart."""
        try:
            source = inspect.getsource(self.given if inspect.isroutine(self.given) else type(self.given))
        except (OSError, TypeError):
            source = self.name
        return f"{source}\n{sorted(getattr(self.given, '__dict__', {}).items(), key=str)}"

    def __str__(self) -> str:
        return "a function in Python" if inspect.isroutine(self.given) else f"{type(self.given).__name__} in Python"
