"""The linear set of a plant that goes with its nonlinear one: what is left while shaft and rod slide.

A linear model fitted to a rig with dry friction takes the friction for damping, and a controller designed on it is too
bold where the rig slides (README, tour). Viscous friction, inertia, mass, volumes and leakage of the nonlinear set make
the linear model that holds between two standstills.
"""

from __future__ import annotations

from dataclasses import replace

from ..core.errors import InputError
from ..core.parameter import Parameter
from ..plant.load import load_plant
from ..plant.plant import Plant


def sliding_linear(plant: Plant) -> Plant:
    """The linear model of the same file, with the numbers that it shares with a nonlinear `plant`.

    V is the mean of V_10 and V_20. Numbers that are new are marked as derived.

    Raises InputError for a plant without a file, or whose file has no linear model.
    """
    if plant.path is None or plant.model != "nonlinear":
        raise InputError("the linear set that goes with a plant needs its nonlinear model, loaded from a file")
    linear = load_plant(plant.path, model="linear")
    shared = {name: plant.parameters[name] for name in linear.parameters if name in plant.parameters}
    if {"V_10", "V_20"} <= set(plant.parameters) and "V" in linear.parameters:
        mean = 0.5 * (plant["V_10"] + plant["V_20"])
        shared["V"] = Parameter("V", mean, "m3", plant.parameters["V_10"].source)
    changed = dict(linear.parameters)
    for name, parameter in shared.items():
        old = linear.parameters[name]
        if parameter.value == old.value:
            continue
        source = "derived" if parameter.source == "identified" else parameter.source
        note = "the nonlinear set's, while it slides" if source == "derived" else parameter.note
        changed[name] = replace(old, value=parameter.value, source=source, sd=None, note=note, written="")
    return replace(linear, parameters=changed)
