"""The paper's linear models as `control.StateSpace`: (6) with four states and (7) with three, each plus position.

The matrices are those of the paper, written independently of the equations in `systems/ehsa.py`, so that they check
`linearise`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from .plant import Plant

if TYPE_CHECKING:
    import control

INPUTS = ("current", "F_D")


def _linear_part(plant: Plant) -> tuple[dict[str, float], str]:
    """Values of the symbols in (6) and (7), and an addition to the model's name.

    Of a linear set with dry friction or effects, only the viscous part is used.
    """
    structure = plant.structure
    if structure.system_name != "ehsa":
        raise InputError(f"{plant.name} is a {structure.system_name!r} system; linear models exist only for 'ehsa'")
    laws = (structure.shaft_friction, structure.rod_friction)
    plain = laws == ("viscous", "viscous") and not structure.effects
    if structure.chambers != "constant" or not (plain or plant.model == "linear"):
        words = [f"{word} friction at the {place}" for word, place in zip(laws, ("shaft", "rod"), strict=True)]
        words += [f"chambers {structure.chambers!r}", *(f"the effect {name}" for name in structure.effects)]
        raise InputError(
            f"(6) and (7) hold for viscous friction and constant volumes, but the {plant.model} model of {plant.name} "
            f"has {', '.join(words)}; load the plant with model='linear', or use linearise()"
        )
    return {"B_FM": 0.0, "B_FR": 0.0, **plant.values}, "" if plain else ", viscous part"


def four_state(plant: Plant) -> control.StateSpace:
    """Equation (6) plus position: states and outputs omega, P_1, P_2, v, x; inputs current and F_D.

    P_1 + P_2 is an uncontrollable mode: use `three_state` for design. The model includes spring K_S and mass m_L of
    the load; F_D is the external force. Deviations from rest, SI units.

    Of a linear set with dry friction or effects, only the viscous part is used; the model's name says so.

    Raises InputError for a nonlinear set, or stroke-dependent volumes.
    """
    import control

    p, part = _linear_part(plant)
    J, K_T, D, K_L, C = p["J_M"], p["K_T"], p["D"], p["K_L"], p["V"] / p["beta"]
    area, mass = p["A"], p["M"] + p["m_L"]
    a = np.array(
        [
            [-p["B_FM"] / J, -D / J, D / J, 0, 0],
            [D / C, -K_L / C, K_L / C, -area / C, 0],
            [-D / C, K_L / C, -K_L / C, area / C, 0],
            [0, area / mass, -area / mass, -p["B_FR"] / mass, -p["K_S"] / mass],
            [0, 0, 0, 1, 0],
        ]
    )
    b = np.array([[K_T / J, 0], [0, 0], [0, 0], [0, -1 / mass], [0, 0]])
    names = ["omega", "P_1", "P_2", "v", "x"]
    return control.ss(
        a, b, np.eye(5), 0, states=names, inputs=list(INPUTS), outputs=names, name=f"{plant.name} (6){part}"
    )


def three_state(plant: Plant, *, position: bool = True) -> control.StateSpace:
    """Equation (7): states and outputs omega, dP, v, and x unless position=False; inputs current and F_D.

    Without position the load must not have a spring, as in the paper. Deviations from rest, SI units.

    Of a linear set with dry friction or effects, only the viscous part is used; the model's name says so.

    Raises InputError for a nonlinear set, for stroke-dependent volumes, or for position=False with a spring.
    """
    import control

    p, part = _linear_part(plant)
    J, K_T, D, K_L, C = p["J_M"], p["K_T"], p["D"], p["K_L"], p["V"] / p["beta"]
    area, mass = p["A"], p["M"] + p["m_L"]
    a = np.array(
        [
            [-p["B_FM"] / J, -D / J, 0, 0],
            [2 * D / C, -2 * K_L / C, -2 * area / C, 0],
            [0, area / mass, -p["B_FR"] / mass, -p["K_S"] / mass],
            [0, 0, 1, 0],
        ]
    )
    b = np.array([[K_T / J, 0], [0, 0], [0, -1 / mass], [0, 0]])
    names = ["omega", "dP", "v", "x"]
    if not position:
        if p["K_S"] != 0.0:
            raise InputError(f"load.stiffness = {p['K_S']:g} N/m needs the position as a state; leave position=True")
        a, b, names = a[:3, :3], b[:3], names[:3]
    return control.ss(
        a, b, np.eye(len(names)), 0, states=names, inputs=list(INPUTS), outputs=names, name=f"{plant.name} (7){part}"
    )
