"""Convert the package's docstrings to the form that mkdocstrings' numpy reader expects.

The code writes an item of a section in one line, "name: meaning"; numpydoc has the meaning indented on the
next line. This griffe extension converts the docstring before it is parsed.
"""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "Yields")
#: "name: meaning" or "name, other: meaning", at the beginning of a line or after a sentence.
ITEM = re.compile(r"(?:^|(?<=[.;] )(?=[a-z]))([A-Za-z_][\w.]*(?:, [A-Za-z_]\w*)*): (?=\S)")


class OneLineItems(Extension):
    """Rewrites the docstring of every object as it is found."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = numpydoc(obj.docstring.value)


def numpydoc(text: str) -> str:
    """The docstring with each item of its sections in two lines; formulas are unchanged."""
    lines = text.split("\n")
    out: list[str] = []
    index = 0
    while index < len(lines):
        line = lines[index]
        following = lines[index + 1] if index + 1 < len(lines) else ""
        if line.strip() in SECTIONS and re.fullmatch(r"-{3,}", following.strip()):
            end = index + 2
            while end < len(lines) and not (
                end + 1 < len(lines) and lines[end].strip() and re.fullmatch(r"-{3,}", lines[end + 1].strip())
            ):
                end += 1
            out += ["", line, following, *_items(lines[index + 2 : end], line.strip())]
            index = end
        else:
            out.append(line)
            index += 1
    return "\n".join(out)


def _items(lines: list[str], section: str) -> list[str]:
    """Items of one section; a line that begins no item goes on with the one before."""
    found: list[str] = []
    for line in lines:
        pieces = _split(line) if line[:1].strip() else []
        if section != "Attributes" and pieces:
            pieces = [(pieces[0][0], line.partition(": ")[2])]
        kind = re.fullmatch(r"([A-Z]\w*)\.(?: (.*))?", line) if section == "Returns" else None
        if kind:
            found += [kind[1], f"    {kind[2] or ''}".rstrip()]
        elif pieces:
            for name, meaning in pieces:
                found += [name, f"    {meaning}"]
        elif line.strip():
            found.append(f"    {line.strip()}")
        else:
            found.append("")
    return found


def _split(line: str) -> list[tuple[str, str]]:
    """("name", "meaning") of each item that stands in a line."""
    starts = list(ITEM.finditer(line))
    if not starts or starts[0].start() != 0:
        return []
    ends = [*(item.start() for item in starts[1:]), len(line)]
    return [(item[1], line[item.end() : end].strip()) for item, end in zip(starts, ends, strict=True)]
