"""`ehsa-ctrl check`: validate plants, controllers and scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError
from .complete import plants
from .options import Json
from .output import say, to_json


def command(
    files: Annotated[list[Path] | None, typer.Argument(help="TOML files; by default the whole catalogue.")] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            help="Plant for whose linear model and limits controllers are checked; by default ehsa's linear model.",
            autocompletion=plants,
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Validate plants, controllers and scenarios: units, ranges, names, references; design the controllers.

    Examples: ehsa-ctrl check · ehsa-ctrl check scenarios/my_step.toml
    """
    from ..core import catalogue
    from ..scenario.prepare import check_definition

    if files:
        todo = [(path.stem, path) for path in files]
    else:
        todo = [
            (f"{kind}/{name}", getattr(catalogue, kind)[name])
            for kind in catalogue.KINDS
            for name in getattr(catalogue, kind)
        ]
    mistakes: dict[str, str] = {}
    for name, path in todo:
        try:
            check_definition(path, plant=plant)
        except InputError as error:
            mistakes[name] = str(error)
    if as_json:
        print(to_json({"checked": [name for name, _ in todo], "mistakes": mistakes}))
    else:
        for name, _ in todo:
            print(f"{'wrong' if name in mistakes else 'ok':<6}{name}")
    for sentence in mistakes.values():
        say(sentence)
    if mistakes:
        raise typer.Exit(2)
