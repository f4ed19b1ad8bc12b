"""Pages made from the stored files of a result: its JSON and its figures.

The same code makes the page of a command with `--out`, the overview of `ehsa-ctrl report`, and the page of
`write_report` in Python. Nothing is simulated again.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from ..core.errors import InputError
from ..core.files import read_json
from ..plant.file import label
from .chart import Chart
from .document import image, to_webp, write_document
from .grid import Grid
from .kinds import kinds
from .live import payloads
from .page import (
    DOUBT,
    Facts,
    FileLink,
    Kind,
    Links,
    Page,
    Paragraph,
    Picture,
    Points,
    Section,
    Table,
    anchors,
    charts_in,
    check,
    pictures_in,
)

#: File of the overview.
FILE = "overview.html"
#: The PNG replaces larger SVG files [bytes], which browsers display slowly and which make pages large to send
#: (engineering judgement). A result with more than MANY figures shows the smaller of the two, a PNG as WebP.
MAX_SVG, MANY = 120_000, 4
#: Larger figures [bytes] are left out of the page; no figure of this package is that large.
MAX_FIGURE = 8_000_000
#: Suffix of a figure file -> its image/... media type.
TYPES = {".svg": "svg+xml", ".png": "png"}


@dataclass(frozen=True)
class StoredResult:
    """A stored result with its page.

    folder: of the JSON. place: the folder relative to that of the page. anchor: id in an overview.
    """

    kind: Kind
    page: Page
    folder: Path
    place: str
    rests_on: Mapping[str, Any]
    anchor: str = ""

    @property
    def doubtful(self) -> bool:
        return self.page.state in (False, DOUBT)

    @property
    def failed(self) -> bool:
        return self.page.state is False

    @property
    def assumed(self) -> Sequence[Mapping[str, str]]:
        return self.rests_on.get("assumed", [])

    @property
    def date(self) -> str:
        """Date and time of the computation; empty if the JSON does not state it."""
        return str(self.rests_on.get("date", ""))

    @cached_property
    def provenance(self) -> Section:
        """Section with facts, assumed parameters, input files, versions and the command."""
        several = len({row["plant"] for row in self.assumed}) > 1
        head = [*(["plant"] if several else []), "name", "value", "range", "note"]
        rows = [[label(row[key]) if key == "name" else row[key] for key in head] for row in self.assumed]
        files = [f"{digits} {name}" for name, digits in self.rests_on.get("files", {}).items()]
        command = self.rests_on.get("command")
        when = [("computed", self.date)] if self.date else []
        blocks = [
            Facts([*when, *self.page.facts]),
            Table("Assumed parameters: not measured, and other values change the results", head, rows),
            *([Paragraph("Input files, with the first digits of their SHA-256:")] if files else []),
            Points(files),
            Facts(list({**self.rests_on.get("versions", {}), **self.page.versions}.items())),
            *([Paragraph("Command:"), Paragraph(command, code=True)] if command else []),
        ]
        return Section("Provenance", blocks, "provenance", folded=True)

    @cached_property
    def images(self) -> dict[str, Markup]:
        """Stem of each existing figure -> its <img> element."""
        verdict = " ".join(words for words, _ in self.page.sentences)
        found, pictures = {}, list(pictures_in(self.page.sections))
        limit = 0 if len(pictures) > MANY else MAX_SVG
        for picture in pictures:
            drawn = _embed(self.folder, picture.stem, f"{picture.heading}. {verdict}", limit)
            if drawn is not None:
                found[picture.stem] = drawn
        return found

    @cached_property
    def sections(self) -> list[Section]:
        """The sections that have content; the provenance is last."""
        return list(_without_empty([*self.page.sections, self.provenance], self.images, self.place))

    @property
    def file(self) -> str:
        """The result's own page relative to the overview; empty if there is none."""
        there = (self.folder / self.kind.page).is_file()
        return (Path(self.place) / self.kind.page).as_posix() if there else ""

    @property
    def link(self) -> str:
        """`file` as a URL; quoted because the name of a folder may start with javascript: or contain # or %."""
        return quote(os.fsencode(self.file))


def write_result_page(folder: Path, name: str) -> Path:
    """Write the page of one result beside its JSON `name` and its figures, and return its path."""
    result = _read(kinds()[name], Path(folder), "")
    return write_document(
        "page.html.j2", Path(folder) / result.kind.page, charts_of([result]), _has_grid(result.sections), result=result
    )


def write_overview(results: Sequence[StoredResult], folder: Path, name: str) -> Path:
    """Write `overview.html` to the folder and return its path.

    results: from `results_in`. name: of their folder, for the heading.
    """
    grids = any(_has_grid(result.sections) for result in results)
    path = Path(folder) / FILE
    return write_document("overview.html.j2", path, charts_of(results), grids, results=results, name=name)


def charts_of(results: Sequence[StoredResult]) -> dict[Chart, dict[str, Any] | str]:
    """Each live chart of a page -> its numbers, or the sentence why it has none."""
    charts = [(chart, result.folder) for result in results for chart in charts_in(result.sections)]
    return dict(zip([chart for chart, _ in charts], payloads(charts), strict=True))


def results_in(root: Path, page: Path | None = None) -> tuple[list[StoredResult], list[str]]:
    """All results in a folder and its subfolders, and sentences about files that could not be read.

    page: folder of the overview, `root` by default; links are relative to it.

    Raises InputError if the folder does not exist or contains no result.
    """
    root = Path(root)
    if not root.is_dir():
        raise InputError(f"{root}: no such folder; give a folder that a command wrote with --out")
    found, wrong = [], []
    for kind, folder in _files(root):
        try:
            found.append(_read(kind, folder, os.path.relpath(folder, page or root)))
        except InputError as error:
            wrong.append(str(error))
    if not found:
        why = f" ({wrong[0]})" if wrong else ""
        raise InputError(f"{root}: contains no result of ehsa-ctrl{why}; run a command with --out {root} first")
    covered = [result.folder / name for result in found for name in result.page.covers]
    shown = [result for result in found if result.folder not in covered]
    ids = anchors(f"{result.kind.name.removesuffix('.json')}-{result.place}" for result in shown)
    return [replace(result, anchor=anchor) for result, anchor in zip(shown, ids, strict=True)], wrong


def _files(root: Path) -> Iterator[tuple[Kind, Path]]:
    """Kind and folder of each result file: those of the folder itself first, then its subfolders by name."""
    known = kinds()
    for folder, below, files in os.walk(root):
        below[:] = sorted(name for name in below if not name.startswith("."))
        for name in sorted(known):
            if name in files:
                yield known[name], Path(folder)


def _read(kind: Kind, folder: Path, place: str) -> StoredResult:
    """Read a result. Raises InputError for a file that is not a result of this kind."""
    path = folder / kind.name
    try:
        content = read_json(path)
        result = StoredResult(kind, kind.read(content, folder), folder, place, content.get("rests_on") or {})
        # Checked here, where the message can still name the file.
        page = result.page
        check([page.title, page.sentences, page.notes, page.covers, page.sections, result.provenance])
        return result
    except InputError as error:
        # Errors of the JSON reader name the file; errors about its content do not.
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: is not a result of ehsa-ctrl") from None
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError):
        raise InputError(f"{path}: is not a result of ehsa-ctrl") from None


def _without_empty(blocks: Iterable[Any], images: Mapping[str, Markup], place: str) -> Iterator[Any]:
    """The blocks without empty ones and without missing figures, with links as seen from the page."""
    for block in blocks:
        if isinstance(block, Section):
            inner = list(_without_empty(block.blocks, images, place))
            if inner:
                yield block._replace(blocks=inner)
        elif isinstance(block, Picture):
            if block.stem in images:
                yield block
        elif isinstance(block, Chart):
            yield replace(block, pictures=[picture for picture in block.pictures if picture.stem in images])
        elif isinstance(block, Table):
            if block.rows:
                yield _linked(block, place)
        elif isinstance(block, Grid):
            yield replace(block, table=_linked(block.table, place))
        elif block[-1] or isinstance(block, Paragraph):
            yield block


def _has_grid(blocks: Iterable[Any]) -> bool:
    return any(isinstance(b, Grid) or (isinstance(b, Section) and _has_grid(b.blocks)) for b in blocks)


def _linked(table: Table, place: str) -> Table:
    """A table whose links to files are seen from the page."""
    rows = [
        [cell.seen_from(place) if isinstance(cell, FileLink | Links) else cell for cell in row] for row in table.rows
    ]
    return table._replace(rows=rows)


def _embed(folder: Path, stem: str, words: str, limit: int) -> Markup | None:
    """A figure as an <img>: the SVG, or a smaller PNG if the SVG exceeds the limit [bytes]; None if neither exists."""
    # Some stems come from the JSON; none may lead out of the folder.
    if Path(stem).name != stem:
        return None
    try:
        files = [file for end in TYPES if (file := folder / f"{stem}{end}").is_file()]
        if not files:
            return None
        file = files[0] if files[0].stat().st_size <= limit else min(files, key=lambda file: file.stat().st_size)
        if file.stat().st_size <= MAX_FIGURE:
            content, kind = file.read_bytes(), TYPES[file.suffix]
            return image(*(to_webp(content) if kind == "png" and not limit else (content, kind)), words)
        why = f"is larger than {MAX_FIGURE // 1_000_000} MB"
    except OSError as error:
        why = f"can't be read ({error.strerror})"
    return Markup('<p class="soft">The figure is left out: {} {}.</p>').format(stem, why)
