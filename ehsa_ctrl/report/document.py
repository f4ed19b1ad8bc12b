"""What every page shares: one self-contained file, figures within, versions and assumed parameters at its end."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure

from ..core.parameter import Parameter
from ..core.unit import factor
from ..plant.plant import Plant
from .figures import to_svg
from .number import number, quantity, unit

#: Plant, parameter or limit, its value and its believed range as written.
Assumed = tuple[str, Parameter, str, str]


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
    path.write_text(page, encoding="utf-8")
    return path


def embedded(figure: Figure, words: str, name: str) -> Markup:
    """A figure as an SVG inside a page: said in words for those who don't see it, its ids apart from other figures'."""
    svg = to_svg(figure)
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


def assumed_of(plants: Iterable[Plant]) -> list[Assumed]:
    """Everything that is assumed in some plants, each value once."""
    found: dict[tuple[str, str, float], Assumed] = {}
    for plant in plants:
        sensors = [number for sensor in plant.sensors.values() for number in sensor.stated]
        for parameter in (*plant.parameters.values(), *plant.limits.values(), *sensors):
            if parameter.source == "assumed":
                key = (plant.name, parameter.name, parameter.value)
                found.setdefault(key, (plant.name, parameter, *_written(parameter)))
    return list(found.values())


def _written(parameter: Parameter) -> tuple[str, str]:
    """Value and believed range in the unit of the plant's file."""
    own = parameter.written.partition(" ")[2] or parameter.unit
    scale = factor(own, parameter.unit)
    value = quantity(parameter.value / scale, own)
    if parameter.lower == -float("inf") and parameter.upper == float("inf"):
        return value, ""
    return value, f"{number(parameter.lower / scale)} to {quantity(parameter.upper / scale, own)}"
