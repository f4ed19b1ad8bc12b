"""Figures of results, registered by result type.

The functions that draw are in `ehsa_ctrl.report.figures` and register themselves with `@draw.register`; the module is
loaded when the first figure is drawn. Users register figures of their own result types in the same way.
"""

from __future__ import annotations

import importlib
from functools import singledispatch
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_modules: list[str] = []


def load_figures_from(module: str) -> None:
    """Add a module whose import registers figures; it is imported when the first figure is drawn."""
    _modules.append(module)


@singledispatch
def draw(result: Any, **options: Any) -> Figure:
    """The figure of a result. Raises TypeError for a type without one.

    This base case is reached if no figure of this type is registered yet: it loads the added modules and tries again.
    """
    while _modules:
        importlib.import_module(_modules.pop())
    if draw.dispatch(type(result)) is draw.dispatch(object):
        raise TypeError(f"no figure is registered for {type(result).__name__}; add one with @draw.register")
    return draw(result, **options)
