"""The pages of TOML files: each key with what it takes, from the forms that validate them."""

from __future__ import annotations

import re
import typing
from collections.abc import Collection
from typing import Any, Literal

from pydantic import BaseModel
from words import cell, sentence

from ehsa_ctrl.core.described import Key, keys, summary
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS, ControllerFile
from ehsa_ctrl.plant.file import CHANNEL_UNITS, LIMIT_UNITS, LOAD_SYMBOLS, PlantFile
from ehsa_ctrl.plant.systems import SYSTEMS
from ehsa_ctrl.scenario.definition import ScenarioFile


def plants() -> str:
    """Keys of a plant's TOML, its symbols, limits and channels."""
    lines = [
        "# A plant's TOML",
        "",
        "In `plants/`, or anywhere if you give the path. An unknown key is a mistake and is said to be one. Numbers "
        "have the form of [`[parameters]`](#parameters) everywhere: in `[limits]`, `[load]`, `[sampling]` and "
        "`[sensors.CHANNEL]` too.",
        *form(PlantFile, ""),
        "",
        "## Systems and their symbols",
        "",
        "`system` selects the equations. The symbols of a system are what `[parameters]`, `[linear.parameters]` and "
        "`[nonlinear.parameters]` may hold; friction adds its own ([Friction laws](friction.md)), and so do effects "
        "([Effects](effects.md)).",
    ]
    for system in SYSTEMS.values():
        lines += ["", f"### {system.name}", "", f"{sentence(system.title)} States: "]
        lines[-1] += ", ".join(f"`{state.name}` [{state.unit}]" for state in system.states) + "."
        lines += ["", "| symbol | unit | meaning |", "|---|---|---|"]
        lines += [f"| `{kind.name}` | {kind.unit} | {cell(kind.meaning)} |" for kind in system.parameters]
    lines += ["", "## Limits", "", "| key | unit |", "|---|---|"]
    lines += [f"| `{name}` | {unit} |" for name, unit in LIMIT_UNITS.items()]
    lines += ["", "## Channels", "", "Of `[sensors]` and `[log]`, beside `t`.", "", "| channel | unit |", "|---|---|"]
    lines += [f"| `{name}` | {unit} |" for name, unit in CHANNEL_UNITS.items()]
    lines += ["", "## Load", "", "On the command line `--set load.stiffness=50e3`.", ""]
    lines += ["| key | symbol |", "|---|---|", *(f"| `{word}` | `{symbol}` |" for word, symbol in LOAD_SYMBOLS.items())]
    return "\n".join(lines) + "\n"


def controllers() -> str:
    """Keys of a controller's TOML, a section a kind."""
    lines = [
        "# A controller's TOML",
        "",
        "In `controllers/`, or anywhere if you give the path. `kind` selects the feedback law and with it the keys; "
        "the stages `[trajectory]`, `[feedforward]`, `[rest]` and `[dither]` go with every kind.",
    ]
    seen: set[Any] = set()
    lines += ["", "## Every kind", *form(ControllerFile, "", level=3, title="every", seen=seen)]
    shared = {key.name for key in keys(ControllerFile)} - {"kind"}
    for kind in CONTROLLER_KINDS.values():
        own = form(kind.file, "", level=3, title=kind.name, seen=set(seen), without=shared)
        lines += ["", f"## {kind.name}", "", sentence(kind.summary), *own]
    return "\n".join(lines) + "\n"


def scenarios() -> str:
    """Keys of a scenario's TOML."""
    lines = [
        "# A scenario's TOML",
        "",
        "In `scenarios/`, or anywhere if you give the path. What may stand under `[limits]` is in "
        "[Metrics](metrics.md).",
        *form(ScenarioFile, ""),
    ]
    return "\n".join(lines) + "\n"


def form(
    kind: type[BaseModel],
    table: str,
    level: int = 2,
    title: str = "",
    seen: set[Any] | None = None,
    without: Collection[str] = (),
) -> list[str]:
    """A table of the keys of one form but those in `without`, and below it those of the tables in it.

    title: first word of the anchors. seen: forms that need not be told again; those that are told here are added.
    """
    seen = set() if seen is None else seen
    seen.add(kind)
    known = [key for key in keys(kind) if key.name not in without]
    lines = []
    if table:
        # A nested table's own anchor, so that the same word in two kinds does not clash.
        anchor = "-".join(re.findall(r"\w+", f"{title} {table} {_word(kind)}")).lower()
        lines += ["", f"{'#' * level} {_heading(kind, table)} {{ #{anchor} }}"]
        said = re.sub(r"^.{0,40}?\[+[\w.]+\]+[:.]?\s*", "", summary(kind))
        if said:
            lines += ["", sentence(said)]
    lines += ["", "| key | value | default | meaning |", "|---|---|---|---|"]
    lines += [f"| `{key.name}` | {_value(key, kind)} | {_default(key)} | {cell(key.meaning)} |" for key in known]
    for key in known:
        for inner in key.forms or _mapped(kind, key):
            if inner not in seen:
                path = f"{table}.{key.name}" if table else key.name
                deeper = form(inner, f"[{path}]" if key.many else path, level + (1 if table else 0), title, seen)
                lines += deeper
    return lines


def _heading(kind: type[BaseModel], table: str) -> str:
    """The table as it is written; where a key chooses the form, with that."""
    word = _word(kind)
    return f"`[{table}]`" + (f" of kind `{word}`" if word else "")


def _word(kind: type[BaseModel]) -> str:
    """The word by which a key `kind` chooses this form; empty where none does."""
    field = kind.model_fields.get("kind")
    return str(typing.get_args(field.annotation)[0]) if field and typing.get_origin(field.annotation) is Literal else ""


def _mapped(kind: type[BaseModel], key: Key) -> tuple[type[BaseModel], ...]:
    """The form of the values of a key that is a table of names, as [parameters] is."""
    field = next(f for name, f in kind.model_fields.items() if (f.alias or name) == key.name)
    arguments = typing.get_args(field.annotation)
    if typing.get_origin(field.annotation) is dict and isinstance(arguments[1], type):
        return (arguments[1],) if issubclass(arguments[1], BaseModel) else ()
    return ()


def _value(key: Key, kind: type[BaseModel]) -> str:
    """What a key takes, in words."""
    if key.choices:
        return " or ".join(f"`{word}`" for word in key.choices)
    if key.unit is not None:
        field = next(f for name, f in kind.model_fields.items() if (f.alias or name) == key.name)
        several = "list of " if "list[" in str(field.annotation) else ""
        return several + ("number" if key.unit in ("1", "fraction") else f'`"... {key.unit}"`')
    if key.forms:
        return "tables" if key.many else "table"
    field = next(f for name, f in kind.model_fields.items() if (f.alias or name) == key.name)
    return _plain(field.annotation)


def _plain(annotation: Any) -> str:
    if typing.get_origin(annotation) is dict:
        names = typing.get_args(annotation)[0]
        words = typing.get_args(names) if typing.get_origin(names) is Literal else ()
        return "table of " + (", ".join(f"`{word}`" for word in words) if words else "names")
    inner = [part for part in typing.get_args(annotation) if part is not type(None)]
    if type(None) in typing.get_args(annotation) and len(inner) == 1:
        return _plain(inner[0])
    if typing.get_origin(annotation) is list:
        return f"list of {_plain(inner[0])}".replace("number", "numbers")
    if typing.get_origin(annotation) is tuple:
        return f"[{', '.join(_plain(part) for part in inner)}]"
    text = str(annotation)
    for word, meaning in (("bool", "`true` or `false`"), ("int", "whole number"), ("float", "number"), ("str", "text")):
        if annotation.__class__ is type and annotation.__name__ == word:
            return meaning
        if re.search(rf"\b{word}\b", text):
            return meaning
    return ""


def _default(key: Key) -> str:
    if key.required:
        return "required"
    if key.default is None or key.default in ("", [], {}) or isinstance(key.default, BaseModel):
        return ""
    if isinstance(key.default, bool):
        return f"`{str(key.default).lower()}`"
    if isinstance(key.default, float):
        unit = f" {key.unit}" if key.unit not in (None, "1", "fraction") else ""
        return "none" if key.default in (float("inf"), float("-inf")) else f"`{key.default:.4g}{unit}`"
    return f"`{key.default}`" if isinstance(key.default, str | int) else ""
