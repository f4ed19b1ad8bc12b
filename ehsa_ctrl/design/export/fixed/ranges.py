"""Ranges of a specialised program's numbers, seen while it runs in doubles over recorded readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...controller import SampledController
from .term import Assignment, Branch, Place, ProgramTerm, Remark, SpecialisedProgram, Statement, table_index

#: Operations that Python writes between their operands.
BETWEEN = {"+", "-", "*", "/", "%", "==", "!=", "<", "<=", ">", ">=", "and", "or"}
CALLED = {
    "absolute": "abs", "smaller": "min", "larger": "max", "sqrt": "sqrt", "exp": "exp", "sin": "sin", "whole": "int",
    "real": "float", "not": "not ", "negative": "-",
}  # fmt: skip
NAMES = {name: getattr(math, name) for name in ("sqrt", "exp", "sin", "isfinite", "inf")}
#: Samples whose numbers are kept until their extremes are taken.
CHUNK = 500


@dataclass(frozen=True)
class SeenRanges:
    """Largest magnitudes seen.

    Attributes
    ----------
    largest: place -> largest magnitude; a moving part of the memory has one place.
    reference (3 or 4), measured (5), memory (m,): largest magnitudes by index; memory after the samples.
    """

    largest: dict[Place, float]
    reference: np.ndarray
    measured: np.ndarray
    memory: np.ndarray


def replay_specialised(
    program: SpecialisedProgram, controller: SampledController, runs: Iterable[tuple[np.ndarray, np.ndarray]]
) -> tuple[SeenRanges, list[np.ndarray]]:
    """Run a specialised program in doubles over runs, each from the initial memory.

    runs: reference (N, 3 or 4) and readings (N, 5), nan for a lost one.

    Returns what was seen, and the currents (N,) of each run.
    """
    made = list(program.assignments())
    sample = _compiled(program)
    largest = np.zeros(len(made))
    memory_seen = np.abs(controller.initial_memory())
    inputs = [np.zeros(4 if controller.follows_force else 3), np.zeros(5)]
    currents = []
    for reference, measured in runs:
        memory = controller.initial_memory().tolist()
        kept: list[list[float]] = []
        found = np.empty(len(reference))
        for seen, table in zip(inputs, (reference, measured), strict=True):
            with np.errstate(invalid="ignore"):
                np.maximum(seen, np.nanmax(np.abs(np.nan_to_num(table)), axis=0), out=seen)
        for k, (r, y) in enumerate(zip(reference.tolist(), measured.tolist(), strict=True)):
            record = [0.0] * len(made)
            found[k] = sample(r, y, memory, record)
            kept.append(record)
            np.maximum(memory_seen, np.abs(memory), out=memory_seen)
            if len(kept) == CHUNK or k == len(reference) - 1:
                np.maximum(largest, np.max(np.abs(np.array(kept)), axis=0), out=largest)
                kept = []
        currents.append(found)
    by_place: dict[Place, float] = {}
    for one, magnitude in zip(made, largest.tolist(), strict=True):
        by_place[one.place] = max(by_place.get(one.place, 0.0), magnitude)
    return SeenRanges(by_place, inputs[0], inputs[1], memory_seen), currents


def _compiled(program: SpecialisedProgram) -> Callable[..., float]:
    """sample(reference, measured, memory, record): the program as a Python function on lists."""
    numbers = iter(range(10**9))
    lines = ["def sample(reference, measured, memory, record):"]
    lines += _lines(program.statements, 1, numbers)
    lines.append(f"    return {_python(program.current)}")
    names: dict[str, Any] = dict(NAMES)
    exec(compile("\n".join(lines), "<specialised>", "exec"), names)
    sample: Callable[..., float] = names["sample"]
    return sample


def _lines(statements: list[Statement], indent: int, numbers: Any) -> list[str]:
    pad, lines = "    " * indent, []
    for one in statements:
        match one:
            case Remark():
                continue
            case Assignment(place=place, term=term, index=index):
                lines.append(f"{pad}record[{next(numbers)}] = {_target(place, index)} = {_python(term)}")
            case Branch():
                lines.append(f"{pad}if {_python(one.test)}:")
                lines += _lines(one.yes, indent + 1, numbers) or [f"{pad}    pass"]
                lines.append(f"{pad}else:")
                lines += _lines(one.no, indent + 1, numbers) or [f"{pad}    pass"]
    return lines


def _target(place: Place, index: ProgramTerm | None) -> str:
    if place.local:
        return place.store
    return f"{place.store}[{place.index}]" if index is None else f"{place.store}[{place.index} + {_python(index)}]"


def _python(term: ProgramTerm) -> str:
    arguments = [_python(each) for each in term.arguments]
    match term.operation:
        case "constant":
            return repr(term.value)
        case "read":
            assert term.place is not None
            return _target(term.place, term.arguments[0] if term.arguments else None)
        case "valid":
            assert term.place is not None
            return f"isfinite({_target(term.place, None)})"
        case "table":
            return f"{term.entries!r}[{table_index(arguments, term.shape)}]"
        case "choice":
            return f"({arguments[1]} if {arguments[0]} else {arguments[2]})"
        case word if word in BETWEEN:
            return f"({f' {word} '.join(arguments)})"
    return f"({CALLED[term.operation]}({', '.join(arguments)}))"
