"""Pages made of what a command has left in a folder, its JSON and its figures: one for a result, one for a whole tree.

Nothing is simulated again. A page of a tree is what one shows to others: every result below a folder, verdicts first.
"""

from __future__ import annotations

import base64
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from ..core.errors import InputError
from ..core.reading import read_json
from .document import Picture, anchors, inlined, write_document
from .kinds import kinds
from .kinds._result import Kind, Result

#: File of the page of a tree.
FILE = "overview.html"
#: An SVG of more letters than this makes a page slow: it is shown as pixels where these are there.
LARGEST = 600_000


class Noted(NamedTuple):
    """A parameter's name and note, as a JSON has them."""

    name: str
    note: str


@dataclass(frozen=True)
class Section:
    """A result in a page.

    place: its folder as seen from the page's; anchor: its id in the page.
    """

    kind: Kind
    result: Result
    folder: Path
    place: str
    anchor: str
    rests_on: Mapping[str, Any]

    @property
    def title(self) -> str:
        return self.result.title

    @property
    def doubtful(self) -> bool:
        return self.result.state is not True

    @property
    def failed(self) -> bool:
        return self.result.state is False

    @property
    def pictures(self) -> list[Picture]:
        said = " ".join(words for words, _ in self.result.sentences)
        found = []
        for number_of, drawing in enumerate(self.result.drawings):
            name = f"{self.anchor}-{number_of}"
            picture = _drawn(self.folder, drawing.stem, f"{drawing.heading}. {said}", name)
            if picture is not None:
                found.append(Picture(drawing.heading, picture, drawing.caption))
        return found

    @property
    def page(self) -> str:
        """The command's own page, where it is a richer one and there."""
        there = self.kind.own and (self.folder / self.kind.page).is_file()
        return (Path(self.place) / self.kind.page).as_posix() if there else ""

    @property
    def assumed(self) -> list[tuple[str, Noted, str, str]]:
        """Rows of the table of assumed parameters."""
        rows = self.rests_on.get("assumed", [])
        return [(row["plant"], Noted(row["name"], row["note"]), row["value"], row["range"]) for row in rows]

    def checked(self) -> None:
        """Raise an error of any kind if the page could not be made of this."""
        texts = [self.command, self.title, *(name for pair in self.files for name in pair)]
        texts += [text for plant, noted, *ends in self.assumed for text in (plant, *noted, *ends)]
        texts += [words for words, _ in self.result.sentences]
        texts += [words for pair in (self.result.versions or {}).items() for words in pair]
        texts += [words for pair in self.result.facts for words in pair]
        texts += [cell for table in self.result.tables for row in (table.head, *table.rows) for cell in row]
        texts += [words for drawing in self.result.drawings for words in drawing]
        if not all(isinstance(text, str) for text in texts):
            raise TypeError("a text is none")
        if any(len(row) != len(table.head) for table in self.result.tables for row in table.rows):
            raise ValueError("a table is ragged")

    @property
    def files(self) -> list[tuple[str, str]]:
        return list(self.rests_on.get("files", {}).items())

    @property
    def command(self) -> str:
        return str(self.rests_on.get("command", ""))


def write_result_page(folder: Path, name: str) -> Path:
    """Write the page of one result beside its JSON `name`, which is there, and return its path."""
    kind = kinds()[name]
    section = _section(kind, Path(folder), "", "result")
    return write_document(
        "result.html.j2",
        Path(folder),
        file=kind.page,
        section=section,
        versions=section.result.versions or {},
        files=section.files,
        assumed=section.assumed,
        command=section.command,
    )


def write_overview(sections: Sequence[Section], folder: Path, name: str) -> Path:
    """Write `overview.html` to the folder and return its path.

    sections: from `results_in`. name: of the tree, for the page's heading.
    """
    return write_document("overview.html.j2", folder, file=FILE, sections=sections, name=name)


def results_in(root: Path, page: Path | None = None) -> tuple[list[Section], list[str]]:
    """Every result in a folder and below it, and sentences about files that could not be read.

    page: folder of the page that will show them, the same one by default; links are relative to it.

    Raises InputError where there is no such folder, or nothing in it that a command has written.
    """
    root = Path(root)
    if not root.is_dir():
        raise InputError(f"{root}: no such folder; give the one that a command wrote to with --out")
    found, wrong = [], []
    for kind, folder in _files(root):
        place = os.path.relpath(folder, page or root)
        try:
            found.append(_section(kind, folder, place, ""))
        except InputError as error:
            wrong.append(str(error))
    if not found:
        why = f" ({wrong[0]})" if wrong else ""
        raise InputError(f"{root}: holds no result of ehsa-ctrl{why}; call a command with --out {root} first")
    covered = [section.folder / name for section in found for name in section.result.covers]
    shown = [section for section in found if section.folder not in covered]
    names = anchors(f"{section.kind.name.removesuffix('.json')}-{section.place}" for section in shown)
    return [_named(section, name) for section, name in zip(shown, names, strict=True)], wrong


def _named(section: Section, anchor: str) -> Section:
    return Section(section.kind, section.result, section.folder, section.place, anchor, section.rests_on)


def _files(root: Path) -> Iterator[tuple[Kind, Path]]:
    """The folder's own results first, then those of its folders in the order of their names."""
    known = kinds()
    for folder, below, files in os.walk(root):
        below[:] = sorted(name for name in below if not name.startswith("."))
        for name in sorted(known):
            if name in files:
                yield known[name], Path(folder)


def _section(kind: Kind, folder: Path, place: str, anchor: str) -> Section:
    """Raises InputError for a file that is no result of this kind."""
    path = folder / kind.name
    try:
        content = read_json(path)
        section = Section(kind, kind.read(content, folder), folder, place, anchor, content.get("rests_on") or {})
        # What a page asks for later is looked at now, while one can still say which file is wrong.
        section.checked()
        return section
    except InputError:
        raise
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError):
        raise InputError(f"{path}: is not what ehsa-ctrl writes under this name") from None


def _drawn(folder: Path, stem: str, words: str, name: str) -> Markup | None:
    """A figure that is there: as lines, as pixels where these would be too many, None where neither is."""
    svg, png = folder / f"{stem}.svg", folder / f"{stem}.png"
    if svg.parent != folder:
        # A JSON may name anything; only the result's own folder is looked into.
        return None
    if svg.is_file() and (svg.stat().st_size <= LARGEST or not png.is_file()):
        text = svg.read_text(encoding="utf-8", errors="replace")
        # What is no figure of ours stays out: a page that is sent around runs nothing.
        if "<svg" in text and "<script" not in text:
            return inlined(text, words, name)
    if png.is_file():
        data = base64.b64encode(png.read_bytes()).decode()
        return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(words, data)
    return None
