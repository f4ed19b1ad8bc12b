"""Words as a sentence has them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path


def listed(items: Iterable[str]) -> str:
    """One, two or more with commas and an "and" before the last; empty for none."""
    words = list(items)
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def told_apart(files: Sequence[str | Path]) -> list[str]:
    """Each file's name, with as many of its folders as tell it from the others: a/log.csv and b/log.csv."""
    paths = [Path.cwd() / file for file in files]
    others = [set(paths) - {path} for path in paths]

    def ending(path: Path, count: int) -> str:
        return "/".join(path.parts[-count:])

    def shortest(path: Path, among: set[Path]) -> str:
        lengths = range(1, len(path.parts))
        return next((e for n in lengths if (e := ending(path, n)) not in {ending(o, n) for o in among}), str(path))

    return [shortest(path, among) for path, among in zip(paths, others, strict=True)]


def folders_of(files: Sequence[str | Path]) -> list[str]:
    """A folder for the results of each file: its name without the ending, as far as that tells them apart."""
    bare = [(Path.cwd() / file).with_suffix("") for file in files]
    return told_apart(bare if len(set(bare)) == len(bare) else files)
