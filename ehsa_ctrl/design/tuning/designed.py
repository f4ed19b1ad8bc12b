"""A controller designed to a specification: its definition, its loop, and whether it has what was asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, log
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.definition import validate
from ...core.errors import InputError
from ...core.unit import parse
from ..analysis.closed_loop import INPUTS, OUTPUTS, closed_loop, discrete_response, linear_law
from ..analysis.loop import LoopAnalysis, analyse_loop
from ..analysis.sampled import sampled_plant
from ..controller import SampledController
from ..kinds import ControllerFile, ControllerKind
from ..load import build_controller
from .specification import leaves, put, toml_text

if TYPE_CHECKING:
    import control

#: What a loop can be asked for: word -> (unit, the least value or the largest one).
FIGURES = {
    "bandwidth": ("rad/s", "least"),
    "phase_margin": ("deg", "least"),
    "Ms": ("1", "largest"),
    "Mt": ("1", "largest"),
    "disk_margin": ("1", "least"),
    "noise_gain": ("A/m", "largest"),
}
#: Range of position weights [m] in which a bandwidth is looked for.
WEIGHTS = (1e-6, 1.0)


@dataclass(frozen=True)
class Designed:
    """A designed controller.

    Attributes
    ----------
    content: of its TOML. controller: on the model. loop: its loop on the model.
    """

    content: dict[str, Any]
    controller: SampledController
    loop: LoopAnalysis

    def toml(self, comments: list[str]) -> str:
        """The TOML with what was reached as comments."""
        reached = [line.strip() for line in f"{self.controller.law}\n{self.loop}".splitlines()]
        return toml_text(self.content, [*comments, *reached])


def keys_for(kind: ControllerKind, figures: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Which of the figures asked for are keys of this kind, and which are left to be judged on the loop."""
    known = set(leaves(kind.file))
    classic = "phase_margin" in figures and "design.phase_margin" in known
    table = "design" if classic else "tuning"
    places = {"bandwidth": (f"{table}.crossover", "position.crossover")}
    keys: dict[str, str] = {}
    judged: dict[str, str] = {}
    for word, text in figures.items():
        options = places.get(word, (f"{table}.{word}", f"position.{word}"))
        key = next((option for option in options if option in known), None)
        (judged if key is None else keys)[word if key is None else key] = text
    return keys, judged


def design(
    name: str,
    kind: ControllerKind,
    content: Mapping[str, Any],
    system: control.StateSpace,
    *,
    figures: Mapping[str, str] | None = None,
    asked: Mapping[str, str] | None = None,
) -> Designed:
    """Design a controller to a specification.

    Parameters
    ----------
    content: the definition to start from, see specification.begin.
    figures: words of FIGURES -> text with a unit. Where the kind's design has a key for one, that is it; a bandwidth is
        else that of `following`, reached by the weight of the position, and the others are only judged.
    asked: keys of the definition -> text, see specification.put.

    Raises
    ------
    InputError: keys that are not there, a design that can't be reached, a figure that the loop does not have.
    """
    keys, judged = keys_for(kind, figures or {})
    wanted = {word: parse(text, FIGURES[word][0]) for word, text in judged.items()}
    whole = put(dict(content), kind, {**keys, **(asked or {})})
    if "bandwidth" in wanted and "weights.position" in leaves(kind.file):
        whole = _weighted(name, kind, whole, system, wanted["bandwidth"])
    found = _build(name, kind, whole, system)
    for word, value in wanted.items():
        got = following(system, found.controller) if word == "bandwidth" else figure(found.loop, word)
        unit, which = FIGURES[word]
        if got < value * (1 - 1e-3) if which == "least" else got > value * (1 + 1e-3):
            raise InputError(
                f"{word} = {value:.4g}{f' {unit}' if unit != '1' else ''} was asked for as the {which} value; "
                f"the loop of this {kind.name} has {got:.4g}: change what it is designed from with --spec, "
                "or ask for less"
            )
    return found


def figure(loop: LoopAnalysis, word: str) -> float:
    """A figure of FIGURES but the bandwidth, of a loop."""
    return loop.noise_gain["position"] if word == "noise_gain" else float(getattr(loop, word))


def following(system: control.StateSpace, controller: SampledController) -> float:
    """Frequency [rad/s] to which the rod follows the position asked for, -3 dB; 0 for a loop that is not stable.

    A state feedback's loop gain at the current crosses 1 where its speed is fed back, which says nothing of this.
    """
    closed = closed_loop(sampled_plant(system, controller.sample_time), linear_law(controller))
    if np.max(np.abs(np.linalg.eigvals(closed.A)), initial=0.0) >= 1.0:
        return 0.0
    omega = np.geomspace(0.1, np.pi / controller.sample_time, 2000)
    way = closed[OUTPUTS.index("position"), INPUTS.index("r_position")]
    size = np.abs(discrete_response(way, omega)[:, 0, 0])
    below = np.flatnonzero(size < np.sqrt(0.5))
    return float(omega[below[0]]) if below.size else float(omega[-1])


def _build(name: str, kind: ControllerKind, content: dict[str, Any], system: control.StateSpace) -> Designed:
    definition = validate(content, kind.file, name)
    assert isinstance(definition, ControllerFile)
    controller = build_controller(name, kind, definition, system)
    return Designed(content, controller, analyse_loop(system, controller))


def _weighted(
    name: str, kind: ControllerKind, content: dict[str, Any], system: control.StateSpace, bandwidth: float
) -> dict[str, Any]:
    """The definition with the position's weight that gives the bandwidth: bisection in its logarithm."""

    def tried(position: float) -> tuple[dict[str, Any], float]:
        other = put(content, kind, {"weights.position": f'"{position:.4g} m"'})
        definition = validate(other, kind.file, name)
        return other, following(system, build_controller(name, kind, definition, system))

    strict, loose = (log(value) for value in WEIGHTS)
    best, reached = tried(WEIGHTS[0])
    if reached < bandwidth:
        raise InputError(
            f"bandwidth = {bandwidth:.4g} rad/s is not reached by any weight of the position; the loop comes to "
            f"{reached:.4g} rad/s: let the current cost less (--spec weights.current) or ask for less"
        )
    for _ in range(12):
        middle = 0.5 * (strict + loose)
        other, reached = tried(exp(middle))
        if reached >= bandwidth:
            best, strict = other, middle
        else:
            loose = middle
    return best
