"""A controller in fixed point: its program, its scales, and the files."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ....core.controller_interface import MEASURED, REFERENCE
from ....core.errors import InputError
from ...controller import SampledController
from ...kinds._scheduled_mpc_law import ScheduledMpc
from ...state_space.mpc import Mpc
from .functions import used_functions
from .ranges import replay_specialised
from .scale import FixedWord, Scales
from .specialise import specialise
from .term import Assignment, Branch, Place, Statement
from .write import FixedWriter

UNITS = {
    "reference_position": "m", "reference_velocity": "m/s", "reference_acceleration": "m/s2", "reference_force": "N",
    "speed": "rad/s", "p1": "Pa", "p2": "Pa", "position": "m", "force": "N",
}  # fmt: skip
#: Operations by kind, as of a controller in doubles.
KINDS = {
    "+": "additions", "-": "additions", "negative": "additions", "*": "multiplications", "/": "divisions",
    "%": "divisions", "==": "comparisons", "!=": "comparisons", "<": "comparisons", "<=": "comparisons",
    ">": "comparisons", ">=": "comparisons", "smaller": "comparisons", "larger": "comparisons",
}  # fmt: skip


@dataclass(frozen=True)
class SignalScale:
    """Scale of a number: kept as the integer nearest to value 2^fraction.

    Attributes
    ----------
    name: of the signal. fraction: binary places. seen: largest magnitude in the runs, SI.
    """

    name: str
    fraction: int
    seen: float

    @property
    def step(self) -> float:
        """Value of the last bit."""
        return math.ldexp(1.0, -self.fraction)

    def headroom(self, bits: int) -> float:
        """Bits between the largest magnitude seen and that of a word; infinite for a signal that stayed 0."""
        return math.inf if self.seen == 0.0 else bits - 1 - math.log2(self.seen / self.step)


@dataclass(frozen=True)
class FixedCode:
    """A controller in fixed point.

    Attributes
    ----------
    controller: the controller. word: of its numbers. scales: ranges of its numbers.
    """

    controller: SampledController
    word: FixedWord
    scales: Scales

    @cached_property
    def writer(self) -> FixedWriter:
        return FixedWriter(self.scales, self.word)

    @cached_property
    def inputs(self) -> list[SignalScale]:
        """Scales of the reference and the readings."""
        seen = self.scales.seen
        references = [f"reference_{name}" for name in (*REFERENCE, "force")][: seen.reference.size]
        places = [("reference", i, value) for i, value in enumerate(seen.reference.tolist())]
        places += [("measured", i, value) for i, value in enumerate(seen.measured.tolist())]
        names = [*references, *MEASURED]
        return [
            SignalScale(name, self.writer.fraction(Place(store, i)), value)
            for name, (store, i, value) in zip(names, places, strict=True)
        ]

    @cached_property
    def current(self) -> SignalScale:
        return SignalScale("current", self.writer.current_fraction, self.controller.current_limit)

    @cached_property
    def memory(self) -> list[SignalScale]:
        """Scales of the memory, named by traces where it has one."""
        names = {index: name for name, index in self.controller.traces.items()}
        return [
            SignalScale(names.get(i, f"memory[{i}]"), self.writer.fraction(Place("memory", i)), value)
            for i, value in enumerate(self.scales.seen.memory.tolist())
        ]

    @cached_property
    def initial(self) -> list[tuple[int, int]]:
        """Index and integer of the memory's numbers that do not begin at 0."""
        values = enumerate(self.controller.initial_memory().tolist())
        return [(i, self._integer(value, self.memory[i].fraction)) for i, value in values if value != 0.0]

    def _integer(self, value: float, fraction: int) -> int:
        return max(min(round(math.ldexp(value, fraction)), self.word.largest), -self.word.largest)

    @cached_property
    def body(self) -> list[str]:
        """Lines of the step function."""
        return self.writer.body()

    @cached_property
    def functions(self) -> str:
        return used_functions("\n".join(self.body), self.word)

    def operations(self) -> dict[str, int]:
        """Integer operations on the longest way through the code, by kind and as `flops`, which omits comparisons;
        shifts are not counted."""
        counts = _longest(self.scales.program.statements)
        counts.update(dict.fromkeys(set(KINDS.values()) - set(counts), 0))
        return {"flops": sum(counts.values()) - counts["comparisons"], **counts}

    def encode(self, reference: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (N, k) as integers; the smallest number of the word for a lost reading."""
        kind = np.int32 if self.word.bits == 32 else np.int16
        tables = []
        split = [self.inputs[: reference.shape[1]], self.inputs[reference.shape[1] :]]
        for table, signals in zip((reference, measured), split, strict=True):
            scaled = np.rint(table * [2.0**signal.fraction for signal in signals])
            lost = np.isnan(scaled)
            integers = np.clip(np.where(lost, 0.0, scaled), -self.word.largest, self.word.largest).astype(kind)
            integers[lost] = -self.word.largest - 1
            tables.append(integers)
        return tables[0], tables[1]

    def context(self) -> dict[str, Any]:
        """What the templates need besides what all exports have."""
        return {
            "real": self.word.word,
            "zero": "0",
            "lost": f"INT{self.word.bits}_MIN",
            "bits": self.word.bits,
            "largest": self.word.largest,
            "signals": [(_title(signal.name), signal, UNITS[signal.name]) for signal in self.inputs],
            "current": self.current,
            "trace_scales": {name: self.memory[index] for name, index in self.controller.traces.items()},
            "initial": self.initial,
            "functions": self.functions,
            "body": self.body,
            "wide": self.word.wide,
            "scales": [*self.inputs, self.current, *(s for s in self.memory if not s.name.startswith("memory["))],
        }


def _title(name: str) -> str:
    return (name if name.startswith("reference_") else f"reading_{name}").upper()


def write_fixed(
    controller: SampledController, word: FixedWord, runs: Iterable[tuple[np.ndarray, np.ndarray]]
) -> FixedCode:
    """A controller in fixed point, with scales for the ranges that its numbers have in runs.

    runs: reference (N, 3 or 4), readings (N, 5) of each.

    Raises InputError for a law with a solver, and for code outside the subset.
    """
    if isinstance(controller.law, Mpc | ScheduledMpc):
        raise InputError(
            f"{controller.name} has a solver, for which there is no fixed-point code; expected --number double or float"
        )
    try:
        program = specialise(controller)
        seen, _ = replay_specialised(program, controller, runs)
        code = FixedCode(controller, word, Scales(program, seen))
        code.body  # noqa: B018 - an operation without fixed-point code is found here
    except InputError as error:
        raise InputError(f"{controller.name} in fixed point: {error}") from None
    return code


def _longest(statements: list[Statement]) -> dict[str, int]:
    """Operations by kind; of a branch the way with more of them."""
    counts: dict[str, int] = {}

    def add(more: dict[str, int]) -> None:
        for kind, number in more.items():
            counts[kind] = counts.get(kind, 0) + number

    for one in statements:
        outer = [one.term] if isinstance(one, Assignment) else [one.test] if isinstance(one, Branch) else []
        for term in (inner for each in outer for inner in each.inner()):
            if term.operation in KINDS:
                add({KINDS[term.operation]: 1})
        if isinstance(one, Branch):
            add(max((_longest(one.yes), _longest(one.no)), key=lambda each: sum(each.values())))
    return counts
