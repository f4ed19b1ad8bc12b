"""Pages made of what a command has left in a folder, its JSON and its figures: one for a result, one for a whole tree.

Nothing is simulated again. A page of a tree is what one shows to others: every result below a folder, verdicts first.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup
from pydantic import BaseModel

from ..core.errors import InputError
from ..core.files import read_json
from .document import Picture, anchors, image, write_document
from .kinds import kinds
from .kinds._result import DOUBT, Kind, Result

#: File of the page of a tree.
FILE = "overview.html"
#: An SVG of more characters than this makes a page slow: it is shown as pixels where these are there.
LARGEST = 600_000
#: A file of more bytes is no figure of ours, and would make the page useless.
TOO_LARGE = 8_000_000
#: Endings of figures, and what follows image/ in their type.
KINDS = {".svg": "svg+xml", ".png": "png"}


class Assumed(BaseModel):
    """An assumed parameter, as a JSON has it."""

    plant: str
    name: str
    value: str
    range: str
    note: str


class RestsOn(BaseModel):
    """What a result rests on, as its JSON has it: see `grounds`."""

    assumed: list[Assumed] = []
    files: dict[str, str] = {}
    command: str = ""


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
    rests_on: RestsOn

    @property
    def title(self) -> str:
        return self.result.title

    @property
    def doubtful(self) -> bool:
        return self.result.state in (False, DOUBT)

    @property
    def failed(self) -> bool:
        return self.result.state is False

    @property
    def pictures(self) -> list[Picture]:
        said = " ".join(words for words, _ in self.result.sentences)
        found = []
        for drawing in self.result.drawings:
            picture = _drawn(self.folder, drawing.stem, f"{drawing.heading}. {said}")
            if picture is not None:
                found.append(Picture(drawing.heading, picture, drawing.caption))
        return found

    @property
    def page(self) -> str:
        """The command's own page, where it is a richer one and there."""
        there = self.kind.own and (self.folder / self.kind.page).is_file()
        return (Path(self.place) / self.kind.page).as_posix() if there else ""

    @property
    def link(self) -> str:
        """The same as a URL: a folder may be called javascript:, or hold a # or %."""
        return quote(os.fsencode(self.page))

    @property
    def assumed(self) -> list[tuple[str, Assumed, str, str]]:
        """Rows of the table of assumed parameters."""
        return [(row.plant, row, row.value, row.range) for row in self.rests_on.assumed]

    def checked(self) -> None:
        """Raise an error of any kind if the page could not be made of this."""
        texts = [self.title, *(words for words, _ in self.result.sentences)]
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
        return list(self.rests_on.files.items())

    @property
    def command(self) -> str:
        return self.rests_on.command


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
        rests_on = RestsOn.model_validate(content.get("rests_on") or {})
        section = Section(kind, kind.read(content, folder), folder, place, anchor, rests_on)
        # What a page asks for later is looked at now, while one can still say which file is wrong.
        section.checked()
        return section
    except InputError as error:
        # What reading says names the file; a unit that is none, within it, does not.
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: is not what ehsa-ctrl writes under this name") from None
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError):
        raise InputError(f"{path}: is not what ehsa-ctrl writes under this name") from None


def _drawn(folder: Path, stem: str, words: str) -> Markup | None:
    """A figure that is there: as lines, as pixels where these would be too many; None where neither is."""
    # The names of some come out of the JSON; none leads out of the folder.
    if Path(stem).name != stem:
        return None
    try:
        files = [file for end in KINDS if (file := folder / f"{stem}{end}").is_file()]
        if not files:
            return None
        file = files[-1] if files[0].stat().st_size > LARGEST else files[0]
        if file.stat().st_size <= TOO_LARGE:
            return image(file.read_bytes(), KINDS[file.suffix], words)
        why = f"is larger than {TOO_LARGE // 1_000_000} MB"
    except OSError as error:
        why = f"can't be read ({error.strerror})"
    return Markup('<p class="soft">The figure is left out: {} {}.</p>').format(stem, why)
