"""What a kind of controller is: the form of its TOML and the function that turns it into a controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...core.definition import Definition


@dataclass(frozen=True)
class ControllerKind:
    """A kind of controller.

    Attributes
    ----------
    name: the word in `kind = "..."` of a controller's TOML.
    summary: one line for lists.
    file: the definition's form.
    design: (controller's name, definition, linear model with an output x) -> a core.protocol.Controller.
    """

    name: str
    summary: str
    file: type[Definition]
    design: Callable[[str, Any, Any], Any]
