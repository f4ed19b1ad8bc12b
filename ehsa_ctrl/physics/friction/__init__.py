"""Friction laws, one per file. Adding a file adds the law to plants, lists, engine and tests.

Users add their own in `friction/` beside their `plants/`, or in a package with an entry point `ehsa_ctrl.friction`.
"""

import sys

from ...core.registry import Registry
from ._law import SYMBOLS, FrictionLaw, FrictionParameter, held

LAWS: Registry[FrictionLaw] = Registry(sys.modules[__name__], "law", FrictionLaw, "friction")

__all__ = ["LAWS", "SYMBOLS", "FrictionLaw", "FrictionParameter", "held"]
