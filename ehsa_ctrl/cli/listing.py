"""`ehsa-ctrl list`: names and titles of definitions, effects and friction laws."""

from __future__ import annotations

from typing import Annotated

import typer

from ..core.errors import InputError, choices
from .complete import listed_kinds
from .options import Json
from .output import to_json

KINDS = ("plants", "controllers", "scenarios", "effects", "friction")


def command(
    kind: Annotated[
        str | None,
        typer.Argument(help="One of: " + ", ".join(KINDS) + "; all of them by default.", autocompletion=listed_kinds),
    ] = None,
    as_json: Json = False,
) -> None:
    """List plants, controllers, scenarios, effects and friction laws.

    Examples: ehsa-ctrl list · ehsa-ctrl list scenarios · ehsa-ctrl list effects --json
    """
    if kind is not None and kind not in KINDS:
        raise InputError(f"list {kind!r}: no such kind; {choices(kind, KINDS)}")
    found = {name: _entries(name) for name in ([kind] if kind else KINDS)}
    if as_json:
        print(to_json(found))
        return
    from rich.console import Console
    from rich.table import Table

    console = Console()
    for name, entries in found.items():
        table = Table(title=name, title_justify="left", box=None, show_header=False, pad_edge=False)
        table.add_column(no_wrap=True, style="bold")
        table.add_column()
        for entry, text in entries.items():
            table.add_row(entry, text)
        console.print(table)
        console.print()


def _entries(kind: str) -> dict[str, str]:
    if kind == "effects":
        from ..physics.effects import EFFECTS

        return {
            name: f"[{effect.place}] {effect.summary}".replace("[", "(").replace("]", ")")
            for name, effect in EFFECTS.items()
        }
    if kind == "friction":
        from ..physics.friction import LAWS

        return {name: law.summary for name, law in LAWS.items()}
    from ..core import catalogue

    return dict(getattr(catalogue, kind).titles())
