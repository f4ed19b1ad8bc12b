"""A result as a page shows it, whatever command it is from: sentences, figures, tables, and what it rests on."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pydantic

from ..number import NOTHING, number

#: How a number begins as pages write them, with or without a unit; nothing, a dash and "not defined" are none.
NUMBER = re.compile(r"\(?[-−]?(\d|∞)|–?$|not defined$")
#: Neither wrong nor quite right: one should look at it.
DOUBT: Literal["doubt"] = "doubt"
#: Of what one should look at, so much is said of a result among others.
LED = 3
#: A sentence, and whether all is well with it; None for one that says nothing of that.
Sentence = tuple[str, bool | Literal["doubt"] | None]
#: Marks and classes of colour, told apart without colour too: fine, failed, a warning.
LOOKS = {True: ("✓", "good"), False: ("✗", "bad"), DOUBT: ("△", "doubt"), None: ("–", "soft")}
#: The banner's class, by the state of what it is about.
BANNERS: dict[bool | str | None, str] = {True: "", False: " fail", DOUBT: " look", None: " plain"}
#: What a fit by its quality is.
FITS: dict[str, bool | Literal["doubt"]] = {"good": True, "fair": DOUBT, "poor": False}


def worst_of(sentences: Sequence[Sentence]) -> bool | Literal["doubt"] | None:
    """The worst state of these sentences: False, else "doubt", else True; None if none is judged."""
    states = {good for _, good in sentences}
    return next((state for state in (False, DOUBT, True) if state in states), None)


class Table(NamedTuple):
    """A table of words and numbers that are written already.

    A cell that begins with ✓ is shown as good, one that begins with ✗ as bad, with △ as something to look at.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def numbers(self) -> list[bool]:
        """Whether a column holds numbers alone, of each; the first one names its row."""
        columns = list(zip(*self.rows, strict=True))
        return [k > 0 and all(NUMBER.match(cell) for cell in column) for k, column in enumerate(columns)]


class Drawing(NamedTuple):
    """A figure that the command has left: its file in the folder without the ending, heading and caption."""

    stem: str
    heading: str
    caption: str = ""


@pydantic.dataclasses.dataclass(frozen=True)
class Result:
    """What one JSON says. Its fields are checked: a file may be another program's, or edited.

    Attributes
    ----------
    title: what it is about. sentences: the verdict.
    drawings: in the order in which they are shown; those that are not there are left out.
    facts: name and words. versions: of what computed it. covers: folders below whose results are a part of this one,
        so that they are not shown again.
    """

    title: str
    sentences: Sequence[Sentence]
    tables: Sequence[Table] = ()
    drawings: Sequence[Drawing] = ()
    facts: Sequence[tuple[str, str]] = ()
    versions: Mapping[str, str] | None = None
    covers: Sequence[str] = ()

    @property
    def state(self) -> bool | Literal["doubt"] | None:
        """The worst of its sentences."""
        return worst_of(self.sentences)

    @property
    def banner(self) -> str:
        """Class of the banner that says it."""
        return BANNERS[self.state]

    @property
    def lead(self) -> list[str]:
        """What is said of it among others: the first sentence, and what one should look at; of much, how much more."""
        first = [words for words, _ in self.sentences][:1]
        doubtful = [words for words, good in self.sentences[1:] if good in (False, DOUBT)]
        left = len(doubtful) - LED
        return [*first, *doubtful] if left <= 1 else [*first, *doubtful[:LED], f"And {left} more."]

    def mark(self, state: bool | str | None) -> tuple[str, str]:
        """The mark of a sentence or of the whole, and its class."""
        return LOOKS[state]


@dataclass(frozen=True)
class Kind:
    """A kind of result.

    name: of its JSON. word: what it is called. page: the command's own page in the same folder.
    read: the JSON's content and its folder to a Result; whatever it raises for a content that is another's is caught.
    own: the command writes a richer page itself, so that none is made of this.
    """

    name: str
    word: str
    read: Callable[[Mapping[str, Any], Path], Result]
    page: str = "report.html"
    own: bool = False


def written(value: float | None, scale: float = 1.0, digits: int = 4) -> str:
    """A number of a JSON, where null is nan or infinity."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return number(float(f"{value / scale:.{digits}g}"))


def percent(value: float | None, digits: int = 3) -> str:
    """A share in percent."""
    return NOTHING if value is None else f"{written(value, 0.01, digits)} %"


def fit_table(caption: str, columns: Mapping[str, Mapping[str, float | None]]) -> Table:
    """Fits in percent: a row a channel, a column a run."""
    channels = dict.fromkeys(channel for fits in columns.values() for channel in fits)
    rows = [[channel, *(written(fits.get(channel)) for fits in columns.values())] for channel in channels]
    return Table(caption, ["channel", *columns], rows)


def settings_of(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Plant and what was set for this run, as facts."""
    changes = ", ".join(f"{key} = {value}" for key, value in content.get("settings", {}).items())
    plant = str(content.get("plant", ""))
    model = content.get("model")
    return [("plant", f"{plant} ({model})" if model else plant), ("set for this run", changes or "nothing")]
