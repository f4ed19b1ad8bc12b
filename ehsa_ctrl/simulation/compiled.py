"""The compiled engine of a structure."""

from __future__ import annotations

from functools import cache
from types import ModuleType

from ..core.compiled import load_compiled
from ..plant.structure import Structure
from .kernel_text import kernel_text


@cache
def engine(structure: Structure, part: str = "open_loop") -> ModuleType:
    """The compiled engine of a structure; `part` is one of `kernel_text.PARTS`.

    The first call ever for a structure compiles (see docs/theory/engine.md for how long); later starts load the result.
    """
    return load_compiled(kernel_text(structure, part), f"the {part.replace('_', '-')} engine for {structure}")
