"""Pages of the results that commands write: one module per kind of result, found by the name of its JSON file."""

from __future__ import annotations

import sys
from functools import cache

from ...core.registry import members
from ..page import Kind


@cache
def kinds() -> dict[str, Kind]:
    """Every kind of result by the name of its JSON file."""
    return members(sys.modules[__name__], "KIND")
