"""What each command leaves in its folder, read from its JSON and figures alone: one kind a file, found by its name."""

from __future__ import annotations

import sys
from functools import cache

from ...core.registry import members
from ._result import Kind


@cache
def kinds() -> dict[str, Kind]:
    """Every kind of result by the name of its JSON file."""
    return members(sys.modules[__name__], "KIND")
