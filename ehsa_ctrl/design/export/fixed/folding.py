"""Operations on numbers that are known or not: what is known is computed, what is not becomes a term.

A table has one known number for each value of its indices. Operations on tables and known numbers give tables.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

from .term import BOOL, INT, REAL, ProgramTerm, constant

COMPUTED: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "%": operator.mod,
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip


def as_term(value: ProgramTerm | float) -> ProgramTerm:
    """A term; a constant for a known number."""
    return value if isinstance(value, ProgramTerm) else constant(value)


def operated(sign: str, a: Any, b: Any) -> Any:
    """a sign b, simplified where one of them is a known 0 or 1."""
    if not isinstance(a, ProgramTerm) and not isinstance(b, ProgramTerm):
        return COMPUTED[sign](a, b)
    if all(not isinstance(each, ProgramTerm) or each.operation == "table" for each in (a, b)):
        return folded(COMPUTED[sign], a, b)
    match sign:
        case "*" if _is(a, 0.0) or _is(b, 0.0):
            return 0.0
        case "/" if _is(a, 0.0):
            return 0.0
        case "*" | "/" if _is(b, 1.0):
            return a
        case "+" | "-" if _is(b, 0.0):
            return a
        case "*" if _is(a, 1.0):
            return b
        case "+" if _is(a, 0.0):
            return b
    a, b = as_term(a), as_term(b)
    whole = a.type == b.type == INT and sign != "/"
    return ProgramTerm(sign, (a, b) if whole else (as_real(a), as_real(b)), INT if whole else REAL)


def folded(function: Callable[..., Any], *operands: Any) -> Any:
    """A function of tables and known numbers: the table of its values, or the only value."""
    tables = [each for each in operands if isinstance(each, ProgramTerm)]
    axes = {axis: count for each in tables for axis, count in zip(each.arguments, each.shape, strict=True)}
    values = []
    for point in product(*map(range, axes.values())):
        at = dict(zip(axes, point, strict=True))
        values.append(function(*(_entry_at(each, at) if each in tables else each for each in operands)))
    if all(value == values[0] for value in values):
        return values[0]
    word = INT if isinstance(values[0], int) else REAL
    return ProgramTerm("table", tuple(axes), word, entries=tuple(values), shape=tuple(axes.values()))


def _entry_at(table: ProgramTerm, at: Mapping[ProgramTerm, int]) -> float:
    place = 0
    for axis, count in zip(table.arguments, table.shape, strict=True):
        place = place * count + at[axis]
    return table.entries[place]


def _is(value: Any, number: float) -> bool:
    """Whether a value is known to be this number."""
    return not isinstance(value, ProgramTerm) and bool(value == number)


def as_real(term: ProgramTerm | float) -> ProgramTerm:
    """A term whose type is not an integer."""
    term = as_term(term)
    if term.type != INT:
        return term
    return constant(float(term.value)) if term.operation == "constant" else ProgramTerm("real", (term,), REAL)


def split_index(index: ProgramTerm) -> tuple[int, ProgramTerm]:
    """The known part of an index and the rest."""
    if index.operation == "+":
        for known, other in (index.arguments, index.arguments[::-1]):
            if known.operation == "constant":
                more, moving = split_index(other)
                return int(known.value) + more, moving
    return 0, index


def chosen(test: ProgramTerm, a: Any, b: Any) -> Any:
    """a if test else b."""
    if not isinstance(a, ProgramTerm) and not isinstance(b, ProgramTerm) and a == b:
        return a
    a, b = as_term(a), as_term(b)
    if a.type != b.type:
        a, b = as_real(a), as_real(b)
    return ProgramTerm("choice", (test, a, b), a.type)


def compared(sign: str, a: Any, b: Any) -> Any:
    """a sign b for a comparison."""
    if not isinstance(a, ProgramTerm) and not isinstance(b, ProgramTerm):
        return COMPUTED[sign](a, b)
    for one, other, turned in ((a, b, sign), (b, a, sign.translate(str.maketrans("<>", "><")))):
        if not isinstance(other, ProgramTerm) and math.isinf(other):
            # Every number is within infinite limits.
            assert isinstance(one, ProgramTerm)
            return bool(COMPUTED[turned](0.0, other))
    a, b = as_term(a), as_term(b)
    if a.type != b.type:
        a, b = as_real(a), as_real(b)
    return ProgramTerm(sign, (a, b), BOOL)


def joined(word: str, values: list[Any]) -> Any:
    """and, or: known values decide or vanish."""
    decides = word == "or"
    if any(not isinstance(value, ProgramTerm) and bool(value) == decides for value in values):
        return decides
    left = [value for value in values if isinstance(value, ProgramTerm)]
    if not left:
        return not decides
    return left[0] if len(left) == 1 else ProgramTerm(word, tuple(left), BOOL)


def extreme(function: Any, values: list[Any]) -> Any:
    """min or max of values."""
    known = [value for value in values if not isinstance(value, ProgramTerm)]
    if len(known) == len(values):
        return function(values)
    result: Any = values[0]
    for value in values[1:]:
        beyond = math.inf if function is min else -math.inf
        if not isinstance(value, ProgramTerm) and value == beyond:
            continue
        if not isinstance(result, ProgramTerm) and result == beyond:
            result = value
            continue
        a, b = as_term(result), as_term(value)
        if a.type != b.type:
            a, b = as_real(a), as_real(b)
        result = ProgramTerm("smaller" if function is min else "larger", (a, b), a.type)
    return result
