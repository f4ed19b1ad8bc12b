"""`ehsa-ctrl list`: names and titles of definitions, controller kinds, effects, friction laws and file formats."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, get_args

import typer

from .options import Json
from .output import to_json

if TYPE_CHECKING:
    from ..physics.friction import FrictionParameter


#: What is listed; "kinds" are those of controllers.
Listed = Literal["plants", "controllers", "kinds", "scenarios", "effects", "friction", "formats"]


def command(
    kind: Annotated[Listed | None, typer.Argument(help="What to list; all of them by default.")] = None,
    as_json: Json = False,
) -> None:
    """List plants, controllers and their kinds, scenarios, effects, friction laws and formats of logs.

    Examples: ehsa-ctrl list · ehsa-ctrl list scenarios · ehsa-ctrl list kinds · ehsa-ctrl list effects --json
    """
    found = {name: _entries(name) for name in ([kind] if kind else get_args(Listed))}
    if as_json:
        print(to_json(found))
        return
    from rich.console import Console
    from rich.table import Table

    console = Console()
    for name, entries in found.items():
        table = Table(
            title="controller kinds" if name == "kinds" else name,
            title_justify="left",
            box=None,
            show_header=False,
            pad_edge=False,
        )
        table.add_column(no_wrap=True, style="bold")
        table.add_column()
        for entry, text in entries.items():
            table.add_row(entry, text)
        console.print(table)
        console.print()


def _own_parameter(parameter: FrictionParameter) -> str:
    """Symbol, meaning and unit of a parameter that a friction law declares."""
    units = dict.fromkeys(parameter.unit_at(*contact) for contact in (("N m", "rad"), ("N", "m")))
    return f"{parameter.symbol}: {parameter.meaning} ({' or '.join(units)})"


def _entries(kind: str) -> dict[str, str]:
    if kind == "effects":
        from ..physics.effects import EFFECTS

        return {
            name: f"[{effect.place}] {effect.summary}".replace("[", "(").replace("]", ")")
            for name, effect in EFFECTS.items()
        }
    if kind == "kinds":
        from ..design.kinds import CONTROLLER_KINDS

        return {name: one.summary for name, one in CONTROLLER_KINDS.items()}
    if kind == "formats":
        from ..core.formats import FORMATS

        return {name: one.summary() for name, one in FORMATS.items()}
    if kind == "friction":
        from ..physics.friction import LAWS

        return {name: "; ".join([law.summary, *map(_own_parameter, law.parameters)]) for name, law in LAWS.items()}
    from ..core import catalogue

    return dict(getattr(catalogue, kind).titles())
