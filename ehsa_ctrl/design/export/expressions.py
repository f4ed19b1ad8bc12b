"""Expressions of the subset as C: the same operations in the same order.

Where C would be free to choose an order, as between two calls that both write, the text is refused.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from .kinds import ARRAY, BOOL, DOUBLE, INT, c_name, join, literal
from .meaning import MATH, QUESTIONS, meaning
from .source import Source

#: How tightly C binds; an operand that binds less tightly gets brackets.
CHOICE, OR, AND, COMPARE, SUM, PRODUCT, SIGN, ATOM = range(8)
SIGNS: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", SUM),
    ast.Sub: ("-", SUM),
    ast.Mult: ("*", PRODUCT),
    ast.Div: ("/", PRODUCT),
}
COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}


@dataclass(frozen=True)
class Signature:
    """How a function of ours is called.

    Attributes
    ----------
    name: in C. arguments: kinds. result: kind or None. writes: for each argument whether the function writes into it.
    """

    name: str
    arguments: tuple[str, ...]
    result: str | None
    writes: tuple[bool, ...]


@dataclass(frozen=True)
class Text:
    """A piece of C and what it is: its kind, and how tightly it binds."""

    code: str
    kind: str
    binds: int = ATOM

    def within(self, binds: int) -> str:
        """As an operand of something that binds this tightly."""
        return self.code if self.binds >= binds else f"({self.code})"


@dataclass
class Expressions:
    """Writes the expressions of one function.

    Attributes
    ----------
    source: the function. variables: name -> kind, of arguments and of what is assigned so far.
    functions: those of ours that may be called. constants, helpers: what was used; filled while writing.
    """

    source: Source
    variables: dict[str, str]
    functions: Mapping[Callable[..., Any], Signature]
    constants: dict[str, float]
    helpers: set[str]

    def write(self, node: ast.expr) -> Text:
        """C of an expression. Raises InputError for one that is not in the subset."""
        match node:
            case ast.Constant():
                return self._constant(node)
            case ast.Name():
                return self._name(node)
            case ast.Attribute():
                value = meaning(self.source, node)
                if isinstance(value, float | int):
                    return _number(value)
            case ast.Subscript():
                return self._subscript(node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.BinOp():
                return self._binary(node)
            case ast.BoolOp():
                return self._logic(node)
            case ast.Compare():
                return self._compare(node)
            case ast.IfExp():
                return self._choice(node)
            case ast.Call():
                return self._call(node)
        return self.source.fail(
            node, f"`{ast.unparse(node)}`", "numbers, vectors' entries and slices, arithmetic, comparisons and calls"
        )

    def number(self, node: ast.expr) -> Text:
        """An expression that is a number."""
        text = self.write(node)
        if text.kind not in (INT, DOUBLE):
            self.source.fail(node, f"`{ast.unparse(node)}` as a number", "a float or an int there")
        return text

    def whole(self, node: ast.expr) -> Text:
        """An expression that is a whole number."""
        text = self.write(node)
        if text.kind != INT:
            self.source.fail(node, f"`{ast.unparse(node)}` as an index", "a whole number: int(...) makes one")
        return text

    def truth(self, node: ast.expr) -> Text:
        """An expression that is true or false."""
        text = self.write(node)
        if text.kind != BOOL:
            self.source.fail(node, f"`{ast.unparse(node)}` as a condition", "a comparison, such as `x != 0.0`")
        return text

    def vector(self, node: ast.expr) -> Text:
        """A vector, or the part of one from an entry on, as a pointer."""
        text = self.write(node)
        if text.kind != ARRAY:
            self.source.fail(node, f"`{ast.unparse(node)}` as a vector", "a vector or a slice of one")
        return text

    def ordered(self, node: ast.expr) -> None:
        """Refuse an expression whose value depends on an order that C leaves open."""
        calls = [n for n in ast.walk(node) if isinstance(n, ast.Call) and self._writes(n)]
        if not calls:
            return
        inside = {id(n) for n in ast.walk(calls[0])}
        outside = [n for n in ast.walk(node) if isinstance(n, ast.Subscript) and id(n) not in inside]
        if len(calls) > 1 or outside:
            self.source.fail(
                node, f"`{ast.unparse(node)}`", "a call that writes into a vector to stand in a statement of its own"
            )

    def _writes(self, call: ast.Call) -> bool:
        function = meaning(self.source, call.func)
        return function in self.functions and any(self.functions[function].writes)

    def _constant(self, node: ast.Constant) -> Text:
        value = node.value
        if isinstance(value, bool):
            return Text("true" if value else "false", BOOL)
        if isinstance(value, int | float):
            if isinstance(value, int) and abs(value) > 2**31 - 1:
                self.source.fail(node, f"{value}", "a whole number below 2^31")
            return _number(value)
        return self.source.fail(node, f"`{ast.unparse(node)}`", "a number")

    def _name(self, node: ast.Name) -> Text:
        if node.id in self.variables:
            return Text(c_name(node.id), self.variables[node.id])
        value = meaning(self.source, node)
        if not isinstance(value, int | float) or isinstance(value, bool):
            self.source.fail(node, f"the name {node.id}", "a variable that is assigned before, or a constant number")
        before = self.constants.setdefault(node.id, value)
        if type(before) is not type(value) or before != value:
            # Two modules use one name for two numbers.
            return _number(value)
        return Text(c_name(node.id), INT if isinstance(value, int) else DOUBLE)

    def _subscript(self, node: ast.Subscript) -> Text:
        if not isinstance(node.value, ast.Name) or self.variables.get(node.value.id) != ARRAY:
            self.source.fail(node, f"`{ast.unparse(node)}`", "an entry or a slice of a vector that has a name")
        name, place = c_name(node.value.id), node.slice
        if isinstance(place, ast.Slice):
            if place.step is not None:
                self.source.fail(node, f"`{ast.unparse(node)}`", "a slice without steps")
            if place.lower is None:
                return Text(name, ARRAY)
            return Text(f"{name} + {self._index(place.lower).within(SUM)}", ARRAY, SUM)
        return Text(f"{name}[{self._index(place).code}]", DOUBLE)

    def _index(self, node: ast.expr) -> Text:
        text = self.whole(node)
        if text.code.startswith("-"):
            self.source.fail(node, f"the index {ast.unparse(node)}", "one that counts from the front")
        return text

    def _unary(self, node: ast.UnaryOp) -> Text:
        if isinstance(node.op, ast.Not):
            return Text(f"!{self.truth(node.operand).within(ATOM)}", BOOL, SIGN)
        if not isinstance(node.op, ast.USub):
            self.source.fail(node, f"`{ast.unparse(node)}`", "a minus or a not")
        operand = self.number(node.operand)
        return Text(f"-{operand.within(ATOM)}", operand.kind, SIGN)

    def _binary(self, node: ast.BinOp) -> Text:
        left, right = self.number(node.left), self.number(node.right)
        whole = left.kind == right.kind == INT
        if isinstance(node.op, ast.Mod) and not whole:
            self.helpers.add("remainder_of")
            return Text(f"remainder_of({left.code}, {right.code})", DOUBLE)
        if type(node.op) not in SIGNS:
            self.source.fail(node, f"`{ast.unparse(node)}`", "+, -, *, / or % of floats")
        sign, binds = SIGNS[type(node.op)]
        first, second = left.within(binds), right.within(binds + 1)
        if sign == "/" and whole:
            first, second = f"(double){left.within(ATOM)}", f"(double){right.within(ATOM)}"
        return Text(f"{first} {sign} {second}", INT if whole and sign != "/" else DOUBLE, binds)

    def _logic(self, node: ast.BoolOp) -> Text:
        sign, binds = ("&&", AND) if isinstance(node.op, ast.And) else ("||", OR)
        # Brackets around an "and" within an "or" too, which compilers ask for.
        return Text(f" {sign} ".join(self.truth(value).within(COMPARE) for value in node.values), BOOL, binds)

    def _compare(self, node: ast.Compare) -> Text:
        operands = [node.left, *node.comparators]
        if any(isinstance(inner, ast.Call) for middle in operands[1:-1] for inner in ast.walk(middle)):
            self.source.fail(node, f"`{ast.unparse(node)}`", "no call in the middle of a chain of comparisons")
        pairs = []
        for operator, left, right in zip(node.ops, operands, operands[1:], strict=False):
            if type(operator) not in COMPARISONS:
                self.source.fail(node, f"`{ast.unparse(node)}`", "==, !=, <, <=, > or >=")
            sign = COMPARISONS[type(operator)]
            pairs.append(f"{self.number(left).within(SUM)} {sign} {self.number(right).within(SUM)}")
        return Text(" && ".join(pairs), BOOL, COMPARE if len(pairs) == 1 else AND)

    def _choice(self, node: ast.IfExp) -> Text:
        test, yes, no = self.truth(node.test), self.write(node.body), self.write(node.orelse)
        kind = join(yes.kind, no.kind)
        if kind is None or kind == ARRAY:
            self.source.fail(node, f"`{ast.unparse(node)}`", "the same kind of number on both sides")
        return Text(f"{test.within(OR)} ? {yes.within(OR)} : {no.within(OR)}", kind, CHOICE)

    def _call(self, node: ast.Call) -> Text:
        if node.keywords or any(isinstance(argument, ast.Starred) for argument in node.args):
            self.source.fail(node, f"`{ast.unparse(node)}`", "plain arguments")
        function = meaning(self.source, node.func)
        if function in self.functions:
            return self._own(node, self.functions[function])
        if function in (min, max) and len(node.args) > 1:
            return self._extreme(node, "smaller" if function is min else "larger")
        if len(node.args) == 1 and function in (abs, int, float):
            value = self.number(node.args[0])
            if function is abs and value.kind == DOUBLE:
                return Text(f"fabs({value.code})", DOUBLE)
            if function is not abs:
                kind = INT if function is int else DOUBLE
                return Text(f"({kind}){value.within(ATOM)}", kind, SIGN)
        if function in QUESTIONS and len(node.args) == 1:
            return Text(f"{QUESTIONS[function]}({self._double(node.args[0])}) != 0", BOOL, COMPARE)
        if function in MATH and len(node.args) == (2 if MATH[function] in ("atan2", "hypot") else 1):
            return Text(f"{MATH[function]}({', '.join(map(self._double, node.args))})", DOUBLE)
        known = sorted(signature.name for signature in self.functions.values())
        return self.source.fail(
            node,
            f"the call `{ast.unparse(node)}`",
            "min, max, abs of a float, int, float, a function of math" + "".join(f", {name}" for name in known),
        )

    def _double(self, node: ast.expr) -> str:
        text = self.number(node)
        return text.code if text.kind == DOUBLE else f"(double){text.within(ATOM)}"

    def _extreme(self, node: ast.Call, helper: str) -> Text:
        values = [self.number(argument) for argument in node.args]
        kind = INT if all(value.kind == INT for value in values) else DOUBLE
        if kind == INT:
            helper += "_int"
        self.helpers.add(helper)
        code = values[0].code
        for value in values[1:]:
            code = f"{helper}({code}, {value.code})"
        return Text(code, kind)

    def _own(self, node: ast.Call, signature: Signature) -> Text:
        if len(node.args) != len(signature.arguments):
            self.source.fail(node, f"`{ast.unparse(node)}`", f"{len(signature.arguments)} arguments")
        made = {ARRAY: self.vector, INT: self.whole, DOUBLE: self.number, BOOL: self.truth}
        arguments = [made[kind](given).code for kind, given in zip(signature.arguments, node.args, strict=True)]
        return Text(f"{signature.name}({', '.join(arguments)})", signature.result or "nothing")


def _number(value: float) -> Text:
    """A literal; a negative one binds as a sign does."""
    kind = INT if isinstance(value, int) else DOUBLE
    code = literal(value)
    return Text(code, kind, SIGN if code.startswith("-") else ATOM)
