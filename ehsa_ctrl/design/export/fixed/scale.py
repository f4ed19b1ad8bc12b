"""Scales of a specialised program's numbers: a power of two for each, from the range that was seen and a margin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from .ranges import SeenRanges
from .term import INT, REAL, Place, ProgramTerm, SpecialisedProgram

#: Of a range that was seen, to what the scale allows; the step to the next power of two comes on top.
MARGIN = 2.0
#: Range of a number that stayed 0 in all runs.
UNSEEN = 1.0
#: Passes over a program in which sure ranges spread through its memory.
SWEEPS = 3


@dataclass(frozen=True)
class FixedWord:
    """A word of fixed-point code.

    Attributes
    ----------
    bits: of a stored number. word, wide: types in C of a number and of sums and products. literal: macro for constants
    of the wide type.
    """

    bits: int
    word: str
    wide: str
    literal: str

    @property
    def largest(self) -> int:
        """Largest stored magnitude; the smallest number of the type means a lost reading."""
        return int(2 ** (self.bits - 1) - 1)

    @property
    def room(self) -> int:
        """Bits that a sum may have."""
        return 2 * self.bits - 2

    def fraction(self, magnitude: float) -> int:
        """Binary places f for numbers up to a magnitude: they are kept as integers X with the value X 2^-f."""
        return self.bits - 1 - bits_of(magnitude)


Q31 = FixedWord(32, "int32_t", "int64_t", "INT64_C")
Q15 = FixedWord(16, "int16_t", "int32_t", "INT32_C")


def bits_of(magnitude: float) -> int:
    """The smallest b with magnitude < 2^b."""
    return math.frexp(magnitude)[1] if magnitude > 0.0 else -1000


Interval = tuple[float, float]


def magnitude_of(interval: Interval) -> float:
    return max(abs(interval[0]), abs(interval[1]))


@dataclass(frozen=True)
class Scales:
    """Ranges of all places of a program, from what was seen in runs."""

    program: SpecialisedProgram
    seen: SeenRanges

    @cached_property
    def ranges(self) -> dict[Place, Interval]:
        """Place -> range. Inputs and memory: MARGIN times the largest magnitude seen. Local variables: what interval
        arithmetic makes of these, at most MARGIN times what was seen; beyond, numbers saturate."""
        found: dict[Place, Interval] = {}
        for store, inputs in (("reference", self.seen.reference), ("measured", self.seen.measured)):
            for i, magnitude in enumerate(inputs.tolist()):
                found[Place(store, i)] = _seen_interval(magnitude)
        sure = self._sure(found)
        parts = self.program.moving_parts(self.seen.memory.size)
        for i, magnitude in enumerate(self.seen.memory.tolist()):
            place = Place("memory", i)
            found[place] = _seen_interval(max(magnitude, self.seen.largest.get(place, 0.0)))
            if place in sure:
                found[place] = _union(found[place], sure[place])
        for start, end in parts.items():
            whole = max((found[Place("memory", i)] for i in range(start, end)), key=magnitude_of)
            whole = max(
                whole, _seen_interval(self.seen.largest.get(Place("memory", start, True), 0.0)), key=magnitude_of
            )
            for i in range(start, end):
                found[Place("memory", i)] = whole
            found[Place("memory", start, True)] = whole
        several: dict[Place, int] = {}
        for one in self.program.assignments():
            if not one.place.local:
                continue
            low, high = self._interval(one.term, found)
            largest = self.seen.largest.get(one.place, 0.0)
            if largest > 0.0 and one.place not in sure:
                low, high = max(low, -MARGIN * largest), min(high, MARGIN * largest)
            several[one.place] = several.get(one.place, 0) + 1
            if several[one.place] > 1:
                low, high = _union((low, high), found[one.place])
            found[one.place] = (low, high)
        return found

    def _sure(self, inputs: dict[Place, Interval]) -> dict[Place, Interval]:
        """Place -> range that holds whatever the inputs are, such as that of the row of a schedule, which the runs need
        not have reached."""
        made = list(self.program.assignments())
        everything: Interval = (-math.inf, math.inf)
        ranges = dict.fromkeys(inputs, everything)
        initial = {Place("memory", i): (-m, m) for i, m in enumerate(self.seen.memory.tolist())}
        ranges |= dict.fromkeys([*initial, *(one.place for one in made)], everything)
        parts = self.program.moving_parts(self.seen.memory.size)
        for _ in range(SWEEPS):
            known = dict(initial)
            for one in made:
                new = self._interval(one.term, ranges)
                known[one.place] = _union(known[one.place], new) if one.place in known else new
                if one.place.local:
                    ranges[one.place] = known[one.place]
            # What is addressed at run time may be any of the memory from there on.
            fixed = [one.place for one in made if one.place.store == "memory" and not parts]
            ranges |= {place: known[place] for place in fixed}
        return {one.place: limits for one in made if math.isfinite(magnitude_of(limits := ranges[one.place]))}

    def interval(self, term: ProgramTerm) -> Interval:
        """Least and largest value of a term."""
        return self._interval(term, self.ranges)

    def _interval(self, term: ProgramTerm, ranges: dict[Place, Interval]) -> Interval:
        given = [self._interval(each, ranges) for each in term.arguments if each.type in (REAL, INT)]
        match term.operation:
            case "constant":
                return (float(term.value), float(term.value))
            case "read":
                assert term.place is not None
                return ranges[term.place]
            case "table":
                return (min(term.entries), max(term.entries))
            case "+":
                return (given[0][0] + given[1][0], given[0][1] + given[1][1])
            case "-":
                return (given[0][0] - given[1][1], given[0][1] - given[1][0])
            case "*":
                # 0 times an unknown number is 0.
                products = [a * b if a and b else 0.0 for a in given[0] for b in given[1]]
                return (min(products), max(products))
            case "/":
                if given[1][0] <= 0.0 <= given[1][1]:
                    return (-math.inf, math.inf)
                quotients = [0.0 if math.isinf(b) else a / b for a in given[0] for b in given[1]]
                return (min(quotients), max(quotients))
            case "%":
                most = magnitude_of(given[1])
                return (-most, most)
            case "negative":
                return (-given[0][1], -given[0][0])
            case "absolute":
                least = 0.0 if given[0][0] <= 0.0 <= given[0][1] else min(map(abs, given[0]))
                return (least, magnitude_of(given[0]))
            case "smaller":
                return (min(given[0][0], given[1][0]), min(given[0][1], given[1][1]))
            case "larger":
                return (max(given[0][0], given[1][0]), max(given[0][1], given[1][1]))
            case "choice":
                return (min(given[0][0], given[1][0]), max(given[0][1], given[1][1]))
            case "sqrt":
                return (math.sqrt(max(given[0][0], 0.0)), math.sqrt(max(given[0][1], 0.0)))
            case "exp":
                return (0.0, math.exp(given[0][1]) if given[0][1] <= 700.0 else math.inf)
            case "sin":
                return (-1.0, 1.0)
            case "whole" | "real":
                return given[0]
        return (0.0, 1.0)  # a truth value


def _union(a: Interval, b: Interval) -> Interval:
    return (min(a[0], b[0]), max(a[1], b[1]))


def _seen_interval(magnitude: float) -> Interval:
    most = MARGIN * magnitude if magnitude > 0.0 else UNSEEN
    return (-most, most)
