"""Design of a controller to a specification: keys of its definition, and required figures of its loop."""

from __future__ import annotations

import copy
import difflib
import textwrap
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from ..core.catalogue import controllers
from ..core.definition import validate
from ..core.errors import InputError, choices
from ..core.files import read_toml
from ..core.unit import parse
from .analysis.closed_loop import INPUTS, OUTPUTS, close_loop, discrete_response, spectral_radius
from .analysis.loop import LoopAnalysis, analyse_loop
from .controller import SampledController
from .kinds import CONTROLLER_KINDS, ControllerFile, ControllerKind
from .load import build_controller

if TYPE_CHECKING:
    import control

#: Tables of which a definition has one: a key of one removes the others.
ALTERNATIVES = ("design", "tuning", "gains")
#: Command line options for the keys of one table.
OPTIONS = {"weights": "--weight", "limits": "--limit"}
#: Figures that can be required: word -> (unit, bound from below or above).
FIGURES = {
    "bandwidth": ("rad/s", "least"),
    "phase_margin": ("deg", "least"),
    "Ms": ("1", "largest"),
    "Mt": ("1", "largest"),
    "disk_margin": ("1", "least"),
    "noise_gain": ("A/m", "largest"),
}
#: Range of position weights [m] that is searched for a bandwidth.
WEIGHTS = (1e-6, 1.0)


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
    raise InputError(
        f"there is no {kind!r} controller to start from; write one with this kind in controllers/, see "
        "docs/how-to/own-controller.md"
    )


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


@dataclass(frozen=True)
class ControllerDesign:
    """A designed controller.

    Attributes
    ----------
    content: of its TOML. controller, loop: on the design model.
    """

    content: dict[str, Any]
    controller: SampledController
    loop: LoopAnalysis

    def toml(self, comments: list[str]) -> str:
        """The TOML with law and loop as comments."""
        reached = [line.strip() for line in f"{self.controller.law}\n{self.loop}".splitlines()]
        return toml_text(self.content, [*comments, *reached])


def keys_for(kind: ControllerKind, figures: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Split required figures into keys of this kind's definition, and those to be checked on the loop."""
    known = set(leaves(kind.file))
    classic = "phase_margin" in figures and "design.phase_margin" in known
    table = "design" if classic else "tuning"
    places = {"bandwidth": (f"{table}.crossover", "position.crossover")}
    keys: dict[str, str] = {}
    checked: dict[str, str] = {}
    for word, text in figures.items():
        options = places.get(word, (f"{table}.{word}", f"position.{word}"))
        key = next((option for option in options if option in known), None)
        (checked if key is None else keys)[word if key is None else key] = text
    return keys, checked


def design(
    name: str,
    kind: ControllerKind,
    content: Mapping[str, Any],
    system: control.StateSpace,
    *,
    figures: Mapping[str, str] | None = None,
    asked: Mapping[str, str] | None = None,
) -> ControllerDesign:
    """Design a controller to a specification.

    Parameters
    ----------
    content: the definition to start from, see specification.begin.
    figures: words of FIGURES -> text with a unit. A figure that is a key of the kind's design sets that key. Otherwise
        a bandwidth is that of `bandwidth_of`, reached by the weight of the position, and the others are checked only.
    asked: keys of the definition -> text, see specification.put.

    Raises InputError for unknown keys, a design that can't be reached, and a figure that the loop does not have.
    """
    keys, checked = keys_for(kind, figures or {})
    wanted = {word: parse(text, FIGURES[word][0]) for word, text in checked.items()}
    whole = put(dict(content), kind, {**keys, **(asked or {})})
    if "bandwidth" in wanted and "weights.position" in leaves(kind.file):
        whole = _with_bandwidth(name, kind, whole, system, wanted["bandwidth"])
    found = _build(name, kind, whole, system)
    for word, value in wanted.items():
        got = bandwidth_of(system, found.controller) if word == "bandwidth" else found.loop.figure(word)
        unit, which = FIGURES[word]
        if got < value * (1 - 1e-3) if which == "least" else got > value * (1 + 1e-3):
            raise InputError(
                f"{word} = {value:.4g}{f' {unit}' if unit != '1' else ''} was asked for as the {which} value; "
                f"the loop of this {kind.name} has {got:.4g}: change what it is designed from with --spec, "
                "or ask for less"
            )
    return found


def bandwidth_of(system: control.StateSpace, controller: SampledController) -> float:
    """Bandwidth [rad/s] from position reference to position, -3 dB; 0 for an unstable loop.

    The gain crossover of a state feedback's loop at the current is that of its speed feedback and says nothing of it.
    """
    _, _, closed = close_loop(system, controller)
    if spectral_radius(closed.A) >= 1.0:
        return 0.0
    omega = np.geomspace(0.1, np.pi / controller.sample_time, 2000)
    channel = closed[OUTPUTS.index("position"), INPUTS.index("r_position")]
    size = np.abs(discrete_response(channel, omega)[:, 0, 0])
    below = np.flatnonzero(size < np.sqrt(0.5))
    return float(omega[below[0]]) if below.size else float(omega[-1])


def _build(name: str, kind: ControllerKind, content: dict[str, Any], system: control.StateSpace) -> ControllerDesign:
    definition = validate(content, kind.file, name)
    assert isinstance(definition, ControllerFile)
    controller = build_controller(name, kind, definition, system)
    return ControllerDesign(content, controller, analyse_loop(system, controller))


def _with_bandwidth(
    name: str, kind: ControllerKind, content: dict[str, Any], system: control.StateSpace, bandwidth: float
) -> dict[str, Any]:
    """The definition with the position weight that gives the bandwidth, by bisection in its logarithm."""

    def attempt(position: float) -> tuple[dict[str, Any], float]:
        other = put(content, kind, {"weights.position": f'"{position:.4g} m"'})
        definition = validate(other, kind.file, name)
        return other, bandwidth_of(system, build_controller(name, kind, definition, system))

    strict, loose = (log(value) for value in WEIGHTS)
    best, reached = attempt(WEIGHTS[0])
    if reached < bandwidth:
        raise InputError(
            f"bandwidth = {bandwidth:.4g} rad/s is not reached by any weight of the position; the loop comes to "
            f"{reached:.4g} rad/s: let the current cost less (--spec weights.current) or ask for less"
        )
    for _ in range(12):
        middle = 0.5 * (strict + loose)
        other, reached = attempt(exp(middle))
        if reached >= bandwidth:
            best, strict = other, middle
        else:
            loose = middle
    return best
