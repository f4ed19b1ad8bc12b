"""The controller under which a log was recorded: of the plant's [log.controller], or one that the user names."""

from __future__ import annotations

from pathlib import Path

from ..core.catalogue import controllers
from ..core.errors import InputError
from ..core.files import read_toml
from ..design.controller import SampledController
from ..design.load import controller_of
from ..plant.conditions import design_model
from ..plant.plant import Plant


def log_controller(plant: Plant, controller: str | Path | None = None) -> SampledController:
    """The controller of a plant's logs, designed on the plant's linear model.

    Parameters
    ----------
    plant: the plant of the log, with the settings of the experiment.
    controller: name or file; by default that of [log.controller]: `file = NAME` (relative to the plant's file), or the
        keys of a controller's file, of which schema and title may be left out.

    Raises InputError for a plant without [log.controller] if none is named, for an invalid definition, for a controller
    of another drive, and for a system around which no controller can be put.
    """
    system, table = plant.structure.system, plant.log_controller
    if system.no_controller:
        raise InputError(f"{plant.name}: {system.no_controller}; leave the controller out")
    if controller is None and table is None:
        raise InputError(
            f"{plant.name}: has no [log.controller]; name the controller of the log, or write it into the plant's file"
        )
    if controller is None and table is not None and "file" not in table:
        content = {"schema": 1, "title": f"controller of the logs of {plant.name}", **table}
        name = f"{plant.name} [log.controller]"
        return controller_of(content, f"{plant.path}: [log.controller]", name, design_model(plant), plant.sample_time)
    if controller is not None:
        path = controllers.find(controller)
    elif table is not None and set(table) == {"file"} and isinstance(table["file"], str):
        path = controllers.find(table["file"], beside=plant.path)
    else:
        raise InputError(
            f"{plant.path}: [log.controller] has file and {', '.join(k for k in table or {} if k != 'file')}; expected "
            "file = NAME alone, or the keys of a controller's file"
        )
    content = read_toml(path)
    return controller_of(content, str(path), path.stem, design_model(plant), plant.sample_time)
