"""Texts of the code in Markdown."""

from __future__ import annotations


def cell(text: str) -> str:
    """A text for a table cell."""
    return text.replace("|", "\\|").replace("\n", " ").strip()


def sentence(text: str) -> str:
    """The text with a capital letter at the beginning and a full stop at the end."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")
