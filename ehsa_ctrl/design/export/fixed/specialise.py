"""A law's Python with its settings known: straight code in which every number has a place, and so a scale, of its own.

Partial evaluation: what depends on settings alone is computed here, loops over known ranges are unrolled, calls are
inlined, and decisions about known numbers are taken. What depends on readings or memory is left as terms. A matrix of
the settings then becomes single coefficients, and terms with a factor 0 vanish.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...controller import SampledController
from ...stages.pipeline import M_LAW, pipeline
from ..expressions import COMPARISONS
from ..source import FunctionSource, c_name, read_source
from .folding import as_real, as_term, chosen, compared, extreme, folded, joined, operated, split_index
from .term import (
    BOOL,
    INT,
    REAL,
    Assignment,
    Branch,
    Place,
    ProgramTerm,
    Remark,
    SpecialisedProgram,
    Statement,
    read,
    without_unread,
)

ARITHMETIC: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Mod: "%"}
FUNCTIONS: dict[Callable[..., Any], str] = {math.sqrt: "sqrt", math.exp: "exp", math.sin: "sin"}
#: Operations whose result gets a variable of its own, because its range is not that of a sum.
KEPT = ("/", "%", "sqrt", "exp", "sin")
#: Turns of a `while` that are unrolled.
TURNS = 100


@dataclass(frozen=True)
class Vector:
    """Part of a vector from an index on. start: known, or a term."""

    store: str
    start: int


Value = float | int | bool | ProgramTerm | Vector


@dataclass
class Frame:
    """A call: the function, and the values of its variables. `result` is one of them under RESULT."""

    source: FunctionSource
    values: dict[str, Value] = field(default_factory=dict)


RESULT = "return"


def specialise(controller: SampledController) -> SpecialisedProgram:
    """One sample of a controller, its settings known.

    Raises InputError for code outside the subset, such as a `for` whose end depends on readings.
    """
    law = controller.law.function
    specialiser = _Specialiser(controller.settings().tolist(), {"law": law})
    arguments = [Vector(name, 0) for name in ("reference", "measured", "memory", "settings")]
    current = specialiser.call(pipeline, arguments)
    assert isinstance(current, ProgramTerm | float | int)
    return without_unread(SpecialisedProgram(specialiser.statements, as_term(current)))


class _Specialiser:
    """Evaluates functions with known and unknown values; `statements` gets what is left."""

    def __init__(self, settings: list[float], substitutes: Mapping[str, Callable[..., Any]]) -> None:
        self.settings, self.substitutes = settings, substitutes
        self.statements: list[Statement] = []
        self._names: dict[str, int] = {}
        #: Numbers of the law's memory that are known, such as sizes in the row of a schedule.
        self._contents: dict[Place, float] = {}
        #: Least and largest value of indices that are not known.
        self._bounds: dict[Place, tuple[int, int]] = {}
        self._sources: dict[Callable[..., Any], FunctionSource] = {}

    def call(self, function: Callable[..., Any], arguments: list[Any]) -> Value | None:
        """Inline a call; arguments are known, kept or vectors."""
        if function not in self._sources:
            self._sources[function] = read_source(function, self.substitutes)
        source = self._sources[function]
        frame = Frame(source, dict(zip(source.arguments, arguments, strict=True)))
        self.statements.append(Remark(f"{source.name}: {source.documentation.partition(chr(10))[0]}"))
        self._block(source.tree.body, frame)
        return frame.values.get(RESULT)

    # Statements

    def _block(self, statements: list[ast.stmt], frame: Frame) -> bool:
        """Whether the block was left by return or continue, on all ways through it."""
        for k, statement in enumerate(statements):
            rest = statements[k + 1 :]
            match statement:
                case ast.If():
                    test = self._evaluate(statement.test, frame)
                    if not isinstance(test, ProgramTerm):
                        return self._block([*(statement.body if test else statement.orelse), *rest], frame)
                    if _leaves(statement):
                        # The way that does not leave goes on with the rest.
                        self._branch(test, [*statement.body, *rest], [*statement.orelse, *rest], frame)
                        return True
                    self._branch(test, statement.body, statement.orelse, frame)
                case ast.For(target=ast.Name(id=counter), iter=ast.Call() as limits):
                    bounds = [self._known(each, frame) for each in limits.args]
                    for i in range(*bounds):
                        frame.values[counter] = i
                        self._block(statement.body, frame)
                        if RESULT in frame.values:
                            frame.source.fail(statement, "a return in a loop", "it after the loop")
                case ast.While() if not _leaves(statement):
                    self._while(statement, frame, TURNS)
                case ast.Return(value=value):
                    result = None if value is None else self._evaluate(value, frame)
                    frame.values[RESULT] = 0.0 if result is None else self._kept(result, "result")
                    return True
                case ast.Continue():
                    return True
                case ast.Assign(targets=[target], value=value):
                    self._assign(target, value, frame)
                case ast.AugAssign(target=target, op=op, value=value):
                    before = self._evaluate(_as_load(target), frame)
                    after = self._operate(ARITHMETIC[type(op)], before, self._evaluate(value, frame))
                    self._store(target, after, frame)
                case ast.Expr(value=ast.Constant()) | ast.Pass():
                    pass
                case ast.Expr(value=value):
                    self._evaluate(value, frame)
                case _:
                    got = f"`{ast.unparse(statement).splitlines()[0]}`"
                    frame.source.fail(
                        statement, f"{got} in fixed point", "loops over known ranges; --number float has any"
                    )
        return False

    def _while(self, loop: ast.While, frame: Frame, turns: int) -> None:
        """A loop that ends after a known number of turns at the latest: decisions within each other."""
        test = self._evaluate(loop.test, frame)
        if not isinstance(test, ProgramTerm) and not test:
            return
        if turns == 0:
            frame.source.fail(loop, f"a loop of more than {TURNS} turns in fixed point", "a shorter table")

        def turn() -> None:
            self._block(loop.body, frame)
            self._while(loop, frame, turns - 1)

        if isinstance(test, ProgramTerm):
            self._decide(test, turn, lambda: None, frame)
        else:
            turn()

    def _branch(self, test: ProgramTerm, yes: list[ast.stmt], no: list[ast.stmt], frame: Frame) -> None:
        self._decide(test, lambda: self._block(yes, frame), lambda: self._block(no, frame), frame)

    def _decide(self, test: ProgramTerm, yes: Callable[[], Any], no: Callable[[], Any], frame: Frame) -> None:
        """Both ways of a decision; variables that differ after them get one place."""
        branch, outer, values, contents = Branch(test), self.statements, dict(frame.values), dict(self._contents)
        self.statements = branch.yes
        yes()
        first, frame.values = frame.values, dict(values)
        stored, self._contents = self._contents, contents
        self.statements = branch.no
        no()
        second = frame.values
        self._contents = {place: v for place, v in self._contents.items() if stored.get(place) == v}
        self.statements = outer
        outer.append(branch)
        frame.values = {}
        # In the order of assignment: that of a set differs from run to run, and so would the code.
        for name in (name for name in first if name in second):
            a, b = first[name], second[name]
            if type(a) is type(b) and a == b:
                frame.values[name] = a
                continue
            if isinstance(a, Vector) or isinstance(b, Vector):
                frame.source.fail(frame.source.tree, f"the vector {name} after a decision", "one meaning of it")
            a, b = as_term(a), as_term(b)
            if a.type != b.type:
                a, b = as_real(a), as_real(b)
            place = self._new_place(name if name != RESULT else f"result_of_{frame.source.name}")
            branch.yes.append(Assignment(place, a))
            branch.no.append(Assignment(place, b))
            frame.values[name] = self._listed(place, a, b) if a.type == INT else read(place, a.type)

    def _listed(self, place: Place, a: ProgramTerm, b: ProgramTerm) -> ProgramTerm:
        """The index at a place that is either a or b: a table of itself if its values are known to be 0 to some n."""
        limits = [self._limits(each) for each in (a, b)]
        if None in limits:
            return read(place, INT)
        low, high = min(each[0] for each in limits if each), max(each[1] for each in limits if each)
        self._bounds[place] = low, high
        if low != 0:
            return read(place, INT)
        return ProgramTerm("table", (read(place, INT),), INT, entries=tuple(range(high + 1)), shape=(high + 1,))

    def _limits(self, index: ProgramTerm) -> tuple[int, int] | None:
        if index.operation == "constant":
            return int(index.value), int(index.value)
        if index.operation == "table":
            return int(min(index.entries)), int(max(index.entries))
        return self._bounds.get(index.place) if index.place is not None else None

    def _assign(self, target: ast.expr, value: ast.expr, frame: Frame) -> None:
        match target, value:
            case ast.Tuple(elts=targets), ast.Tuple(elts=values):
                found = [self._evaluate(each, frame) for each in values]
                # Python evaluates all values before it assigns the first.
                found = [self._kept(each, "value") for each in found]
                for each, result in zip(targets, found, strict=True):
                    self._store(each, result, frame)
            case ast.Tuple(elts=targets), _:
                vector = self._evaluate(value, frame)
                assert isinstance(vector, Vector)
                for k, each in enumerate(targets):
                    self._store(each, self._entry(vector, k), frame)
            case ast.Subscript(slice=ast.Slice(lower=lower, upper=ast.expr() as upper)), _:
                start = 0 if lower is None else self._known(lower, frame)
                to, origin = self._evaluate(target.value, frame), self._evaluate(value, frame)
                assert isinstance(to, Vector) and isinstance(origin, Vector)
                found = [self._kept(self._entry(origin, k), "value") for k in range(self._known(upper, frame) - start)]
                for k, each in enumerate(found):
                    self._put(Place(to.store, to.start + start + k), as_term(each))
            case _:
                self._store(target, self._evaluate(value, frame), frame)

    def _store(self, target: ast.expr, value: Any, frame: Frame) -> None:
        """Assign a value to a variable, or to an entry of a vector."""
        if isinstance(target, ast.Name):
            frame.values[target.id] = self._kept(value, target.id)
            return
        assert isinstance(target, ast.Subscript)
        vector, index = self._evaluate(target.value, frame), self._evaluate(target.slice, frame)
        assert isinstance(vector, Vector)
        place, at = self._place(vector, index, target, frame)
        self._put(place, as_real(as_term(value)), at)

    def _put(self, place: Place, term: ProgramTerm, at: ProgramTerm | None = None) -> None:
        """Assign to an entry of a vector, and remember it if it is known."""
        self.statements.append(Assignment(place, term, at))
        if at is not None:
            self._contents.clear()
        self._contents.pop(place, None)
        if term.operation == "constant" and place.store == "memory" and place.index >= M_LAW:
            self._contents[place] = term.value

    def _kept(self, value: Any, name: str) -> Any:
        """A value that later assignments do not change: a term in a variable of its own."""
        if not isinstance(value, ProgramTerm) or value.operation in ("constant", "table"):
            return value
        if value.operation == "read" and value.place is not None and value.place.local:
            return value
        place = self._new_place(name)
        self.statements.append(Assignment(place, value))
        return read(place, value.type)

    def _new_place(self, name: str) -> Place:
        self._names[name] = self._names.get(name, 0) + 1
        return Place(f"{c_name(name)}_{self._names[name]}")

    # Expressions

    def _known(self, node: ast.expr, frame: Frame) -> int:
        value = self._evaluate(node, frame)
        if not isinstance(value, int):
            frame.source.fail(node, f"`{ast.unparse(node)}` that depends on readings", "a known whole number")
        return int(value)

    def _place(self, vector: Vector, index: Any, node: ast.expr, frame: Frame) -> tuple[Place, ProgramTerm | None]:
        """Place of an entry, and its index in a part that is addressed at run time."""
        if not isinstance(index, ProgramTerm):
            return Place(vector.store, vector.start + index), None
        if vector.store != "memory":
            frame.source.fail(
                node,
                f"`{ast.unparse(node)}`, a table with an index that depends on readings, in fixed point",
                "a known index; --number float has any",
            )
        known, moving = split_index(index)
        return Place("memory", vector.start + known, moving=True), moving

    def _entry(self, vector: Vector, index: int) -> Any:
        """The entry of a vector at a known index."""
        if vector.store == "settings":
            return self.settings[vector.start + index]
        place = Place(vector.store, vector.start + index)
        return self._contents[place] if place in self._contents else read(place)

    def _evaluate(self, node: ast.expr, frame: Frame) -> Any:
        """The value of an expression, known or a term."""
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name) if name in frame.values:
                return frame.values[name]
            case ast.Name() | ast.Attribute():
                return frame.source.meaning(node)
            case ast.Subscript(value=inner, slice=ast.Slice(lower=lower)):
                vector = self._evaluate(inner, frame)
                assert isinstance(vector, Vector)
                return Vector(vector.store, vector.start + (0 if lower is None else self._known(lower, frame)))
            case ast.Subscript(value=inner, slice=place):
                vector, index = self._evaluate(inner, frame), self._evaluate(place, frame)
                assert isinstance(vector, Vector)
                if not isinstance(index, ProgramTerm):
                    return self._entry(vector, index)
                if vector.store == "settings" and index.operation == "table":
                    return folded(lambda i: self.settings[vector.start + i], index)
                where, at = self._place(vector, index, node, frame)
                assert at is not None
                return ProgramTerm("read", (at,), REAL, place=where)
            case ast.UnaryOp(op=ast.Not(), operand=inner):
                value = self._evaluate(inner, frame)
                return ProgramTerm("not", (value,), BOOL) if isinstance(value, ProgramTerm) else not value
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                value = self._evaluate(inner, frame)
                return ProgramTerm("negative", (value,), value.type) if isinstance(value, ProgramTerm) else -value
            case ast.BinOp(left=left, op=op, right=right):
                return self._operate(ARITHMETIC[type(op)], self._evaluate(left, frame), self._evaluate(right, frame))
            case ast.BoolOp(op=op, values=values):
                return joined("and" if isinstance(op, ast.And) else "or", [self._evaluate(v, frame) for v in values])
            case ast.Compare(left=left, ops=ops, comparators=others):
                operands = [self._evaluate(each, frame) for each in (left, *others)]
                pairs = zip(ops, operands, operands[1:], strict=False)
                return joined("and", [compared(COMPARISONS[type(op)], a, b) for op, a, b in pairs])
            case ast.IfExp(test=test, body=body, orelse=orelse):
                value = self._evaluate(test, frame)
                if not isinstance(value, ProgramTerm):
                    return self._evaluate(body if value else orelse, frame)
                return chosen(value, self._evaluate(body, frame), self._evaluate(orelse, frame))
            case ast.Call(func=func, args=arguments):
                return self._called(node, frame.source.meaning(func), arguments, frame)
        return frame.source.fail(node, f"`{ast.unparse(node)}` in fixed point", "arithmetic, comparisons and calls")

    def _called(self, node: ast.Call, function: Any, arguments: list[ast.expr], frame: Frame) -> Any:
        values = [self._evaluate(each, frame) for each in arguments]
        terms = any(isinstance(value, ProgramTerm) for value in values)
        if function in (min, max):
            return extreme(function, values)
        if function is abs:
            return ProgramTerm("absolute", (values[0],), values[0].type) if terms else abs(values[0])
        if function is float:
            return as_real(values[0]) if terms else float(values[0])
        if function is int:
            if not terms:
                return int(values[0])
            return values[0] if values[0].type == INT else ProgramTerm("whole", (values[0],), INT)
        if function is math.isfinite:
            if not terms:
                return math.isfinite(values[0])
            place = values[0].place
            if place is None or place.store != "measured":
                return True  # a number in fixed point is finite; a reading says when it is lost
            return ProgramTerm("valid", (), BOOL, place=place)
        if not terms and callable(function) and getattr(function, "__module__", "") == "math":
            return function(*values)
        if function in FUNCTIONS:
            return self._kept(ProgramTerm(FUNCTIONS[function], (values[0],)), FUNCTIONS[function])
        if getattr(function, "__code__", None) is None:
            return frame.source.fail(node, f"`{ast.unparse(node)}` in fixed point", "sqrt, exp or sin")
        return self.call(function, [self._kept(value, "given") for value in values])

    def _operate(self, sign: str, a: Any, b: Any) -> Any:
        result = operated(sign, a, b)
        new = isinstance(result, ProgramTerm) and result is not a and result is not b
        return self._kept(result, "value") if new and result.operation in KEPT and result.type != INT else result


def _leaves(node: ast.AST) -> bool:
    """Whether a statement may leave its block: a return anywhere in it, or a continue or break of this loop."""
    if isinstance(node, ast.Return | ast.Continue | ast.Break):
        return True
    if isinstance(node, ast.For | ast.While):
        return any(isinstance(each, ast.Return) for each in ast.walk(node))
    return any(_leaves(child) for child in ast.iter_child_nodes(node))


def _as_load(node: ast.expr) -> ast.expr:
    """The target of an augmented assignment as an expression."""
    return ast.parse(ast.unparse(node), mode="eval").body
