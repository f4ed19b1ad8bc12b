"""Statements and whole functions of the subset as C."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from .expressions import SUM, CExpression, CSignature, Expressions
from .number import DOUBLES, NumberType
from .source import (
    ARRAY,
    DOUBLE,
    INT,
    FunctionSource,
    LocalVariable,
    c_name,
    comment_lines,
    common_type,
    find_variables,
)

#: Augmented assignments that exist in C too.
AUGMENTED: dict[type[ast.operator], str] = {ast.Add: "+=", ast.Sub: "-=", ast.Mult: "*=", ast.Div: "/="}


@dataclass(frozen=True)
class CFunction:
    """A function in C: its text, its signature, and the constants and helpers that it needs."""

    text: str
    signature: CSignature
    constants: Mapping[str, float]
    helpers: frozenset[str]


def write_function(
    source: FunctionSource, functions: Mapping[Callable[..., Any], CSignature], number: NumberType = DOUBLES
) -> CFunction:
    """Write a function of the subset as C, with its doubles as `number`.

    Raises InputError with file, line and function for anything outside the subset.
    """
    arguments, result = source.arguments, source.result
    if result is not None and not _always_returns(source.tree.body):
        source.fail(source.tree, "a path without `return`", "a return at the end of every path")
    variables = find_variables(source)
    final: dict[str, str] = dict(arguments)
    written: set[str] = set()
    while True:
        # A later statement may widen a type or write to a vector: repeat until both are known from the first line on.
        before = dict(final), set(written)
        statements = Statements(source, functions, variables, final, written, number)
        body = statements.block(source.tree.body, 1)
        if (final, written) == before:
            break
    writes = tuple(word == ARRAY and name in written for name, word in arguments.items())
    name = c_name(source.name)
    declared = ", ".join(
        f"{'' if into else 'const '}{number.word} {c_name(argument)}[]"
        if word == ARRAY
        else f"{number.of(word)} {c_name(argument)}"
        for (argument, word), into in zip(arguments.items(), writes, strict=True)
    )
    used = {node.id for node in ast.walk(source.tree) if isinstance(node, ast.Name)}
    top = [f"    (void){c_name(argument)};" for argument in arguments if argument not in used]
    for word in sorted(set(variables) - set(arguments)):
        if not variables[word].loops and variables[word].declared_by is None:
            zero = {DOUBLE: number.literal(0.0), "bool": "false"}.get(final[word], "0")
            top.append(f"    {number.of(final[word])} {c_name(word)} = {zero};")
    text = [*comment_lines(source.documentation), f"static {number.of(result or 'void')} {name}({declared or 'void'})"]
    return CFunction(
        "\n".join([*text, "{", *top, *body, "}"]),
        CSignature(name, tuple(arguments.values()), result, writes),
        statements.constants,
        frozenset(statements.helpers),
    )


def _always_returns(body: list[ast.stmt]) -> bool:
    last = body[-1]
    if isinstance(last, ast.If):
        return bool(last.orelse) and _always_returns(last.body) and _always_returns(last.orelse)
    return isinstance(last, ast.Return)


class Statements(Expressions):
    """Translates the body of one function.

    Attributes
    ----------
    variables: local variables by name.
    final: name -> type of all variables, double where both int and double are assigned.
    written: names of the vectors that the function writes to.
    """

    def __init__(
        self,
        source: FunctionSource,
        functions: Mapping[Callable[..., Any], CSignature],
        variables: Mapping[str, LocalVariable],
        final: dict[str, str],
        written: set[str],
        number: NumberType,
    ) -> None:
        super().__init__(source, functions, number)
        self.variables, self.final, self.written = variables, final, written
        self.temporaries = 0

    def block(self, body: list[ast.stmt], indent: int) -> list[str]:
        """Lines of C of a block, indented."""
        lines: list[str] = []
        pad = "    " * indent
        for statement in body:
            lines += [f"{pad}/* {text} */" for text in self.source.comment_above(statement)]
            lines += [pad + line for line in self._statement(statement, indent)]
        return lines

    def _statement(self, node: ast.stmt, indent: int) -> list[str]:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)]):
                return self._assign_all(node, targets)
            case ast.Assign(targets=[ast.Subscript(slice=ast.Slice()) as target]):
                return self._copy(target, node.value)
            case ast.Assign(targets=[target]):
                parts = [node.value, target.slice] if isinstance(target, ast.Subscript) else [node.value]
                self.require_order(parts[0] if len(parts) == 1 else ast.Tuple(parts, ast.Load()))
                return self._assign(node, target, self._value(node.value))
            case ast.AugAssign():
                return self._augmented(node)
            case ast.If():
                return self._if(node, indent)
            case ast.For():
                return self._for(node, indent)
            case ast.While(orelse=[]):
                self.require_order(node.test)
                return [f"while ({self.truth(node.test).code}) {{", *self._inner(node.body, indent)]
            case ast.Return():
                return self._return(node)
            case ast.Expr(value=ast.Constant(value=str())) | ast.Pass():
                return []
            case ast.Expr(value=ast.Call()):
                self.require_order(node.value)
                text = self._value(node.value)
                return [f"{text.code};" if text.type == "nothing" else f"(void){text.code};"]
            case ast.Continue():
                return ["continue;"]
            case ast.Break():
                return ["break;"]
        return self.source.fail(
            node, f"`{ast.unparse(node).splitlines()[0]}`", "assignments, if, for over range, while, return and calls"
        )

    def _inner(self, body: list[ast.stmt], indent: int) -> list[str]:
        """A nested block and its closing brace, without the indentation that `block` adds."""
        pad = "    " * indent
        return [*(line.removeprefix(pad) for line in self.block(body, indent + 1)), "}"]

    def _value(self, node: ast.expr) -> CExpression:
        """An expression; records the vectors that its calls write to."""
        text = self.write(node)
        for call in (inner for inner in ast.walk(node) if isinstance(inner, ast.Call)):
            for given, writes in zip(call.args, self._writes(call), strict=False):
                if writes:
                    self._mark_written(given)
        return text

    def _mark_written(self, vector: ast.expr) -> None:
        name = vector.value if isinstance(vector, ast.Subscript) else vector
        assert isinstance(name, ast.Name)
        self.written.add(name.id)

    def _temporary(self, word: str, code: str, lines: list[str]) -> str:
        """The name of a new constant with this value, whose declaration is added to `lines`."""
        self.temporaries += 1
        lines.append(f"const {self.number.of(word)} value_{self.temporaries} = {code};")
        return f"value_{self.temporaries}"

    def _assign_all(self, node: ast.Assign, targets: list[ast.expr]) -> list[str]:
        """Unpacking of a tuple or vector; Python evaluates all values before it assigns the first."""
        self.require_order(node.value)
        if isinstance(node.value, ast.Tuple):
            if len(node.value.elts) != len(targets):
                self.fail(node, f"{len(targets)} values")
            values = [self._value(value) for value in node.value.elts]
            early = [any(_touches(first, value) for first in targets[:k]) for k, value in enumerate(node.value.elts)]
        else:
            name, _, start = self.vector(node.value).code.partition(" + ")
            places = [f"{start} + {k}" if start and k else start or str(k) for k in range(len(targets))]
            values = [CExpression(f"{name}[{place}]", DOUBLE) for place in places]
            early = [any(isinstance(first, ast.Subscript) for first in targets[:k]) for k in range(len(targets))]
        lines: list[str] = []
        for k, value in enumerate(values):
            if early[k]:
                values[k] = CExpression(self._temporary(value.type, value.code, lines), value.type)
        for target, value in zip(targets, values, strict=True):
            lines += self._assign(node, target, value)
        return lines

    def _assign(self, node: ast.Assign, target: ast.expr, value: CExpression) -> list[str]:
        """Assign a value to a variable or an entry, declaring the variable where this is its place."""
        if isinstance(target, ast.Subscript):
            if value.type not in (INT, DOUBLE):
                self.fail(node, "a number in a vector's entry")
            self._mark_written(target)
            return [f"{self.write(target).code} = {self._as_double(value).code};"]
        if not isinstance(target, ast.Name):
            self.fail(node, "a variable or a vector's entry on the left")
        assert isinstance(target, ast.Name)
        argument = target.id in self.source.arguments
        if argument and self.types[target.id] == ARRAY:
            expected = "another name: an argument's vector keeps its name"
            self.source.fail(node, f"the new meaning of {target.id}", expected)
        self._record_type(node, target.id, value.type)
        word, name, variable = self.final[target.id], c_name(target.id), self.variables[target.id]
        declares = variable.declared_by is node and not argument
        if word == ARRAY:
            return self._alias(node, target.id, value, declares)
        if word == DOUBLE:
            value = self._as_double(value)
        if not declares:
            return [f"{name} = {value.code};"]
        fixed = "const " if variable.assigned == 1 else ""
        return [f"{fixed}{self.number.of(word)} {name} = {value.code};", *([] if variable.read else [f"(void){name};"])]

    def _alias(self, node: ast.Assign, name: str, value: CExpression, declares: bool) -> list[str]:
        """A name for a vector or part of one, as a pointer."""
        if not declares or self.variables[name].assigned > 1:
            self.source.fail(node, f"the vector {name}, assigned more than once or not always", "one assignment")
        if name in self.written:
            self._mark_written(node.value)
        fixed = "" if name in self.written else "const "
        return [f"{fixed}{self.number.word} *{c_name(name)} = {value.code};"]

    def _record_type(self, node: ast.stmt, name: str, word: str) -> None:
        """Record the type of a variable after an assignment."""
        before = self.final.get(name, word)
        both = common_type(before, word)
        if both is None or word == "nothing":
            self.source.fail(node, f"{name}, once {before} and once {word},", "one kind a name")
        self.final[name] = self.types[name] = both

    def _copy(self, target: ast.Subscript, value: ast.expr) -> list[str]:
        """Assignment of a vector to a slice; memmove, because both may overlap, as in numpy."""
        part = target.slice
        assert isinstance(part, ast.Slice)
        if part.upper is None or part.step is not None:
            self.source.fail(target, f"`{ast.unparse(target)}` on the left", "a slice with an end")
        self._mark_written(target)
        to, size = self.vector(target), self.whole(part.upper).code
        if part.lower is not None:
            start = self.whole(part.lower)
            plain = size.isdigit() and start.code.isdigit()
            size = str(int(size) - int(start.code)) if plain else f"({size} - {start.within(SUM + 1)})"
        return [f"memmove({to.code}, {self.vector(value).code}, {size} * sizeof({self.number.word}));"]

    def _augmented(self, node: ast.AugAssign) -> list[str]:
        value, target = self._value(node.value), node.target
        if isinstance(target, ast.Subscript):
            self.require_order(ast.Tuple([node.value, target], ast.Load()))
            place, before = self.write(target).code, DOUBLE
            if isinstance(target.slice, ast.Slice):
                self.fail(node, "a loop over the entries")
            self._mark_written(target)
        else:
            assert isinstance(target, ast.Name)
            self.require_order(node.value)
            before, place = self.types[target.id], c_name(target.id)
        if value.type not in (INT, DOUBLE) or before not in (INT, DOUBLE):
            self.fail(node, "numbers on both sides")
        if isinstance(target, ast.Name):
            divides = isinstance(node.op, ast.Div | ast.Mod)
            self._record_type(node, target.id, str(common_type(before, DOUBLE if divides else value.type)))
        if isinstance(node.op, ast.Mod):
            self.helpers.add("remainder_of")
            return [f"{place} = remainder_of({place}, {self._as_double(value).code});"]
        if type(node.op) not in AUGMENTED:
            self.fail(node, "+=, -=, *=, /= or %=")
        if not (isinstance(target, ast.Name) and self.final[target.id] == INT):
            value = self._as_double(value)
        return [f"{place} {AUGMENTED[type(node.op)]} {value.code};"]

    def _if(self, node: ast.If, indent: int) -> list[str]:
        self.require_order(node.test)
        self._value(node.test)
        lines = [f"if ({self.truth(node.test).code}) {{", *self._inner(node.body, indent)]
        match node.orelse:
            case []:
                return lines
            case [ast.If() as other]:
                first, *rest = self._if(other, indent)
                return [*lines[:-1], f"}} else {first}", *rest]
        return [*lines[:-1], "} else {", *self._inner(node.orelse, indent)]

    def _for(self, node: ast.For, indent: int) -> list[str]:
        match node.target, node.iter:
            case ast.Name(id=counter), ast.Call(func=called, args=[_] | [_, _] as bounds) if (
                not node.orelse and self.source.meaning(called) is range
            ):
                pass
            case _:
                head = f"`for {ast.unparse(node.target)} in {ast.unparse(node.iter)}`"
                self.source.fail(node, head, "a for over range(n) or range(a, b)")
        name, lines = c_name(counter), list[str]()
        start, stop = ([ast.Constant(0), *bounds])[-2:]
        first, last = self.whole(start).code, self.whole(stop).code
        inner = [n for part in node.body for n in ast.walk(part) if isinstance(n, ast.Name)]
        changing = {n.id for n in inner if isinstance(n.ctx, ast.Store)}
        if any(isinstance(n, ast.Subscript | ast.Call) or getattr(n, "id", "") in changing for n in ast.walk(stop)):
            # Python evaluates the range once, C in each iteration.
            last = self._temporary(INT, last, lines)
        self._record_type(node, counter, INT)
        return [*lines, f"for (int {name} = {first}; {name} < {last}; {name}++) {{", *self._inner(node.body, indent)]

    def _return(self, node: ast.Return) -> list[str]:
        wanted = self.source.result
        if node.value is None or wanted is None:
            if node.value is not None or wanted is not None:
                self.fail(node, "a return that fits the function's annotation")
            return ["return;"]
        self.require_order(node.value)
        text = self._value(node.value)
        if common_type(text.type, wanted) != wanted:
            self.fail(node, f"a {wanted}, as in the function's annotation")
        return [f"return {self._as_double(text).code if wanted == DOUBLE else text.code};"]


def _touches(target: ast.expr, value: ast.expr) -> bool:
    """Whether an assignment to `target` may change `value`; vectors may alias."""
    if isinstance(target, ast.Subscript):
        return any(isinstance(node, ast.Subscript | ast.Call) for node in ast.walk(value))
    return any(isinstance(node, ast.Name) and node.id == getattr(target, "id", "") for node in ast.walk(value))
