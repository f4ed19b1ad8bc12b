"""Design of a controller to a specification: values of keys in its definition, and required figures of its loop."""

from __future__ import annotations

import copy
import difflib
import textwrap
import tomllib
import typing
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from ..core.catalogue import controllers, shipped
from ..core.definition import validate
from ..core.errors import InputError, choices
from ..core.files import read_toml
from ..core.unit import parse, parse_angular_frequency, unit_suffix
from .analysis.closed_loop import INPUTS, OUTPUTS, close_loop, discrete_response, spectral_radius
from .analysis.loop import LoopAnalysis, analyse_loop
from .analysis.sampled import drive_unit_of
from .controller import SampledController
from .kinds import CONTROLLER_KINDS, ControllerFile, ControllerKind
from .load import build_controller
from .tuning.constraints import Tuning
from .tuning.keys import BUDGET, tune_keys

if TYPE_CHECKING:
    import control

#: Tables that exclude each other: setting a key of one removes the others.
ALTERNATIVES = ("design", "tuning", "gains")
#: Tables whose keys have a command line option of their own.
OPTIONS = {"weights": "--weight", "limits": "--limit"}
#: Figures that can be required -> (unit, whether the required value is the least or the largest).
FIGURES = {
    "bandwidth": ("rad/s", "least"),
    "phase_margin": ("deg", "least"),
    "Ms": ("1", "largest"),
    "Mt": ("1", "largest"),
    "disk_margin": ("1", "least"),
    "noise_gain": ("A/m", "largest"),
}
#: Position weights [m] searched for a bandwidth: from a tenth of the position sensor's resolution (10 um) to a
#: deviation far beyond any stroke. Engineering judgement.
WEIGHTS = (1e-6, 1.0)


def starting_definition(kind: str, base: str | None = None) -> tuple[ControllerKind, Path]:
    """Controller kind, and TOML file that a design starts from.

    Parameters
    ----------
    kind: a key of CONTROLLER_KINDS.
    base: a controller's name or path; by default that of `example_of`.

    Raises InputError for an unknown kind, a base of another kind, or a kind that the catalogue lacks.
    """
    if kind not in CONTROLLER_KINDS:
        raise InputError(f"--kind {kind!r}: no such kind of controller; {choices(kind, CONTROLLER_KINDS)}")
    if base is not None:
        path = controllers.find(base)
        found = read_toml(path).get("kind")
        if found != kind:
            raise InputError(f"--base {base}: is a {found!r} controller; expected kind = {kind!r}")
        return CONTROLLER_KINDS[kind], path
    example = example_of(kind)
    if example is None:
        raise InputError(
            f"there is no {kind!r} controller to start from; write one by `ehsa-ctrl new controller NAME --kind {kind}`"
        )
    return CONTROLLER_KINDS[kind], example


def example_of(kind: str) -> Path | None:
    """The controller KIND_position of the catalogue, else a shipped one of this kind, else any; None without one."""
    own = set(controllers) - set(shipped("controllers"))
    for name in sorted(controllers, key=lambda name: (name != f"{kind}_position", name in own, name)):
        if read_toml(controllers[name]).get("kind") == kind:
            return controllers[name]
    return None


def definition_keys(form: type[BaseModel], prefix: str = "") -> list[str]:
    """Dotted keys of a form, those of nested tables included."""
    found = []
    for name, field in form.model_fields.items():
        key = f"{prefix}{field.alias or name}"
        parts = [field.annotation, *getattr(field.annotation, "__args__", ())]
        inner = next((part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)), None)
        found += definition_keys(inner, f"{key}.") if inner is not None else [key]
    return found


def full_key(key: str, form: type[BaseModel]) -> str:
    """The dotted key for a key without its table. Raises InputError for an unknown or ambiguous key."""
    known = definition_keys(form)
    table = form.model_fields.get(key.partition(".")[0])
    if key in known or ("." in key and table is not None and typing.get_origin(table.annotation) is dict):
        return key
    matches = [name for name in known if "." not in key and name.endswith(f".{key}")]
    if len(matches) > 1:
        raise InputError(f"--spec {key}: may be {' or '.join(matches)}; write it out")
    if not matches:
        raise InputError(_unknown_key_message(key, known))
    return matches[0]


def _unknown_key_message(key: str, known: list[str]) -> str:
    """Message that lists the keys of the table, or the tables if there is no such table."""
    table, dot, word = key.partition(".")
    option = f"{OPTIONS[table]} {word}" if dot and table in OPTIONS else f"--spec {key}"
    within = [name.removeprefix(f"{table}.") for name in known if name.startswith(f"{table}.")]
    if dot and within:
        return f"{option}: this kind of controller has no such key in [{table}]; {choices(word, within)}"
    if table in OPTIONS:
        return f"{option}: this kind of controller has no [{table}]; leave it out"
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    tables = dict.fromkeys(f"{name.partition('.')[0]}.*" if "." in name else name for name in sorted(known))
    suggestion = f"did you mean {near[0]!r}? " if near else ""
    return f"{option}: this kind of controller has no such key; {suggestion}known: {', '.join(tables)}"


def with_values(content: dict[str, Any], kind: ControllerKind, values: Mapping[str, str]) -> dict[str, Any]:
    """A copy of the definition's content with other values; `values` is key -> text as after --spec.

    A key of a table among ALTERNATIVES removes the other tables.

    Raises InputError for keys that the kind does not have.
    """
    content = copy.deepcopy(content)
    for name, text in values.items():
        *tables, key = full_key(name, kind.file).split(".")
        if tables and tables[0] in ALTERNATIVES:
            for other in set(ALTERNATIVES) - {tables[0]}:
                content.pop(other, None)
        target = content
        for table in tables:
            target = target.setdefault(table, {})
        target[key] = parse_value(text)
    return content


def without_keys(content: Mapping[str, Any], keys: Collection[str]) -> dict[str, Any]:
    """A copy of the definition's content without some dotted keys, and without tables that are then empty."""
    found = copy.deepcopy(dict(content))
    for key in keys:
        *tables, name = key.split(".")
        holders = [found]
        for table in tables:
            holders.append(holders[-1][table])
        del holders[-1][name]
        for table, holder, inner in zip(reversed(tables), reversed(holders[:-1]), reversed(holders[1:]), strict=True):
            if not inner:
                del holder[table]
    return found


def parse_value(text: str) -> Any:
    """A TOML value ("1.5", "true", "[1, 2]"); text that is none ("30 rad/s") stays text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def toml_text(content: Mapping[str, Any], comments: list[str]) -> str:
    """The definition as TOML, comments first."""
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
    content: the tables and keys of its TOML. controller, loop: on the design model.
    """

    content: dict[str, Any]
    controller: SampledController
    loop: LoopAnalysis

    def toml(self, comments: list[str]) -> str:
        """The TOML, with `comments`, the law and the loop's margins as comments."""
        result = [line.strip() for line in f"{self.controller.law_words}\n{self.loop}".splitlines()]
        return toml_text(self.content, [*comments, *result])


def split_figures(
    kind: ControllerKind, figures: Mapping[str, str], *, tuned: bool = False
) -> tuple[dict[str, str], dict[str, str]]:
    """Split required figures into those that are keys of this kind's definition, and those to check on the loop.

    tuned: whether `tune_keys` chooses the gains, so that a PID's own [tuning] plays no part.
    """
    known = set(definition_keys(kind.file))
    classic = tuned or ("phase_margin" in figures and "design.phase_margin" in known)
    table = "design" if classic else "tuning"
    places = {"bandwidth": (f"{table}.crossover", "position.crossover", f"{kind.name}.bandwidth")}
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
    values: Mapping[str, str] | None = None,
    tuning: Tuning | None = None,
    budget: int = BUDGET,
) -> ControllerDesign:
    """Design a controller to a specification.

    Parameters
    ----------
    content: the definition to start from, see `starting_definition`.
    figures: key of FIGURES -> text with a unit. A figure that is a key of the definition sets that key. Otherwise the
        position weight is chosen for a bandwidth (see `bandwidth_of`), and other figures are only checked on the loop.
    values: key of the definition -> text, see `with_values`.
    tuning: criterion and bounds for which the keys of `kind.tunes` are chosen, but for those in `values` and `figures`.
    budget: number of evaluations of the tuning.

    Raises InputError for unknown keys, an infeasible design, and a required figure that the loop does not reach.
    """
    keys, checked = split_figures(kind, figures or {}, tuned=tuning is not None)
    required = {
        word: parse_angular_frequency(text)
        if word == "bandwidth"
        else parse(text, FIGURES[word][0].replace("A", drive_unit_of(system)))
        for word, text in checked.items()
    }
    specified = with_values(dict(content), kind, {**keys, **(values or {})})
    if tuning is not None:
        given = {full_key(key, kind.file) for key in {**keys, **(values or {})}}
        specified = _with_tuned_keys(name, kind, specified, system, tuning, given, budget)
    if "bandwidth" in required and "weights.position" in definition_keys(kind.file):
        specified = _with_bandwidth(name, kind, specified, system, required["bandwidth"])
    result = _build(name, kind, specified, system)
    for word, value in required.items():
        got = bandwidth_of(system, result.controller) if word == "bandwidth" else result.loop.figure(word)
        unit, which = FIGURES[word][0].replace("A", drive_unit_of(system)), FIGURES[word][1]
        # 0.1 % of tolerance: tuner and bisection stop near a bound, not on it.
        if got < value * (1 - 1e-3) if which == "least" else got > value * (1 + 1e-3):
            raise InputError(
                f"{word} = {value:.4g}{unit_suffix(unit)} is required as the {which} value; "
                f"the loop of this {kind.name} has {got:.4g}: change its specification with --spec, or relax the "
                "requirement"
            )
    return result


def bandwidth_of(system: control.StateSpace, controller: SampledController) -> float:
    """Bandwidth [rad/s] from position reference to position, -3 dB; 0 for an unstable loop.

    With state feedback the gain crossover at the current does not measure it: speed feedback dominates that loop.
    """
    _, _, closed = close_loop(system, controller)
    if spectral_radius(closed.A) >= 1.0:
        return 0.0
    # 2000 points resolve about 0.5 % of the frequency.
    omega = np.geomspace(0.1, np.pi / controller.sample_time, 2000)
    channel = closed[OUTPUTS.index("position"), INPUTS.index("r_position")]
    size = np.abs(discrete_response(channel, omega)[:, 0, 0])
    below = np.flatnonzero(size < np.sqrt(0.5))
    return float(omega[below[0]]) if below.size else float(omega[-1])


def _build(name: str, kind: ControllerKind, content: dict[str, Any], system: control.StateSpace) -> ControllerDesign:
    controller = build_controller(name, kind, _read(name, kind, content, system), system)
    return ControllerDesign(content, controller, analyse_loop(system, controller))


def _read(name: str, kind: ControllerKind, content: dict[str, Any], system: control.StateSpace) -> ControllerFile:
    """The definition, in the unit of the drive of `system`."""
    return validate(content, kind.file, name, context={"drive_unit": drive_unit_of(system)})


def _with_tuned_keys(
    name: str,
    kind: ControllerKind,
    content: dict[str, Any],
    system: control.StateSpace,
    tuning: Tuning,
    given: Collection[str],
    budget: int,
) -> dict[str, Any]:
    """The definition with the kind's free keys chosen by `tune_keys`; keys in `given` stay."""
    free = {key: span for key, span in kind.tunes.items() if key not in given}
    if not kind.tunes:
        tuned = ", ".join(word for word, one in CONTROLLER_KINDS.items() if one.tunes)
        raise InputError(f"--tune: a {kind.name} has no keys that are tuned; kinds with some: {tuned}")

    def changed(values: Mapping[str, float]) -> dict[str, Any]:
        texts = {key: f'"{values[key]:.5g} {unit}"' if unit != "1" else f"{values[key]:.5g}" for key, unit in units}
        # A whole number is no float in TOML.
        texts = {key: text if '"' in text or {*text} & {*".en"} else f"{text}.0" for key, text in texts.items()}
        return with_values(content, kind, texts)

    def build(values: Mapping[str, float]) -> SampledController:
        return build_controller(name, kind, _read(name, kind, changed(values), system), system)

    units = [(key, unit) for key, (unit, _, _) in free.items()]
    period = _read(name, kind, content, system).sample_time
    limits = {key: (low, high) for key, (_, low, high) in free.items()}
    return changed(tune_keys(build, limits, system, tuning, sample_time=period, budget=budget).values)


def _with_bandwidth(
    name: str, kind: ControllerKind, content: dict[str, Any], system: control.StateSpace, bandwidth: float
) -> dict[str, Any]:
    """The definition with the largest position weight that reaches the bandwidth, by bisection of its logarithm."""

    def attempt(position: float) -> tuple[dict[str, Any], float]:
        other = with_values(content, kind, {"weights.position": f'"{position:.4g} m"'})
        return other, bandwidth_of(system, build_controller(name, kind, _read(name, kind, other, system), system))

    strict, loose = (log(value) for value in WEIGHTS)
    best, reached = attempt(WEIGHTS[0])
    if reached < bandwidth:
        raise InputError(
            f"bandwidth = {bandwidth:.4g} rad/s is beyond reach of the position weight; the loop reaches at most "
            f"{reached:.4g} rad/s: increase --spec weights.current, or require less"
        )
    for _ in range(12):  # to 0.3 % of the weight
        middle = 0.5 * (strict + loose)
        other, reached = attempt(exp(middle))
        if reached >= bandwidth:
            best, strict = other, middle
        else:
            loose = middle
    return best
