"""The systems that a plant's TOML may name, one a file. Adding a file adds the system to plants, engine and tests."""

import sys

from ...core.registry import members
from ..system import System

SYSTEMS: dict[str, System] = members(sys.modules[__name__], "system")

__all__ = ["SYSTEMS"]
