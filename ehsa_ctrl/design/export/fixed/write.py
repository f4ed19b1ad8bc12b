"""A specialised program as C in fixed point: integers with a scale each, sums and products in words twice as long.

A number v is kept as the integer X = round(v 2^f). Products are exact in the wide word; sums have the finest scale that
their range allows; a result is rounded and saturated once, when it is stored. Divisions, roots, exp and sin are
functions of integers.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

from ....core.errors import InputError
from ..source import comment_lines
from .scale import FixedWord, Interval, Scales, bits_of, magnitude_of
from .term import BOOL, INT, REAL, Assignment, Branch, Place, ProgramTerm, Remark, Statement, table_index

#: Declaration of a local constant.
CONSTANT = re.compile(r" *(?:static )?const \w+ (\w+)(?:\[\])? = ")


class WideNumber(NamedTuple):
    """C of a number in the wide word: the value is code 2^-fraction. narrow: the same as a stored word, if it is one.
    exact: value of a constant."""

    code: str
    fraction: int
    interval: Interval
    narrow: str = ""
    exact: float | None = None


@dataclass(frozen=True)
class FixedWriter:
    """Writes a program with its scales."""

    scales: Scales
    word: FixedWord
    _tables: dict[tuple[int, ...], str] = field(default_factory=dict, repr=False, compare=False)

    def fraction(self, place: Place) -> int:
        """Binary places of a place's number."""
        return self.word.fraction(magnitude_of(self.scales.ranges[place]))

    def body(self) -> list[str]:
        """Lines of the function that computes the current."""
        program = self.scales.program
        count: dict[Place, ProgramTerm] = {}
        several: dict[Place, ProgramTerm] = {}
        for one in program.assignments():
            if one.place.local:
                (several if one.place in count else count)[one.place] = one.term
        lines = [
            f"{self._type(term)} {place.store} = {'false' if term.type == BOOL else '0'};"
            for place, term in several.items()
        ]
        lines += self._block(program.statements, frozenset(several), 0)
        lines.append(f"return {self._stored(self._real(program.current), self.current_fraction)};")
        tables = [
            f"static const {self.word.word} {name}[] = {{ {', '.join(map(str, entries))} }};"
            for entries, name in self._tables.items()
        ]
        return _without_unused([*tables, *lines])

    @property
    def current_fraction(self) -> int:
        """Binary places of the current."""
        return self.word.fraction(magnitude_of(self.scales.interval(self.scales.program.current)))

    # Statements

    def _type(self, term: ProgramTerm) -> str:
        return {REAL: self.word.word, INT: "int", BOOL: "bool"}[term.type]

    def _block(self, statements: list[Statement], declared: frozenset[Place], indent: int) -> list[str]:
        pad, lines = "    " * indent, []
        for one in statements:
            match one:
                case Remark(text=text):
                    lines += [pad + line for line in comment_lines(text)]
                case Assignment(place=place, term=term):
                    target = place.store if place.local else self._target(place, one.index)
                    value = self._value(term, place)
                    head = "" if not place.local or place in declared else f"const {self._type(term)} "
                    lines.append(f"{pad}{head}{target} = {value};")
                case Branch(test=test, yes=yes, no=no):
                    first, second = (self._block(each, declared, indent + 1) for each in (yes, no))
                    if not any(isinstance(each, Assignment | Branch) for each in yes):
                        lines += [f"{pad}if (!({self._truth(test)})) {{", *second, f"{pad}}}"]
                        continue
                    lines += [f"{pad}if ({self._truth(test)}) {{", *first]
                    if any(isinstance(each, Assignment | Branch) for each in no):
                        lines += [f"{pad}}} else {{", *second]
                    lines.append(f"{pad}}}")
        return lines

    def _value(self, term: ProgramTerm, place: Place) -> str:
        if term.type == BOOL:
            return self._truth(term)
        if term.type == INT:
            return self._whole(term)
        return self._stored(self._real(term), self.fraction(place))

    def _target(self, place: Place, index: ProgramTerm | None) -> str:
        if place.local:
            return place.store
        inner = str(place.index) if index is None else f"{place.index} + {self._whole(index)}"
        return f"{place.store}[{inner}]"

    # Truth values and indices

    def _truth(self, term: ProgramTerm) -> str:
        match term.operation:
            case "constant":
                return "true" if term.value else "false"
            case "read":
                assert term.place is not None
                return term.place.store
            case "not":
                return f"!({self._truth(term.arguments[0])})"
            case "and" | "or":
                sign = "&&" if term.operation == "and" else "||"
                return f" {sign} ".join(f"({self._truth(each)})" for each in term.arguments)
            case "valid":
                assert term.place is not None
                return f"{self._target(term.place, None)} != EHSA_LOST"
            case "choice":
                test, yes, no = map(self._truth, term.arguments)
                return f"({test}) ? ({yes}) : ({no})"
        a, b = term.arguments
        if a.type != REAL:
            made = (self._truth, self._truth) if a.type == BOOL else (self._whole, self._whole)
            return f"{made[0](a)} {term.operation} {made[1](b)}"
        first, second, _ = self._common(self._real(a), self._real(b))
        return f"{first} {term.operation} {second}"

    def _whole(self, term: ProgramTerm) -> str:
        match term.operation:
            case "constant":
                return str(int(term.value))
            case "read":
                assert term.place is not None
                return term.place.store
            case "table" if term.entries == tuple(range(len(term.entries))):
                return self._whole(term.arguments[0])
            case "whole":
                number = self._real(term.arguments[0])
                if number.fraction < 0:
                    return f"(int)({self._aligned(number, 0)})"
                return f"(int)({number.code} / {self._integer(2**number.fraction)})"
            case "choice":
                return (
                    f"({self._truth(term.arguments[0])} ? {self._whole(term.arguments[1])} : "
                    f"{self._whole(term.arguments[2])})"
                )
            case "+" | "-" | "*":
                return f"({self._whole(term.arguments[0])} {term.operation} {self._whole(term.arguments[1])})"
        raise InputError(f"`{term.operation}` of indices can't be written in fixed point; expected +, - and *")

    # Numbers

    def _integer(self, value: int) -> str:
        """A constant of the wide type."""
        return f"{self.word.literal}({value})"

    def _real(self, term: ProgramTerm) -> WideNumber:
        """A number in the wide word."""
        interval = self.scales.interval(term)
        match term.operation:
            case "constant":
                return self._constant(float(term.value))
            case "read":
                assert term.place is not None
                name = self._target(term.place, term.arguments[0] if term.arguments else None)
                return WideNumber(f"({self.word.wide}){name}", self.fraction(term.place), interval, name)
            case "table":
                return self._table(term, interval)
            case "real":
                return WideNumber(f"({self.word.wide})({self._whole(term.arguments[0])})", 0, interval)
            case "+" | "-":
                return self._sum(term, interval)
            case "*":
                return self._product(self._real(term.arguments[0]), self._real(term.arguments[1]), interval)
            case "/":
                return self._quotient(term.arguments[0], term.arguments[1], interval)
            case "%":
                a, b, fraction = self._common(*map(self._real, term.arguments))
                return WideNumber(f"remainder_of({a}, {b})", fraction, interval)
            case "negative":
                inner = self._real(term.arguments[0])
                return WideNumber(f"-({inner.code})", inner.fraction, interval)
            case "absolute":
                inner = self._real(term.arguments[0])
                return WideNumber(f"magnitude({inner.code})", inner.fraction, interval)
            case "smaller" | "larger":
                a, b, fraction = self._common(*map(self._real, term.arguments))
                return WideNumber(f"{term.operation}({a}, {b})", fraction, interval)
            case "choice":
                a, b, fraction = self._common(*map(self._real, term.arguments[1:]))
                return WideNumber(f"({self._truth(term.arguments[0])} ? {a} : {b})", fraction, interval)
            case "sqrt":
                inner = self._real(term.arguments[0])
                fraction = (self.word.room - bits_of(magnitude_of(inner.interval))) // 2 * 2
                return WideNumber(f"root({self._aligned(inner, fraction)})", fraction // 2, interval)
            case "exp":
                return self._exponential(self._real(term.arguments[0]))
            case "sin":
                inner = self._product(self._real(term.arguments[0]), self._constant(0.5 / math.pi), None)
                return WideNumber(
                    f"({self.word.wide})sine({self._aligned(inner, self.word.bits - 2)})", self.word.bits - 2, interval
                )
        raise InputError(f"`{term.operation}` can't be written in fixed point")

    def _constant(self, value: float) -> WideNumber:
        """A constant with all bits of a word."""
        fraction = self.word.fraction(abs(value)) if value else 0
        integer = round(math.ldexp(value, fraction))
        if abs(integer) > self.word.largest:
            fraction -= 1
            integer = round(math.ldexp(value, fraction))
        narrow = f"({integer})" if integer < 0 else str(integer)
        return WideNumber(self._integer(integer), fraction, (value, value), narrow, value)

    def _table(self, term: ProgramTerm, interval: Interval) -> WideNumber:
        """An entry of a table of constants, all with the scale of the largest."""
        fraction, most = self.word.fraction(magnitude_of(interval)), self.word.largest
        entries = tuple(max(min(round(math.ldexp(each, fraction)), most), -most) for each in term.entries)
        name = self._tables.setdefault(entries, f"table_{len(self._tables) + 1}")
        entry = f"{name}[{table_index([self._whole(each) for each in term.arguments], term.shape)}]"
        return WideNumber(f"({self.word.wide}){entry}", fraction, interval, entry)

    def _aligned(self, number: WideNumber, fraction: int) -> str:
        """C of a number with other binary places; the caller makes sure that it fits."""
        if number.exact is not None:
            return self._integer(round(math.ldexp(number.exact, fraction)))
        shift = fraction - number.fraction
        if shift == 0:
            return number.code
        if shift > 0:
            return f"({number.code}) * {self._integer(2**shift)}"
        if -shift >= 2 * self.word.bits - 1:
            return self._integer(0)
        return f"rounded({number.code}, {-shift})"

    def _fitting(self, fraction: int, *intervals: Interval) -> int:
        """The binary places, or fewer, with which these ranges fit the wide word."""
        return min(fraction, *(self.word.room - bits_of(magnitude_of(each)) for each in intervals))

    def _common(self, a: WideNumber, b: WideNumber, *, result: Interval = (0.0, 0.0)) -> tuple[str, str, int]:
        """Both numbers with the same binary places, with which the range of a result fits too."""
        known = [each.fraction for each in (a, b) if each.exact is None] or [a.fraction, b.fraction]
        fraction = self._fitting(max(known), a.interval, b.interval, result)
        return self._aligned(a, fraction), self._aligned(b, fraction), fraction

    def _sum(self, term: ProgramTerm, interval: Interval) -> WideNumber:
        first, second, fraction = self._common(*map(self._real, term.arguments), result=interval)
        if term.operation == "-":
            second = f"({second})"
        return WideNumber(f"({first} {term.operation} {second})", fraction, interval)

    def _narrowed(self, number: WideNumber) -> tuple[str, int]:
        """A number as a stored word, and its binary places."""
        if number.narrow:
            return number.narrow, number.fraction
        fraction = self.word.fraction(magnitude_of(number.interval))
        return self._stored(number, fraction), fraction

    def _product(self, a: WideNumber, b: WideNumber, interval: Interval | None) -> WideNumber:
        (first, f_a), (second, f_b) = self._narrowed(a), self._narrowed(b)
        if interval is None:
            products = [x * y for x in a.interval for y in b.interval]
            interval = (min(products), max(products))
        return WideNumber(f"({self.word.wide}){first} * {second}", f_a + f_b, interval)

    def _quotient(self, dividend: ProgramTerm, divisor: ProgramTerm, interval: Interval) -> WideNumber:
        if divisor.operation == "constant":
            return self._product(self._real(dividend), self._constant(1.0 / divisor.value), interval)
        (first, f_a), (second, f_b) = self._narrowed(self._real(dividend)), self._narrowed(self._real(divisor))
        fraction = f_a + self.word.bits - 1 - f_b
        most = math.ldexp(1.0, self.word.room - fraction - 1)
        interval = (max(interval[0], -most), min(interval[1], most))
        return WideNumber(f"quotient({first}, {second})", fraction, interval)

    def _exponential(self, number: WideNumber) -> WideNumber:
        if number.interval[1] > 0.0:
            raise InputError("exp of a number above 0 can't be written in fixed point; --number float has it")
        power = self._product(number, self._constant(1.0 / math.log(2.0)), None)
        fraction = self._fitting(self.word.bits - 2, power.interval)
        return WideNumber(
            f"({self.word.wide})power_of_two({self._aligned(power, fraction)}, {fraction})",
            self.word.bits - 2,
            (0.0, 1.0),
        )

    def _stored(self, number: WideNumber, fraction: int) -> str:
        """A number as a stored word with these binary places, rounded and saturated."""
        if number.exact is not None:
            integer = round(math.ldexp(number.exact, fraction))
            return str(max(min(integer, self.word.largest), -self.word.largest))
        if number.narrow and number.fraction == fraction:
            return number.narrow
        if fraction > number.fraction:
            shift = fraction - number.fraction
            return f"raised({number.code}, {min(shift, self.word.room)})"
        return f"saturated({self._aligned(number, fraction)})"


def _without_unused(lines: list[str]) -> list[str]:
    """Lines without constants that nothing reads: a term may vanish because it is below the last bit of a sum."""
    while True:
        counts = Counter(word for line in lines for word in re.findall(r"\w+", line))
        kept = [line for line in lines if not (found := CONSTANT.match(line)) or counts[found[1]] > 1]
        if len(kept) == len(lines):
            return lines
        lines = kept
