"""Notebooks from scripts with cells: `# %%` begins a code cell, `# %% [markdown]` a text cell of comment lines."""

from __future__ import annotations

from typing import Any

METADATA = {
    "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
    "language_info": {"name": "python"},
}


def notebook_of(source: str) -> dict[str, Any]:
    """The notebook of a script, not executed, as the content of its file. Lines before the first cell are left out."""
    cells = []
    for number, part in enumerate(f"\n{source}".split("\n# %%")[1:]):
        head, _, body = part.partition("\n")
        text = body.strip()
        cell: dict[str, Any] = {"metadata": {}}
        if head.strip() == "[markdown]":
            lines = [line.removeprefix("#").removeprefix(" ") for line in text.splitlines()]
            cell |= {"id": f"text-{number:02d}", "cell_type": "markdown", "source": "\n".join(lines)}
        else:
            cell |= {
                "id": f"code-{number:02d}", "cell_type": "code", "source": text, "execution_count": None, "outputs": [],
            }  # fmt: skip
        cells.append(cell)
    return {"cells": cells, "metadata": METADATA, "nbformat": 4, "nbformat_minor": 5}
