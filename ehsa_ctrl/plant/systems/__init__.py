"""The systems that a plant's TOML may name, one per file. Adding a file adds the system to plants, engine and tests.

Users add their own in `systems/` beside their `plants/`, or in a package with an entry point `ehsa_ctrl.systems`.
"""

import sys

from ...core.registry import Registry
from ..system import System

SYSTEMS: Registry[System] = Registry(sys.modules[__name__], "system", System, "systems")

__all__ = ["SYSTEMS"]
