"""Functions with their callees as C, and the names of their settings."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from .expressions import CSignature
from .number import DOUBLES, NumberType
from .source import FunctionSource, c_name, read_source
from .statements import CFunction, write_function

#: Python's min and max, which return the first of equal values, and %, which has the sign of the divisor.
HELPERS = {
    "smaller": "static {word} smaller({word} a, {word} b)\n{{\n    return b < a ? b : a;\n}}",
    "larger": "static {word} larger({word} a, {word} b)\n{{\n    return b > a ? b : a;\n}}",
    "smaller_int": "static int smaller_int(int a, int b)\n{{\n    return b < a ? b : a;\n}}",
    "larger_int": "static int larger_int(int a, int b)\n{{\n    return b > a ? b : a;\n}}",
    "remainder_of": """\
static {word} remainder_of({word} a, {word} b)
{{
    const {word} rest = {fmod}(a, b);
    if (rest == {zero}) {{
        return {copysign}({zero}, b);
    }}
    return (b < {zero}) != (rest < {zero}) ? rest + b : rest;
}}""",
}


class Program(Mapping[Callable[..., Any], CSignature]):
    """Functions as C, each after those that it calls.

    The first call of a function translates it; functions without a call do not appear.
    """

    def __init__(
        self,
        allowed: Sequence[Callable[..., Any]],
        *,
        substitutes: Mapping[str, Callable[..., Any]] | None = None,
        number: NumberType = DOUBLES,
    ) -> None:
        """allowed: functions that may appear. substitutes: see FunctionSource. number: type of doubles in C."""
        self._number = number
        self._allowed = set(allowed)
        self._substitutes = dict(substitutes or {})
        self._done: dict[Callable[..., Any], CFunction] = {}
        self._open: list[Callable[..., Any]] = []

    def __getitem__(self, function: Callable[..., Any]) -> CSignature:
        if function not in self._allowed:
            raise KeyError(function)
        if function not in self._done:
            source = read_source(function, self._substitutes)
            if function in self._open:
                source.fail(source.tree, "a function that calls itself", "a loop")
            self._open.append(function)
            self._done[function] = write_function(source, self, self._number)
            self._open.pop()
            names = [done.signature.name for done in self._done.values()]
            if names.count(c_name(source.name)) > 1:
                source.fail(source.tree, f"a second function of the name {source.name}", "a name of its own")
        return self._done[function].signature

    def __contains__(self, function: object) -> bool:
        return callable(function) and function in self._allowed

    def __iter__(self) -> Iterator[Callable[..., Any]]:
        return iter(self._allowed - {*self._open})

    def __len__(self) -> int:
        return len(self._allowed - {*self._open})

    def text(self, *entries: Callable[..., Any]) -> str:
        """C code of these functions, their callees, constants and helpers."""
        for entry in entries:
            self[entry]
        functions = self._done.values()
        constants = {name: value for function in functions for name, value in function.constants.items()}
        numbers = [
            f"enum {{ {c_name(name)} = {value} }};"
            if isinstance(value, int)
            else f"static const {self._number.word} {c_name(name)} = {self._number.literal(value)};"
            for name, value in sorted(constants.items())
        ]
        helpers = sorted({name for function in functions for name in function.helpers})
        parts = ["\n".join(numbers)] if numbers else []
        words = {
            "word": self._number.word,
            "zero": self._number.literal(0.0),
            **{name: self._number.function(name) for name in ("fmod", "copysign")},
        }
        texts = [HELPERS[name].format(**words) for name in helpers]
        return "\n\n".join([*parts, *texts, *(function.text for function in functions)])


def setting_names(function: Callable[..., Any], allowed: tuple[Callable[..., Any], ...]) -> dict[int, str]:
    """Index in `settings` -> variable to which `function`, or one of `allowed` that it calls, assigns this entry."""
    source = read_source(function)
    found: dict[int, str] = {}
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Assign):
            for target, value in _single_assignments(node.targets[0], node.value):
                if isinstance(value, ast.Call) and getattr(value.func, "id", "") == "int":
                    value = value.args[0]
                match target, value:
                    case ast.Name(id=name), ast.Subscript(
                        value=ast.Name(id="settings"), slice=ast.Constant(value=int() as index)
                    ):
                        found.setdefault(index, name)
        elif isinstance(node, ast.Call) and any(getattr(given, "id", "") == "settings" for given in node.args):
            called = _called(source, node)
            if called in allowed and called is not function:
                found = {**setting_names(called, allowed), **found}
    return found


def _called(source: FunctionSource, node: ast.Call) -> Any:
    return source.meaning(node.func) if isinstance(node.func, ast.Name) else None


def _single_assignments(target: ast.expr, value: ast.expr) -> list[tuple[ast.expr, ast.expr]]:
    """Unpacking of a tuple or vector as single assignments."""
    match target, value:
        case ast.Tuple(elts=targets), ast.Tuple(elts=values):
            return list(zip(targets, values, strict=True))
        case ast.Tuple(elts=targets), ast.Name() | ast.Subscript(slice=ast.Slice(lower=None)):
            vector = value.value if isinstance(value, ast.Subscript) else value
            entries = [ast.Subscript(vector, ast.Constant(k), ast.Load()) for k in range(len(targets))]
            return list(zip(targets, entries, strict=True))
    return [(target, value)]
