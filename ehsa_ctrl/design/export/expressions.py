"""Expressions of the subset as C: the same operations in the same order.

An expression whose order of evaluation C leaves open, such as two calls that both write, is an InputError.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from .number import DOUBLES, NumberType
from .source import ARRAY, BOOL, DOUBLE, INT, FunctionSource, c_name, common_type

#: Precedence in C; an operand of lower precedence gets parentheses.
CHOICE, OR, AND, COMPARE, SUM, PRODUCT, SIGN, ATOM = range(8)
OPERATORS: dict[type[ast.operator], tuple[str, int]] = {
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
#: Functions of one or two numbers with the same value in C: exact, or from the libm that Python calls too.
MATH_NAMES = "sqrt exp log log10 sin cos tan asin acos atan sinh cosh tanh fabs atan2 hypot"
MATH: dict[Callable[..., Any], tuple[str, int]] = {
    getattr(math, name): (name, 2 if name in ("atan2", "hypot") else 1) for name in MATH_NAMES.split()
}
PREDICATES: dict[Callable[..., Any], str] = {getattr(math, name): name for name in ("isfinite", "isnan", "isinf")}


class CSignature(NamedTuple):
    """Signature of a function in C.

    name: in C. arguments: types. result: type or None. writes: for each argument, whether the function writes to it.
    """

    name: str
    arguments: tuple[str, ...]
    result: str | None
    writes: tuple[bool, ...]


class CExpression(NamedTuple):
    """A piece of C with its type and precedence."""

    code: str
    type: str
    precedence: int = ATOM

    def within(self, precedence: int) -> str:
        """The code as an operand of an operator of this precedence."""
        return self.code if self.precedence >= precedence else f"({self.code})"


class Expressions:
    """Translates the expressions of one function.

    Attributes
    ----------
    source: the function. functions: those that it may call.
    types: name -> type of arguments and of variables assigned so far.
    constants, helpers: those used so far.
    number: type of a double in C.
    """

    def __init__(
        self,
        source: FunctionSource,
        functions: Mapping[Callable[..., Any], CSignature],
        number: NumberType = DOUBLES,
    ) -> None:
        self.source, self.functions, self.number = source, functions, number
        self.types = dict(source.arguments)
        self.constants: dict[str, float] = {}
        self.helpers: set[str] = set()

    def fail(self, node: ast.AST, expected: str) -> Any:
        """Raise InputError for the code of a node."""
        self.source.fail(node, f"`{ast.unparse(node)}`", expected)

    def write(self, node: ast.expr) -> CExpression:
        """C of an expression. Raises InputError for one outside the subset."""
        match node:
            case ast.Constant(value=bool() as value):
                return CExpression("true" if value else "false", BOOL)
            case ast.Constant(value=int() | float() as value):
                if isinstance(value, int) and abs(value) > 2**31 - 1:
                    self.source.fail(node, f"{value}", "a whole number below 2^31")
                return self._literal(value)
            case ast.Name():
                return self._name(node)
            case ast.Attribute() if isinstance(value := self.source.meaning(node), float | int):
                return self._literal(value)
            case ast.Subscript(value=ast.Name(id=name)) if self.types.get(name) == ARRAY:
                return self._part(node, c_name(name))
            case ast.UnaryOp(op=ast.Not()):
                return CExpression(f"!{self.truth(node.operand).within(ATOM)}", BOOL, SIGN)
            case ast.UnaryOp(op=ast.USub()):
                operand = self._number(node.operand)
                return CExpression(f"-{operand.within(ATOM)}", operand.type, SIGN)
            case ast.BinOp():
                return self._binary(node)
            case ast.BoolOp():
                sign, precedence = ("&&", AND) if isinstance(node.op, ast.And) else ("||", OR)
                # Parentheses also around "and" within "or", without which compilers warn.
                code = f" {sign} ".join(self.truth(value).within(COMPARE) for value in node.values)
                return CExpression(code, BOOL, precedence)
            case ast.Compare():
                return self._compare(node)
            case ast.IfExp():
                test, yes, no = self.truth(node.test), self.write(node.body), self.write(node.orelse)
                both = common_type(yes.type, no.type)
                if both is None or both == ARRAY:
                    self.fail(node, "the same kind of number on both sides")
                if both == DOUBLE:
                    yes, no = self._as_double(yes), self._as_double(no)
                return CExpression(f"{test.within(OR)} ? {yes.within(OR)} : {no.within(OR)}", str(both), CHOICE)
            case ast.Call():
                return self._call(node)
        return self.fail(node, "numbers, vectors' entries and slices, arithmetic, comparisons and calls")

    def _number(self, node: ast.expr) -> CExpression:
        return self._typed(node, (INT, DOUBLE), "a number", "a float or an int there")

    def whole(self, node: ast.expr) -> CExpression:
        return self._typed(node, (INT,), "an index", "a whole number: int(...) makes one")

    def truth(self, node: ast.expr) -> CExpression:
        return self._typed(node, (BOOL,), "a condition", "a comparison, such as `x != 0.0`")

    def vector(self, node: ast.expr) -> CExpression:
        """A vector, or the part of one from an entry on, as a pointer."""
        return self._typed(node, (ARRAY,), "a vector", "a vector or a slice of one")

    def _typed(self, node: ast.expr, types: tuple[str, ...], use: str, expected: str) -> CExpression:
        text = self.write(node)
        if text.type not in types:
            self.source.fail(node, f"`{ast.unparse(node)}` as {use}", expected)
        return text

    def _real(self, node: ast.expr) -> CExpression:
        return self._as_double(self._number(node))

    def _double(self, node: ast.expr) -> str:
        return self._real(node).code

    def _as_double(self, text: CExpression) -> CExpression:
        """A number as a double; C would convert a whole one to float without asking."""
        if text.type == DOUBLE:
            return text
        if text.code.lstrip("-").isdigit():
            return self._literal(float(text.code))
        return CExpression(f"({self.number.word}){text.within(ATOM)}", DOUBLE, SIGN)

    def _literal(self, value: float) -> CExpression:
        """A literal; a negative one has the precedence of its sign."""
        code = self.number.literal(value)
        return CExpression(code, INT if isinstance(value, int) else DOUBLE, SIGN if code.startswith("-") else ATOM)

    def require_order(self, node: ast.expr) -> None:
        """Raise InputError if the value depends on an order of evaluation that C leaves open."""
        calls = [n for n in ast.walk(node) if isinstance(n, ast.Call) and any(self._writes(n))]
        if not calls:
            return
        inside = {id(n) for n in ast.walk(calls[0])}
        outside = [n for n in ast.walk(node) if isinstance(n, ast.Subscript) and id(n) not in inside]
        if len(calls) > 1 or outside:
            self.fail(node, "a call that writes into a vector in a statement of its own")

    def _writes(self, call: ast.Call) -> tuple[bool, ...]:
        function = self.source.meaning(call.func)
        return self.functions[function].writes if function in self.functions else ()

    def _name(self, node: ast.Name) -> CExpression:
        if node.id in self.types:
            return CExpression(c_name(node.id), self.types[node.id])
        value = self.source.meaning(node)
        if not isinstance(value, int | float) or isinstance(value, bool):
            self.source.fail(node, f"the name {node.id}", "a variable that is assigned before, or a constant number")
        before = self.constants.setdefault(node.id, value)
        if type(before) is not type(value) or before != value:
            # Two modules use the same name for different numbers.
            return self._literal(value)
        return CExpression(c_name(node.id), INT if isinstance(value, int) else DOUBLE)

    def _part(self, node: ast.Subscript, name: str) -> CExpression:
        """An entry of a vector, or the vector from an entry on."""
        place = node.slice
        if not isinstance(place, ast.Slice):
            return CExpression(f"{name}[{self._index(place).code}]", DOUBLE)
        if place.step is not None:
            self.fail(node, "a slice without steps")
        if place.lower is None:
            return CExpression(name, ARRAY)
        return CExpression(f"{name} + {self._index(place.lower).within(SUM)}", ARRAY, SUM)

    def _index(self, node: ast.expr) -> CExpression:
        text = self.whole(node)
        if text.code.startswith("-"):
            self.source.fail(node, f"the index {ast.unparse(node)}", "one that counts from the front")
        return text

    def _binary(self, node: ast.BinOp) -> CExpression:
        left, right = self._number(node.left), self._number(node.right)
        whole = left.type == right.type == INT
        if isinstance(node.op, ast.Mod) and not whole:
            self.helpers.add("remainder_of")
            return CExpression(f"remainder_of({self._as_double(left).code}, {self._as_double(right).code})", DOUBLE)
        if type(node.op) not in OPERATORS:
            self.fail(node, "+, -, *, / or % of floats")
        sign, precedence = OPERATORS[type(node.op)]
        if sign == "/" or not whole:
            left, right = self._as_double(left), self._as_double(right)
        first, second = left.within(precedence), right.within(precedence + 1)
        return CExpression(f"{first} {sign} {second}", INT if whole and sign != "/" else DOUBLE, precedence)

    def _compare(self, node: ast.Compare) -> CExpression:
        operands = [node.left, *node.comparators]
        if any(isinstance(inner, ast.Call) for middle in operands[1:-1] for inner in ast.walk(middle)):
            self.fail(node, "no call in the middle of a chain of comparisons")
        pairs = []
        for operator, left, right in zip(node.ops, operands, operands[1:], strict=False):
            if type(operator) not in COMPARISONS:
                self.fail(node, "==, !=, <, <=, > or >=")
            sign = COMPARISONS[type(operator)]
            one, other = self._number(left), self._number(right)
            if DOUBLE in (one.type, other.type):
                one, other = self._as_double(one), self._as_double(other)
            pairs.append(f"{one.within(SUM)} {sign} {other.within(SUM)}")
        return CExpression(" && ".join(pairs), BOOL, COMPARE if len(pairs) == 1 else AND)

    def _call(self, node: ast.Call) -> CExpression:
        if node.keywords or any(isinstance(argument, ast.Starred) for argument in node.args):
            self.fail(node, "plain arguments")
        function, given = self.source.meaning(node.func), node.args
        if function in self.functions:
            signature = self.functions[function]
            if len(given) != len(signature.arguments):
                self.fail(node, f"{len(signature.arguments)} arguments")
            made = {ARRAY: self.vector, INT: self.whole, DOUBLE: self._real, BOOL: self.truth}
            codes = [made[word](argument).code for word, argument in zip(signature.arguments, given, strict=True)]
            return CExpression(f"{signature.name}({', '.join(codes)})", signature.result or "nothing")
        if function in (min, max) and len(given) > 1:
            return self._extreme(node, "smaller" if function is min else "larger")
        if len(given) == 1 and function in (abs, int, float):
            value = self._number(given[0])
            if function is abs and value.type == DOUBLE:
                return CExpression(f"{self.number.function('fabs')}({value.code})", DOUBLE)
            if function is float:
                return self._as_double(value)
            if function is int:
                return CExpression(f"({INT}){value.within(ATOM)}", INT, SIGN)
        if function in PREDICATES and len(given) == 1:
            return CExpression(f"{PREDICATES[function]}({self._double(given[0])}) != 0", BOOL, COMPARE)
        if function in MATH and len(given) == MATH[function][1]:
            return CExpression(
                f"{self.number.function(MATH[function][0])}({', '.join(map(self._double, given))})", DOUBLE
            )
        known = "".join(f", {name}" for name in sorted(signature.name for signature in self.functions.values()))
        return self.source.fail(
            node, f"the call `{ast.unparse(node)}`", f"min, max, abs of a float, int, float, a function of math{known}"
        )

    def _extreme(self, node: ast.Call, helper: str) -> CExpression:
        values = [self._number(argument) for argument in node.args]
        both = INT if all(value.type == INT for value in values) else DOUBLE
        if both == INT:
            helper += "_int"
        else:
            values = [self._as_double(value) for value in values]
        self.helpers.add(helper)
        code = values[0].code
        for value in values[1:]:
            code = f"{helper}({code}, {value.code})"
        return CExpression(code, both)
