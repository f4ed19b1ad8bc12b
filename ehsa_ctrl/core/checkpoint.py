"""Checkpoints: results of a long computation in a file, one line each, so that an interrupted one can continue."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from .errors import InputError
from .files import parse_json, write_text

T = TypeVar("T")


@dataclass
class Checkpoint(Generic[T]):
    """An open checkpoint file. path: None writes nothing. results: those of earlier runs."""

    path: Path | None
    results: list[T] = field(default_factory=list)
    _head: str = ""

    def append(self, lines: Iterable[str]) -> None:
        """Add results, one line each. Raises InputError for a file that can't be written; its content is kept."""
        text = "".join(line + "\n" for line in lines)
        if self.path is None or not text:
            return
        if self._head:
            write_text(self.path, self._head + text)
            self._head = ""
            return
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise InputError(
                f"{self.path}: can't be written ({error.strerror}); what was done is kept, and the same call goes on "
                "from there"
            ) from None


def open_checkpoint(
    path: Path | None,
    key: str,
    mark: Any,
    parse: Callable[[str], T],
    *,
    anew: bool,
    none: str,
    other: str,
    wrong: str,
) -> Checkpoint[T]:
    """Continue a checkpoint file, or begin it with the first results; its first line is {key: mark}.

    A last line that an interrupt cut off is removed.

    Parameters
    ----------
    mark: identifies the computation; only results with the same mark share a file.
    parse: from a line to a result; raises ValueError, LookupError, TypeError or ArithmeticError for an invalid line.
    anew: begin again; a file of this kind is replaced with the first result, any other file never.
    none, other, wrong: end of the message for a file that is no checkpoint, for one with another mark, and for an
        invalid line.

    Raises InputError with one of these messages, or for a file that can't be read or written.
    """
    begun = json.dumps({key: mark}) + "\n"
    if path is None or not path.exists():
        return Checkpoint(path, [], begun)
    try:
        head, *lines = path.read_text(encoding="utf-8").split("\n")
        found = parse_json(head)[key]
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    except (ValueError, LookupError, TypeError, ArithmeticError):
        raise InputError(f"{path}: {none}") from None
    if anew:
        return Checkpoint(path, [], begun)
    if found != mark:
        raise InputError(f"{path}: {other}")
    results, whole = [], [head]
    for number, line in enumerate(lines, 2):
        if not line:
            continue
        try:
            results.append(parse(line))
        except (ValueError, LookupError, TypeError, ArithmeticError):
            if number <= len(lines):
                raise InputError(f"{path}: line {number} {wrong}; mend or delete it") from None
            continue
        whole.append(line)
    if [*whole, ""] != [head, *lines]:
        write_text(path, "\n".join(whole) + "\n")
    return Checkpoint(path, results)
