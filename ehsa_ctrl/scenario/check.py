"""Validate a definition of any kind, and what it refers to."""

from __future__ import annotations

from pathlib import Path

from ..core.errors import InputError
from ..core.files import read_toml
from ..design.load import load_controller, read_controller
from ..plant.linear import three_state
from ..plant.plant import load_plant
from .baseline import baseline_files, read_baseline
from .ratings import require_within
from .run import prepare
from .scenario import load_scenario
from .spread import uncertainty_of


def check_definition(path: Path, *, plant: str | Path | None = None) -> str:
    """Return the kind ("plant", "controller", "scenario") of a valid definition.

    Parameters
    ----------
    plant: on whose linear model a controller is designed, to see that it can be, and whose limits it must keep; the
        shipped EHSA's model and nobody's limits where none is named.

    Raises InputError, one sentence with file and key, for the first mistake: of form, of a unit, of a value, a name
    that refers to nothing, a controller that can't be designed.
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
        loaded = load_plant(plant or "ehsa", model="linear")
        if plant is not None:
            require_within(path, read_controller(path, loaded.sample_time)[1], loaded)
        load_controller(path, three_state(loaded), sample_time=loaded.sample_time)
        return "controller"
    if "why" in content or "reference" in content:
        scenario = load_scenario(path)
        case = prepare(scenario)
        try:
            uncertainty_of(case.nonlinear, scenario.definition.spread)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        for file in baseline_files(scenario):
            read_baseline(file)
        return "scenario"
    raise InputError(f"{path}: is no plant (system = ...), no controller (kind = ...) and no scenario (why = ...)")
