"""A scenario by name or path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..core.catalogue import scenarios
from ..core.definition import read_toml, validate
from .definition import ScenarioFile


@dataclass(frozen=True)
class Scenario:
    """A scenario's definition with its name and file."""

    name: str
    definition: ScenarioFile
    path: Path | None = None

    @property
    def title(self) -> str:
        return self.definition.title


def load_scenario(name: str | Path) -> Scenario:
    """Load a scenario by catalogue name or path. Raises InputError with file and key."""
    path = scenarios.find(name)
    definition = validate(read_toml(path), ScenarioFile, str(path), context={"folder": path.parent})
    return Scenario(path.stem, definition, path)
