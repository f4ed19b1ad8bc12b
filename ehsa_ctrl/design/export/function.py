"""One Python function as one C function."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from .expressions import Signature
from .kinds import ARRAY, c_name
from .places import find_variables
from .source import Source
from .statements import Statements


@dataclass(frozen=True)
class CFunction:
    """A function written as C.

    Attributes
    ----------
    text: the C. signature: how it is called. constants: name -> number that it needs. helpers: names of those it needs.
    """

    text: str
    signature: Signature
    constants: Mapping[str, float]
    helpers: frozenset[str]


def write_function(source: Source, functions: Mapping[Callable[..., Any], Signature]) -> CFunction:
    """Write a function of the subset as C.

    Raises InputError, which names file, line and function, for anything outside the subset.
    """
    arguments, result = source.arguments, source.result
    if result is not None and not _always_returns(source.tree.body):
        source.fail(source.tree, "a way through without `return`", "a return at the end of each way")
    variables = find_variables(source)
    kinds: dict[str, str] = dict(arguments)
    written: set[str] = set()
    while True:
        before = dict(kinds), set(written)
        statements = Statements(source, variables, functions, kinds, written)
        body = statements.block(source.tree.body, 1)
        if (kinds, written) == before:
            break
    writes = tuple(kind == ARRAY and name in written for name, kind in arguments.items())
    signature = Signature(c_name(source.name), tuple(arguments.values()), result, writes)
    declared = ", ".join(
        f"{'' if into else 'const '}double {c_name(name)}[]" if kind == ARRAY else f"{kind} {c_name(name)}"
        for (name, kind), into in zip(arguments.items(), writes, strict=True)
    )
    used = {node.id for node in ast.walk(source.tree) if isinstance(node, ast.Name)}
    top = [f"    (void){c_name(name)};" for name in arguments if name not in used]
    for name in sorted(set(variables) - set(arguments)):
        variable = variables[name]
        if not variable.loops and variable.declared_by is None:
            zero = {"double": "0.0", "bool": "false"}.get(kinds[name], "0")
            top.append(f"    {kinds[name]} {c_name(name)} = {zero};")
    text = [*comment(source.documentation), f"static {result or 'void'} {c_name(source.name)}({declared or 'void'})"]
    return CFunction(
        "\n".join([*text, "{", *top, *body, "}"]),
        signature,
        statements.constants,
        frozenset(statements.helpers),
    )


def comment(text: str) -> list[str]:
    """Text as the lines of a C comment."""
    if not text:
        return []
    safe = text.replace("*/", "* /").replace("/*", "/ *").splitlines()
    if len(safe) == 1:
        return [f"/* {safe[0]} */"]
    return [f"/* {safe[0]}", *(f" * {line}".rstrip() for line in safe[1:]), " */"]


def _always_returns(body: list[ast.stmt]) -> bool:
    last = body[-1]
    if isinstance(last, ast.If):
        return bool(last.orelse) and _always_returns(last.body) and _always_returns(last.orelse)
    return isinstance(last, ast.Return)
