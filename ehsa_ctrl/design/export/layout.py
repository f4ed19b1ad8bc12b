"""Settings as a table of numbers with their names beside them.

The names are those that the functions give them: a law's text that says `k_p, k_i = settings[0], settings[1]` has
named two of its settings.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .kinds import literal
from .meaning import meaning
from .source import Source, read_source

#: Numbers on a line, where they have no names.
ACROSS = 4


def setting_names(function: Callable[..., Any], allowed: tuple[Callable[..., Any], ...]) -> dict[int, str]:
    """Index in `settings` -> the name that `function`, or one in `allowed` to which it hands them on, gives it."""
    source = read_source(function)
    found: dict[int, str] = {}
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Assign):
            for target, value in _pairs(node.targets[0], node.value):
                index = _index(value)
                if isinstance(target, ast.Name) and index is not None:
                    found.setdefault(index, target.id)
        if isinstance(node, ast.Call) and any(_is_settings(argument) for argument in node.args):
            called = _called(source, node)
            if called in allowed and called is not function:
                found = {**setting_names(called, allowed), **found}
    return found


def settings_lines(values: np.ndarray, names: Mapping[int, str], parts: Mapping[str, np.ndarray]) -> list[str]:
    """Lines of a C initialiser; `parts`: matrices by name, which stand last, in this order."""
    begins, place = {}, values.size - sum(part.size for part in parts.values())
    for name, part in parts.items():
        begins[place] = f"{name} ({', '.join(str(n) for n in part.shape)})"
        place += part.size
    lines: list[str] = []
    row: list[str] = []
    for k, value in enumerate(values.tolist()):
        if row and (k in begins or k in names or len(row) == ACROSS):
            lines.append(" ".join(row))
            row = []
        if k in begins:
            lines.append(f"/* {begins[k]} */")
        if k in names:
            lines.append(f"{literal(value)}, /* {names[k]} */")
        else:
            row.append(f"{literal(value)},")
    return [*lines, " ".join(row)] if row else lines


def _pairs(target: ast.expr, value: ast.expr) -> list[tuple[ast.expr, ast.expr]]:
    if not isinstance(target, ast.Tuple):
        return [(target, value)]
    if isinstance(value, ast.Tuple):
        return list(zip(target.elts, value.elts, strict=True))
    base = value.value if isinstance(value, ast.Subscript) else value
    if not _is_settings(base) or (isinstance(value, ast.Subscript) and getattr(value.slice, "lower", None) is not None):
        return []
    return [(single, ast.Subscript(base, ast.Constant(k), ast.Load())) for k, single in enumerate(target.elts)]


def _index(node: ast.expr) -> int | None:
    """k of `settings[k]` or `int(settings[k])`."""
    if isinstance(node, ast.Call) and len(node.args) == 1 and getattr(node.func, "id", "") == "int":
        node = node.args[0]
    if isinstance(node, ast.Subscript) and _is_settings(node.value) and isinstance(node.slice, ast.Constant):
        return int(node.slice.value) if isinstance(node.slice.value, int) else None
    return None


def _is_settings(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id == "settings"


def _called(source: Source, node: ast.Call) -> Any:
    return meaning(source, node.func) if isinstance(node.func, ast.Name) else None
