"""Statements of the subset as C."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from typing import Any

from .expressions import SUM, Expressions, Signature, Text
from .kinds import ARRAY, DOUBLE, INT, c_name, join
from .meaning import meaning
from .places import Variable
from .source import Source

#: Operators of augmented assignments that C has as well.
AUGMENTED: dict[type[ast.operator], str] = {ast.Add: "+=", ast.Sub: "-=", ast.Mult: "*=", ast.Div: "/="}


class Statements:
    """Writes the body of one function; made anew until what it learns of the variables no longer changes.

    Attributes
    ----------
    kinds: name -> kind, of all variables; grows and widens from an int to a float.
    written: names of the vectors that are written into.
    """

    def __init__(
        self,
        source: Source,
        variables: Mapping[str, Variable],
        functions: Mapping[Callable[..., Any], Signature],
        kinds: dict[str, str],
        written: set[str],
    ) -> None:
        self.source, self.variables, self.functions = source, variables, functions
        self.kinds, self.written = kinds, written
        self.constants: dict[str, float] = {}
        self.helpers: set[str] = set()
        self.known = dict(source.arguments)
        self.expressions = Expressions(source, self.known, functions, self.constants, self.helpers)
        self.temporaries = 0

    def block(self, body: list[ast.stmt], indent: int) -> list[str]:
        """Lines of a block."""
        lines: list[str] = []
        for statement in body:
            lines += [f"{_pad(indent)}/* {text} */" for text in self.source.comment_above(statement)]
            lines += [_pad(indent) + line for line in self._statement(statement, indent)]
        return lines

    def _statement(self, node: ast.stmt, indent: int) -> list[str]:
        match node:
            case ast.Assign(targets=[target]):
                return self._assign(node, target)
            case ast.AugAssign():
                return self._augmented(node)
            case ast.If():
                return self._if(node, indent)
            case ast.For():
                return self._for(node, indent)
            case ast.While(orelse=[]):
                self.expressions.ordered(node.test)
                return [f"while ({self.expressions.truth(node.test).code}) {{", *self._inner(node.body, indent)]
            case ast.Return():
                return self._return(node)
            case ast.Expr(value=ast.Constant(value=str())) | ast.Pass():
                return []
            case ast.Expr(value=ast.Call()):
                return [f"{self._call(node.value)};"]
            case ast.Continue():
                return ["continue;"]
            case ast.Break():
                return ["break;"]
        return self.source.fail(
            node, f"`{ast.unparse(node).splitlines()[0]}`", "assignments, if, for over range, while, return and calls"
        )

    def _inner(self, body: list[ast.stmt], indent: int) -> list[str]:
        """A nested block and its closing bracket, to be put behind a line that `block` indents."""
        pad = _pad(indent)
        return [*(line.removeprefix(pad) for line in self.block(body, indent + 1)), "}"]

    def _call(self, node: ast.expr) -> str:
        assert isinstance(node, ast.Call)
        self.expressions.ordered(node)
        text = self._value(node)
        return text.code if text.kind == "nothing" else f"(void){text.code}"

    def _value(self, node: ast.expr) -> Text:
        """An expression; notes which vectors its calls write into."""
        text = self.expressions.write(node)
        for call in ast.walk(node):
            if not isinstance(call, ast.Call):
                continue
            function = meaning(self.source, call.func)
            if function in self.functions:
                for given, writes in zip(call.args, self.functions[function].writes, strict=True):
                    if writes:
                        self._write_into(given)
        return text

    def _write_into(self, vector: ast.expr) -> None:
        name = vector.value if isinstance(vector, ast.Subscript) else vector
        assert isinstance(name, ast.Name)
        self.written.add(name.id)

    def _assign(self, node: ast.Assign, target: ast.expr) -> list[str]:
        if not isinstance(target, ast.Tuple):
            if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
                return self._copy(target, node.value)
            self.expressions.ordered(
                ast.Tuple([node.value, target.slice], ast.Load()) if isinstance(target, ast.Subscript) else node.value
            )
            return self._set(node, target, self._value(node.value))
        targets = target.elts
        self.expressions.ordered(node.value)
        if isinstance(node.value, ast.Tuple):
            if len(node.value.elts) != len(targets):
                self.source.fail(node, f"`{ast.unparse(node)}`", f"{len(targets)} values")
            values = [self._value(value) for value in node.value.elts]
            apart = [any(_touches(first, value) for first in targets[:k]) for k, value in enumerate(node.value.elts)]
        else:
            vector = self.expressions.vector(node.value)
            name, _, start = vector.code.partition(" + ")
            values = [
                Text(f"{name}[{f'{start} + {k}' if start and k else start or k}]", DOUBLE) for k in range(len(targets))
            ]
            apart = [any(isinstance(first, ast.Subscript) for first in targets[:k]) for k in range(len(targets))]
        lines = []
        # Python works all values out before it assigns the first.
        for k, value in enumerate(values):
            if apart[k]:
                self.temporaries += 1
                name = f"value_{self.temporaries}"
                lines.append(f"const {value.kind} {name} = {value.code};")
                values[k] = Text(name, value.kind)
        for single, value in zip(targets, values, strict=True):
            lines += self._set(node, single, value)
        return lines

    def _set(self, node: ast.Assign, target: ast.expr, value: Text) -> list[str]:
        """Assign a value to a variable or an entry, declaring the variable where this is its place."""
        if isinstance(target, ast.Subscript):
            if value.kind not in (INT, DOUBLE):
                self.source.fail(node, f"`{ast.unparse(node)}`", "a number in a vector's entry")
            self._write_into(target)
            return [f"{self.expressions.write(target).code} = {value.code};"]
        if not isinstance(target, ast.Name):
            self.source.fail(node, f"`{ast.unparse(node)}`", "a variable or a vector's entry on the left")
        if target.id in self.source.arguments and self.known[target.id] == ARRAY:
            self.source.fail(
                node, f"the new meaning of {target.id}", "another name: an argument's vector keeps its name"
            )
        self._learn(node, target.id, value.kind)
        kind, name, variable = self.kinds[target.id], c_name(target.id), self.variables[target.id]
        declares = variable.declared_by is node and target.id not in self.source.arguments
        if kind == ARRAY:
            return self._alias(node, target.id, value, declares)
        if not declares:
            return [f"{name} = {value.code};"]
        fixed = "const " if variable.assigned == 1 else ""
        return [f"{fixed}{kind} {name} = {value.code};", *([] if variable.read else [f"(void){name};"])]

    def _alias(self, node: ast.Assign, name: str, value: Text, declares: bool) -> list[str]:
        """A name for a part of a vector."""
        if not declares or self.variables[name].assigned > 1:
            self.source.fail(node, f"the vector {name}, assigned more than once or not always", "one assignment")
        if name in self.written:
            self._write_into(node.value)
        fixed = "" if name in self.written else "const "
        return [f"{fixed}double *{c_name(name)} = {value.code};"]

    def _learn(self, node: ast.stmt, name: str, kind: str) -> None:
        both = join(self.kinds.get(name, kind), kind)
        if both is None or kind == "nothing":
            self.source.fail(
                node, f"{name}, once {self.kinds.get(name, 'unknown')} and once {kind},", "one kind a name"
            )
        self.kinds[name] = self.known[name] = both

    def _copy(self, target: ast.Subscript, value: ast.expr) -> list[str]:
        """A slice that takes the entries of another vector."""
        part = target.slice
        assert isinstance(part, ast.Slice)
        if part.upper is None or part.step is not None:
            self.source.fail(target, f"`{ast.unparse(target)}` on the left", "a slice that says where it ends")
        self._write_into(target)
        to, stop = self.expressions.vector(target), self.expressions.whole(part.upper)
        size = stop.code
        if part.lower is not None:
            start = self.expressions.whole(part.lower)
            plain = size.isdigit() and start.code.isdigit()
            size = str(int(size) - int(start.code)) if plain else f"({size} - {start.within(SUM + 1)})"
        if self.expressions.write(value).kind != ARRAY:
            self.source.fail(value, f"`{ast.unparse(value)}` for a slice", "a vector or a slice of the same length")
        given = self.expressions.vector(value)
        # Like numpy it copies right where both parts overlap.
        return [f"memmove({to.code}, {given.code}, {size} * sizeof(double));"]

    def _augmented(self, node: ast.AugAssign) -> list[str]:
        value = self._value(node.value)
        target = node.target
        if isinstance(target, ast.Subscript):
            self.expressions.ordered(ast.Tuple([node.value, target], ast.Load()))
            place = self.expressions.write(target).code
            if isinstance(target.slice, ast.Slice):
                self.source.fail(node, f"`{ast.unparse(node)}`", "a loop over the entries")
            self._write_into(target)
            before = DOUBLE
        else:
            assert isinstance(target, ast.Name)
            self.expressions.ordered(node.value)
            before, place = self.known[target.id], c_name(target.id)
        if value.kind not in (INT, DOUBLE) or before not in (INT, DOUBLE):
            self.source.fail(node, f"`{ast.unparse(node)}`", "numbers on both sides")
        if isinstance(target, ast.Name):
            kind = DOUBLE if isinstance(node.op, ast.Div | ast.Mod) else value.kind
            self._learn(node, target.id, str(join(before, kind)))
        if isinstance(node.op, ast.Mod):
            self.helpers.add("remainder_of")
            return [f"{place} = remainder_of({place}, {value.code});"]
        if type(node.op) not in AUGMENTED:
            self.source.fail(node, f"`{ast.unparse(node)}`", "+=, -=, *=, /= or %=")
        return [f"{place} {AUGMENTED[type(node.op)]} {value.code};"]

    def _if(self, node: ast.If, indent: int) -> list[str]:
        self.expressions.ordered(node.test)
        self._value(node.test)
        lines = [f"if ({self.expressions.truth(node.test).code}) {{", *self._inner(node.body, indent)]
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            other = self._if(node.orelse[0], indent)
            lines[-1] = f"}} else {other[0]}"
            return [*lines, *other[1:]]
        if node.orelse:
            lines[-1] = "} else {"
            lines += self._inner(node.orelse, indent)
        return lines

    def _for(self, node: ast.For, indent: int) -> list[str]:
        call = node.iter
        if (
            not isinstance(node.target, ast.Name)
            or node.orelse
            or not isinstance(call, ast.Call)
            or meaning(self.source, call.func) is not range
            or not 1 <= len(call.args) <= 2
        ):
            self.source.fail(
                node, f"`for {ast.unparse(node.target)} in {ast.unparse(call)}`", "a for over range(n) or range(a, b)"
            )
        name, lines = c_name(node.target.id), []
        start, stop = ([ast.Constant(0), *call.args])[-2:]
        first, last = self.expressions.whole(start).code, self.expressions.whole(stop).code
        changing = {
            n.id
            for part in node.body
            for n in ast.walk(part)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }
        if any(isinstance(n, ast.Subscript | ast.Call) or getattr(n, "id", "") in changing for n in ast.walk(stop)):
            # Python looks at the range once, C at each turn.
            self.temporaries += 1
            lines.append(f"const int value_{self.temporaries} = {last};")
            last = f"value_{self.temporaries}"
        self._learn(node, node.target.id, INT)
        return [*lines, f"for (int {name} = {first}; {name} < {last}; {name}++) {{", *self._inner(node.body, indent)]

    def _return(self, node: ast.Return) -> list[str]:
        wanted = self.source.result
        if node.value is None or wanted is None:
            if node.value is not None or wanted is not None:
                self.source.fail(node, f"`{ast.unparse(node)}`", "a return that fits the function's annotation")
            return ["return;"]
        self.expressions.ordered(node.value)
        text = self._value(node.value)
        if join(text.kind, wanted) != wanted:
            self.source.fail(node, f"`{ast.unparse(node)}`", f"a {wanted}, as the function's annotation says")
        return [f"return {text.code};"]


def _pad(indent: int) -> str:
    return "    " * indent


def _touches(target: ast.expr, value: ast.expr) -> bool:
    """Whether an assignment to `target` may change `value`: any entry may be any other's, by another name."""
    if isinstance(target, ast.Subscript):
        return any(isinstance(node, ast.Subscript | ast.Call) for node in ast.walk(value))
    return any(isinstance(node, ast.Name) and node.id == getattr(target, "id", "") for node in ast.walk(value))
