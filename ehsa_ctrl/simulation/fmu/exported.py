"""The files of a plant inside an FMU: its TOML, and a JSON file with exact structure and nominal values."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

from ...core.errors import InputError
from ...plant.load import load_plant
from ...plant.plant import Plant
from ...plant.structure import Structure

#: File with structure and parameters. Its name is that of FMUs which exist already.
NOMINAL_FILE = "believed.json"


def write_exported(plant: Plant, folder: Path) -> tuple[Path, Path]:
    """Write both files to a folder. Raises InputError for a plant that was not read from a TOML file."""
    from importlib.metadata import version

    if plant.path is None:
        raise InputError(f"{plant.name} was not read from a TOML file, which the FMU must contain; use load_plant")
    toml, nominal = folder / f"{plant.name}.toml", folder / NOMINAL_FILE
    toml.write_text(plant.path.read_text(encoding="utf-8"), encoding="utf-8")
    content = {
        "plant": toml.name,
        "model": plant.model,
        "structure": asdict(plant.structure),
        "parameters": {name: {"value": p.value, "source": p.source} for name, p in plant.parameters.items()},
        "ehsa_ctrl": version("ehsa_ctrl"),
    }
    nominal.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return toml, nominal


def read_exported(folder: Path) -> tuple[Plant, str]:
    """The plant in a folder written by `write_exported`, and the version of ehsa_ctrl that wrote it."""
    content = json.loads((folder / NOMINAL_FILE).read_text(encoding="utf-8"))
    base = load_plant(folder / content["plant"], model=content["model"])
    structure = Structure(**{**content["structure"], "effects": tuple(content["structure"]["effects"])})
    nominal = content["parameters"]
    added = {name: entry["value"] for name, entry in nominal.items() if name not in base.parameters}
    plant = base.with_structure(structure, **added)
    parameters = {
        name: p if p.value == nominal[name]["value"] else p.given(nominal[name]["value"])
        for name, p in plant.parameters.items()
    }
    sourced = {name: replace(p, source=nominal[name]["source"]) for name, p in parameters.items()}
    return replace(plant, parameters=sourced), content["ehsa_ctrl"]
