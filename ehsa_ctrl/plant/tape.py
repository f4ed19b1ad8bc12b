"""Straight-line form of the equations: every operation once, in order, from inputs and parameters to signals.

The physics consists of small scalar functions (`physics/`). A tape parses their source, inlines their calls and lists
the operations. From this list the compiled right-hand side (`simulation/plant_text.py`) and the exact derivatives
(`tangent.py`) are made; the plain evaluation (`plain.py`) calls the functions themselves.

A physics function may use: assignments to local names, one `return` at the end, arithmetic, comparisons,
`a if condition else b`, `and`, `or`, `min`, `max`, `abs`, functions of `math`, other physics functions and numeric
constants of the module. Both branches of a conditional are evaluated.
"""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from ..core.errors import CompileError
from ..core.syntax import argument_names, parse_statement
from .wiring import Equations

Ref = int

_BINARY = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_COMPARE = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_MATH = {"exp", "log", "sqrt", "sin", "cos", "tan", "tanh", "atan"}


@dataclass(frozen=True)
class Node:
    """One operation. args: positions of earlier nodes. parametric: depends only on parameters."""

    op: str
    args: tuple[Ref, ...]
    value: float | str | None
    parametric: bool


class Tape:
    """A list of operations without duplicates.

    Parameters
    ----------
    inputs: names whose values change during a run (states, inputs, directions).
    parameters: names that are constant during a run; what depends only on them is computed once per run.
    """

    def __init__(self, inputs: Iterable[str], parameters: Iterable[str]) -> None:
        self.nodes: list[Node] = []
        self._known: dict[tuple[str, tuple[Ref, ...], Any], Ref] = {}
        self.refs: dict[str, Ref] = {}
        for name in inputs:
            self.refs[name] = self._append(Node("input", (), name, False))
        for name in parameters:
            self.refs[name] = self._append(Node("parameter", (), name, True))
        #: Positions of the inputs and parameters; `refs` may change, because a signal may have the name of one of them.
        self.given = dict(self.refs)

    def _append(self, node: Node) -> Ref:
        key = (node.op, node.args, node.value)
        if key not in self._known:
            self.nodes.append(node)
            self._known[key] = len(self.nodes) - 1
        return self._known[key]

    def constant(self, value: float) -> Ref:
        return self._append(Node("const", (), float(value), True))

    def emit(self, op: str, *args: Ref) -> Ref:
        """Append an operation unless it exists already; returns its position.

        A division by a parametric node becomes a product with its reciprocal, which is computed once per run.
        """
        if op == "/" and self.nodes[args[1]].parametric and not self.nodes[args[0]].parametric:
            op, args = "*", (args[0], self.emit("/", self.constant(1.0), args[1]))
        return self._append(Node(op, args, None, all(self.nodes[arg].parametric for arg in args)))

    def call(self, function: Callable[..., float], arguments: Mapping[str, Ref]) -> Ref:
        """Inline a physics function; `arguments` maps its argument names to positions on the tape."""
        return _Inlining(self, function).run(arguments)

    def needed(self, outputs: Iterable[Ref], *, stop: Callable[[Node], bool] = lambda node: False) -> list[Ref]:
        """Every operation that `outputs` depend on, in order of evaluation; the search ends at nodes with `stop`."""
        reached: set[Ref] = set()
        pending = list(outputs)
        while pending:
            ref = pending.pop()
            if ref not in reached:
                reached.add(ref)
                if not stop(self.nodes[ref]):
                    pending.extend(self.nodes[ref].args)
        return sorted(reached)


@cache
def _body(function: Callable[..., float]) -> tuple[list[ast.stmt], dict[str, Any], str]:
    tree = parse_statement(inspect.getsource(function))
    if not isinstance(tree, ast.FunctionDef):
        raise CompileError(f"{function!r} is not a plain function")
    body = tree.body
    if isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
        body = body[1:]
    where = f"{inspect.getsourcefile(function)}, function {function.__name__}"
    return body, inspect.unwrap(function).__globals__, where


class _Inlining:
    def __init__(self, tape: Tape, function: Callable[..., float]) -> None:
        self.tape = tape
        self.body, self.globals, self.where = _body(function)
        self.names: dict[str, Ref] = {}

    def fail(self, node: ast.AST, what: str) -> CompileError:
        text = ast.unparse(node)
        return CompileError(f"{self.where}: `{text}` {what}; see plant/tape.py for what a physics function may use")

    def run(self, arguments: Mapping[str, Ref]) -> Ref:
        self.names = dict(arguments)
        for statement in self.body[:-1]:
            if not (isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)):
                raise self.fail(statement, "is not an assignment to a local name")
            self.names[statement.targets[0].id] = self.expression(statement.value)
        last = self.body[-1]
        if not isinstance(last, ast.Return) or last.value is None:
            raise self.fail(last, "is not the return that must end the function")
        return self.expression(last.value)

    def expression(self, node: ast.expr) -> Ref:
        emit = self.tape.emit
        match node:
            case ast.Constant(value=int() | float() as number):
                return self.tape.constant(number)
            case ast.Name(id=name):
                return self.name(node, name)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return emit(_BINARY[type(op)], self.expression(left), self.expression(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return emit("neg", self.expression(operand))
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARE:
                return emit(_COMPARE[type(op)], self.expression(left), self.expression(right))
            case ast.BoolOp(op=op, values=values):
                word = "and" if isinstance(op, ast.And) else "or"
                result = self.expression(values[0])
                for value in values[1:]:
                    result = emit(word, result, self.expression(value))
                return result
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return emit("select", self.expression(test), self.expression(body), self.expression(orelse))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self.function(node, name, [self.expression(arg) for arg in args])
        raise self.fail(node, "can't be translated")

    def name(self, node: ast.expr, name: str) -> Ref:
        if name in self.names:
            return self.names[name]
        value = self.globals.get(name)
        if isinstance(value, int | float):
            return self.tape.constant(value)
        raise self.fail(node, "is neither an argument nor a numeric constant of its module")

    def function(self, node: ast.expr, name: str, args: list[Ref]) -> Ref:
        emit = self.tape.emit
        if name in ("abs", "round") and name not in self.globals:
            return emit(name, *args)
        if name in ("min", "max") and name not in self.globals:
            result = args[0]
            for arg in args[1:]:
                result = emit("select", emit("<" if name == "min" else ">", arg, result), arg, result)
            return result
        function = self.globals.get(name)
        if name in _MATH and function is getattr(math, name):
            return emit(name, *args)
        if inspect.isfunction(function):
            return self.tape.call(function, dict(zip(argument_names(function), args, strict=True)))
        raise self.fail(node, "calls neither a function of `math` nor a physics function")


def build_tape(equations: Equations, *, residuals: bool = False) -> Tape:
    """Tape with all equations of a structure; `tape.refs` has every signal by name.

    residuals: add the balances of the system; the measured names that they use are then inputs too.
    """
    measured = equations.measured if residuals else ()
    tape = Tape(
        inputs=[*(s.name for s in equations.states), *equations.inputs, *equations.directions, *measured],
        parameters=equations.parameter_names,
    )
    for call in (*equations.calls, *(equations.residual_calls if residuals else ())):
        tape.refs[call.target] = tape.call(
            call.function, {argument: tape.refs[name] for argument, name in call.arguments.items()}
        )
    for signal, name in equations.signals.items():
        tape.refs[signal] = tape.refs[name]
    return tape
