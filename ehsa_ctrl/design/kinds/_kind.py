"""The interface of a controller kind: the form of its TOML and its design function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pydantic import Field, model_validator

from ...core.definition import Definition, Drive, Schema, Second
from ...core.errors import InputError
from ...core.watchdog import Watchdog
from ..analysis.closed_loop import close_loop, spectral_radius
from ..stages.feedforward import Feedforward
from ..stages.rest import Dither, Rest
from ..stages.trajectory import TrajectoryLimits

if TYPE_CHECKING:
    import control


class ControllerFile(Definition):
    """Keys of every controller's TOML; a kind adds its own."""

    schema_version: Schema = Field(alias="schema", description="format version")
    kind: str = Field(description="type of feedback law")
    title: str = Field(description="one line for lists and tables")
    note: str = Field(default="", description="remarks for the reader")
    sample_time: Second = Field(
        default=0.004, ge=1e-6, lt=1, description="sample time of the loop; by default that of the plant"
    )
    current_limit: Drive = Field(
        gt=0, description="largest magnitude of the current, or of the plant's other drive in its unit (N, V)"
    )
    trajectory: TrajectoryLimits | None = Field(default=None, description="motion planning; off if left out")
    feedforward: Feedforward | None = Field(default=None, description="model-based feedforward; off if left out")
    dither: Dither | None = Field(default=None, description="sine added to the current; off if left out")
    watchdog: Watchdog = Field(default=Watchdog(), description="safe output of `serve` when the plant is silent")

    @model_validator(mode="after")
    def _check_dither(self) -> ControllerFile:
        if self.dither is not None and self.dither.frequency * self.sample_time >= 0.5:
            raise ValueError(f"[dither] frequency must be below half the sample rate {0.5 / self.sample_time:g} Hz")
        return self

    @model_validator(mode="after")
    def _check_safe_current(self) -> ControllerFile:
        if abs(self.watchdog.safe_current) > self.current_limit:
            raise ValueError(
                f"[watchdog] safe_current = {self.watchdog.safe_current:g} exceeds current_limit = "
                f"{self.current_limit:g} of the drive"
            )
        return self

    def refuse_inertia(self, law: str, how: str = "") -> None:
        """Raise ValueError for [feedforward] inertia beside a law that feeds the planned acceleration forward."""
        if self.feedforward is not None and self.feedforward.inertia != 0.0:
            raise ValueError(
                f"[feedforward] inertia: {law} feeds the planned acceleration forward itself{how}; leave it out"
            )


class PositionControllerFile(ControllerFile):
    """Keys of every controller whose rod holds a position, and may be left alone where friction holds it."""

    rest: Rest | None = Field(default=None, description="deadband at rest; off if left out")


@dataclass(frozen=True)
class ControllerKind:
    """A kind of controller.

    Attributes
    ----------
    name: value of `kind = "..."` of a controller's TOML.
    summary: one line for lists.
    file: the definition's form, a ControllerFile.
    design: (controller's name, definition, linear model with an output x) -> a design.controller.Law.
    tunes: dotted keys that `design --tune` chooses -> SI unit, least and largest value.
    """

    name: str
    summary: str
    file: type[ControllerFile]
    design: Callable[[str, Any, Any], Any]
    tunes: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)


def require_stable(system: control.StateSpace, controller: Any, fix: str) -> None:
    """Raise InputError for a controller whose sampled linear loop is unstable; `fix` says what to change."""
    radius = spectral_radius(close_loop(system, controller)[2].A)
    if radius >= 1.0:
        raise InputError(f"the loop is unstable on this model (largest |pole| {radius:.4g}); {fix}")
