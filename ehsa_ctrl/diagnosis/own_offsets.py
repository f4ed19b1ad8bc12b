"""Offsets that differ between logs of one rig: a sensor's zero or that of the current may drift from day to day.

Such a number has the name NAME@LOG and acts in that log alone. Everything else is shared by all logs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..physics.effects import CandidateEffect

#: Between the name of a number and the log in which it acts.
IN_LOG = "@"


def shared_name(name: str) -> str:
    """The name without the log."""
    return name.partition(IN_LOG)[0]


def log_of(name: str) -> str:
    """The log in which a number acts; empty for all of them."""
    return name.partition(IN_LOG)[2]


def values_in_log(values: Mapping[str, float], log: str) -> Mapping[str, float]:
    """The values that act in a log, by their names without the log."""
    if not any(IN_LOG in name for name in values):
        return values
    return {shared_name(name): value for name, value in values.items() if log_of(name) in ("", log)}


def with_own_offsets(candidates: Sequence[CandidateEffect], logs: Sequence[str]) -> tuple[CandidateEffect, ...]:
    """The candidates, and those whose effect drifts once more with a number for each log."""
    found = list(candidates)
    for candidate in candidates:
        if candidate.effect.drifts and len(logs) > 1:
            own = tuple(replace(n, name=f"{n.name}{IN_LOG}{log}") for n in candidate.free for log in logs)
            found.append(replace(candidate, free=own, starts=(tuple(n.nominal for n in own),)))
    return tuple(found)
