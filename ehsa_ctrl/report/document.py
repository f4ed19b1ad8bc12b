"""What every page shares: one self-contained file, figures within, versions and assumed parameters at its end."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure

from .figures import to_svg
from .number import number, unit


class Picture(NamedTuple):
    """A figure in a page: its heading, itself, and what to look for."""

    heading: str
    svg: Markup
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
    environment.filters |= {"number": number, "unit": unit, **(filters or {})}
    page = environment.get_template(template).render(**content)
    path = Path(folder) / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8", errors="backslashreplace")
    return path


def embedded(figure: Figure, words: str, name: str) -> Markup:
    """A figure as an SVG inside a page: said in words for those who don't see it, its ids apart from other figures'."""
    return inlined(to_svg(figure), words, name)


def inlined(svg: str, words: str, name: str) -> Markup:
    """The text of one of our SVG files as it stands inside a page, as `embedded` has it."""
    svg = svg[svg.index("<svg") :]
    # What a page can't use: name spaces, comments, and a style that would hold for the whole page.
    svg = re.sub(r"\s*(<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->)", "", svg, flags=re.DOTALL)
    box = re.search(r'viewBox="[^"]+"', svg)
    head = f'<svg role="img" aria-label="{Markup.escape(words)}" {box[0] if box else ""}>'
    svg = head + svg[svg.index(">") + 1 :]
    svg = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    # matplotlib's own text, in which every word is an outline; `words` is escaped.
    return Markup(svg.strip())


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
