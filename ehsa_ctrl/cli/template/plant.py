"""A plant's commented TOML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomlkit

from ...core.catalogue import plants, shipped
from ...core.described import keys
from ...physics.effects import EFFECTS
from ...physics.friction import LAWS
from ...plant.file import CHANNEL_UNITS, LIMIT_UNITS, LOAD_SYMBOLS, PlantFile, Quantity, SensorFile
from ...plant.plant import Plant, load_plant, models_of
from ...plant.system import ParameterKind
from ...plant.systems import SYSTEMS
from ...simulation.limits import NAMES
from .annotate import Annotator, Lines, comment, examples_of, meaning, named, toml

#: Somebody else's log, as an example: bar, rpm, milliseconds, a position counted from the end stop, tension positive.
LOG = {
    "t": ('{ column = "time_ms", scale = 1e-3 }', "milliseconds to s"),
    "current": ('{ column = "I_set_A" }', "asked of the drive, A"),
    "current_measured": ('{ column = "I_motor_A" }', "of the motor, where it is logged, A"),
    "speed": ('{ column = "n_rpm", scale = 0.10471976 }', "rpm to rad/s"),
    "p1": ('{ column = "p_upper_bar", scale = 1e5 }', "bar to Pa, gauge"),
    "p2": ('{ column = "p_lower_bar_abs", scale = 1e5, offset = -101325 }', "bar absolute to Pa gauge"),
    "position": ('{ column = "stroke_mm", scale = 1e-3, offset = -0.1 }', "mm from the end stop to m from mid-stroke"),
    "force": ('{ column = "F_kN", scale = -1e3 }', "kN, pulling positive, to N resisting extension"),
}
#: Words of a sensor that a shipped plant does not have.
SENSOR = {"filter": "2 ms", "delay": "4 ms", "scale": "1.01 1"}


def next_commands(base: str, name: str) -> list[str]:
    """What to call next; without a linear model there is nothing to analyse and to control.

    Raises InputError: no such plant to begin as, or one that is wrong.
    """
    check = f"ehsa-ctrl check plants/{name}.toml"
    if "linear" not in models_of(plants.find(base)):
        return [check, f"ehsa-ctrl compare log.csv --plant {name}", f"ehsa-ctrl identify log.csv --plant {name}"]
    return [check, f"ehsa-ctrl analyse {name}", f"ehsa-ctrl run steps_spring --plant {name} --out results/{name}"]


def plant_toml(base: str, name: str) -> str:
    """The plant `base`, commented, as a file of another name.

    Raises InputError: no such plant, or one that is wrong.
    """
    path = plants.find(base)
    models = {word: load_plant(path, model=word) for word in models_of(path)}
    given = tomlkit.parse(path.read_text(encoding="utf-8"))
    given["title"] = f"{name}, begun as {path.stem}"
    last = list(models.values())[-1]
    examples = examples_of(shipped("plants").values())
    for word, plant in models.items():
        examples |= {
            f"{word}.effects": ["end_stop"],
            f"{word}.free": list(plant.free),
            f"{word}.estimation.width": "0.2 s",
        }
    known = {kind.name: kind for plant in models.values() for kind in plant.structure.equations.parameters}
    special = {
        "parameters": lambda there: named("parameters", there, _shared(known, there)),
        "load": lambda there: named("load", there, _load(known)),
        "limits": lambda there: named("limits", there, _limits()),
        "sensors": lambda there: _sensors(last, there),
        "log": lambda there: named("log", there, _log(last, there)),
        **{f"{word}.parameters": _own(word, plant) for word, plant in models.items()},
    }
    described = {key.name: key for key in keys(Quantity)}
    head = [
        f"{name}: a plant, begun as {path.stem}; systems are {', '.join(SYSTEMS)}, friction laws {', '.join(LAWS)}.",
        "A number has these keys:",
        *(f"  {word}: {meaning(described[word], left_out=False)}" for word in described),
        "Reports list what is only assumed. x = 0 is mid-stroke; positive current, speeds, positions extend the rod, "
        "positive forces resist that.",
        *(f"  {line}" for line in next_commands(base, name)),
    ]
    return Annotator(PlantFile, given, examples, special).text(head)


def _said(kind: ParameterKind) -> str:
    least = f", {'greater than' if kind.lower_open else 'at least'} {kind.lower:g}" if kind.lower > -1e29 else ""
    return f"{kind.meaning} [{kind.unit}]{least}"


def _shared(known: Mapping[str, ParameterKind], there: Any) -> list[tuple[str, str, str | None]]:
    return [(name, _said(known[name]), None) for name in (there or {}) if name in known]


def _own(word: str, plant: Plant) -> Any:
    """Lines of one model's parameters, and those of the effects that it does not have."""
    known = {kind.name: kind for kind in plant.structure.equations.parameters}

    def lines(there: Any) -> Lines:
        found = named(f"{word}.parameters", there, [(name, _said(known[name]), None) for name in there or {}])
        if word == "nonlinear":
            found += comment(
                "Parameters of effects, which `effects` switches on by name; these are the values of those left out:"
            )
            found += _effects(plant)
        return found

    return lines


def _effects(plant: Plant) -> Lines:
    lines: Lines = []
    for effect in EFFECTS.values():
        if not effect.wired or effect.name in plant.structure.effects:
            continue
        for p in effect.parameters:
            number = {"value": p.typical, "unit": p.unit, "source": "assumed"}
            neutral = f"; no effect at {p.neutral:g}" if p.neutral != p.typical else ""
            lines.append(f"#{p.name} = {toml(number)}  # {effect.name}: {p.meaning}{neutral}")
    return lines


def _load(known: Mapping[str, ParameterKind]) -> list[tuple[str, str, str | None]]:
    return [
        (word, _said(known[symbol]), _number(0.0, known[symbol].unit))
        for word, symbol in LOAD_SYMBOLS.items()
        if symbol in known
    ]


def _limits() -> list[tuple[str, str, str | None]]:
    said = {**NAMES, "stroke": "the rod's whole way, half of it to either side of x = 0"}
    return [(name, f"{said[name]} [{unit}]", None) for name, unit in LIMIT_UNITS.items()]


def _sensors(plant: Plant, there: Any) -> Lines:
    """A table a channel; what may be said of each is written out at the first one."""
    lines: Lines = []
    for channel in plant.structure.system.channels:
        set_ = None if there is None else there.get(channel)
        unit = CHANNEL_UNITS[channel]
        rows = []
        for key in keys(SensorFile):
            word_unit = {"scale": "1", "delay": "s", "filter": "s"}.get(key.name, unit)
            value, written = SENSOR.get(key.name, f"0 {unit}").split(" ", 1)
            example = None if lines else _number(float(value), written)
            rows.append((key.name, f"{key.meaning} [{word_unit}]", example))
        lines += [*([""] if lines else []), *named(f"sensors.{channel}", set_, rows)]
    return lines


def _log(plant: Plant, there: Any) -> list[tuple[str, str, str | None]]:
    rows: list[tuple[str, str, str | None]] = []
    for channel in ("t", *plant.structure.system.channels, "current_measured"):
        example, said = LOG.get(channel, ('{ column = "NAME", scale = 1.0, offset = 0.0 }', ""))
        rows.append((channel, said if there is None or channel not in there else "as this rig logs it", example))
    return rows


def _number(value: float, unit: str) -> str:
    return toml({"value": value, "unit": unit, "source": "assumed"})
