"""Design of a controller to required figures of its loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, log
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.definition import validate
from ...core.errors import InputError
from ...core.unit import parse
from ..analysis.closed_loop import INPUTS, OUTPUTS, closed_loop, discrete_response, linear_law, spectral_radius
from ..analysis.loop import LoopAnalysis, analyse_loop
from ..analysis.sampled import sampled_plant
from ..controller import SampledController
from ..kinds import ControllerFile, ControllerKind
from ..load import build_controller
from .specification import leaves, put, toml_text

if TYPE_CHECKING:
    import control

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
        got = bandwidth_of(system, found.controller) if word == "bandwidth" else figure(found.loop, word)
        unit, which = FIGURES[word]
        if got < value * (1 - 1e-3) if which == "least" else got > value * (1 + 1e-3):
            raise InputError(
                f"{word} = {value:.4g}{f' {unit}' if unit != '1' else ''} was asked for as the {which} value; "
                f"the loop of this {kind.name} has {got:.4g}: change what it is designed from with --spec, "
                "or ask for less"
            )
    return found


def figure(loop: LoopAnalysis, word: str) -> float:
    """A figure of FIGURES but the bandwidth, of a loop analysis."""
    return loop.noise_gain["position"] if word == "noise_gain" else float(getattr(loop, word))


def bandwidth_of(system: control.StateSpace, controller: SampledController) -> float:
    """Bandwidth [rad/s] from position reference to position, -3 dB; 0 for an unstable loop.

    The gain crossover of a state feedback's loop at the current is that of its speed feedback and says nothing of it.
    """
    closed = closed_loop(sampled_plant(system, controller.sample_time), linear_law(controller))
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
