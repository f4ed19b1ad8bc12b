"""Operating points of linear models: position, speed, load and bulk modulus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

from ..core.errors import InputError
from .file import label
from .linear import three_state
from .linearise import linearise, reduce_to_difference
from .plant import Plant

if TYPE_CHECKING:
    import control

#: Symbol of a condition, shown unit, and this unit in SI.
WORDS = {
    "position": ("x", "mm", 1e-3),
    "velocity": ("v", "mm/s", 1e-3),
    "stiffness": ("K_S", "kN/m", 1e3),
    "mass": ("m_L", "kg", 1.0),
    "beta": ("beta", "GPa", 1e9),
}


@dataclass(frozen=True)
class Condition:
    """An operating point in SI units; None keeps the plant's value.

    Attributes
    ----------
    position [m], velocity [m/s]: of the rod; a plant with dry friction is linearised while it slides. Position changes
        stroke-dependent volumes, speed the slope of Stribeck friction; neither affects the linear set.
    stiffness [N/m], mass [kg]: of the load.
    beta: bulk modulus [Pa], which depends on the pressure level where the oil contains air.
    named: attributes in the label.
    """

    position: float = 0.0
    velocity: float = 0.05
    stiffness: float | None = None
    mass: float | None = None
    beta: float | None = None
    named: tuple[str, ...] = ()

    def model(self, plant: Plant) -> control.StateSpace:
        """Design model at this point: (7) for the linear set, else linearised while it slides.

        Raises InputError for a value that is physically impossible.
        """
        given = {"K_S": self.stiffness, "m_L": self.mass, "beta": self.beta}
        there = plant.set(**{symbol: value for symbol, value in given.items() if value is not None})
        if there.model == "linear":
            return three_state(there)
        return reduce_to_difference(linearise(there, position=self.position, velocity=self.velocity), there)

    def __str__(self) -> str:
        parts = []
        for name in self.named:
            symbol, unit, scale = WORDS[name]
            parts.append(f"{label(symbol)} = {getattr(self, name) / scale:.6g} {unit}")
        return ", ".join(parts)


def conditions(
    *,
    positions: Sequence[float] = (0.0,),
    velocities: Sequence[float] = (0.05,),
    stiffnesses: Sequence[float] = (),
    masses: Sequence[float] = (),
    betas: Sequence[float] = (),
) -> list[Condition]:
    """Every combination of the given conditions (SI units); an empty sequence keeps the plant's value.

    Labels contain given stiffnesses, masses and moduli, and positions or speeds if there are several.

    Raises InputError without a position or a speed.
    """
    if not positions or not velocities:
        raise InputError("conditions got no position or no velocity; give at least one of each")
    named = [name for name, values in (("position", positions), ("velocity", velocities)) if len(values) > 1]
    named += [
        name for name, values in (("stiffness", stiffnesses), ("mass", masses), ("beta", betas)) if len(values) > 0
    ]
    axes = (positions, velocities, stiffnesses or (None,), masses or (None,), betas or (None,))
    return [Condition(*values, named=tuple(named)) for values in product(*axes)]


def operating_points(plant: Plant, at: Sequence[Condition]) -> dict[str, control.StateSpace]:
    """Linear models of one plant by the label of the condition, "nominal" for an empty one.

    Raises InputError for a value that is physically impossible.
    """
    return {str(one) or "nominal": one.model(plant) for one in at}
