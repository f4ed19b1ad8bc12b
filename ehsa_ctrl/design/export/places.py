"""Where the variables of a function are declared in C.

Python's variables live in the whole function, C's in their block: a variable is declared where it is first assigned if
that assignment always runs before every other use, else at the function's top.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field

from .source import Source

#: A block as the way to it from the function's body.
Block = tuple[int, ...]


@dataclass
class Variable:
    """What is known of a name.

    Attributes
    ----------
    uses: block and statement of every occurrence, in the text's order.
    assigned: how often. read: whether anything reads it. loops: the loops that count with it.
    """

    uses: list[tuple[Block, ast.stmt]] = field(default_factory=list)
    assigned: int = 0
    read: bool = False
    loops: list[ast.For] = field(default_factory=list)

    @property
    def declared_by(self) -> ast.stmt | None:
        """The assignment that may declare it, None if it has to be declared at the function's top."""
        common = self.uses[0][0]
        for block, _ in self.uses:
            common = common[: _shared(common, block)]
        block, statement = self.uses[0]
        return statement if block == common and isinstance(statement, ast.Assign) else None


def _shared(a: Block, b: Block) -> int:
    """How many steps two ways have in common from the start."""
    for i, (x, y) in enumerate(zip(a, b, strict=False)):
        if x != y:
            return i
    return min(len(a), len(b))


def find_variables(source: Source) -> dict[str, Variable]:
    """Every name that the function assigns, with its uses. Raises InputError for a loop's counter used beside it."""
    assigned = {
        node.id for node in ast.walk(source.tree) if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load)
    }
    found: dict[str, Variable] = {name: Variable() for name in assigned}
    for block, statement, own in _statements(source.tree.body, ()):
        # The right side first: what a statement reads, it reads before it assigns.
        for node in own:
            for name in ast.walk(node):
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
        if variable.loops:
            inside = {id(node) for loop in variable.loops for node in ast.walk(loop)}
            alone = all(id(statement) in inside for _, statement in variable.uses)
            if variable.assigned or not alone:
                source.fail(variable.loops[0], f"the counter {word}, used beside its loop,", "a name of its own for it")
    return found


def _statements(body: list[ast.stmt], block: Block) -> Iterator[tuple[Block, ast.stmt, list[ast.AST]]]:
    """Block, statement and the statement's own expressions, those that are evaluated first in front."""
    for statement in body:
        nested = [getattr(statement, name, []) for name in ("body", "orelse")]
        inner = {id(child) for part in nested for child in part}
        own = [child for child in ast.iter_child_nodes(statement) if id(child) not in inner]
        own.sort(key=lambda child: isinstance(getattr(child, "ctx", None), ast.Store))
        yield block, statement, own
        for part in nested:
            if part:
                yield from _statements(part, (*block, id(part)))
