"""A controller: a feedback law with supervision, trajectory, feedforward and friction compensation around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..core.controller_interface import REFERENCE_FORCE
from ..core.result import Result
from ..core.watchdog import Watchdog
from .python_law import PythonLaw
from .stages.adaptation import TRACES as ADAPTED
from .stages.compiled import compiled_pipeline
from .stages.feedforward import Feedforward, feedforward_settings
from .stages.pipeline import M_CURRENT, M_LAW, TRACES, pipeline
from .stages.rest import Dither, Rest, rest_settings
from .stages.supervision import Supervision
from .stages.trajectory import TrajectoryLimits, trajectory_settings
from .words import drive_limit, law_words

if TYPE_CHECKING:
    import control


class Law(Protocol):
    """A sampled feedback law.

    Attributes
    ----------
    function: law(reference, measured, memory, settings, extra, hold) -> current. `reference` (4,) is the planned
        motion with the force target [N], `measured` (5,) the validated readings, in the orders of
        core.controller_interface; `extra` [A] is the current of feedforward and friction compensation; `hold` is 1.0
        while integral action must pause, and -1.0 at the start of a motion, when the law may reset its integral. It
        returns feedback + extra, limited to the drive's current, and uses the limited value in its anti-windup. A
        module-level function whose source is compiled and translated to C. Vectors have indices and slices that count
        from their beginning, but no length; it may call those in `uses` and sqrt, exp, log, sin, cos, tan, tanh, atan
        and isfinite.
    uses: functions that `function` calls.
    compiles: False for a law that only runs as plain Python (with a solver inside); `function` may then be any
        callable.
    reads: channels that it requires.
    traces: name -> index in memory of the numbers to record at each sample.

    A law with an attribute `follows_force`, True, gets the force target of the reference; any other gets 0. A method
    `findings(case)` adds checks of its own to a design review; words(unit) is the law in words where the drive has
    another unit than A.
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
        """Settings (k,) of `function`."""
        ...

    def initial_memory(self) -> np.ndarray:
        """Fresh memory (m,)."""
        ...

    def linear(self) -> control.StateSpace:
        """The law without limits: discrete, inputs [*REFERENCE, *MEASURED], output current; see law_state_space."""
        ...


@dataclass(frozen=True)
class SampledController(Result):
    """A core.controller_interface.Controller for simulation, analysis and export.

    Attributes
    ----------
    name: for tables. kind: key of CONTROLLER_KINDS; "own" for a law that the user gave as a Python object.
    sample_time: s. current_limit: A.
    law: the feedback law.
    trajectory, feedforward, rest, dither: the other stages; None switches one off.
    supervision: plausibility limits of the readings.
    watchdog: safe output when the plant's side of a link is silent.
    note: what the design left out of the given model; empty if nothing.
    drive_unit: SI unit of the plant's drive, which takes the place of A.
    """

    name: str
    kind: str
    sample_time: float
    current_limit: float
    law: Law
    trajectory: TrajectoryLimits | None = None
    feedforward: Feedforward | None = None
    rest: Rest | None = None
    dither: Dither | None = None
    supervision: Supervision = field(default_factory=Supervision)
    watchdog: Watchdog = field(default_factory=Watchdog)
    note: str = ""
    drive_unit: str = "A"

    @property
    def compiled(self) -> Callable[..., float] | None:
        return compiled_pipeline(self.law.function, self.law.uses) if self.law.compiles else None

    @property
    def traces(self) -> Mapping[str, int]:
        adapts = self.feedforward is not None and self.feedforward.adaptation is not None
        own = {name: M_CURRENT + index for name, index in ADAPTED.items()} if adapts else {}
        return {**TRACES, **own, **{name: M_LAW + index for name, index in self.law.traces.items()}}

    def settings(self) -> np.ndarray:
        return self._settings.copy()

    @cached_property
    def _settings(self) -> np.ndarray:
        """Cached, because plain Python needs them at every sample."""
        return np.concatenate(
            [
                self.supervision.settings(self.sample_time, self.law.reads),
                trajectory_settings(self.trajectory, self.sample_time, force=self.follows_force),
                feedforward_settings(self.feedforward, self.sample_time, self.current_limit),
                rest_settings(self.rest, self.dither, self.sample_time),
                self.law.settings(),
            ]
        )

    def initial_memory(self) -> np.ndarray:
        memory = np.zeros(M_LAW)
        supervision = self.supervision.initial_memory()
        memory[: supervision.size] = supervision
        return np.concatenate([memory, self.law.initial_memory()])

    @property
    def follows_force(self) -> bool:
        """Whether the law follows the force target, the fourth number of a reference."""
        return bool(getattr(self.law, "follows_force", False))

    def step(self, reference: np.ndarray, measured: np.ndarray, memory: np.ndarray) -> float:
        if self.follows_force and reference.size == REFERENCE_FORCE:
            reference = np.append(reference, 0.0)
        return float(pipeline(reference, measured, memory, self._settings, self.law.function))

    @property
    def law_words(self) -> str:
        """The law with the drive's unit."""
        return law_words(self.law, self.drive_unit)

    def linear(self) -> control.StateSpace:
        """The feedback law alone without limits: discrete, inputs [*REFERENCE, *MEASURED], output current."""
        return self.law.linear()

    def __str__(self) -> str:
        stages = [
            name
            for name, stage in (
                ("trajectory", self.trajectory),
                ("feed-forward", self.feedforward),
                ("rest", self.rest),
                ("dither", self.dither),
            )
            if stage is not None
        ]
        suffix = f", with {', '.join(stages)}" if stages else ""
        return (
            f"{self.name}: {self.law_words}, {drive_limit(self.current_limit, self.drive_unit)}, "
            f"every {self.sample_time:g} s{suffix}" + (f" ({self.note})" if self.note else "")
        )


def has_linear_law(controller: Any) -> bool:
    """Whether margins can be computed: a controller whose law is neither Python code nor an MPC with a user's cost."""
    law = controller.law if isinstance(controller, SampledController) else None
    return law is not None and not isinstance(law, PythonLaw) and getattr(law, "own", None) is None
