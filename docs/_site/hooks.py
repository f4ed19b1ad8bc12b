"""Hooks of mkdocs: write the reference pages, draw formulas."""

from __future__ import annotations

from typing import Any

import formulas
import reference
from mkdocs.structure.files import File, Files


def on_files(files: Files, config: Any) -> Files:
    """Add the pages generated from the code."""
    for path, text in reference.pages().items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_content(html: str, **_: Any) -> str:
    """Draw the formulas that Markdown has marked."""
    return formulas.render(html)
