"""What a name means that a function does not define itself: a constant, a function of math, a function of ours."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

from .source import Source

OF_ONE = "sqrt exp log log10 sin cos tan asin acos atan sinh cosh tanh fabs"
#: Functions whose C has the same value: exactly, or as the machine's libm rounds them, which is what Python calls too.
MATH: dict[Callable[..., Any], str] = {getattr(math, name): name for name in OF_ONE.split()} | {
    math.atan2: "atan2",
    math.hypot: "hypot",
}
#: Questions about one number.
QUESTIONS: dict[Callable[..., Any], str] = {
    math.isfinite: "isfinite",
    math.isnan: "isnan",
    math.isinf: "isinf",
}
BUILTINS: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "min": min,
    "max": max,
    "int": int,
    "float": float,
    "range": range,
}


def meaning(source: Source, node: ast.expr) -> Any:
    """The Python object behind a name or a dotted name. Raises InputError if there is none."""
    if isinstance(node, ast.Name):
        if node.id in source.stands_for:
            return source.stands_for[node.id]
        known = source.function.__globals__
        if node.id in known:
            return known[node.id]
        if node.id in BUILTINS:
            return BUILTINS[node.id]
        source.fail(node, f"the name {node.id}", "an argument, a variable, a constant or a function of its module")
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        module = meaning(source, node.value)
        if hasattr(module, node.attr):
            return getattr(module, node.attr)
    return source.fail(node, ast.unparse(node), "a name, or math.name")
