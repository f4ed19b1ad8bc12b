"""Generate LLVM assembly for a structure: its equations, and an integration step.

The equations come from the tape (`plant/tape.py`), which already has the form of LLVM assembly: every operation once,
in order. This compiles in a fraction of the time that numba needs for the same operations in Python. All code with
branches and loops, mainly the handling of events, is the same for all structures: `integrator.py` calls these functions
by their addresses.

Functions and their arguments (vectors are pointers to doubles; y states, d sliding directions, c constants of the run;
u, f the two inputs). Each returns one double.

    constants(p, c)                                  fill c from the parameters p; c[i] is the stop band of contact i
    step(y, h, u, du, f, df, d, c, k1, y_n, k7, a_0) one Dormand-Prince step; returns the squared error norm; a_0: the
                                                     acceleration at its end that each contact would have at speed 0
    rates(y, u, f, d, c, k)                          time derivatives of the states
    accept(y, k1, y_n, k_n, extremes)                set y and k1 to y_n and k_n, and widen the extremes (2, n)
    cell(y, u, f, d, c)                              reading of the load cell
    propagate(y, h, u, du, f, df, d, c, S, F, columns, width)   the sensitivities over a step
    hold_i(y, u, f, d, c)                            margin of the contact i at rest, in units of its scale
    kink_i(y, u, f, d, c)                            signal at whose zero the equations bend
    net_i, friction_i(y, u, f, d, c)                 net effort without friction, friction in the direction d[i]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..plant.structure import Structure
from ..plant.tangent import Tangent
from ..plant.tape import Ref, build_tape
from .llvm_function import FUSED, SHARED_TEXT, Function, number

#: Dormand & Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6 (1980): the 5(4) pair with
#: 7 stages; the last stage is evaluated at the result (row 7 = weights of the fifth-order solution).
TABLEAU = (
    (1 / 5, (1 / 5,)),
    (3 / 10, (3 / 40, 9 / 40)),
    (4 / 5, (44 / 45, -56 / 15, 32 / 9)),
    (8 / 9, (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729)),
    (1.0, (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656)),
    (1.0, (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)),
)
#: Fifth- minus fourth-order weights of the same pair.
ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)

#: Arguments of functions of a point, and of functions of a step.
POINT = ("ptr %y", "double %u", "double %f", "ptr %d", "ptr %c")
STEP = ("ptr %y", "double %h", "double %u", "double %du", "double %f", "double %df", "ptr %d", "ptr %c")


def weighted(weights: Sequence[float], rates: Sequence[str]) -> list[tuple[float, str]]:
    """Non-zero weights of a row of the tableau, with their rates."""
    return [(weight, rate) for weight, rate in zip(weights, rates, strict=True) if weight != 0.0]


class _Writer:
    """Writes the functions of a structure. What depends only on parameters is computed once per run and stored in c."""

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.equations = structure.equations
        self.tape = build_tape(self.equations)
        self.slots: dict[Ref, int] = {}
        self.jacobian: dict[tuple[int, int], int] = {}
        self.names = [state.name for state in self.equations.states]
        self.directions = list(self.equations.directions)

    def expressions(self, g: Function, refs: Sequence[Ref], values: Mapping[str, str], flags: str = "") -> list[str]:
        """Operands with the values of `refs`; values: operand of each input of the tape."""
        nodes = self.tape.nodes
        live = self.tape.needed(refs, stop=lambda node: node.parametric)
        partner = self._exp_pairs(live) if not flags else {}
        found: dict[Ref, str] = {}

        def operand(ref: Ref) -> str:
            if ref in found:
                return found[ref]
            node = nodes[ref]
            if node.op == "const":
                found[ref] = number(float(node.value))  # type: ignore[arg-type]
            elif node.op == "input":
                found[ref] = values[str(node.value)]
            elif node.parametric:
                slot = self.slots.setdefault(ref, len(self.slots))
                found[ref] = g.load("%c", len(self.directions) + slot)
            elif ref in partner:
                first, second = sorted((ref, partner[ref]))
                found[first], found[second] = g.exp_of_two(*(operand(nodes[each].args[0]) for each in (first, second)))
            else:
                found[ref] = g.operation(node.op, [operand(arg) for arg in node.args], flags)
            return found[ref]

        return [operand(ref) for ref in refs]

    def _exp_pairs(self, live: Sequence[Ref]) -> dict[Ref, Ref]:
        """Pairs of independent exponentials, each mapped to the other, to be computed together."""
        pairs: dict[Ref, Ref] = {}
        waiting: Ref | None = None
        for ref in live:
            node = self.tape.nodes[ref]
            if node.op == "exp" and not node.parametric:
                if waiting is not None and waiting not in self.tape.needed([ref]):
                    pairs |= {waiting: ref, ref: waiting}
                    waiting = None
                else:
                    waiting = ref
        return pairs

    def at(self, states: Sequence[str], u: str, f: str, directions: Sequence[str]) -> dict[str, str]:
        names = [*self.names, *self.equations.inputs, *self.directions]
        return dict(zip(names, [*states, u, f, *directions], strict=True))

    def rates(self, g: Function, values: Mapping[str, str]) -> list[str]:
        return self.expressions(g, [self.tape.refs[rate] for rate in self.equations.rates], values)

    def vector(self, g: Function, pointer: str, size: int) -> list[str]:
        return [g.load(pointer, i) for i in range(size)]

    def signal(self, name: str, ref: Ref) -> str:
        """A function of a point that returns one signal."""
        g = Function(name, POINT)
        return g.text(self.expressions(g, [ref], self.point(g))[0])

    def point(self, g: Function) -> dict[str, str]:
        """Inputs of the tape by name, read from the arguments POINT."""
        return self.at(self.vector(g, "%y", len(self.names)), "%u", "%f", self.vector(g, "%d", len(self.directions)))

    def hold(self, name: str, net: Ref, friction: Ref, direction: str, scale: float) -> str:
        g = Function(name, POINT)
        values = self.point(g)
        driving = self.expressions(g, [net], values)[0]
        positive = g.truth(f"fcmp ogt double {driving}, 0.0")
        ahead = g.emit(f"select i1 {positive}, double 1.0, double -1.0")
        held = g.operation("*", (ahead, self.expressions(g, [friction], {**values, direction: ahead})[0]))
        left = g.operation("-", (held, g.operation("abs", (driving,))))
        return g.text(g.operation("*", (left, number(1.0 / scale))))

    def rates_text(self) -> str:
        g = Function("rates", [*POINT, "ptr %k"])
        for i, rate in enumerate(self.rates(g, self.point(g))):
            g.store("%k", i, rate)
        return g.text()

    @staticmethod
    def inputs_at(g: Function, c: float, flags: str = "") -> tuple[str, str]:
        """Inputs at the fraction c of a step."""
        u, f = (
            g.operation("+", (f"%{name}", g.operation("*", (number(c), f"%d{name}"), flags)), flags) for name in "uf"
        )
        return u, f

    def step_text(self) -> str:
        g = Function("step", [*STEP, "ptr %k1", "ptr %yn", "ptr %k7", "ptr %a0"])
        n = len(self.names)
        y, k = self.vector(g, "%y", n), [self.vector(g, "%k1", n)]
        directions = self.vector(g, "%d", len(self.directions))
        stage = y
        for c, row in TABLEAU:
            stage = [self.advanced(g, y[i], weighted(row, [rates[i] for rates in k]), FUSED) for i in range(n)]
            values = self.at(stage, *self.inputs_at(g, c, FUSED), directions)
            k.append(self.rates(g, values))
        squares = []
        for i, state in enumerate(self.equations.states):
            part = g.sum(weighted([e / state.scale for e in ERROR], [rates[i] for rates in k]), FUSED)
            squares.append(g.operation("*", (part, part), FUSED))
        # Divided by the number of the system's states: the states of a neutral effect must not change the steps.
        own = len(self.structure.system.states)
        error = g.total([g.total(squares[:own]), *squares[own:]])
        factor = g.operation("*", (g.operation("*", ("%h", "%h")), number(1.0 / own)))
        for i in range(n):
            g.store("%yn", i, stage[i])
            g.store("%k7", i, k[-1][i])
        for i, contact in enumerate(self.structure.system.contacts):
            rate = self.tape.refs[self.equations.rates[self.equations.index(contact.velocity)]]
            # These flags let LLVM simplify exp(0 / tau) to 1.
            at_rest = self.expressions(g, [rate], values | {contact.velocity: number(0.0)}, "nnan nsz ")
            g.store("%a0", i, at_rest[0])
        return g.text(g.operation("*", (error, factor)))

    def accept_text(self) -> str:
        g = Function("accept", ["ptr %y", "ptr %k1", "ptr %yn", "ptr %kn", "ptr %extremes"])
        n = len(self.names)
        y, k = self.vector(g, "%yn", n), self.vector(g, "%kn", n)
        worst = self.vector(g, "%extremes", 2 * n)
        for i in range(n):
            g.store("%y", i, y[i])
            g.store("%k1", i, k[i])
            for place, test in ((i, "<"), (n + i, ">")):
                beyond = g.operation(test, (y[i], worst[place]))
                g.store("%extremes", place, g.operation("select", (beyond, y[i], worst[place])))
        return g.text()

    @staticmethod
    def advanced(g: Function, y: str, terms: Sequence[tuple[float, str]], flags: str = "") -> str:
        """y + h (a1 k1 + a2 k2 ...); the last rate is added last, because it is computed last."""
        *known, (a, k) = terms
        if known:
            y = g.operation("+", (y, g.operation("*", ("%h", g.sum(known, flags)), flags)), flags)
        return g.operation("+", (y, g.operation("*", (g.operation("*", ("%h", number(a))), k), flags)), flags)

    def slopes_text(self) -> str:
        """Rates into k, their non-zero derivatives by states into J, those by parameters into F (state, column)."""
        g = Function("slopes", [*POINT, "ptr %k", "ptr %J", "ptr %F", "ptr %columns", "i64 %width"], "internal ")
        values = self.point(g)
        tape, refs = self.tape, [self.tape.refs[rate] for rate in self.equations.rates]
        parameters = [*self.equations.parameter_names, *self.equations.inputs]
        tangent = Tangent(tape, [*self.names, *parameters])
        by_parameter = []
        for row, rate in enumerate(list(refs)):
            for seed, ref in tangent.of(rate).items():
                if seed in self.names:
                    self.jacobian[row, self.names.index(seed)] = len(self.jacobian)
                    refs.append(ref)
                else:
                    by_parameter.append((row, parameters.index(seed), ref))
        n = len(self.names)
        found = self.expressions(g, [*refs, *(ref for _, _, ref in by_parameter)], values)
        columns = {column: g.load("%columns", column, "i64") for _, column, _ in by_parameter}
        for i, value in enumerate(found[: len(refs)]):
            g.store("%k" if i < n else "%J", i if i < n else i - n, value)
        for (row, column, _), value in zip(by_parameter, found[len(refs) :], strict=True):
            place = g.emit(f"add i64 {columns[column]}, {g.emit(f'mul i64 %width, {row}')}")
            g.store("%F", place, value)
        return g.text()

    def propagate_text(self) -> str:
        """Advance the sensitivities S (state, column) over a step of the states: dS/dt = J S + F.

        It is the same Runge-Kutta step for the variational equations, so that S is the derivative of the numerical
        solution. The Jacobians of all stages come first, then a loop over the columns.
        """
        n, entries = len(self.names), len(self.jacobian)
        arguments = [*STEP, "ptr noalias %S", "ptr noalias %F", "ptr %columns", "i64 %width"]
        g = Function("propagate", arguments)
        y, k, J = self.vector(g, "%y", n), [], []
        state = g.emit(f"alloca double, i64 {n}")
        stages: list[tuple[float, tuple[float, ...]]] = [(0.0, ()), *TABLEAU[:-1]]
        for stage, (c, row) in enumerate(stages):
            k.append(g.emit(f"alloca double, i64 {n}"))
            J.append(g.emit(f"alloca double, i64 {max(entries, 1)}"))
            for i in range(n):
                rates = [g.load(pointer, i) for pointer in k[:-1]]
                g.store(state, i, self.advanced(g, y[i], weighted(row, rates)) if row else y[i])
            u, f = self.inputs_at(g, c)
            offset = g.emit(f"mul i64 %width, {stage * n}")
            part = g.emit(f"getelementptr double, ptr %F, i64 {offset}")
            point = f"ptr {state}, double {u}, double {f}, ptr %d, ptr %c"
            g.emit(f"call double @slopes({point}, ptr {k[-1]}, ptr {J[-1]}, ptr {part}, ptr %columns, i64 %width)")
        entry = {(stage, at): g.load(J[stage], at) for stage in range(len(stages)) for at in range(entries)}
        rows = [g.emit(f"mul i64 %width, {i}") for i in range(len(stages) * n)]
        count = g.emit("add i64 %width, -1")
        some = g.emit(f"icmp sgt i64 {count}, 0")
        g.lines += [f"  br i1 {some}, label %column, label %end", "column:"]
        g.lines.append("  %q = phi i64 [ 0, %0 ], [ %next, %column ]")
        S = [g.load("%S", g.emit(f"add i64 {rows[i]}, %q")) for i in range(n)]
        K: list[list[str]] = []
        for stage, (_, row) in enumerate(stages):
            T = [self.advanced(g, S[i], weighted(row, [rates[i] for rates in K])) if row else S[i] for i in range(n)]
            rate = [g.load("%F", g.emit(f"add i64 {rows[stage * n + i]}, %q")) for i in range(n)]
            for (i, j), at in self.jacobian.items():
                rate[i] = g.operation("+", (rate[i], g.operation("*", (entry[stage, at], T[j]))))
            K.append(rate)
        for i in range(n):
            after = self.advanced(g, S[i], weighted(TABLEAU[-1][1], [rates[i] for rates in K]))
            g.store("%S", g.emit(f"add i64 {rows[i]}, %q"), after)
        g.lines += [
            "  %next = add i64 %q, 1",
            f"  %done = icmp eq i64 %next, {count}",
            "  br i1 %done, label %end, label %column",
            "end:",
        ]
        return g.text()

    def constants_text(self, bands: Sequence[Ref | None]) -> str:
        """Must be called last: it fills all slots of c that the other functions use."""
        g = Function("constants", ["ptr %p", "ptr %c"])
        index = {name: i for i, name in enumerate(self.equations.parameter_names)}
        found: dict[Ref, str] = {}
        for ref in self.tape.needed([*self.slots, *(band for band in bands if band is not None)]):
            node = self.tape.nodes[ref]
            if node.op == "const":
                found[ref] = number(float(node.value))  # type: ignore[arg-type]
            elif node.op == "parameter":
                found[ref] = g.load("%p", index[str(node.value)])
            else:
                found[ref] = g.operation(node.op, [found[arg] for arg in node.args])
        for i, band in enumerate(bands):
            g.store("%c", i, number(0.0) if band is None else found[band])
        for ref, slot in self.slots.items():
            g.store("%c", len(bands) + slot, found[ref])
        return g.text()

    def all_texts(self, sensitivities: bool) -> dict[str, str]:
        """Name -> text of every function."""
        tape, system = self.tape, self.structure.system
        texts = {"step": self.step_text(), "accept": self.accept_text(), "rates": self.rates_text()}
        texts["cell"] = self.signal("cell", tape.refs[system.cell] if system.cell else tape.constant(0.0))
        if sensitivities:
            texts["slopes"] = self.slopes_text()
            texts["propagate"] = self.propagate_text()
        bands: list[Ref | None] = []
        for i, contact in enumerate(system.contacts):
            law = self.structure.law(contact)
            bands.append(None if law.band is None else tape.refs[contact.symbol(law.band)])
            if law.sticks:
                net, friction = tape.refs[contact.net], tape.refs[contact.friction]
                texts[f"hold_{i}"] = self.hold(f"hold_{i}", net, friction, contact.direction, contact.effort_scale)
                texts[f"net_{i}"] = self.signal(f"net_{i}", net)
                texts[f"friction_{i}"] = self.signal(f"friction_{i}", friction)
        for i, signal in enumerate(system.kinks):
            texts[f"kink_{i}"] = self.signal(f"kink_{i}", tape.refs[signal])
        texts["constants"] = self.constants_text(bands)
        return texts


def plant_text(structure: Structure, *, sensitivities: bool = False) -> tuple[str, int]:
    """Text of all functions of a structure, and the number of constants of a run."""
    writer = _Writer(structure)
    texts = writer.all_texts(sensitivities)
    return SHARED_TEXT + "".join(texts.values()), len(structure.system.contacts) + len(writer.slots)
