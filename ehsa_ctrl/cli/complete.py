"""What a shell offers after TAB: names from the three folders, the effects, the symbols of a plant.

Nothing heavy is imported here: names come from the files' names and, where a name's meaning is shown or a plant's
symbols are asked for, from their TOML alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import typer

Offer = list[tuple[str, str]]


def plants(incomplete: str) -> Offer:
    return _definitions("plants", incomplete)


def controllers(incomplete: str) -> Offer:
    return _definitions("controllers", incomplete)


def scenarios(incomplete: str) -> Offer:
    return _definitions("scenarios", incomplete)


def several_controllers(incomplete: str) -> Offer:
    """A,B,C: the last one is completed, those before it are not offered again."""
    *before, last = incomplete.split(",")
    start = "".join(f"{name}," for name in before)
    return [(f"{start}{name}", words) for name, words in controllers(last) if name not in before]


def _definitions(kind: str, incomplete: str) -> Offer:
    """Names with their titles; TOML files where a path is begun."""
    from ..core.catalogue import Catalogue

    if "/" in incomplete or incomplete.startswith("."):
        return files(incomplete, ".toml")
    catalogue = Catalogue(kind)
    return [(name, _title(catalogue[name])) for name in catalogue if name.startswith(incomplete)]


def files(incomplete: str, *endings: str) -> Offer:
    """Files of these endings and folders, below what is typed."""
    folder = Path(incomplete if incomplete.endswith("/") else Path(incomplete).parent)
    start = incomplete[: incomplete.rfind("/") + 1]
    try:
        entries = sorted(folder.expanduser().iterdir())
    except OSError:
        return []
    found = [(f"{start}{e.name}{'/' if e.is_dir() else ''}", "") for e in entries if e.is_dir() or e.suffix in endings]
    return [(name, words) for name, words in found if name.startswith(incomplete)]


def _title(path: Path) -> str:
    return str(_read(path).get("title", ""))


def _read(path: Path) -> Mapping[str, Any]:
    from ..core.errors import InputError
    from ..core.files import read_toml

    try:
        return read_toml(path)
    except InputError:
        return {}


def _begun(words: Iterable[str], incomplete: str) -> list[str]:
    return [word for word in words if word.startswith(incomplete)]


def kinds_of_list(incomplete: str) -> list[str]:
    from .listing import KINDS

    return _begun(KINDS, incomplete)


def controller_kinds(incomplete: str) -> list[str]:
    """The words of the registry, which are those of its files' own `kind`, as the catalogue has them."""
    from ..core.catalogue import Catalogue

    catalogue = Catalogue("controllers")
    words = {str(_read(catalogue[name]).get("kind", "")) for name in catalogue} - {""}
    return _begun(sorted(words), incomplete)


def reference_kinds(incomplete: str) -> list[str]:
    from ..core.catalogue import Catalogue

    catalogue = Catalogue("scenarios")
    words = {str(_read(catalogue[name]).get("reference", {}).get("kind", "")) for name in catalogue} - {""}
    return _begun(sorted(words), incomplete)


def models(incomplete: str) -> list[str]:
    return _begun(("linear", "nonlinear"), incomplete)


def models_or_both(incomplete: str) -> list[str]:
    return _begun(("linear", "nonlinear", "both"), incomplete)


def excitations(incomplete: str) -> list[str]:
    return _begun(("noise", "steps", "sine", "ramp", "chirp", "multisine"), incomplete)


def symbols(ctx: typer.Context, incomplete: str) -> Offer:
    """KEY= of --set: symbols and loads of the plant that the command names, with what they are now."""
    if "=" in incomplete:
        return []
    return [(f"{name}=", words) for name, words in _symbols(ctx).items() if name.startswith(incomplete)]


def several_symbols(ctx: typer.Context, incomplete: str) -> Offer:
    """K_T,beta: the last one is completed."""
    *before, last = incomplete.split(",")
    start = "".join(f"{name}," for name in before)
    return [
        (f"{start}{name}", words)
        for name, words in _symbols(ctx).items()
        if name.startswith(last) and name not in before and not name.startswith("load.")
    ]


def _symbols(ctx: typer.Context) -> dict[str, str]:
    """Key -> its value in the plant's file, as far as a plant is named; else in the paper's."""
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
    """The plant on the line; before an option that still lacks its value, arguments are left over."""
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
