"""Pages of the TOML files: each key with its values, from the models that validate them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any

from pydantic import BaseModel
from words import cell, sentence

from ehsa_ctrl.core.log import CHANNELS, REFERENCES
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS, ControllerFile, PositionControllerFile
from ehsa_ctrl.plant.file import CHANNEL_UNITS, LIMIT_UNITS, LOAD_SYMBOLS, PlantFile
from ehsa_ctrl.plant.systems import SYSTEMS
from ehsa_ctrl.scenario.definition import ScenarioFile


def plants() -> str:
    """Keys of a plant's TOML, its symbols, limits and channels."""
    lines = [
        "# A plant's TOML",
        "",
        "In `plants/`, or anywhere if you give the path. Unknown keys are errors. Numbers have the form of "
        "[`[parameters]`](#parameters) everywhere: in `[limits]`, `[load]`, `[sampling]` and `[sensors.CHANNEL]` too.",
        *form(PlantFile),
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
    lines += [
        "",
        "## Channels",
        "",
        "Keys of `[sensors]` and `[log]`, in addition to `t`; `[log]` also has the references of the controller.",
        "",
        "| channel | unit |",
        "|---|---|",
    ]
    references = {name: CHANNELS[name].unit for name in REFERENCES}
    lines += [f"| `{name}` | {unit} |" for name, unit in (CHANNEL_UNITS | references).items()]
    lines += ["", "## Load", "", "On the command line `--set load.stiffness=50e3`.", ""]
    lines += ["| key | symbol |", "|---|---|", *(f"| `{word}` | `{symbol}` |" for word, symbol in LOAD_SYMBOLS.items())]
    return "\n".join(lines) + "\n"


def controllers() -> str:
    """Keys of a controller's TOML, one section per kind."""
    lines = [
        "# A controller's TOML",
        "",
        "In `controllers/`, or anywhere if you give the path. `kind` selects the feedback law and with it the keys; "
        "every kind accepts the stages `[trajectory]`, `[feedforward]` and `[dither]`, and those that hold a position "
        "also `[rest]`.",
    ]
    seen: set[str] = set()
    lines += ["", "## Every kind", *form(ControllerFile, level=3, title="every", seen=seen)]
    shared = set(ControllerFile.model_json_schema()["properties"]) - {"kind"}
    others = [
        f"`{name}`" for name, kind in CONTROLLER_KINDS.items() if not issubclass(kind.file, PositionControllerFile)
    ]
    at_rest = form(PositionControllerFile, level=3, title="position", seen=seen, without={*shared, "kind"})
    lines += ["", f"## Every kind but {' and '.join(others)}", *at_rest]
    shared.add("rest")
    for kind in CONTROLLER_KINDS.values():
        own = form(kind.file, level=3, title=kind.name, seen=set(seen), without=shared)
        lines += ["", f"## {kind.name}", "", sentence(kind.summary), *own]
    return "\n".join(lines) + "\n"


def scenarios() -> str:
    """Keys of a scenario's TOML."""
    lines = [
        "# A scenario's TOML",
        "",
        "In `scenarios/`, or anywhere if you give the path. [Metrics](metrics.md) lists the keys of `[limits]`.",
        *form(ScenarioFile),
    ]
    return "\n".join(lines) + "\n"


def form(
    model: type[BaseModel],
    *,
    level: int = 2,
    title: str = "",
    seen: set[str] | None = None,
    without: Collection[str] = (),
) -> list[str]:
    """A table of the keys of a file but those in `without`, and below it those of the tables in it.

    title: first word of the anchors. seen: names of models that are not repeated; those described here are added.
    """
    schema = model.model_json_schema()
    return _table(schema, schema["$defs"], "", level, title, set() if seen is None else seen, without)


def _table(
    schema: dict[str, Any],
    models: dict[str, Any],
    table: str,
    level: int,
    title: str,
    seen: set[str],
    without: Collection[str] = (),
) -> list[str]:
    seen.add(schema["title"])
    known = {key: field for key, field in schema["properties"].items() if key not in without}
    lines = []
    if table:
        word = schema["properties"].get("kind", {}).get("const", "")
        # A nested table has its own anchor, so that the same word in two kinds does not clash.
        anchor = "-".join(re.findall(r"\w+", f"{title} {table} {word}")).lower()
        lines += ["", f"{'#' * level} `[{table}]`{f' of kind `{word}`' if word else ''} {{ #{anchor} }}"]
        summary = " ".join(schema.get("description", "").split("\n\n")[0].split())
        summary = re.sub(r"^.{0,40}?\[+[\w.]+\]+[:.]?\s*", "", summary)
        lines += ["", sentence(summary)] if summary else []
    lines += ["", "| key | value | default | meaning |", "|---|---|---|---|"]
    for key, field in known.items():
        default = "required" if key in schema.get("required", ()) else _default(field)
        lines.append(f"| `{key}` | {_value(field)} | {default} | {cell(field['description'])} |")
    for key, field in known.items():
        for name, many in _nested(field):
            if name not in seen:
                path = f"{table}.{key}" if table else key
                path = f"[{path}]" if many else path
                lines += _table(models[name], models, path, level + (1 if table else 0), title, seen)
    return lines


def _alternatives(field: dict[str, Any]) -> list[dict[str, Any]]:
    parts = field.get("anyOf") or field.get("oneOf") or [field]
    return [part for part in parts if part.get("type") != "null"]


def _nested(field: dict[str, Any]) -> Iterator[tuple[str, bool]]:
    """Names of the models that a key may hold, and whether it is an array of them."""
    for part in _alternatives(field):
        if "$ref" in part:
            yield part["$ref"].rpartition("/")[2], False
        for inner in (part.get("items"), part.get("additionalProperties")):
            if isinstance(inner, dict):
                yield from ((name, "items" in part) for name, _ in _nested(inner))


def _value(field: dict[str, Any]) -> str:
    """The values of a key, in words."""
    parts = _alternatives(field)
    part = parts[0]
    words = part.get("enum") or ([part["const"]] if "const" in part else [])
    kinds = {"boolean": "`true` or `false`", "integer": "whole number", "number": "number", "string": "text"}
    if isinstance(part.get("additionalProperties"), dict):
        names = part.get("propertyNames", {}).get("enum", ())
        return "table of " + (", ".join(f"`{word}`" for word in names) or "names")
    if words:
        return " or ".join(f"`{word}`" for word in words)
    if "unit" in part:
        return "number" if part["unit"] in ("1", "fraction") else f'`"... {part["unit"]}"`'
    if "prefixItems" in part:
        return f"[{', '.join(_value(item) for item in part['prefixItems'])}]"
    if "items" in part:
        several = next(_nested(field), None)
        return "tables" if several else f"list of {_value(part['items'])}".replace("number", "numbers")
    return "table" if "$ref" in part else kinds.get(part.get("type", ""), "")


def _default(field: dict[str, Any]) -> str:
    value = field.get("default")
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        unit = next((f" {part['unit']}" for part in _alternatives(field) if "unit" in part), "")
        unit = "" if unit in (" 1", " fraction") else unit
        return "none" if value in (float("inf"), float("-inf")) else f"`{value:.4g}{unit}`"
    return f"`{value}`" if isinstance(value, str | int) and value != "" else ""
