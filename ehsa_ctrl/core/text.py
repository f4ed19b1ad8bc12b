"""Join words, and shorten file names to unique ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path


def join_words(items: Iterable[str]) -> str:
    """Items separated by commas, with "and" before the last; empty for none."""
    words = list(items)
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def stems(name: str, count: int) -> list[str]:
    """Stems of the files of several logs: name, name-2, name-3."""
    return [name if number == 1 else f"{name}-{number}" for number in range(1, count + 1)]


def unique_names(files: Sequence[str | Path]) -> list[str]:
    """The name of each file, with as many parent folders as distinguish it from the others: a/log.csv, b/log.csv."""
    paths = [Path.cwd() / file for file in files]

    def ending(path: Path, count: int) -> str:
        return "/".join(path.parts[-count:])

    def shortest(path: Path) -> str:
        others = set(paths) - {path}
        endings = ((n, ending(path, n)) for n in range(1, len(path.parts)))
        return next((name for n, name in endings if name not in {ending(o, n) for o in others}), str(path))

    return [shortest(path) for path in paths]


def folder_names(files: Sequence[str | Path]) -> list[str]:
    """A folder name for the results of each file: its name, without the suffix if the names still differ."""
    bare = [(Path.cwd() / file).with_suffix("") for file in files]
    return unique_names(bare if len(set(bare)) == len(bare) else files)
