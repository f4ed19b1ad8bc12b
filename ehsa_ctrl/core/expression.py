"""Arithmetic expressions in TOML files: read, checked for units, and written as Python anew.

The text is parsed by `ast`, and every node that is not plain arithmetic is an error: there are no attributes, indices,
strings or calls except those of FUNCTIONS. What is compiled later is written from the checked tree, never the text.
"""

from __future__ import annotations

import ast
import hashlib
import linecache
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache, reduce
from types import CodeType
from typing import Any

import numpy as np

from .errors import InputError, choices, shown
from .syntax import parse_expression
from .unit import base_units

#: Function -> smallest number of arguments; only min and max take more.
FUNCTIONS = {
    "sign": 1, "abs": 1, "sqrt": 1, "exp": 1, "sin": 1, "cos": 1, "tanh": 1, "round": 1, "min": 2, "max": 2
}  # fmt: skip
#: Longest expression, and largest power. Engineering judgement: a law of a rig is shorter.
LONGEST, LARGEST_POWER = 400, 6
#: Exponents of base units that differ by less are equal; halves come from square roots.
SAME = 1e-9

_OPERATIONS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
#: Base unit -> exponent; None for a number that may have any unit, zero.
Dimension = dict[str, float]


def sign(value: float) -> float:
    """1, -1 or 0; the function of that name in an expression."""
    return 1.0 if value > 0.0 else (-1.0 if value < 0.0 else 0.0)


@lru_cache(maxsize=4096)
def _parsed(text: str) -> ast.expr:
    """See `Expression.parse`; the terms of a search for laws are parsed for every unknown input."""
    if len(text) > LONGEST:
        raise InputError(f"has {len(text)} characters; expected at most {LONGEST}")
    try:
        tree = parse_expression(text.strip())
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"{shown(text)} is not an expression; write it as in 'c * omega * abs(omega)'") from None
    _check(tree)
    return tree


@dataclass(frozen=True)
class Expression:
    """A checked expression. text: as written. tree: contains only arithmetic, numbers, names and FUNCTIONS."""

    text: str
    tree: ast.expr = field(repr=False, compare=False)

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Parse a text. Raises InputError for anything that is not an arithmetic expression."""
        return cls(text.strip(), _parsed(text))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of variables and parameters, in the order of their first use."""
        return _names(self.text)

    @property
    def terms(self) -> tuple[Expression, ...]:
        """The expression as a sum, with the signs of the terms."""
        return tuple(Expression(ast.unparse(tree), tree) for tree in _terms(self.tree))

    def dimension(self, units: Mapping[str, str]) -> Dimension | None:
        """Exponents of the SI base units; None for zero, which has any unit.

        units: name -> SI unit. An angle counts as a number. Raises InputError for an unknown name, and for terms whose
        units do not fit each other.
        """
        return _dimension(self.tree, units)

    def check_unit(self, unit: str, units: Mapping[str, str]) -> None:
        """Raise InputError unless the expression has this SI unit."""
        found = self.dimension(units)
        if found is not None and not _equal(found, dimension_of(unit)):
            raise InputError(f"{self.text!r} has the unit {words(found)}; expected {unit}, {words(dimension_of(unit))}")

    @property
    def python(self) -> str:
        """The expression in Python, with every number as a float and small powers as products."""
        return _python(self.tree)

    def values(self, known: Mapping[str, Any]) -> Any:
        """Its value for numbers or arrays (N,) by name."""
        return eval(_compiled(self.text), {**_ARRAY_FUNCTIONS, **known})

    def function(
        self, name: str, file: str, first: str, form: str, *, also: Sequence[str] = ()
    ) -> Callable[..., float]:
        """A Python function of `first` and the names of the expression, with a source that the engine can read.

        name: of the function. file: where the expression stands, for messages. form: what it returns, such as
        "T_net + ({})". also: further names in `form`.
        """
        arguments = dict.fromkeys([first, *self.names, *also])
        source = f"def {name}({', '.join(arguments)}):\n    return {form.format(self.python)}\n"
        known: dict[str, Any] = {"__name__": f"effects.{name}", "sign": sign}
        known |= {one: getattr(math, one) for one in ("sqrt", "exp", "sin", "cos", "tanh")}
        known["__builtins__"] = {"abs": abs, "round": round, "min": min, "max": max}
        # The engine reads the source with `inspect`, which finds names in angle brackets in this cache.
        place = f"<{file}, {hashlib.sha256(source.encode()).hexdigest()[:8]}>"
        linecache.cache[place] = (len(source), None, source.splitlines(keepends=True), place)
        exec(compile(source, place, "exec"), known)
        found: Callable[..., float] = known[name]
        return found


def _smallest(*values: Any) -> Any:
    return reduce(np.minimum, values)


def _largest(*values: Any) -> Any:
    return reduce(np.maximum, values)


_ARRAY_FUNCTIONS: Mapping[str, Any] = {
    "__builtins__": {}, "min": _smallest, "max": _largest,
    **{name: getattr(np, name) for name in ("sign", "abs", "sqrt", "exp", "sin", "cos", "tanh", "round")},
}  # fmt: skip


@cache
def _names(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(node.id for node in _nodes(_parsed(text)) if isinstance(node, ast.Name)))


@cache
def _compiled(text: str) -> CodeType:
    return compile(_python(_parsed(text)), "<expression>", "eval")


def dimension_of(unit: str) -> Dimension:
    """Exponents of the SI base units of an SI unit, without angles. Raises InputError as `base_units`."""
    return {base: power for base, power in base_units(unit).items() if base != "rad" and abs(power) > SAME}


def words(dimension: Mapping[str, float]) -> str:
    """Exponents in words: kg m2/s2 is 'kg m2 s-2'."""
    return " ".join(f"{base}{'' if power == 1.0 else f'{power:g}'}" for base, power in dimension.items()) or "1"


def put(text: str, **names: str) -> str:
    """The text with other names: whole words that are keys of `names` become their values."""
    out, word = [], ""
    for sign in text + " ":
        if sign.isalnum() or sign == "_":
            word += sign
            continue
        out.append(names.get(word, word) + sign)
        word = ""
    return "".join(out)[:-1]


def _nodes(tree: ast.expr) -> list[ast.AST]:
    """All nodes from left to right, without the names of functions."""
    found: list[ast.AST] = [tree]
    children = tree.args if isinstance(tree, ast.Call) else ast.iter_child_nodes(tree)
    for child in children:
        found += _nodes(child) if isinstance(child, ast.expr) else []
    return found


def _check(node: ast.AST) -> None:
    """Raise InputError for a node that is not arithmetic."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool) and abs(value) <= 1e30:
            return
        case ast.Name(id=name) if not name.startswith("__"):
            if name in FUNCTIONS:
                raise InputError(f"{name} is a function; write it as in '{name}(omega)'")
            return
        case ast.BinOp(left=left, op=ast.Pow(), right=power):
            _check(left)
            number = power.operand if isinstance(power, ast.UnaryOp) and isinstance(power.op, ast.USub) else power
            whole = getattr(number, "value", None)
            if type(whole) is int and 1 <= whole <= LARGEST_POWER:
                return
            raise InputError(
                f"'{ast.unparse(node)}': expected a whole power of 1 to {LARGEST_POWER}; for a root write sqrt(...)"
            )
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
            _check(left)
            _check(right)
            return
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            _check(operand)
            return
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
            count, most = FUNCTIONS[name], 9 if FUNCTIONS[name] > 1 else 1
            if not count <= len(args) <= most:
                expected = "two to nine arguments" if count > 1 else "one argument"
                raise InputError(f"'{ast.unparse(node)}': {name} takes {expected}")
            for arg in args:
                _check(arg)
            return
        case ast.Call(func=ast.Name(id=name)):
            raise InputError(f"'{ast.unparse(node)}': {shown(name)} can't be called; {choices(name, FUNCTIONS)}")
    raise InputError(
        f"'{ast.unparse(node)[:60]}' is not allowed; expected numbers, names, + - * / **, brackets and the functions "
        f"{', '.join(FUNCTIONS)}"
    )


def _terms(tree: ast.expr) -> list[ast.expr]:
    match tree:
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return [*_terms(left), *_terms(right)]
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return [*_terms(left), *(ast.UnaryOp(ast.USub(), term) for term in _terms(right))]
        case ast.UnaryOp(op=ast.USub(), operand=ast.BinOp(op=ast.Add() | ast.Sub()) as inner):
            return [ast.UnaryOp(ast.USub(), term) for term in _terms(inner)]
    return [tree]


def _equal(a: Mapping[str, float], b: Mapping[str, float]) -> bool:
    return all(abs(a.get(base, 0.0) - b.get(base, 0.0)) < SAME for base in {*a, *b})


def _number(node: ast.expr) -> float:
    """Value of a constant exponent."""
    if isinstance(node, ast.UnaryOp):
        return -_number(node.operand)
    return float(node.value)  # type: ignore[attr-defined]


def _dimension(node: ast.expr, units: Mapping[str, str]) -> Dimension | None:
    match node:
        case ast.Constant(value=value):
            return None if value == 0 else {}
        case ast.Name(id=name):
            if name not in units:
                raise InputError(f"{name!r} is not known; {choices(name, units)}")
            return dimension_of(units[name])
        case ast.UnaryOp(operand=operand):
            return _dimension(operand, units)
        case ast.BinOp(left=left, op=ast.Pow(), right=power):
            base = _dimension(left, units)
            return None if base is None else {unit: _number(power) * one for unit, one in base.items()}
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as op, right=right):
            one, other = _dimension(left, units), _dimension(right, units)
            if one is None or other is None:
                return None
            way = 1.0 if isinstance(op, ast.Mult) else -1.0
            total = {base: one.get(base, 0.0) + way * other.get(base, 0.0) for base in {**one, **other}}
            return {base: power for base, power in total.items() if abs(power) > SAME}
        case ast.BinOp(left=left, right=right):
            return _alike([left, right], node, units)
        case ast.Call(func=ast.Name(id=name), args=args):
            if name in ("min", "max"):
                return _alike(args, node, units)
            inner = _dimension(args[0], units)
            if name in ("abs", "sign", "sqrt"):
                if name == "sign":
                    return {}
                return inner if inner is None or name == "abs" else {base: 0.5 * p for base, p in inner.items()}
            if inner:
                raise InputError(f"'{ast.unparse(node)}': {name} needs a number; its argument is in {words(inner)}")
            return {}
    raise AssertionError(ast.dump(node))


def _alike(parts: list[ast.expr], whole: ast.expr, units: Mapping[str, str]) -> Dimension | None:
    """The common unit of the parts of a sum, or of the arguments of min and max."""
    known = [(part, found) for part in parts if (found := _dimension(part, units)) is not None]
    for part, found in known[1:]:
        if not _equal(found, known[0][1]):
            first, second = ast.unparse(known[0][0]), ast.unparse(part)
            raise InputError(
                f"'{ast.unparse(whole)}': '{first}' is in {words(known[0][1])}, but '{second}' in {words(found)}"
            )
    return known[0][1] if known else None


def _python(node: ast.expr) -> str:
    match node:
        case ast.Constant(value=int() | float() as value):
            return repr(float(value))
        case ast.Name(id=name):
            return name
        case ast.UnaryOp(op=op, operand=operand):
            return f"(-{_python(operand)})" if isinstance(op, ast.USub) else _python(operand)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            base, power = _python(left), int(_number(right))
            if isinstance(left, ast.Name):
                product = " * ".join([base] * abs(power))
                return f"({product})" if power > 0 else f"(1.0 / ({product}))"
            return f"({base} ** {float(power)!r})"
        case ast.BinOp(left=left, op=op, right=right):
            return f"({_python(left)} {_OPERATIONS[type(op)]} {_python(right)})"
        case ast.Call(func=ast.Name(id=name), args=args):
            return f"{name}({', '.join(map(_python, args))})"
    raise AssertionError(ast.dump(node))
