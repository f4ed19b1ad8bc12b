"""A Python function to translate to C: syntax tree, types, global names, and scopes of its variables."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from ...core.errors import InputError
from ...core.syntax import parse_statement

#: Types of values; an array is a vector of doubles.
BOOL, INT, DOUBLE, ARRAY = "bool", "int", "double", "array"
#: Annotation of an argument or result -> type; None for no result.
ANNOTATIONS: dict[str, str | None] = {"float": DOUBLE, "int": INT, "bool": BOOL, "np.ndarray": ARRAY, "None": None}
#: Names in use by C, its headers or the templates; a Python name among them gets a trailing underscore.
RESERVED_NAMES = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while

    abs acos asin atan atan2 bool ceil copysign cos cosh ehsa_reset ehsa_step exp fabs false floor fmod
    hypot isfinite isinf isnan larger larger_int log log10 main memcpy memmove pow remainder_of round sin
    settings_of_all sinh smaller smaller_int sqrt tan tanh true trunc INFINITY NAN NULL
"""
RESERVED = frozenset(RESERVED_NAMES.split()) | {f"{name}f" for name in RESERVED_NAMES.split()}
BUILTINS: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "min": min,
    "max": max,
    "int": int,
    "float": float,
    "range": range,
}


def common_type(a: str, b: str) -> str | None:
    """The type of a variable for values of both types; None if there is none."""
    if a == b:
        return a
    return DOUBLE if {a, b} == {INT, DOUBLE} else None


def c_name(name: str) -> str:
    """A Python name in C, where the compiler reserves leading underscores."""
    return f"{name.lstrip('_')}_" if name in RESERVED or name.startswith("_") else name


def comment_lines(text: str) -> list[str]:
    """Text as the lines of a C comment."""
    if not text:
        return []
    safe = text.replace("*/", "* /").replace("/*", "/ *").splitlines()
    if len(safe) == 1:
        return [f"/* {safe[0]} */"]
    return [f"/* {safe[0]}", *(f" * {line}".rstrip() for line in safe[1:]), " */"]


@dataclass(frozen=True)
class FunctionSource:
    """A function to translate to C.

    Attributes
    ----------
    function: the Python function. tree: its syntax tree. lines: its source. file, first: file and first line number.
    substitutes: name inside it -> the function that it means, e.g. for an argument that is a function.
    """

    function: Callable[..., Any]
    tree: ast.FunctionDef
    lines: tuple[str, ...]
    file: str
    first: int
    substitutes: Mapping[str, Callable[..., Any]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.tree.name

    @property
    def arguments(self) -> dict[str, str]:
        """Argument -> type. Raises InputError for an annotation outside the subset."""
        given = self.tree.args
        if given.vararg or given.kwarg or given.kwonlyargs or given.defaults or given.posonlyargs:
            self.fail(self.tree, "optional, keyword or starred arguments", "plain arguments")
        types = {}
        for argument in given.args:
            if argument.arg in self.substitutes:
                continue
            found = ANNOTATIONS.get(ast.unparse(argument.annotation)) if argument.annotation else None
            if found is None:
                self.fail(argument, f"the argument {argument.arg}", "one annotated as float, int, bool or np.ndarray")
            types[argument.arg] = found
        return types

    @property
    def result(self) -> str | None:
        """Type of the result; None for no result."""
        annotation = ast.unparse(self.tree.returns) if self.tree.returns else ""
        if annotation not in ANNOTATIONS or annotation == "np.ndarray":
            self.fail(self.tree, f"a result {annotation!r}", "one annotated as float, int, bool or None")
        return ANNOTATIONS[annotation]

    @property
    def documentation(self) -> str:
        return inspect.cleandoc(ast.get_docstring(self.tree) or "")

    def comment_above(self, node: ast.stmt) -> list[str]:
        """Comment lines directly above a statement."""
        found: list[str] = []
        line = node.lineno - 2
        while line >= 0 and self.lines[line].strip().startswith("#"):
            found.insert(0, self.lines[line].strip().lstrip("# "))
            line -= 1
        return found

    def meaning(self, node: ast.expr) -> Any:
        """The Python object of a global or dotted name. Raises InputError for an unknown name."""
        if isinstance(node, ast.Name):
            for names in (self.substitutes, self.function.__globals__, BUILTINS):
                if node.id in names:
                    return names[node.id]
            self.fail(node, f"the name {node.id}", "an argument, a variable, a constant or a function of its module")
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = self.meaning(node.value)
            if hasattr(module, node.attr):
                return getattr(module, node.attr)
        return self.fail(node, ast.unparse(node), "a name, or math.name")

    def fail(self, node: ast.AST, got: str, expected: str) -> NoReturn:
        """Raise InputError with file, line and function."""
        line = self.first + getattr(node, "lineno", 1) - 1
        raise InputError(f"{self.file}, line {line}: {self.name}: {got} can't be written as C; expected {expected}")


def read_source(
    function: Callable[..., Any], substitutes: Mapping[str, Callable[..., Any]] | None = None
) -> FunctionSource:
    """Read the source of a function. Raises InputError if it has none or is no plain function."""
    try:
        lines, first = inspect.getsourcelines(function)
        file = Path(inspect.getsourcefile(function) or "").name
    except (OSError, TypeError):
        name = getattr(function, "__name__", repr(function))
        raise InputError(f"{name}: its text can't be found, so that it can't be written as C") from None
    text = textwrap.dedent("".join(lines))
    tree = parse_statement(text)
    if not isinstance(tree, ast.FunctionDef) or tree.decorator_list:
        raise InputError(f"{file}, line {first}: expected a plain function without decorators to be written as C")
    return FunctionSource(function, tree, tuple(text.splitlines()), file, first, dict(substitutes or {}))


#: A block, as the path of nested bodies that leads to it.
BlockPath = tuple[int, ...]


@dataclass
class LocalVariable:
    """A local variable of a function.

    Attributes
    ----------
    uses: block and statement of every occurrence, in order of the source.
    assigned: number of assignments. read: whether anything reads it. loops: loops with this counter.
    """

    uses: list[tuple[BlockPath, ast.stmt]] = field(default_factory=list)
    assigned: int = 0
    read: bool = False
    loops: list[ast.For] = field(default_factory=list)

    @property
    def declared_by(self) -> ast.stmt | None:
        """The assignment that can declare it; None if the top of the function must declare it.

        The scope of a variable is the function in Python and the block in C: the first assignment can declare it if all
        other uses are in its block or nested in it.
        """
        block, statement = self.uses[0]
        inside = all(other[: len(block)] == block for other, _ in self.uses)
        return statement if inside and isinstance(statement, ast.Assign) else None


def find_variables(source: FunctionSource) -> dict[str, LocalVariable]:
    """The local variables by name. Raises InputError for a loop counter that is used outside its loop."""
    names = [node for node in ast.walk(source.tree) if isinstance(node, ast.Name)]
    found = {node.id: LocalVariable() for node in names if not isinstance(node.ctx, ast.Load)}
    for block, statement, parts in _statements(source.tree.body, ()):
        for name in (node for part in parts for node in ast.walk(part)):
            if not isinstance(name, ast.Name) or name.id not in found:
                continue
            variable = found[name.id]
            if isinstance(name.ctx, ast.Load):
                variable.read = True
                if not variable.uses and name.id not in source.arguments:
                    source.fail(name, f"{name.id}, which is read before it is assigned", "it to be assigned first")
            elif not isinstance(statement, ast.For):
                variable.assigned += 1
            variable.uses.append((block, statement))
        if isinstance(statement, ast.For) and isinstance(statement.target, ast.Name):
            found[statement.target.id].loops.append(statement)
    for word, variable in found.items():
        inside = {id(node) for loop in variable.loops for node in ast.walk(loop)}
        outside = any(id(statement) not in inside for _, statement in variable.uses)
        if variable.loops and (variable.assigned or outside):
            source.fail(variable.loops[0], f"the counter {word}, used outside its loop,", "a name of its own for it")
    return found


def _statements(body: list[ast.stmt], block: BlockPath) -> Iterator[tuple[BlockPath, ast.stmt, list[ast.AST]]]:
    """Block, statement and the statement's own expressions in the order of their evaluation: stores last."""
    for statement in body:
        nested = [getattr(statement, name, []) for name in ("body", "orelse")]
        inner = {id(child) for part in nested for child in part}
        parts = [child for child in ast.iter_child_nodes(statement) if id(child) not in inner]
        yield block, statement, sorted(parts, key=lambda child: isinstance(getattr(child, "ctx", None), ast.Store))
        for part in nested:
            if part:
                yield from _statements(part, (*block, id(part)))
