"""Shell completion: names of definitions, symbols of a plant, values of options.

Imports little, to answer fast: names come from file names, titles and symbols from the TOML files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import typer

Offer = list[tuple[str, str]]


def _definitions(kind: str) -> Callable[[str], Offer]:
    """Complete names, with titles; TOML files if a path is typed."""

    def offer(incomplete: str) -> Offer:
        from ..core.catalogue import Catalogue

        if "/" in incomplete or incomplete.startswith("."):
            return files(incomplete, ".toml")
        catalogue = Catalogue(kind)
        names = [name for name in catalogue if name.startswith(incomplete)]
        return [(name, str(_read(catalogue[name]).get("title", ""))) for name in names]

    return offer


def _kinds(catalogue: str, *keys: str) -> Callable[[str], list[str]]:
    """Complete the values that a key has in the definitions of a catalogue."""

    def offer(incomplete: str) -> list[str]:
        from ..core.catalogue import Catalogue

        words = set()
        for path in Catalogue(catalogue).values():
            content: Any = _read(path)
            for key in keys:
                content = content.get(key, {})
            words.add(str(content or ""))
        return sorted(word for word in words if word and word.startswith(incomplete))

    return offer


plants, controllers, scenarios = map(_definitions, ("plants", "controllers", "scenarios"))
controller_kinds = _kinds("controllers", "kind")
reference_kinds = _kinds("scenarios", "reference", "kind")


def several_controllers(incomplete: str) -> Offer:
    """Complete the last name of A,B,C, without those before it."""
    *before, last = incomplete.split(",")
    start = "".join(f"{name}," for name in before)
    return [(f"{start}{name}", words) for name, words in controllers(last) if name not in before]


def files(incomplete: str, *endings: str) -> Offer:
    """Folders, and files with these endings, that begin as typed."""
    folder = Path(incomplete if incomplete.endswith("/") else Path(incomplete).parent)
    start = incomplete[: incomplete.rfind("/") + 1]
    try:
        entries = sorted(folder.expanduser().iterdir())
    except OSError:
        return []
    found = [(f"{start}{e.name}{'/' if e.is_dir() else ''}", "") for e in entries if e.is_dir() or e.suffix in endings]
    return [(name, words) for name, words in found if name.startswith(incomplete)]


def _read(path: Path) -> Mapping[str, Any]:
    from ..core.errors import InputError
    from ..core.files import read_toml

    try:
        return read_toml(path)
    except InputError:
        return {}


def symbols(ctx: typer.Context, incomplete: str) -> Offer:
    """Complete KEY= of --set: parameters and loads of the plant on the command line, with their values."""
    if "=" in incomplete:
        return []
    return [(f"{name}=", words) for name, words in _symbols(ctx).items() if name.startswith(incomplete)]


def several_symbols(ctx: typer.Context, incomplete: str) -> Offer:
    """Complete the last symbol of K_T,beta."""
    *before, last = incomplete.split(",")
    start = "".join(f"{name}," for name in before)
    return [
        (f"{start}{name}", words)
        for name, words in _symbols(ctx).items()
        if name.startswith(last) and name not in before and not name.startswith("load.")
    ]


def _symbols(ctx: typer.Context) -> dict[str, str]:
    """Key -> its value in the plant's file."""
    from ..core.catalogue import Catalogue
    from ..core.errors import InputError

    try:
        path = Catalogue("plants").find(_plant(ctx))
    except InputError:
        return {}
    content = _read(path)
    found: dict[str, str] = {}
    for place in ("linear", "nonlinear"):
        found |= _numbers(content.get(place, {}).get("parameters", {}))
    found |= _numbers(content.get("parameters", {}))
    return found | {f"load.{word}": text for word, text in _numbers(content.get("load", {})).items()}


def _plant(ctx: typer.Context) -> str:
    """The plant on the command line, by default ehsa."""
    given = ctx.params.get("plant")
    if given is None and any(p.name == "plant" and p.param_type_name == "argument" for p in ctx.command.params):
        given = next(iter(ctx.args), None)
    return str(given or "ehsa")


def _numbers(table: Mapping[str, Any]) -> dict[str, str]:
    return {
        name: f"{item.get('value')} {item.get('unit')}, {item.get('source')}"
        for name, item in table.items()
        if isinstance(item, Mapping)
    }
