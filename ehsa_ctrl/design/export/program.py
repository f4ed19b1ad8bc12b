"""Functions that call each other as one piece of C."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from .expressions import Signature
from .function import CFunction, write_function
from .kinds import c_name, literal
from .source import read_source

#: Python's min, max and % as C: the first of equals, and the sign of the divisor.
HELPERS = {
    "smaller": "static double smaller(double a, double b)\n{\n    return b < a ? b : a;\n}",
    "larger": "static double larger(double a, double b)\n{\n    return b > a ? b : a;\n}",
    "smaller_int": "static int smaller_int(int a, int b)\n{\n    return b < a ? b : a;\n}",
    "larger_int": "static int larger_int(int a, int b)\n{\n    return b > a ? b : a;\n}",
    "remainder_of": """\
static double remainder_of(double a, double b)
{
    const double rest = fmod(a, b);
    if (rest == 0.0) {
        return copysign(0.0, b);
    }
    return (b < 0.0) != (rest < 0.0) ? rest + b : rest;
}""",
}


class Program(Mapping[Callable[..., Any], Signature]):
    """Functions as C, each behind those that it calls.

    A function is written when a call of it is met first; what is not called does not appear.
    """

    def __init__(
        self,
        allowed: Sequence[Callable[..., Any]],
        *,
        outside: Mapping[Callable[..., Any], Signature] | None = None,
        stands_for: Mapping[str, Callable[..., Any]] | None = None,
    ) -> None:
        """allowed: functions that may appear. outside: those whose C stands elsewhere. stands_for: see Source."""
        self._allowed = {*allowed, *(outside or {})}
        self._outside = dict(outside or {})
        self._stands_for = dict(stands_for or {})
        self._written: dict[Callable[..., Any], CFunction] = {}
        self._open: list[Callable[..., Any]] = []

    def __getitem__(self, function: Callable[..., Any]) -> Signature:
        if function in self._outside:
            return self._outside[function]
        if function not in self._allowed:
            raise KeyError(function)
        if function not in self._written:
            source = read_source(function, self._stands_for)
            if function in self._open:
                source.fail(source.tree, "a function that calls itself", "a loop")
            self._open.append(function)
            self._written[function] = write_function(source, self)
            self._open.pop()
            names = [written.signature.name for written in self._written.values()]
            if names.count(c_name(source.name)) > 1:
                source.fail(source.tree, f"a second function of the name {source.name}", "a name of its own")
        return self._written[function].signature

    def __contains__(self, function: object) -> bool:
        return callable(function) and function in self._allowed

    def __iter__(self) -> Iterator[Callable[..., Any]]:
        return iter(self._allowed - {*self._open})

    def __len__(self) -> int:
        return len(self._allowed - {*self._open})

    def text(self, *entries: Callable[..., Any]) -> str:
        """C of these functions, of all that they call, and of the constants and helpers that they need."""
        for entry in entries:
            self[entry]
        functions = self._written.values()
        constants = {name: value for function in functions for name, value in function.constants.items()}
        numbers = [
            f"enum {{ {c_name(name)} = {value} }};"
            if isinstance(value, int)
            else f"static const double {c_name(name)} = {literal(value)};"
            for name, value in sorted(constants.items())
        ]
        helpers = sorted({name for function in functions for name in function.helpers})
        parts = ["\n".join(numbers)] if numbers else []
        return "\n\n".join([*parts, *(HELPERS[name] for name in helpers), *(function.text for function in functions)])
