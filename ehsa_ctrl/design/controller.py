"""A controller: a feedback law with supervision, trajectory, feed-forward and cures against friction around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..core.controller_interface import MEASURED
from ..core.text import TextResult
from .law import Law
from .stages.feedforward import Feedforward, feedforward_settings
from .stages.pipeline import M_LAW, TRACES, compiled_pipeline, pipeline
from .stages.rest import Dither, Rest, rest_settings
from .stages.supervision import Supervision
from .stages.trajectory import Trajectory, trajectory_settings

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class SampledController(TextResult):
    """A controller as the simulator, the analysis and the export take it: a core.controller_interface.Controller.

    Attributes
    ----------
    name: for tables. kind: the word of its kind.
    sample_time: s. current_limit: A.
    law: the feedback.
    trajectory, feedforward, rest, dither: the other stages; None leaves one out.
    supervision: limits of what is taken for possible.
    """

    name: str
    kind: str
    sample_time: float
    current_limit: float
    law: Law
    trajectory: Trajectory | None = None
    feedforward: Feedforward | None = None
    rest: Rest | None = None
    dither: Dither | None = None
    supervision: Supervision = field(default_factory=Supervision)

    @property
    def compiled(self) -> Callable[..., float] | None:
        return compiled_pipeline(self.law.function, self.law.uses) if self.law.compiles else None

    @property
    def traces(self) -> Mapping[str, int]:
        return {**TRACES, **{name: M_LAW + index for name, index in self.law.traces.items()}}

    def settings(self) -> np.ndarray:
        return self._settings.copy()

    @cached_property
    def _settings(self) -> np.ndarray:
        """Once a controller: a plain step asks for them at every sample."""
        return np.concatenate(
            [
                self.supervision.settings(self.sample_time, self.law.reads),
                trajectory_settings(self.trajectory, self.sample_time),
                feedforward_settings(self.feedforward, self.sample_time),
                rest_settings(self.rest, self.dither, self.sample_time),
                self.law.settings(),
            ]
        )

    def initial_memory(self) -> np.ndarray:
        memory = np.zeros(M_LAW)
        watched = self.supervision.initial_memory()
        memory[: watched.size] = watched
        return np.concatenate([memory, self.law.initial_memory()])

    def step(self, reference: np.ndarray, measured: np.ndarray, memory: np.ndarray) -> float:
        return float(pipeline(reference, measured, memory, self._settings, self.law.function))

    def linear(self) -> control.StateSpace:
        """The law alone, discrete, inputs [*REFERENCE, *MEASURED], output current."""
        return self.law.linear()

    def __str__(self) -> str:
        stages = [
            word
            for word, stage in (
                ("trajectory", self.trajectory),
                ("feed-forward", self.feedforward),
                ("rest", self.rest),
                ("dither", self.dither),
            )
            if stage is not None
        ]
        around = f", with {', '.join(stages)}" if stages else ""
        return f"{self.name}: {self.law}, |current| <= {self.current_limit:g} A, every {self.sample_time:g} s{around}"


assert len(MEASURED) == 5  # the supervision's memory has a place for each
