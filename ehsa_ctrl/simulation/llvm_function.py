"""Write LLVM assembly: functions of straight-line arithmetic on doubles, with an inlined exponential."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from math import factorial

#: Allows a multiplication and an addition to become one fused instruction; used in steps, not in the equations.
FUSED = "contract "

_ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
_COMPARE = {"<": "olt", "<=": "ole", ">": "ogt", ">=": "oge", "==": "oeq", "!=": "une"}
_FUNCTIONS = {
    "exp": "exp_of_one",
    "abs": "llvm.fabs.f64",
    "round": "llvm.rint.f64",
    "sqrt": "llvm.sqrt.f64",
    "log": "llvm.log.f64",
    "sin": "llvm.sin.f64",
    "cos": "llvm.cos.f64",
    "tan": "tan",
    "tanh": "tanh",
    "atan": "atan",
}
DECLARATIONS = (
    "".join(
        f"declare double @{name}(double{', double' if name.startswith('llvm.pow') else ''})\n"
        for name in [*_FUNCTIONS.values(), "llvm.pow.f64"]
        if name != "exp_of_one"
    )
    + "declare <2 x double> @llvm.fabs.v2f64(<2 x double>)\n"
)


def number(value: float) -> str:
    """A double as a hexadecimal constant of LLVM, without rounding."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


class Function:
    """Text of one LLVM function; operands are names (%3) or numbers."""

    def __init__(self, name: str, arguments: Sequence[str], attributes: str = "") -> None:
        self.head = f"define {attributes}double @{name}({', '.join(arguments)}) nounwind "
        self.lines: list[str] = []
        self.booleans: set[str] = set()
        self.loaded: dict[tuple[str, str], str] = {}

    def emit(self, instruction: str) -> str:
        name = f"%v{len(self.lines)}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def load(self, pointer: str, index: int | str, kind: str = "double") -> str:
        """Element of a vector. It is read only once, because a function reads all its inputs before it writes."""
        key = pointer, str(index)
        if key not in self.loaded:
            place = self.emit(f"getelementptr {kind}, ptr {pointer}, i64 {index}")
            self.loaded[key] = self.emit(f"load {kind}, ptr {place}")
        return self.loaded[key]

    def store(self, pointer: str, index: int | str, value: str) -> None:
        place = self.emit(f"getelementptr double, ptr {pointer}, i64 {index}")
        self.lines.append(f"  store double {self.as_double(value)}, ptr {place}")

    def boolean(self, value: str) -> str:
        return value if value in self.booleans else self.emit(f"fcmp une double {value}, 0.0")

    def as_double(self, value: str) -> str:
        return self.emit(f"uitofp i1 {value} to double") if value in self.booleans else value

    def operation(self, op: str, args: Sequence[str], flags: str = "") -> str:
        """An operation of a tape."""
        if op in _ARITHMETIC:
            return self.emit(f"{_ARITHMETIC[op]} {flags}double {args[0]}, {args[1]}")
        if op == "neg":
            return self.emit(f"fneg {flags}double {args[0]}")
        if op == "**":
            return self.emit(f"call double @llvm.pow.f64(double {args[0]}, double {args[1]})")
        if op in _COMPARE:
            return self.truth(f"fcmp {_COMPARE[op]} double {args[0]}, {args[1]}")
        if op in ("and", "or"):
            return self.truth(f"{op} i1 {self.boolean(args[0])}, {self.boolean(args[1])}")
        if op == "select":
            a, b = self.as_double(args[1]), self.as_double(args[2])
            return self.emit(f"select i1 {self.boolean(args[0])}, double {a}, double {b}")
        return self.emit(f"call {flags}double @{_FUNCTIONS[op]}(double {args[0]})")

    def exp_of_two(self, a: str, b: str) -> tuple[str, str]:
        """Two exponentials at the cost of one."""
        pair = self.emit(f"insertelement <2 x double> poison, double {a}, i64 0")
        pair = self.emit(f"insertelement <2 x double> {pair}, double {b}, i64 1")
        pair = self.emit(f"call <2 x double> @exp_of_two(<2 x double> {pair})")
        first, second = (self.emit(f"extractelement <2 x double> {pair}, i64 {k}") for k in (0, 1))
        return first, second

    def truth(self, instruction: str) -> str:
        name = self.emit(instruction)
        self.booleans.add(name)
        return name

    def sum(self, terms: Sequence[tuple[float, str]], flags: str = "") -> str:
        """w1 x1 + w2 x2 ..., added from the left."""
        total = None
        for weight, value in terms:
            part = self.operation("*", (number(weight), value), flags)
            total = part if total is None else self.operation("+", (total, part), flags)
        assert total is not None
        return total

    def total(self, values: Sequence[str]) -> str:
        """Sum in pairs, which has a shorter dependency chain than one after the other."""
        while len(values) > 1:
            pairs = [self.operation("+", pair, FUSED) for pair in zip(values[::2], values[1::2], strict=False)]
            values = [*pairs, *values[len(values) // 2 * 2 :]]
        return values[0]

    def text(self, result: str = "0.0") -> str:
        return self.head + "{\n" + "\n".join([*self.lines, f"  ret double {self.as_double(result)}"]) + "\n}\n\n"


def exp_text(pair: bool) -> str:
    """e^x for a number or a pair: within 2 units in the last place, exactly 1 at 0; 0 or infinite from |x| = 700 on.

    A call of the library's exp makes the compiler save all registers around it. This function is inlined, which makes
    an engine with friction 1.7 times as fast. x = m ln 2 + r with |r| < 0.35. Adding 1.5 * 2^52 rounds to the integer
    m and leaves it in the last bits, from where it is shifted into the exponent. ln 2 is split so that m times its
    first part is exact. e^r is its Taylor series.
    """
    d, i, truth, suffix = ("<2 x double>", "<2 x i64>", "<2 x i1>", "v2f64") if pair else ("double", "i64", "i1", "f64")

    def constant(value: float | int) -> str:
        text = str(value) if isinstance(value, int) else number(value)
        kind = "i64" if isinstance(value, int) else "double"
        return f"<{kind} {text}, {kind} {text}>" if pair else text

    lines: list[str] = []

    def set_to(name: str, op: str, left: str | float, right: str | float) -> str:
        left, right = (value if isinstance(value, str) else constant(value) for value in (left, right))
        lines.append(f"%{name} = {_ARITHMETIC[op]} {FUSED}{d} {left}, {right}")
        return f"%{name}"

    def add_product(name: str, first: str | float, left: str, right: str | float) -> str:
        return set_to(name, "+", first, set_to(f"{name}_product", "*", left, right))

    large = 6755399441055744.0
    rounded = add_product("rounded", large, "%x", 1.4426950408889634)
    whole = set_to("whole", "-", rounded, large)
    r = set_to("r_high", "-", "%x", set_to("high", "*", whole, 0.693147180369123816490))
    r = set_to("r", "-", r, set_to("low", "*", whole, 1.90821492927058770002e-10))
    r2 = set_to("r2", "*", r, r)
    r4 = set_to("r4", "*", r2, r2)
    # Pairs of terms of the series, r^n / n! + r^(n + 1) / (n + 1)!, without their common r^n.
    terms = [set_to("terms_0", "+", 1.0, r)]
    for n in range(2, 13, 2):
        terms.append(add_product(f"terms_{n}", 1 / factorial(n), r, 1 / factorial(n + 1)))
    first = add_product("first", terms[0], r2, terms[1])
    first = add_product("first_8", first, r4, add_product("second", terms[2], r2, terms[3]))
    last = add_product("last", add_product("third", terms[4], r2, terms[5]), r4, terms[6])
    series = add_product("sum", first, set_to("r8", "*", r4, r4), last)
    lines += [
        f"%bits = bitcast {d} {rounded} to {i}",
        f"%biased = add {i} %bits, {constant(1023)}",
        f"%exponent = shl {i} %biased, {constant(52)}",
        f"%power = bitcast {i} %exponent to {d}",
        f"%value = fmul {d} {series}, %power",
        f"%size = call {d} @llvm.fabs.{suffix}({d} %x)",
        f"%near = fcmp olt {d} %size, {constant(700.0)}",
        f"%negative = fcmp olt {d} %x, {constant(0.0)}",
        f"%over = fadd {d} %x, {constant(float('inf'))}",
        f"%beyond = select {truth} %negative, {d} {constant(0.0)}, {d} %over",
        f"%result = select {truth} %near, {d} %value, {d} %beyond",
        f"ret {d} %result",
    ]
    body = "".join(f"  {line}\n" for line in lines)
    return f"define internal {d} @exp_of_{'two' if pair else 'one'}({d} %x) nounwind alwaysinline {{\n{body}}}\n\n"


#: Declarations and functions that the text of every structure needs.
SHARED_TEXT = DECLARATIONS + exp_text(pair=False) + exp_text(pair=True)
