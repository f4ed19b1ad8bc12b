"""Operating points of linear models: position, velocity, load and bulk modulus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

from ..core.errors import InputError
from ..core.pressure_difference import reduce_to_difference
from .file import label
from .linear import three_state
from .linearise import linearise
from .load import load_plant, models_of
from .plant import Plant

if TYPE_CHECKING:
    import control

#: Attribute of Condition -> symbol, unit in labels, and this unit in SI.
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
    position [m], velocity [m/s]: of the rod; a plant with dry friction is linearised during sliding. Position changes
        stroke-dependent volumes, velocity the slope of Stribeck friction; neither affects the linear set.
    stiffness [N/m], mass [kg]: of the load.
    beta: bulk modulus [Pa]; it depends on the mean pressure if the oil contains air.
    named: attributes that appear in the label.
    """

    position: float = 0.0
    velocity: float = 0.05
    stiffness: float | None = None
    mass: float | None = None
    beta: float | None = None
    named: tuple[str, ...] = ()

    def model(self, plant: Plant) -> control.StateSpace:
        """Design model at this point: (7) for the EHSA's linear set; any other model is linearised during sliding.

        Raises InputError for a physically impossible value.
        """
        given = {"K_S": self.stiffness, "m_L": self.mass, "beta": self.beta}
        there = plant.set(**{symbol: value for symbol, value in given.items() if value is not None})
        if there.model == "linear" and there.structure.system_name == "ehsa":
            return three_state(there)
        model = linearise(there, position=self.position, velocity=self.velocity)
        return reduce_to_difference(model, f"{there.name} ({there.model}) linearised")

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
    """All combinations of these values (SI units); an empty sequence keeps the plant's value.

    Labels contain the stiffnesses, masses and bulk moduli, and positions or velocities if there are several.

    Raises InputError without a position or a velocity.
    """
    if not positions or not velocities:
        raise InputError("conditions: positions or velocities is empty; give at least one of each")
    named = [name for name, values in (("position", positions), ("velocity", velocities)) if len(values) > 1]
    named += [
        name for name, values in (("stiffness", stiffnesses), ("mass", masses), ("beta", betas)) if len(values) > 0
    ]
    axes = (positions, velocities, stiffnesses or (None,), masses or (None,), betas or (None,))
    return [Condition(*values, named=tuple(named)) for values in product(*axes)]


def linear_model(plant: Plant) -> control.StateSpace:
    """The linear model of a linear set, on which controllers are designed: (7) for the EHSA.

    Raises InputError as `three_state` does for an EHSA, and for a set whose motion at rest is not linear.
    """
    return Condition().model(plant)


def design_model(plant: Plant) -> control.StateSpace:
    """The linear model on which controllers of a plant are designed.

    (7) of its file's linear set, without settings for one run; of a file without one, the nonlinear set linearised
    during sliding.
    """
    if plant.path is None:
        return Condition().model(plant)
    models = models_of(plant.path)
    return Condition().model(load_plant(plant.path, model="linear" if "linear" in models else models[0]))


def operating_points(plant: Plant, at: Sequence[Condition]) -> dict[str, control.StateSpace]:
    """Label of a condition ("nominal" if empty) -> linear model of the plant there.

    Raises InputError for a physically impossible value.
    """
    return {str(one) or "nominal": one.model(plant) for one in at}
