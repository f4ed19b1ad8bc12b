"""A controller's commented TOML."""

from __future__ import annotations

import tomlkit

from ...core.catalogue import controllers, shipped
from ...core.reading import read_toml
from ...design.kinds import CONTROLLER_KINDS
from ...design.load import read_controller
from ...design.tuning.specification import begin
from .annotate import QUANTITIES, Annotator, examples_of

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


def next_commands(name: str) -> list[str]:
    """What to call next."""
    return [
        f"ehsa-ctrl check controllers/{name}.toml",
        f"ehsa-ctrl analyse ehsa --controller {name}",
        f"ehsa-ctrl run steps_spring --controller {name}",
    ]


def controller_base(kind: str) -> str:
    """The shipped controller that one of this kind begins as. Raises InputError for an unknown kind."""
    _, content = begin(kind)
    return next(name for name in controllers if read_toml(controllers[name]) == content)


def controller_toml(base: str, name: str) -> str:
    """The shipped (or the user's) controller `base`, commented, as a file of another name.

    Raises InputError: no such controller, or one that is wrong.
    """
    path = controllers.find(base)
    kind, _ = read_controller(path)
    given = tomlkit.parse(path.read_text(encoding="utf-8"))
    given["title"] = f"{name}, begun as {path.stem}"
    files = [path for _, path in sorted(shipped("controllers").items())]
    files.sort(key=lambda other: read_toml(other).get("kind") != kind.name)
    examples = {**EXAMPLES, **examples_of(files)}
    head = [
        f"{name}: a controller of the kind {kind.name!r}, {kind.summary}; the kinds are {', '.join(CONTROLLER_KINDS)}.",
        "It is designed on the linear model of the plant that it is used with. Positive current extends the rod; "
        "positions are positive towards extension.",
        *(f"  {line}" for line in next_commands(name)),
        QUANTITIES,
    ]
    return Annotator(kind.file, given, examples).text(head)
