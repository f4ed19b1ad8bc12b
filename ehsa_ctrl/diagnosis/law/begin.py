"""What a law remembers where a simulation begins in the middle of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core.expression import Expression
from ...physics.effects import LawFile
from ..records import Record, Segment
from .grammar import Grammar
from .memory import Memory


def courses(
    file: LawFile,
    values: Mapping[str, float],
    known: Mapping[str, np.ndarray],
    sample_time: float,
    begins: Sequence[int] = (0,),
) -> dict[str, np.ndarray]:
    """State of a law -> (N - 1,) along logs. values: of its parameters. known: name in the equations -> (N - 1,)."""
    found: dict[str, np.ndarray] = {}
    for name, state in file.states.items():
        linked = [other for other in file.states if other in Expression.parse(state.rate).names]
        group = list(dict.fromkeys([name, *linked])) if name not in found else []
        if group:
            rates = {one: file.states[one].rate for one in group}
            memory = Memory(rates, dict.fromkeys(group, "1"), dict.fromkeys(group, 1.0))
            found |= memory.course(known, values, sample_time, begins)
    return found


@dataclass(frozen=True)
class Begin:
    """The states of a law along the logs from which it was found.

    starts: time of the first sample of each log [s]. states: of each log, state -> (N - 1,).
    """

    starts: tuple[float, ...] = ()
    states: tuple[Mapping[str, np.ndarray], ...] = ()

    @classmethod
    def of(cls, file: LawFile, grammar: Grammar) -> Begin:
        """By the rates of a definition along the measured signals."""
        if not file.states:
            return cls()
        values = {name: one.value for name, one in file.parameters.items()}
        found = courses(file, values, grammar.in_motion, grammar.sample_time, grammar.begins)
        # Where a law is in two balances the logs come twice; the states are those of the first time.
        edges = (*grammar.begins, None)[: len(grammar.starts) + 1]
        parts = [slice(a, b) for a, b in pairwise(edges)]
        return cls(grammar.starts, tuple({name: y[part] for name, y in found.items()} for part in parts))

    def on(self, segment: Segment) -> Segment:
        """The segment with these states where a record begins in the middle of its log.

        A second log for validation has no course: its records are whole.
        """
        if len(segment.records) != len(self.starts):
            return segment
        pairs = zip(segment.records, self.starts, self.states, strict=True)
        return replace(segment, records=tuple(_begun(*pair) for pair in pairs))

    def on_windows(self, by_log: Sequence[Segment]) -> tuple[Segment, ...] | None:
        """The windows of each log with these states; None for those of a second log for validation."""
        if not self.starts:
            return tuple(by_log)
        if len(by_log) != len(self.starts):
            return None
        of_log = zip(by_log, self.starts, self.states, strict=True)
        return tuple(
            replace(one, records=tuple(_begun(record, start, states) for record in one.records))
            for one, start, states in of_log
        )


def _begun(record: Record, start: float, states: Mapping[str, np.ndarray]) -> Record:
    model = record.model
    if model.start is None:
        return record
    at = int(round((model.log.time[0] - start) / model.log.sample_time))
    own = {name: float(y[min(max(at, 0), y.size - 1)]) for name, y in states.items()}
    return replace(record, model=replace(model, start={**model.start, **own}))
