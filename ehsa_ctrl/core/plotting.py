"""Figures of results, registered by result type.

A result only declares that it can be drawn. The functions that draw live in `ehsa_ctrl.report.figures`, which is loaded
when the first figure is asked for, and register themselves with `@draw.register`. A user registers a figure of a result
type of his own in the same way.
"""

from __future__ import annotations

import importlib
from functools import singledispatch
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_modules: list[str] = []


def load_figures_from(module: str) -> None:
    """Name a module whose import registers figures; it is imported when the first figure is drawn."""
    _modules.append(module)


@singledispatch
def draw(result: Any, **options: Any) -> Figure:
    """The figure of a result. Raises TypeError for a type without one.

    This is the base case, reached while no figure of this type is registered: the named modules are loaded first.
    """
    while _modules:
        importlib.import_module(_modules.pop())
    if draw.dispatch(type(result)) is draw.dispatch(object):
        raise TypeError(f"no figure is registered for {type(result).__name__}; add one with @draw.register")
    return draw(result, **options)
