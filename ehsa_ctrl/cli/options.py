"""Options that several commands share, and how their values are read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError

Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Believe another value in this run: K_T=1.1, load.stiffness=50e3, M='20 kg'. Repeatable.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write the result's files to this folder.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a result that is already in the folder.")]


def read_pairs(settings: list[str]) -> dict[str, str]:
    """Turn ["K_T=1.1"] into {"K_T": "1.1"}. Raises InputError for text without '=' and for a key given twice."""
    pairs: dict[str, str] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key or not value.strip():
            raise InputError(f"--set {text!r}: expected KEY=VALUE, as in --set K_T=1.1")
        if key in pairs:
            raise InputError(f"--set {key} is given twice; give it once")
        pairs[key] = value.strip()
    return pairs
