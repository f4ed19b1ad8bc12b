"""What every page shares: one self-contained file, figures within, versions and assumed parameters at its end."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure

from ..plant.file import both
from .figures import to_svg
from .number import number, unit

#: Characters beside a-z, 0-9 and _.-~ that mean nothing in a data: URL nor in an attribute of HTML.
PLAIN = " !$()*+,/:;=?@"


class Picture(NamedTuple):
    """A figure in a page: its heading, itself, and what to look for."""

    heading: str
    image: Markup
    caption: str


def write_document(
    template: str,
    folder: Path,
    filters: Mapping[str, Any] | None = None,
    *,
    file: str = "report.html",
    **content: Any,
) -> Path:
    """Write a page, a template of this folder with its content, and return its path; no date, no network."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "unit": unit, "both": both, **(filters or {})}
    # The page may use this style and nothing else: no script, no other file, no network.
    style = environment.get_template("page.css").render()
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    page = environment.get_template(template).render(style_digest=digest, **content)
    path = Path(folder) / file
    path.parent.mkdir(parents=True, exist_ok=True)
    # A name of a file may hold bytes that are no letters.
    path.write_text(page, encoding="utf-8", errors="backslashreplace")
    return path


def embedded(figure: Figure, words: str) -> Markup:
    """A figure of ours inside a page, and in words for those who don't see it."""
    return image(to_svg(figure).encode(), "svg+xml", words)


def image(content: bytes, kind: str, words: str) -> Markup:
    """A file inside a page, as an <img>: in one a browser runs no script and loads nothing, whatever the file holds.

    kind: of image/..., "svg+xml" or "png". words: what it shows, for those who don't see it.
    """
    # An SVG is shorter with a percent sign where a character has a meaning in HTML or in a URL, pixels are as base64.
    written = f",{quote(content, safe=PLAIN)}", f";base64,{base64.b64encode(content).decode()}"
    return Markup('<img alt="{}" src="data:image/{}{}">').format(words, kind, min(written, key=len))


def anchors(names: Iterable[str]) -> list[str]:
    """An id for each name; a name that comes twice (files in two folders) gets a number."""
    found: list[str] = []
    for name in names:
        anchor = plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name)
        number_of = 2
        while anchor in found:
            anchor = f"{plain}--{number_of}"
            number_of += 1
        found.append(anchor)
    return found


def merged_versions(provenances: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Versions of several results; where they differ, all of them."""
    found: dict[str, set[str]] = {}
    for provenance in provenances:
        for name, version in provenance.items():
            found.setdefault(name, set()).add(version)
    return {name: ", ".join(sorted(versions)) for name, versions in found.items()}
