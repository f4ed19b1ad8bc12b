"""Validate a definition of any kind, and what it refers to."""

from __future__ import annotations

from pathlib import Path

from ..core.definition import read_toml
from ..core.errors import InputError
from ..design.load import load_controller, read_controller
from ..plant.linear import three_state
from ..plant.plant import load_plant
from .run import load_scenario


def check_definition(path: Path) -> str:
    """Return the kind ("plant", "controller", "scenario") of a valid definition.

    Raises InputError, one sentence with file and key, for the first mistake: of form, of a unit, of a value, or a
    name that refers to nothing.
    """
    content = read_toml(path)
    if "system" in content:
        for model in ("linear", "nonlinear"):
            if model in content:
                load_plant(path, model=model)
        if "linear" not in content and "nonlinear" not in content:
            raise InputError(f"{path}: has neither a [linear] nor a [nonlinear] model")
        return "plant"
    if "kind" in content:
        read_controller(path)
        return "controller"
    if "why" in content or "reference" in content:
        scenario = load_scenario(path)
        definition = scenario.definition
        try:
            model = three_state(load_plant(definition.plant, model="linear"))
            load_plant(definition.plant, settings=definition.all_settings)
            load_controller(definition.controller, model)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        return "scenario"
    raise InputError(f"{path}: is no plant (system = ...), no controller (kind = ...) and no scenario (why = ...)")
