"""Results of long work kept in a file, a line each, so that what was interrupted goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from .errors import InputError

T = TypeVar("T")


def read_kept(
    path: Path, key: str, mark: str, parse: Callable[[str], T], *, none: str, other: str, wrong: str
) -> list[T]:
    """What a file holds; one that is not there is begun, its head {key: mark}.

    A last line that was cut off by an interrupt is dropped, from the file too: the next one must not be joined to it.

    Parameters
    ----------
    mark: what makes results comparable, so that they may stand in one file.
    parse: turns a line into a result; raises ValueError, KeyError or TypeError for one that is none.
    none, other, wrong: end of the sentence for a file that is no such file, for one with another mark, and for a line
        in the middle that is no result.

    Raises
    ------
    InputError: with one of these sentences.
    """
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({key: mark}) + "\n", encoding="utf-8")
        return []
    head, *lines = path.read_text(encoding="utf-8").split("\n")
    try:
        found = json.loads(head)[key]
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{path}: {none}") from None
    if found != mark:
        raise InputError(f"{path}: {other}")
    results, whole = [], [head]
    for number, line in enumerate(lines, 2):
        if not line:
            continue
        try:
            results.append(parse(line))
        except (ValueError, KeyError, TypeError):
            if number <= len(lines):
                raise InputError(f"{path}: line {number} {wrong}; mend or delete it") from None
            continue
        whole.append(line)
    path.write_text("\n".join(whole) + "\n", encoding="utf-8")
    return results


def append_kept(path: Path, lines: Iterable[str]) -> None:
    """Add results, a line each."""
    with path.open("a", encoding="utf-8") as file:
        file.writelines(line + "\n" for line in lines)
