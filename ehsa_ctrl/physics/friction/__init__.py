"""The friction family: one law a file. Adding a file adds the law to plants, lists, engine and tests."""

import sys

from ...core.registry import members
from ._law import LETTERS, FrictionLaw, held

LAWS: dict[str, FrictionLaw] = members(sys.modules[__name__], "law")

__all__ = ["LAWS", "LETTERS", "FrictionLaw", "held"]
