"""Interleaved timing: every method runs in every round, in a new order, so that all see the same machine load."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from engine_cases import Array, Case, worst_error

Run = Callable[[], Array]


@dataclass
class Row:
    """A timed method. Peers run once per round on the beginning of the record, `slow` ones in the first rounds only."""

    label: str
    prepare: Callable[[Case], Run]
    slow: bool = False
    peer: bool = False
    short: bool = False
    shown: bool = True


@dataclass
class Timing:
    """CPU ms per simulated second of one row on one case, one list per round; or the reason of a failure."""

    duration: float
    rounds: list[list[float]] = field(default_factory=list)
    error: float = float("nan")
    failure: str = ""

    @property
    def best(self) -> Array:
        """The fastest call of every round, which other processes disturb least."""
        return np.array([min(calls) for calls in self.rounds])

    @property
    def median(self) -> float:
        return float(np.median([call for calls in self.rounds for call in calls])) if self.rounds else float("nan")

    @property
    def minimum(self) -> float:
        return float(self.best.min()) if self.rounds else float("nan")


def ratio(a: Timing, others: Sequence[Timing]) -> tuple[float, float, float]:
    """a over the fastest of the others, from the best calls of each round: median, and 5 and 95 % of the rounds."""
    n = min(len(timing.rounds) for timing in (a, *others))
    ratios = a.best[:n] / np.min([other.best[:n] for other in others], axis=0)
    low, median, high = np.quantile(ratios, [0.05, 0.5, 0.95])
    return float(median), float(low), float(high)


def measure(
    rows: Sequence[Row],
    cases: dict[str, Case],
    references: dict[str, Array],
    short: dict[str, float],
    rounds: int,
    slow_rounds: int,
    calls: int = 5,
    say: Callable[[str], None] = lambda text: None,
) -> dict[tuple[str, str], Timing]:
    """Time all rows on all cases; keys of the result are (label, case name).

    `short`: length [s] of the records for slow, peer and short rows.
    """
    runs: dict[tuple[str, str], Run] = {}
    result: dict[tuple[str, str], Timing] = {}
    for row in rows:
        for name, case in cases.items():
            record = case.first(short[name]) if row.slow or row.peer or row.short else case
            timing = result[row.label, name] = Timing(record.duration)
            say(f"first run of {row.label} on {name}")
            try:
                run = row.prepare(record)
                timing.error = worst_error(run(), references[name][: record.current.size])
            except (ImportError, RuntimeError, ArithmeticError, ValueError) as failure:  # shown in the table
                timing.failure = " ".join(str(failure).split())
                continue
            runs[row.label, name] = run
    order = [(row, name) for row in rows for name in cases if (row.label, name) in runs]
    shuffle = random.Random(0).shuffle
    for number in range(rounds):
        say(f"round {number + 1} of {rounds}")
        shuffle(order)
        # Case by case, so that compared methods run within a few milliseconds of each other.
        for row, name in sorted(order, key=lambda pair: (pair[0].slow or pair[0].peer, pair[1])):
            if row.slow and number >= slow_rounds:
                continue
            run, timing = runs[row.label, name], result[row.label, name]
            once = row.slow or row.peer
            if not once:
                run()  # warm up: caches hold the previous method's code
            times = []
            for _ in range(1 if once else calls):
                start = time.process_time_ns()
                run()
                times.append((time.process_time_ns() - start) * 1e-6 / timing.duration)
            timing.rounds.append(times)
    return result
