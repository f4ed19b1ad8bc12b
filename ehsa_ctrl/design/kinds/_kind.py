"""What a kind of controller is: the form of its TOML and the function that turns it into a feedback law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import Field, model_validator

from ...core.definition import Ampere, Definition, Schema, Second
from ..stages.feedforward import Feedforward
from ..stages.rest import Dither, Rest
from ..stages.trajectory import Trajectory


class ControllerFile(Definition):
    """What every controller's TOML may have; a kind adds its own keys.

    schema: version of this form. kind: of the feedback law.
    title: one line for lists and tables. note: what a reader should know.
    sample_time: of the loop; left out, the period of the plant that it is used with.
    current_limit: largest current that it asks for, to either side.
    [trajectory], [feedforward], [rest], [dither]: stages around the feedback law; each is off where it is left out.
    """

    schema_version: Schema = Field(alias="schema")
    kind: str
    title: str
    note: str = ""
    sample_time: Second = 0.004
    current_limit: Ampere
    trajectory: Trajectory | None = None
    feedforward: Feedforward | None = None
    rest: Rest | None = None
    dither: Dither | None = None

    @model_validator(mode="after")
    def _possible(self) -> ControllerFile:
        if not 1e-6 <= self.sample_time < 1:
            raise ValueError(f"sample_time = {self.sample_time:g} s; expected at least 1 us and less than 1 s")
        if not 0 < self.current_limit < float("inf"):
            raise ValueError(f"current_limit = {self.current_limit:g} A; expected more than 0 A")
        if self.dither is not None and self.dither.frequency * self.sample_time >= 0.5:
            raise ValueError(f"[dither] frequency must be below half the sample rate {0.5 / self.sample_time:g} Hz")
        return self


@dataclass(frozen=True)
class ControllerKind:
    """A kind of controller.

    Attributes
    ----------
    name: the word in `kind = "..."` of a controller's TOML.
    summary: one line for lists.
    file: the definition's form, a ControllerFile.
    design: (controller's name, definition, linear model with an output x) -> a design.law.Law.
    """

    name: str
    summary: str
    file: type[ControllerFile]
    design: Callable[[str, Any, Any], Any]
