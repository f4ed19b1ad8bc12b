"""Checkpoints: a file with one line per result, from which an interrupted computation continues."""

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
    """An open checkpoint file. path: None to write nothing. results: those of earlier runs."""

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
                f"{self.path}: can't be written ({error.strerror}); finished results are kept, and the same command "
                "continues with the others"
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
    """Open a checkpoint file to continue it, or a new one that the first results create.

    The first line of the file is {key: mark}. A last line that an interrupt truncated is removed.

    Parameters
    ----------
    mark: identifies the computation; only results with the same mark share a file.
    parse: from a line to a result; raises ValueError, LookupError, TypeError or ArithmeticError for an invalid line.
    anew: start again; the first result replaces an earlier checkpoint, but never a file of another kind.
    none, other, wrong: end of the message for a file that is not a checkpoint, for one with another mark, and for an
        invalid line.

    Raises InputError with one of these messages, or for a file that can't be read or written.
    """
    first = json.dumps({key: mark}) + "\n"
    if path is None or not path.exists():
        return Checkpoint(path, [], first)
    found, head, lines = _read(path, key, none)
    if anew:
        return Checkpoint(path, [], first)
    if found != mark:
        raise InputError(f"{path}: {other}")
    results, whole = _parse(path, lines, parse, wrong)
    if [head, *whole, ""] != [head, *lines]:
        write_text(path, "\n".join([head, *whole]) + "\n")
    return Checkpoint(path, results)


def read_results(path: Path, key: str, parse: Callable[[str], T], *, none: str, wrong: str) -> list[T]:
    """The results in a checkpoint file, which stays as it is; arguments and errors as for `open_checkpoint`."""
    _, _, lines = _read(path, key, none)
    return _parse(path, lines, parse, wrong)[0]


def _read(path: Path, key: str, none: str) -> tuple[Any, str, list[str]]:
    """The mark of a checkpoint file, its first line and the others."""
    try:
        head, *lines = path.read_text(encoding="utf-8").split("\n")
        return parse_json(head)[key], head, lines
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    except (ValueError, LookupError, TypeError, ArithmeticError):
        raise InputError(f"{path}: {none}") from None


def _parse(path: Path, lines: list[str], parse: Callable[[str], T], wrong: str) -> tuple[list[T], list[str]]:
    """The results, and the lines that hold them; a last line that an interrupt truncated has none."""
    results, whole = [], []
    for number, line in enumerate(lines, 2):
        if not line:
            continue
        try:
            results.append(parse(line))
        except (ValueError, LookupError, TypeError, ArithmeticError):
            if number <= len(lines):
                raise InputError(f"{path}: line {number} {wrong}; correct or delete it") from None
            continue
        whole.append(line)
    return results, whole
