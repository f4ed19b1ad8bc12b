"""The text of a Python function, with a place for every complaint about it."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from ...core.errors import InputError
from .kinds import ANNOTATIONS


@dataclass(frozen=True)
class Source:
    """A function to be written as C.

    Attributes
    ----------
    function: the Python function.
    tree: its syntax. lines: its text. file, first: where it stands.
    stands_for: names inside it that mean another function, e.g. an argument that is a function.
    """

    function: Callable[..., Any]
    tree: ast.FunctionDef
    lines: tuple[str, ...]
    file: str
    first: int
    stands_for: Mapping[str, Callable[..., Any]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.tree.name

    @property
    def arguments(self) -> dict[str, str]:
        """Argument -> its kind. Raises InputError for one whose annotation is none of the subset's."""
        rules = self.tree.args
        if rules.vararg or rules.kwarg or rules.kwonlyargs or rules.defaults or rules.posonlyargs:
            self.fail(self.tree, "optional, keyword or starred arguments", "plain arguments")
        kinds = {}
        for argument in rules.args:
            if argument.arg in self.stands_for:
                continue
            kind = ANNOTATIONS.get(ast.unparse(argument.annotation)) if argument.annotation else None
            if kind is None:
                self.fail(argument, f"the argument {argument.arg}", "one annotated as float, int, bool or np.ndarray")
            kinds[argument.arg] = kind
        return kinds

    @property
    def result(self) -> str | None:
        """Kind of what it returns, None for nothing."""
        annotation = ast.unparse(self.tree.returns) if self.tree.returns else ""
        if annotation not in ANNOTATIONS or annotation == "np.ndarray":
            self.fail(self.tree, f"a result {annotation!r}", "one annotated as float, int, bool or None")
        return ANNOTATIONS[annotation]

    @property
    def documentation(self) -> str:
        return inspect.cleandoc(ast.get_docstring(self.tree) or "")

    def comment_above(self, node: ast.stmt) -> list[str]:
        """Comments that stand alone on the lines above a statement."""
        found: list[str] = []
        line = node.lineno - 2
        while line >= 0 and self.lines[line].strip().startswith("#"):
            found.insert(0, self.lines[line].strip().lstrip("# "))
            line -= 1
        return found

    def fail(self, node: ast.AST, what: str, expected: str) -> NoReturn:
        """Raise InputError with file, line and function."""
        line = self.first + getattr(node, "lineno", 1) - 1
        raise InputError(f"{self.file}, line {line}: {self.name}: {what} can't be written as C; expected {expected}")


def read_source(function: Callable[..., Any], stands_for: Mapping[str, Callable[..., Any]] | None = None) -> Source:
    """Read a function's text. Raises InputError if it has none, or is no plain function."""
    try:
        lines, first = inspect.getsourcelines(function)
        file = Path(inspect.getsourcefile(function) or "").name
    except (OSError, TypeError):
        name = getattr(function, "__name__", repr(function))
        raise InputError(f"{name}: its text can't be found, so that it can't be written as C") from None
    text = textwrap.dedent("".join(lines))
    tree = ast.parse(text).body[0]
    if not isinstance(tree, ast.FunctionDef) or tree.decorator_list:
        raise InputError(f"{file}, line {first}: expected a plain function without decorators to be written as C")
    return Source(function, tree, tuple(text.splitlines()), file, first, dict(stands_for or {}))
