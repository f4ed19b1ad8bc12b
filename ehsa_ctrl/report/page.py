"""A page as data: sentences of the verdict, then sections with text, facts, tables and figures.

Every kind of result becomes a `Page` (see `kinds`), and one template renders all of them. `check` verifies that all
texts are strings, so that an edited JSON is rejected while the message can still name the file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple
from urllib.parse import quote

from .chart import Chart

#: Start of a cell that counts as a number, with or without a unit; nothing, a dash and "n/a" count as numbers.
NUMBER = re.compile(r"(● )?\(?[-−+]?(\d|∞)|–?$|n/a$")
#: State of a sentence that the reader should check.
DOUBT: Literal["doubt"] = "doubt"
State = bool | Literal["doubt"] | None
#: A sentence and its state; None for a sentence without a verdict.
Sentence = tuple[str, State]
#: State -> mark and CSS class; the marks differ without colour too.
LOOKS: dict[State, tuple[str, str]] = {
    True: ("✓", "good"), False: ("✗", "bad"), DOUBT: ("△", "doubt"), None: ("–", "soft")
}  # fmt: skip
#: State -> CSS class of the banner.
BANNERS: dict[State, str] = {True: "", False: " fail", DOUBT: " look", None: " plain"}
#: Sentences to check that an overview repeats for each result.
REPEATED = 3


def worst_of(sentences: Iterable[Sentence]) -> State:
    """The worst state: False, then "doubt", then True; None if no sentence has a verdict."""
    states = {state for _, state in sentences}
    return next((state for state in (False, DOUBT, True) if state in states), None)


def mark(good: bool, words: str) -> str:
    """Text with a tick or a cross, for tables."""
    return f"{'✓' if good else '✗'} {words}"


def unique(names: Iterable[str]) -> list[str]:
    """The names, with a number appended to repeated ones."""
    found: list[str] = []
    for name in names:
        candidate, count = name, 2
        while candidate in found:
            candidate, count = f"{name}--{count}", count + 1
        found.append(candidate)
    return found


def anchors(names: Iterable[str]) -> list[str]:
    """Unique HTML ids of sections; characters other than letters, digits, - and _ become hyphens."""
    return unique(re.sub(r"[^A-Za-z0-9_-]+", "-", name) for name in names)


class Link(str):
    """A text that links to the section with the key `target`."""

    target: str

    def __new__(cls, text: str, target: str) -> Link:
        link = super().__new__(cls, text)
        link.target = target
        return link


class FileLink(str):
    """A text that links to a file beside the JSON; `url` is its address in the page."""

    file: str
    url: str

    def __new__(cls, text: str, file: str, place: str = ".") -> FileLink:
        link = super().__new__(cls, text)
        link.file = file
        # Quoted because the name of a folder may start with javascript: or contain # or %.
        path = (Path(place) / file).as_posix()
        try:
            link.url = quote(os.fsencode(path))
        except UnicodeEncodeError:
            # An edited JSON; no file has such a name.
            link.url = quote(path.encode(errors="replace"))
        return link

    def seen_from(self, place: str) -> FileLink:
        """The link in a page from which the folder of the JSON is `place`."""
        return FileLink(str(self), self.file, place)


class Links(str):
    """A text that unfolds to links to files; `links` has them."""

    links: tuple[FileLink, ...]

    def __new__(cls, text: str, links: Iterable[FileLink]) -> Links:
        found = super().__new__(cls, text)
        found.links = tuple(links)
        return found

    def seen_from(self, place: str) -> Links:
        """The links in a page from which the folder of the JSON is `place`."""
        return Links(str(self), [link.seen_from(place) for link in self.links])


class Paragraph(NamedTuple):
    """A paragraph, with a mark if its state is not None; `code` selects a monospaced font."""

    words: str
    state: State = None
    code: bool = False


class Points(NamedTuple):
    """A list of sentences, with a mark for those that have a state."""

    items: Sequence[str | Sentence]

    @property
    def sentences(self) -> list[Sentence]:
        return [(item, None) if isinstance(item, str) else item for item in self.items]


class Facts(NamedTuple):
    """Pairs of name and value."""

    rows: Sequence[tuple[str, str]]


class Table(NamedTuple):
    """A table of texts; the first column names the row, and "\n" in a heading breaks the line.

    Cells that start with ✓ are shown as good, with ✗ as bad, with △ as to be checked.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def numbers(self) -> list[bool]:
        """For each column, whether it contains only numbers."""
        columns = zip(*self.rows, strict=True)
        return [k > 0 and all(NUMBER.match(cell) for cell in column) for k, column in enumerate(columns)]


class Picture(NamedTuple):
    """A figure beside the JSON: file stem, heading and caption.

    The page omits it if the file does not exist, and shows its heading only if `headed`.
    """

    stem: str
    heading: str
    caption: str = ""
    headed: bool = False


class Section(NamedTuple):
    """A heading and its blocks, which may be sections. key: target of links, unique in a page.

    folded: closed on the screen until a reader opens it; open in print and without scripts.
    """

    heading: str
    blocks: Sequence[Any]
    key: str = ""
    state: State = None
    folded: bool = False


@dataclass(frozen=True)
class Page:
    """The content of one result's JSON as a page.

    Attributes
    ----------
    title: heading of the page. sentences: the verdict.
    notes: paragraphs below the verdict on how the numbers were computed.
    sections: in display order; empty ones are omitted.
    facts: settings and conditions. versions: of the software that computed the result.
    covers: subfolders whose results are part of this one; an overview does not show them again.
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
        """The worst state of its sentences."""
        return worst_of(self.sentences)

    @property
    def lead(self) -> list[str]:
        """Sentences for an overview: the first one, those to check up to REPEATED, and the number of the others."""
        first = [words for words, _ in self.sentences][:1]
        doubtful = [words for words, state in self.sentences[1:] if state in (False, DOUBT)]
        left = len(doubtful) - REPEATED
        return [*first, *doubtful] if left <= 1 else [*first, *doubtful[:REPEATED], f"And {left} more."]


@dataclass(frozen=True)
class Kind:
    """A kind of result.

    name: of its JSON file. word: noun for the result. page: file of its page in the same folder.
    read: makes a Page from the content of the JSON and its folder; its exceptions for foreign content are caught.
    """

    name: str
    word: str
    read: Callable[[Mapping[str, Any], Path], Page]
    page: str = "report.html"


def check(content: Any) -> None:
    """Check blocks or texts of a page recursively.

    Raises TypeError for anything that is neither text nor a state, ValueError for a ragged table.
    """
    if isinstance(content, Chart):
        check([*content.texts, *content.pictures])
    elif hasattr(content, "texts"):
        check(content.texts)
    elif isinstance(content, list | tuple):
        if isinstance(content, Table) and any(len(row) != len(content.head) for row in content.rows):
            raise ValueError(f"the table {content.caption!r} is ragged")
        for item in content:
            check(item)
    elif not isinstance(content, str | bool | None):
        raise TypeError("a text of a page is not a string")


def pictures_in(blocks: Iterable[Any]) -> Iterator[Picture]:
    """All figures of some blocks."""
    for block in blocks:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, Chart):
            yield from block.pictures
        elif isinstance(block, Section):
            yield from pictures_in(block.blocks)


def charts_in(blocks: Iterable[Any]) -> Iterator[Chart]:
    """All live charts of some blocks."""
    for block in blocks:
        if isinstance(block, Chart):
            yield block
        elif isinstance(block, Section):
            yield from charts_in(block.blocks)
