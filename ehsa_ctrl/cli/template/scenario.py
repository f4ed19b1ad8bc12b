"""A scenario's commented TOML."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from ...core.catalogue import is_shipped, plants, shipped
from ...core.errors import InputError, choices
from ...core.files import read_toml
from ...plant.file import LOAD_SYMBOLS
from ...plant.plant import Plant, load_plant
from ...scenario.carried import carrier
from ...scenario.definition import ScenarioFile
from ...scenario.metrics import METRICS
from ...scenario.scenario import load_scenario
from .annotate import QUANTITIES, Annotator, Lines, change, examples_of, kinds, leaves, named, toml

#: For keys that no shipped scenario has.
EXAMPLES: dict[str, Any] = {
    "expect_trips": ["stroke"],
    "load.hardening": "1e6 N/m3",
    "sensors.noise": False,
    "sensors.speed.noise": "2 rad/s",
    "sensors.p1.noise": "50 kPa",
    "sensors.p2.noise": "50 kPa",
    "sensors.force.noise": "50 N",
    "sensors.speed.step": "1 rad/s",
    "sensors.p1.step": "20 kPa",
    "sensors.p2.step": "20 kPa",
    "sensors.force.step": "10 N",
    "sensors.speed.delay": "4 ms",
    "sensors.p1.delay": "4 ms",
    "sensors.p2.delay": "4 ms",
    "sensors.force.delay": "4 ms",
    "supervision.speed": "450 rad/s",
    "supervision.pressure_min": "0 bar",
    "supervision.pressure_max": "200 bar",
}
#: A limit that is seldom too strict, in the unit that a person reads.
LOOSE = {"ms": "2000", "mm": "5", "%": "30", "A": "3", "J": "500"}


def reference_kinds() -> list[str]:
    """What `[reference] kind` may be."""
    from ...core.described import keys

    return list(kinds(next(key for key in keys(ScenarioFile) if key.name == "reference").forms))


def base_of(kind: str) -> str:
    """The shipped scenario with this kind of reference that has least beside it. Raises InputError for none such."""
    if kind not in reference_kinds():
        raise InputError(f"--kind {kind!r}: no such kind of reference; {choices(kind, reference_kinds())}")
    found = {name: read_toml(path) for name, path in shipped("scenarios").items()}
    names = [name for name in found if found[name].get("reference", {}).get("kind") == kind]
    if not names:
        raise InputError(f"there is no scenario with kind = {kind!r} to start from; name one with --from")
    # The one for 10 mm steps is what the documentation speaks of.
    return min(names, key=lambda name: (name != "steps_spring", len(leaves(found[name]))))


def reference_of(base: str) -> str:
    """The kind of a scenario's reference. Raises InputError as load_scenario does."""
    return load_scenario(base).definition.reference.kind


def trajectory(base: str) -> tuple[str, Path] | None:
    """The file of a scenario's reference, as it is written there and where it is; None for one without."""
    loaded = load_scenario(base)
    name = getattr(loaded.definition.reference, "file", None)
    if name is None or Path(name).is_absolute() or loaded.path is None:
        return None
    return name, loaded.path.parent / name


def next_commands(name: str) -> list[str]:
    """What to call next."""
    return [
        f"ehsa-ctrl check scenarios/{name}.toml",
        f"ehsa-ctrl run {name} --out results/{name}",
        f"pytest scenarios/{name}.toml",
    ]


def scenario_toml(base: str, name: str, *, plant: str | None = None, controller: str | None = None) -> str:
    """The scenario `base`, commented, as a file of another name, with another plant or controller if asked for.

    Raises InputError: no such scenario, plant or controller, or one that is wrong.
    """
    begun = load_scenario(base)
    path = begun.path
    assert path is not None
    given = tomlkit.parse(path.read_text(encoding="utf-8"))
    given["title"] = f"{name}, begun as {path.stem}"
    for key, other in (("plant", plant), ("controller", controller)):
        if other is not None:
            given[key] = other
    loaded = load_plant(plants.find(str(given["plant"]), beside=path))
    examples = {**EXAMPLES, **examples_of(shipped("scenarios").values())}
    if plant is not None:
        to_plant = carrier(plant)
        examples = {key: to_plant.carry(key, value) for key, value in examples.items()}
        if is_shipped("scenarios", path):
            change(given, to_plant.changes(given.unwrap(), ()))
    special = {
        "load": lambda there: named("load", there, _load(loaded, examples)),
        "settings": lambda there: named("settings", there, _settings(loaded)),
        "limits": lambda there: named("limits", there, _limits(begun.definition)),
        "spread": lambda there: _spread(there, examples),
    }
    head = [
        f"{name}: a scenario, begun as {path.stem}; simulation, regression test and section of the report in one.",
        "x = 0 is mid-stroke, positions are positive towards extension, forces where they resist it.",
        *(f"  {line}" for line in next_commands(name)),
        QUANTITIES,
    ]
    return Annotator(ScenarioFile, given, examples, special, context={"folder": path.parent}).text(head)


def _load(plant: Plant, examples: Mapping[str, Any]) -> list[tuple[str, str, str | None]]:
    kinds_ = {kind.name: kind for kind in plant.structure.equations.parameters}
    rows: list[tuple[str, str, str | None]] = []
    for word, symbol in LOAD_SYMBOLS.items():
        if symbol in kinds_:
            said = f"{kinds_[symbol].meaning.split(' (')[0]} [{kinds_[symbol].unit}]; left out: as in the plant"
            rows.append((word, said, toml(examples.get(f"load.{word}", f"0 {kinds_[symbol].unit}"))))
    return rows


def _settings(plant: Plant) -> list[tuple[str, str, str | None]]:
    kinds_ = {kind.name: kind for kind in plant.structure.equations.parameters}
    return [
        (name, f"{kinds_[name].meaning} [{p.unit}]", toml(p.written or f"{p.value:g} {p.unit}"))
        for name, p in plant.parameters.items()
        if name not in LOAD_SYMBOLS.values()
    ]


def _limits(definition: ScenarioFile) -> list[tuple[str, str, str | None]]:
    rows: list[tuple[str, str, str | None]] = []
    for name, metric in METRICS.items():
        if definition.undefined(name):
            continue
        size = LOOSE.get(metric.shown, "10")
        bound = toml(f"{size} {metric.shown}") if metric.shown != "1" else size
        unit = "" if metric.shown == "1" else f" [{metric.shown}]"
        rows.append((name, f"{metric.meaning}{unit}", f"{{ max = {bound} }}"))
    return rows


def _spread(there: Any, examples: Mapping[str, Any]) -> Lines:
    if there is not None:
        return ["[spread]", *str(there.as_string()).rstrip().splitlines()]
    found = {key.removeprefix("spread."): value for key, value in examples.items() if key.startswith("spread.")}
    return ["#[spread]", *(f"#{key} = {toml(value)}" for key, value in found.items())]
