"""A page as data: sentences of the verdict, then sections of text, facts, tables and figures.

Every kind of result is turned into a `Page` (see `kinds`), and one template renders all of them. `check` makes sure
that every text is one, so that a JSON that was edited is refused while its file can still be named.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

#: How a number begins as pages show them, with or without a unit; nothing, a dash and "n/a" count as numbers.
NUMBER = re.compile(r"(● )?\(?[-−+]?(\d|∞)|–?$|n/a$")
#: Neither right nor wrong: the reader should have a look.
DOUBT: Literal["doubt"] = "doubt"
State = bool | Literal["doubt"] | None
#: A sentence and its state; None where there is nothing to judge.
Sentence = tuple[str, State]
#: Mark and class of colour of a state; marks differ without colour too.
LOOKS: dict[State, tuple[str, str]] = {
    True: ("✓", "good"), False: ("✗", "bad"), DOUBT: ("△", "doubt"), None: ("–", "soft")
}  # fmt: skip
#: Class of the banner of a state.
BANNERS: dict[State, str] = {True: "", False: " fail", DOUBT: " look", None: " plain"}
#: Sentences to look at that an overview repeats of one result.
REPEATED = 3


def worst_of(sentences: Iterable[Sentence]) -> State:
    """The worst state: False, else "doubt", else True; None if none of the sentences is judged."""
    states = {state for _, state in sentences}
    return next((state for state in (False, DOUBT, True) if state in states), None)


def mark(good: bool, words: str) -> str:
    """Words with a tick or a cross, as tables have them."""
    return f"{'✓' if good else '✗'} {words}"


def unique(names: Iterable[str]) -> list[str]:
    """The names; one that occurs again gets a number."""
    found: list[str] = []
    for name in names:
        candidate, count = name, 2
        while candidate in found:
            candidate, count = f"{name}--{count}", count + 1
        found.append(candidate)
    return found


def anchors(names: Iterable[str]) -> list[str]:
    """Unique ids of sections: anything but letters, digits, - and _ becomes a hyphen."""
    return unique(re.sub(r"[^A-Za-z0-9_-]+", "-", name) for name in names)


class Link(str):
    """A text that leads to the section with the key `target`."""

    target: str

    def __new__(cls, text: str, target: str) -> Link:
        link = super().__new__(cls, text)
        link.target = target
        return link


class Paragraph(NamedTuple):
    """A paragraph, with a mark where its state is not None; `code` is shown in letters of equal width."""

    words: str
    state: State = None
    code: bool = False


class Points(NamedTuple):
    """A list of sentences; one with a state has its mark."""

    items: Sequence[str | Sentence]

    @property
    def sentences(self) -> list[Sentence]:
        return [(item, None) if isinstance(item, str) else item for item in self.items]


class Facts(NamedTuple):
    """Names and what they are."""

    rows: Sequence[tuple[str, str]]


class Table(NamedTuple):
    """A table of texts; the first column names the row, "\n" in a heading breaks the line.

    A cell that begins with ✓ is shown as good, with ✗ as bad, with △ as one to look at.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def numbers(self) -> list[bool]:
        """Whether each column holds numbers alone."""
        columns = zip(*self.rows, strict=True)
        return [k > 0 and all(NUMBER.match(cell) for cell in column) for k, column in enumerate(columns)]


class Picture(NamedTuple):
    """A figure that lies beside the JSON: its file without the ending, what it shows, and what to look for.

    It is left out where the file is absent. In a page it has a heading of its own only with `headed`.
    """

    stem: str
    heading: str
    caption: str = ""
    headed: bool = False


class Section(NamedTuple):
    """A heading and the blocks below it, sections among them. key: for links, unique in a page."""

    heading: str
    blocks: Sequence[Any]
    key: str = ""
    state: State = None


@dataclass(frozen=True)
class Page:
    """The content of one result's JSON as a page.

    Attributes
    ----------
    title: what it is about. sentences: the verdict.
    notes: how the numbers came about, in paragraphs below the verdict.
    sections: in the order in which they are shown; an empty one is left out.
    facts: settings and conditions. versions: of the software that computed it.
    covers: folders below whose results are a part of this one, so that an overview does not show them again.
    """

    title: str
    sentences: Sequence[Sentence]
    notes: Sequence[str] = ()
    sections: Sequence[Section] = ()
    facts: Sequence[tuple[str, str]] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    covers: Sequence[str] = ()

    @property
    def state(self) -> State:
        """The worst of its sentences."""
        return worst_of(self.sentences)

    @property
    def lead(self) -> list[str]:
        """For an overview: the first sentence, and those to look at; of many the first ones and how many more."""
        first = [words for words, _ in self.sentences][:1]
        doubtful = [words for words, state in self.sentences[1:] if state in (False, DOUBT)]
        left = len(doubtful) - REPEATED
        return [*first, *doubtful] if left <= 1 else [*first, *doubtful[:REPEATED], f"And {left} more."]


@dataclass(frozen=True)
class Kind:
    """A kind of result.

    name: of its JSON. word: what it is called. page: file of its page in the same folder.
    read: turns the JSON's content and its folder into a Page; what it raises for the content of another program's file
        is caught.
    """

    name: str
    word: str
    read: Callable[[Mapping[str, Any], Path], Page]
    page: str = "report.html"


def check(content: Any) -> None:
    """Check some blocks, or the texts of a page, with all that is in them.

    Raises TypeError for what is neither text nor a state, ValueError for a ragged table.
    """
    if isinstance(content, list | tuple):
        if isinstance(content, Table) and any(len(row) != len(content.head) for row in content.rows):
            raise ValueError(f"the table {content.caption!r} is ragged")
        for item in content:
            check(item)
    elif not isinstance(content, str | bool | None):
        raise TypeError("a text of a page is not a string")


def pictures_in(blocks: Iterable[Any]) -> Iterator[Picture]:
    """Every figure of some sections."""
    for block in blocks:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, Section):
            yield from pictures_in(block.blocks)
