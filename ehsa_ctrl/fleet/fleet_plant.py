"""The plant of a fleet: its mean parameters, and how much its units differ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..core.files import write_text
from ..identification.plant_toml import plant_toml
from ..plant.plant import Plant
from .result import Fleet


def fleet_plant(plant: Plant, fleet: Fleet) -> Plant:
    """The plant with the fleet's mean as value, and its spread as prior deviation of a unit in a diagnosis.

    Parameters that the logs do not determine stay as they are. A spread that is smaller than the mean's own standard
    deviation is replaced by it.
    """
    parameters = dict(plant.parameters)
    for one in fleet.parameters:
        if one.spread is None:
            continue
        note = f"mean of {len(fleet.rigs)} rigs, {fleet.log_count} logs"
        parameters[one.name] = replace(
            parameters[one.name], value=one.mean, source="identified", sd=one.mean_sd,
            spread=max(one.spread, one.mean_sd), note=note,
        )  # fmt: skip
    return replace(plant, parameters=parameters)


def write_fleet_plant(path: str | Path, plant: Plant, fleet: Fleet) -> Path:
    """Write `fleet_plant` as TOML and return its path. Raises InputError if it can't be written."""
    return write_text(path, plant_toml([fleet_plant(plant, fleet)]))
