"""A controller's commented TOML."""

from __future__ import annotations

import tomlkit

from ...core.catalogue import controllers, is_shipped, shipped
from ...core.files import read_toml
from ...design.kinds import CONTROLLER_KINDS
from ...design.load import read_controller
from ...design.tuning.specification import leaves as known_keys
from ...scenario.carried import carrier
from .annotate import QUANTITIES, Annotator, change, examples_of

#: For keys that no shipped controller has.
EXAMPLES = {
    "tracking_time": "50 ms",
    "rest.knocker.first": "0.3 A",
    "rest.knocker.growth": "0.05 A",
    "rest.knocker.largest": "1.5 A",
    "dither.amplitude": "0.3 A",
    "dither.frequency": "60 Hz",
    "feedforward.stiffness": "16 A/m",
    "tuning.crossover": "20 rad/s",
    "weights.speed": "50 rad/s",
    "weights.pressure": "20 bar",
    "weights.current_rate": "200 A/s",
    "weights.integral": "0.1 mm s",
    "gains.k_p": "500 A/m",
    "gains.k_i": "1500 A/(m s)",
    "gains.k_d": "10 A s/m",
    "gains.T_f": "4 ms",
    "solver.deadline": "4 ms",
    "schedule.points.stiffness": "50 kN/m",
    "schedule.points.mass": "50 kg",
}


def next_commands(name: str, plant: str | None = None) -> list[str]:
    """What to call next."""
    on = f" --plant {plant}" if plant is not None else ""
    return [
        f"ehsa-ctrl check controllers/{name}.toml{on}",
        f"ehsa-ctrl analyse {plant or 'ehsa'} --controller {name}",
        f"ehsa-ctrl run steps_spring --controller {name}{on}",
    ]


def controller_toml(base: str, name: str, *, plant: str | None = None) -> str:
    """The shipped (or the user's) controller `base`, commented, as a file of another name.

    plant: whose limits, sample time and scales a shipped controller gets, and every example; else the shipped EHSA's.

    Raises InputError: no such controller or plant, or one that is wrong.
    """
    path = controllers.find(base)
    kind, _ = read_controller(path)
    given = tomlkit.parse(path.read_text(encoding="utf-8"))
    given["title"] = f"{name}, begun as {path.stem}"
    files = [path for _, path in sorted(shipped("controllers").items())]
    files.sort(key=lambda other: read_toml(other).get("kind") != kind.name)
    examples = {**EXAMPLES, **examples_of(files)}
    if plant is not None:
        to_plant = carrier(plant)
        examples = {key: to_plant.carry(key, value) for key, value in examples.items()}
        if is_shipped("controllers", path):
            change(given, to_plant.changes(given.unwrap(), known_keys(kind.file)))
            given.pop("note", None)
        # What notes say of numbers holds for the plant that they are of.
        examples.pop("note", None)
    head = [
        f"{name}: a controller of the kind {kind.name!r}, {kind.summary}; the kinds are {', '.join(CONTROLLER_KINDS)}.",
        "It is designed on the linear model of the plant that it is used with. Positive current extends the rod; "
        "positions are positive towards extension.",
        *([f"Limits, sample time and scales are for the plant {plant}."] if plant is not None else []),
        *(f"  {line}" for line in next_commands(name, plant)),
        QUANTITIES,
    ]
    return Annotator(kind.file, given, examples).text(head)
