"""The HTML file of a page: self-contained, with embedded figures and no external resources."""

from __future__ import annotations

import base64
import hashlib
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2
from markupsafe import Markup

from .page import BANNERS, LOOKS

#: Characters besides letters, digits and _.-~ that need no escape in a data: URL or an HTML attribute.
PLAIN = " !$()*+,/:;=?@"


def write_document(template: str, path: Path, **content: Any) -> Path:
    """Render a template of this package to `path` and return it; the same content gives the same bytes."""
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
    # The page's content security policy permits this style only: no script, no other file, no network.
    style = environment.get_template("page.css").render()
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    page = environment.get_template(template).render(style_digest=digest, **content)
    path.parent.mkdir(parents=True, exist_ok=True)
    # File names may contain bytes that are not valid UTF-8.
    path.write_text(page, encoding="utf-8", errors="backslashreplace")
    return path


def image(content: bytes, kind: str, words: str) -> Markup:
    """An image file as <img> with a data: URL; a browser neither runs scripts nor loads files from such an image.

    kind: media subtype, "svg+xml" or "png". words: the alternative text.
    """
    # Percent encoding is usually shorter for SVG text, base64 for a PNG.
    encodings = f",{quote(content, safe=PLAIN)}", f";base64,{base64.b64encode(content).decode()}"
    return Markup('<img alt="{}" src="data:image/{}{}">').format(words, kind, min(encodings, key=len))
