"""Keys of a controller's definition: resolve them by name, put values, write the TOML."""

from __future__ import annotations

import copy
import difflib
import textwrap
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ...core.catalogue import controllers
from ...core.errors import InputError, choices
from ...core.files import read_toml
from ..kinds import CONTROLLER_KINDS, ControllerKind

#: Tables of which a definition has one: a key of one removes the others.
ALTERNATIVES = ("design", "tuning", "gains")
#: Command line options for the keys of one table.
OPTIONS = {"weights": "--weight", "limits": "--limit"}


def begin(kind: str, base: str | None = None) -> tuple[ControllerKind, Path]:
    """Kind and file of the definition that a design starts from.

    Parameters
    ----------
    kind: a key of CONTROLLER_KINDS.
    base: a controller's name or path; by default KIND_position, else the first of this kind in the catalogue.

    Raises InputError for an unknown kind, a base of another kind, or a kind without one.
    """
    if kind not in CONTROLLER_KINDS:
        raise InputError(f"--kind {kind!r}: no such kind of controller; {choices(kind, CONTROLLER_KINDS)}")
    if base is not None:
        path = controllers.find(base)
        found = read_toml(path).get("kind")
        if found != kind:
            raise InputError(f"--base {base}: is a {found!r} controller; expected kind = {kind!r}")
        return CONTROLLER_KINDS[kind], path
    for name in sorted(controllers, key=lambda name: name != f"{kind}_position"):
        if read_toml(controllers[name]).get("kind") == kind:
            return CONTROLLER_KINDS[kind], controllers[name]
    raise InputError(f"there is no {kind!r} controller to start from; give one with --base FILE")


def leaves(form: type[BaseModel], prefix: str = "") -> list[str]:
    """Dotted keys of a form and its tables."""
    found = []
    for name, field in form.model_fields.items():
        key = f"{prefix}{field.alias or name}"
        parts = [field.annotation, *getattr(field.annotation, "__args__", ())]
        inner = next((part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)), None)
        found += leaves(inner, f"{key}.") if inner is not None else [key]
    return found


def resolve(key: str, form: type[BaseModel]) -> str:
    """The dotted key of a word. Raises InputError for one that the form does not have, or has twice."""
    known = leaves(form)
    meant = [name for name in known if name == key or ("." not in key and name.endswith(f".{key}"))]
    if key in known:
        return key
    if len(meant) > 1:
        raise InputError(f"--spec {key}: may be {' or '.join(meant)}; write it out")
    if not meant:
        raise InputError(_unknown(key, known))
    return meant[0]


def _unknown(key: str, known: list[str]) -> str:
    """The error message for an unknown key: the keys of its table, else the tables."""
    table, dot, word = key.partition(".")
    option = f"{OPTIONS[table]} {word}" if dot and table in OPTIONS else f"--spec {key}"
    within = [name.removeprefix(f"{table}.") for name in known if name.startswith(f"{table}.")]
    if dot and within:
        return f"{option}: this kind of controller has no such key in [{table}]; {choices(word, within)}"
    if table in OPTIONS:
        return f"{option}: this kind of controller has no [{table}]; leave it out"
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    tables = dict.fromkeys(f"{name.partition('.')[0]}.*" if "." in name else name for name in sorted(known))
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"{option}: this kind of controller has no such key; {meant}known: {', '.join(tables)}"


def put(content: dict[str, Any], kind: ControllerKind, asked: Mapping[str, str]) -> dict[str, Any]:
    """The definition's content with other values; `asked` is key -> text as after --spec.

    A key of a table among ALTERNATIVES removes the other tables. All other values stay.

    Raises InputError for keys that the kind does not have.
    """
    content = copy.deepcopy(content)
    for word, text in asked.items():
        *tables, key = resolve(word, kind.file).split(".")
        if tables and tables[0] in ALTERNATIVES:
            for other in set(ALTERNATIVES) - {tables[0]}:
                content.pop(other, None)
        place = content
        for table in tables:
            place = place.setdefault(table, {})
        place[key] = value(text)
    return content


def value(text: str) -> Any:
    """A value as TOML reads it ("1.5", "true", "[1, 2]"), else the text ("30 rad/s")."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def toml_text(content: Mapping[str, Any], comments: list[str]) -> str:
    """The definition as TOML under its comments."""
    import tomlkit

    document = tomlkit.document()
    for line in comments:
        for part in textwrap.wrap(line, 110, subsequent_indent="  ", break_on_hyphens=False):
            document.add(tomlkit.comment(part))
    document.add(tomlkit.nl())
    ordered = sorted(content.items(), key=lambda item: isinstance(item[1], dict))
    for key, item in ordered:
        document[key] = item
    return tomlkit.dumps(document)
