"""The compiled functions of a structure (see plant_text.py), and the sizes that the integrator needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ..core.compiled import load_functions
from ..core.errors import InputError
from ..physics.effects import EFFECTS
from ..plant.wiring import Equations
from .plant_text import plant_text

#: Names in the order of `PlantCode.functions`: those of every structure, three for each contact, one for each kink.
NAMES = ("constants", "step", "accept", "rates", "cell", "propagate")
OF_A_CONTACT = ("hold", "net", "friction")
MEASURED_STATES = ("omega", "P_1", "P_2", "x")


@dataclass(frozen=True)
class PlantCode:
    """The compiled functions of a structure, with the sizes that the integrator needs.

    functions: addresses in the order of NAMES and OF_A_CONTACT; 0 for functions that a structure lacks.
    shape: numbers of states, contacts and constants; index of the dead time among the parameters (-1 for none);
        indices of MEASURED_STATES (-1 for none); number of kinks; then for each contact the index of its
        speed, and 1 if it can stick.
    scales: scale of the speed of each contact, then their reciprocals; then the reciprocal scale of each kink.
    """

    functions: np.ndarray
    shape: np.ndarray
    scales: np.ndarray

    @property
    def arguments(self) -> tuple[Any, ...]:
        """First arguments of the compiled loops."""
        return self.functions, self.shape, self.scales


@cache
def plant_code(equations: Equations, *, sensitivities: bool = False) -> PlantCode:
    """The compiled functions of a structure. The first call for its equations compiles them, later processes load them.

    Raises InputError for sensitivities of a structure with a dead time.
    """
    structure = equations.structure
    if sensitivities and structure.delay is not None:
        raise InputError(
            f"there are no derivatives by {structure.delay}; a dead time of the drive acts as a delay of all sensors: "
            "estimate delay.CHANNEL instead"
        )
    contacts = structure.system.contacts
    text, constants = plant_text(structure, sensitivities=sensitivities)
    # The many laws that a diagnosis tries would fill the disk, and none of them is likely to come again.
    addresses = load_functions(text, store=EFFECTS.members().keys() >= set(structure.effects))
    names = [*NAMES, *(f"{name}_{i}" for i in range(len(contacts)) for name in OF_A_CONTACT)]
    kinks = structure.system.kinks
    names += [f"kink_{i}" for i in range(len(kinks))]
    states = [state.name for state in equations.states]
    late = -1 if structure.delay is None else equations.parameter_names.index(structure.delay)
    shape = [len(states), len(contacts), constants, late]
    shape += [states.index(name) if name in states else -1 for name in MEASURED_STATES]
    shape.append(len(kinks))
    for contact in contacts:
        shape += [states.index(contact.velocity), int(structure.law(contact).sticks)]
    scales = np.array([equations.states[states.index(contact.velocity)].scale for contact in contacts])
    return PlantCode(
        functions=np.array([addresses.get(name, 0) for name in names], dtype=np.int64),
        shape=np.array(shape, dtype=np.int64),
        scales=np.concatenate([scales, 1.0 / scales, [1.0 / scale for scale in kinks.values()]]),
    )
