"""The HTML file of a page: self-contained, with embedded figures and scripts and no external resources."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

import jinja2
from markupsafe import Markup
from PIL import Image

from .chart import Chart
from .live import chart_library
from .page import BANNERS, LOOKS

#: Characters besides letters, digits and _.-~ that need no escape in a data: URL or an HTML attribute.
PLAIN = " !$()*+,/:;=?@"


def write_document(
    template: str,
    path: Path,
    charts: Mapping[Chart, Mapping[str, Any] | str] = MappingProxyType({}),
    grids: bool = False,
    **content: Any,
) -> Path:
    """Render a template of this package to `path` and return it; the same content gives the same bytes.

    charts: live charts in `content` -> their numbers, or why they have none. grids: whether there are tables with small
    lines.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"looks": LOOKS, "banners": BANNERS}
    environment.filters["kind"] = lambda block: type(block).__name__
    environment.filters["longest_line"] = lambda cell: max(map(len, cell.split("\n")))
    environment.filters["numbers"] = lambda chart: charts[chart]
    live = any(not isinstance(numbers, str) for numbers in charts.values())
    library = chart_library() if live else None
    styles = [environment.get_template("page.css").render(), *([library.style] if library else [])]
    scripts = [*([library.script] if library else []), environment.get_template("page.js").render()]
    scripts += [environment.get_template("grid.js").render()] if grids else []
    page = environment.get_template(template).render(
        styles=list(map(Markup, styles)),
        scripts=list(map(Markup, scripts)),
        # The content security policy permits these styles and scripts only: no other script, no other file, no network.
        style_digests=digests(styles),
        script_digests=digests(scripts),
        live=library is not None,
        lacks_library=live and library is None,
        **content,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    # File names may contain bytes that are not valid UTF-8.
    path.write_text(page, encoding="utf-8", errors="backslashreplace")
    return path


def digests(texts: Iterable[str]) -> str:
    """Hashes of inline styles or scripts for a content security policy."""
    found = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts)
    return " ".join(f"'sha256-{digest}'" for digest in found)


def to_webp(png: bytes) -> tuple[bytes, str]:
    """The same pixels as a lossless WebP, a fifth smaller, with its media subtype; the PNG if that fails."""
    stream = BytesIO()
    try:
        # Slower settings make it no smaller.
        Image.open(BytesIO(png)).convert("RGB").save(stream, "WEBP", lossless=True, method=2, quality=40)
    except (OSError, ValueError, KeyError):
        return png, "png"
    return stream.getvalue(), "webp"


def image(content: bytes, kind: str, words: str) -> Markup:
    """An image file as <img> with a data: URL; a browser neither runs scripts nor loads files from such an image.

    kind: media subtype, "svg+xml", "png" or "webp". words: the alternative text.
    """
    # Percent encoding is usually shorter for SVG text, base64 for a PNG.
    encodings = f",{quote(content, safe=PLAIN)}", f";base64,{base64.b64encode(content).decode()}"
    return Markup('<img alt="{}" src="data:image/{}{}">').format(words, kind, min(encodings, key=len))
