"""Control laws in words, in the unit of the plant's drive."""

from __future__ import annotations

from typing import Any

from .analysis.sampled import DRIVES


class WordsByUnit:
    """A law whose words depend on the unit of the drive; `str` takes A."""

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        raise NotImplementedError

    def __str__(self) -> str:
        return self.words("A")


def law_words(law: Any, unit: str) -> str:
    """A law in words, with the drive's unit where the law has units of the drive."""
    words = getattr(law, "words", None)
    return str(law) if words is None else str(words(unit))


def drive_limit(limit: float, unit: str, *, rate: bool = False) -> str:
    """A limit of the drive or of its rate in words: |current| <= 3 A, or |F_M rate| <= 100 N/s."""
    drive = next((name for name, own in DRIVES.items() if own == unit), "drive")
    return f"|{drive} rate| <= {limit:g} {unit}/s" if rate else f"|{drive}| <= {limit:g} {unit}"
