"""Commented TOML files for `ehsa-ctrl new`: an existing plant, controller or scenario filled into its template."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit

from ..core.catalogue import controllers, is_shipped, plants, shipped
from ..core.errors import InputError, choices
from ..core.files import read_toml
from ..core.log import CHANNELS
from ..core.unit import unit_suffix
from ..design.kinds import CONTROLLER_KINDS, ControllerKind
from ..design.load import read_controller
from ..design.specification import definition_keys
from ..physics.effects import EFFECTS
from ..plant.file import CHANNEL_UNITS, LIMIT_UNITS, LOAD_SYMBOLS
from ..plant.load import load_plant, models_of
from ..plant.plant import Plant
from ..plant.systems import SYSTEMS
from ..scenario.definition import load_scenario
from ..scenario.metrics import METRICS
from ..scenario.rescaling import is_for_shipped_ehsa, rescaling_to
from ..simulation.limits import NAMES
from .template import HOW, KeyLine, comment, fill, form_template, sections, template, to_toml

QUANTITIES = 'Quantities are texts with any unit that converts ("20 mm", "50 kN/m"); the SI unit is in brackets.'
#: Tables of a model: [linear], [linear.parameters], [linear.estimation].
PARTS = ("", ".parameters", ".estimation")
#: Example of a limit in the metric's display unit. Engineering judgement: generous, so that few runs exceed it.
EXAMPLE_LIMITS = {"ms": "2000", "mm": "5", "%": "30", "A": "3", "J": "500"}


def plant_commands(base: str, name: str) -> list[str]:
    """The next commands for a new plant. Raises InputError as load_plant does."""
    check = f"ehsa-ctrl check plants/{name}.toml"
    if "linear" not in models_of(plants.find(base)):
        return [check, f"ehsa-ctrl compare log.csv --plant {name}", f"ehsa-ctrl identify log.csv --plant {name}"]
    return [check, f"ehsa-ctrl analyse {name}", f"ehsa-ctrl run steps_spring --plant {name} --out results/{name}"]


def plant_toml(base: str, name: str) -> str:
    """Template filled with the plant `base`, for a file NAME.toml. Raises InputError as load_plant does."""
    path = plants.find(base)
    models = {word: load_plant(path, model=word) for word in models_of(path)}
    channels = next(iter(models.values())).structure.system.channels
    text = template("plant").replace("SYSTEMS", ", ".join(SYSTEMS))
    start, end = text.index("# Sensor of the channel"), text.index("# Columns of the rig's")
    sensors = (text[start:end].replace("CHANNEL", word).replace("UNIT", CHANNELS[word].unit) for word in channels)
    given = _titled(path, name)
    # The template's comments describe its example columns, not those of the plant.
    columns = re.sub("  # .*", "", text[end:]) if "log" in given else text[end:]
    text = text[:start] + "".join(sensors) + columns
    log = {row.key for part in sections(text) if part.name == "log" for row in part.rows if isinstance(row, KeyLine)}
    symbols = {kind.name: kind for plant in models.values() for kind in plant.structure.equations.parameters}
    meanings: list[KeyLine | str] = []
    for kind in symbols.values():
        least = f", {'greater than' if kind.lower_open else 'at least'} {kind.lower:g}" if kind.lower > -1e29 else ""
        meanings.append(KeyLine(kind.name, None, f"{kind.meaning} [{kind.unit}]{least}"))
    limits = {**NAMES, "stroke": "full stroke of the rod, half of it to either side of x = 0"}
    more: dict[str, Sequence[KeyLine | str]] = {
        "parameters": meanings,
        "linear.parameters": meanings,
        "nonlinear.parameters": [*meanings, *_effect_rows(models["nonlinear"])] if "nonlinear" in models else [],
        "limits": [KeyLine(limit, None, f"{limits[limit]} [{unit}]") for limit, unit in LIMIT_UNITS.items()],
        "log": [
            KeyLine(word, '{ column = "NAME", scale = 1.0, offset = 0.0 }') for word in channels if word not in log
        ],
    }
    foreign = {f"log.{word}" for word in CHANNEL_UNITS if word not in (*channels, "current_measured")}
    foreign |= {f"{word}{end}" for word in ("linear", "nonlinear") if word not in models for end in PARTS}
    foreign |= {f"load.{word}" for word, symbol in LOAD_SYMBOLS.items() if symbol not in symbols}
    free = {f"{word}.free": list(plant.free) for word, plant in models.items()}
    head = comment(f"{name}: a plant, started from {path.stem}.", *_indented(plant_commands(base, name)), HOW)
    return "\n".join(head) + "\n" + fill(text, given, more=more, without=foreign, example=lambda k, v: free.get(k, v))


def _effect_rows(plant: Plant) -> list[KeyLine | str]:
    """Parameters of the effects that the plant does not have: commented out, with their typical values."""
    rows: list[KeyLine | str] = [
        *comment("Parameters of effects that `effects` switches on by name, with their defaults:")
    ]
    for effect in EFFECTS.values():
        if effect.wired and effect.name not in plant.structure.effects:
            for p in effect.parameters:
                neutral = f"; no effect at {p.neutral:g}" if p.neutral != p.typical else ""
                value = f'{{ value = {to_toml(p.typical)}, unit = "{p.unit}", source = "assumed" }}'
                rows.append(KeyLine(p.name, value, f"{effect.name}: {p.meaning}{neutral}"))
    return rows


def controller_commands(name: str, plant: str | None = None) -> list[str]:
    """The next commands for a new controller."""
    on = f" --plant {plant}" if plant is not None else ""
    return [
        f"ehsa-ctrl check controllers/{name}.toml{on}",
        f"ehsa-ctrl analyse {plant or 'ehsa'} --controller {name}",
        f"ehsa-ctrl run steps_spring --controller {name}{on}",
    ]


def controller_toml(base: str, name: str, *, plant: str | None = None) -> str:
    """Template filled with the controller `base`, for a file NAME.toml.

    plant: plant to whose limits, sample time and scales a shipped controller and the examples are rescaled.

    Raises InputError for an unknown or invalid controller or plant.
    """
    path = controllers.find(base)
    kind, _ = read_controller(path)
    unit = load_plant(plant, model=models_of(plant)[0]).structure.system.drive_unit if plant is not None else "A"
    of_ehsa = is_for_shipped_ehsa(path)
    if unit != "A" and of_ehsa:
        raise InputError(
            f"--plant {plant}: its drive is in {unit}, the shipped controllers are in A; write one by "
            f"`ehsa-ctrl design {plant} --kind {kind.name} --current-limit '100 {unit}' -o {name}.toml`"
        )
    given = _titled(path, name)
    example = _rescale(given, plant, shipped_base=of_ehsa, keys=definition_keys(kind.file))
    head = _controller_head(kind, name, f"started from {path.stem}", plant)
    text = template(f"controller_{kind.name}", "controller_stages") or form_template(kind.file)
    return head + fill(text, given, example=example)


def controller_of_form(kind: str, name: str, *, plant: str | None = None) -> str:
    """A controller of a kind without any example: every key of its form, required ones with a placeholder.

    Raises InputError for a plant that is wrong.
    """
    form = CONTROLLER_KINDS[kind].file
    given = tomlkit.parse(tomlkit.dumps(tomllib.loads(form_template(form, required=True)) | {"title": name}))
    head = _controller_head(CONTROLLER_KINDS[kind], name, "with placeholders: replace each value that is set", plant)
    return head + fill(form_template(form), given, example=_rescale(given, plant, shipped_base=False))


def _controller_head(kind: ControllerKind, name: str, start: str, plant: str | None) -> str:
    """The comments at the top of a controller's file."""
    head = comment(
        f"{name}: a controller of the kind {kind.name!r}, {kind.summary}, {start}. Other kinds: "
        f"{', '.join(word for word in CONTROLLER_KINDS if word != kind.name)}.",
        "It is designed on the linear model of the plant that it is used with. Positive current and position extend "
        "the rod.",
        *([f"Limits, sample time and scales are for the plant {plant}."] if plant is not None else []),
        *_indented(controller_commands(name, plant)),
        QUANTITIES,
        HOW,
    )
    return "\n".join(head) + "\n\n"


def reference_kinds() -> list[str]:
    """The kinds of a scenario's reference."""
    return [str(section.kind) for section in sections(template("scenario")) if section.name == "reference"]


def scenario_of_kind(kind: str) -> str:
    """Shortest shipped scenario with this kind of reference. Raises InputError if there is none."""
    if kind not in reference_kinds():
        raise InputError(f"--kind {kind!r}: no such kind of reference; {choices(kind, reference_kinds())}")
    found = {name: read_toml(path) for name, path in shipped("scenarios").items()}
    names = [name for name in found if found[name].get("reference", {}).get("kind") == kind]
    if not names:
        raise InputError(f"there is no scenario with kind = {kind!r} to start from; name one with --from")
    # steps_spring comes first: the documentation uses it.
    return min(names, key=lambda name: (name != "steps_spring", len(str(found[name]))))


def scenario_commands(name: str) -> list[str]:
    """The next commands for a new scenario."""
    return [
        f"ehsa-ctrl check scenarios/{name}.toml",
        f"ehsa-ctrl run {name} --out results/{name}",
        f"pytest scenarios/{name}.toml",
    ]


def scenario_toml(base: str, name: str, *, plant: str | None = None, controller: str | None = None) -> str:
    """Template filled with the scenario `base`, for a file NAME.toml, with another plant or controller if given.

    Raises InputError for an unknown or invalid scenario, plant or controller.
    """
    begun = load_scenario(base)
    assert begun.path is not None
    given = _titled(begun.path, name)
    given.update({key: word for key, word in (("plant", plant), ("controller", controller)) if word is not None})
    loaded = load_plant(plants.find(str(given["plant"]), beside=begun.path))
    example = _rescale(given, plant, shipped_base=is_shipped("scenarios", begun.path))
    kinds = {kind.name: kind for kind in loaded.structure.equations.parameters}
    limits = []
    for metric, known in METRICS.items():
        if not begun.definition.reason_undefined(metric):
            size, unit = EXAMPLE_LIMITS.get(known.display_unit, "10"), unit_suffix(known.display_unit)
            value = f'{{ max = "{size}{unit}" }}' if unit else f"{{ max = {size} }}"
            limits.append(KeyLine(metric, value, known.meaning + (f" [{known.display_unit}]" if unit else "")))
    more: dict[str, Sequence[KeyLine | str]] = {
        "settings": [
            KeyLine(symbol, to_toml(p.text), f"{kinds[symbol].meaning} [{p.unit}]")
            for symbol, p in loaded.parameters.items()
            if symbol not in LOAD_SYMBOLS.values()
        ],
        "limits": limits,
    }
    foreign = {f"load.{word}" for word, symbol in LOAD_SYMBOLS.items() if symbol not in kinds}
    head = comment(
        f"{name}: a scenario, started from {begun.path.stem}: simulation, regression test and section of the report.",
        "x = 0 is mid-stroke, positions are positive towards extension, forces where they resist it.",
        *_indented(scenario_commands(name)),
        QUANTITIES,
        HOW,
    )
    return "\n".join(head) + "\n\n" + fill(template("scenario"), given, more=more, without=foreign, example=example)


def _titled(path: Path, name: str) -> Any:
    """A definition as tomlkit parses it, with another title."""
    given = tomlkit.parse(path.read_text(encoding="utf-8"))
    given["title"] = f"{name}, started from {path.stem}"
    return given


def _rescale(given: Any, plant: str | None, *, shipped_base: bool, keys: Iterable[str] = ()) -> Any:
    """Rescale a shipped definition to a plant, in place; return the function that rescales a template's example."""
    if plant is None:
        return lambda key, value: value
    to_plant = rescaling_to(plant)
    if shipped_base:
        changes: Mapping[str, Any] = to_plant.changes(given.unwrap(), keys)
        for key, value in changes.items():
            *tables, last = key.split(".")
            place = given
            for table in tables:
                place = place.setdefault(table, {})
            place[last] = value
            place.item(last).trivia.comment = ""
        # The note is about the numbers of the shipped plant.
        given.pop("note", None)
    return to_plant.scale


def _indented(commands: Iterable[str]) -> list[str]:
    return [f"  {command}" for command in commands]
