"""The HTML file of a page: self-contained, with its figures as data and nothing loaded from outside."""

from __future__ import annotations

import base64
import hashlib
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2
from markupsafe import Markup

from .page import BANNERS, LOOKS

#: Characters beside a-z, 0-9 and _.-~ that need no escape in a data: URL nor in an attribute of HTML.
PLAIN = " !$()*+,/:;=?@"


def write_document(template: str, path: Path, **content: Any) -> Path:
    """Write a page from a template of this folder and return its path; the same content gives the same bytes."""
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
    # The page may use this style and nothing else: no script, no other file, no network.
    style = environment.get_template("page.css").render()
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    page = environment.get_template(template).render(style_digest=digest, **content)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The name of a file may hold bytes that are not valid UTF-8.
    path.write_text(page, encoding="utf-8", errors="backslashreplace")
    return path


def image(content: bytes, kind: str, words: str) -> Markup:
    """A file inside a page, as an <img>: in one a browser runs no script and loads nothing, whatever the file holds.

    kind: of image/..., "svg+xml" or "png". words: the alternative text.
    """
    # Percent escapes are shorter for an SVG, base64 for pixels.
    forms = f",{quote(content, safe=PLAIN)}", f";base64,{base64.b64encode(content).decode()}"
    return Markup('<img alt="{}" src="data:image/{}{}">').format(words, kind, min(forms, key=len))
