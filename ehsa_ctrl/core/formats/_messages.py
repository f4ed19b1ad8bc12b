"""Messages of a robot's log as tables: one table per topic, one column per number in its messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..table import FileTime, LogTable, table_of

#: Most numbers in a message that become columns. Engineering judgement: images and point clouds have more.
MOST = 200


class Message(NamedTuple):
    """One message: its topic, the time at which it was recorded [ns since 1970], and its decoded content."""

    topic: str
    recorded: int
    content: Any


def message_tables(path: Path, messages: Iterable[Message]) -> list[LogTable]:
    """A table per topic of numbers, with the stamps of the messages' headers, or else the times of recording.

    Columns are named by their path in the message, as in pose.position.x or position[0]; a topic of a single number
    gives it its own name.
    """
    topics: dict[str, list[tuple[int, dict[str, float]]]] = {}
    for topic, recorded, content in messages:
        numbers: dict[str, float] = {}
        _collect(content, "", numbers)
        topics.setdefault(topic, []).append((recorded, numbers))
    tables = []
    for topic, rows in topics.items():
        stamps = np.array([_stamp(numbers) for _, numbers in rows], dtype=np.int64)
        arrivals = np.array([at for at, _ in rows], dtype=np.int64)
        names = dict.fromkeys(name for _, numbers in rows for name in numbers if not name.startswith("header."))
        if not names or len(names) > MOST:
            continue
        columns = {name: np.array([numbers.get(name, np.nan) for _, numbers in rows]) for name in names}
        plain = topic.strip("/")
        if len(columns) == 1:
            columns = {plain: next(iter(columns.values()))}
        stamped = bool(np.all(stamps > 0))
        # A recorder may write messages out of order.
        order = np.argsort(stamps if stamped else arrivals, kind="stable")
        nanoseconds = (stamps if stamped else arrivals)[order]
        source = "header.stamp" if stamped else "the times of recording"
        time = FileTime((nanoseconds - nanoseconds[0]) * 1e-9, source, start=float(nanoseconds[0]) * 1e-9)
        tables.append(table_of(path, {k: v[order] for k, v in columns.items()}, group=plain, time=time))
    return tables


def _collect(content: Any, name: str, numbers: dict[str, float]) -> None:
    """Add the numbers in a message (an object, mapping, sequence or number) under their paths."""
    if len(numbers) > MOST:
        return
    if isinstance(content, bool | int | float | np.number | np.bool_):
        numbers[name] = float(content)
    elif isinstance(content, str | bytes) or content is None:
        return
    elif isinstance(content, Mapping):
        for key, value in content.items():
            _collect(value, f"{name}.{key}" if name else str(key), numbers)
    elif isinstance(content, np.ndarray | list | tuple):
        if len(content) <= MOST:
            for index, value in enumerate(content):
                _collect(value, f"{name}[{index}]", numbers)
    else:
        # Decoders give objects with slots or plain attributes.
        for key in getattr(content, "__slots__", None) or getattr(content, "__dict__", {}):
            if not key.startswith("__"):
                _collect(getattr(content, key), f"{name}.{key}" if name else key, numbers)


def _stamp(numbers: Mapping[str, float]) -> int:
    """The time of a message's header [ns since 1970], 0 without one."""
    below = numbers.get("header.stamp.nanosec", numbers.get("header.stamp.nsec", 0.0))
    return 1_000_000_000 * int(numbers.get("header.stamp.sec", 0.0)) + int(below)
