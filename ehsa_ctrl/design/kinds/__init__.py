"""Kinds of controllers, one per file. A new file adds its kind to TOML, lists, runs and tests."""

import sys

from ...core.registry import members
from ._kind import ControllerFile, ControllerKind, PositionControllerFile

CONTROLLER_KINDS: dict[str, ControllerKind] = members(sys.modules[__name__], "kind")

__all__ = ["CONTROLLER_KINDS", "ControllerFile", "ControllerKind", "PositionControllerFile"]
