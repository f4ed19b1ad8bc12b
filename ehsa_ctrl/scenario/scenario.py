"""A scenario by name or path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..core.catalogue import scenarios
from ..core.definition import validate
from ..core.files import read_toml
from ..core.text import TextResult
from ..core.unit import factor
from .definition import ScenarioFile
from .metrics import METRICS


@dataclass(frozen=True)
class Scenario(TextResult):
    """A scenario's definition with its name and file."""

    name: str
    definition: ScenarioFile
    path: Path | None = None

    @property
    def title(self) -> str:
        return self.definition.title

    def __str__(self) -> str:
        said = self.definition
        settings = ", ".join(f"{key} = {value}" for key, value in said.all_settings.items())
        lines = [
            f"{self.name}: {said.title}",
            f"  {said.controller} on {said.plant}, {said.duration:g} s of {said.reference.kind}",
            *([f"  believed of the plant: {settings}"] if settings else []),
        ]
        for name, bound in said.limits.items():
            metric = METRICS[name]
            ends = {"at least": bound.min, "at most": bound.max}
            scale, unit = factor(metric.shown, metric.unit), "" if metric.shown == "1" else f" {metric.shown}"
            words = [f"{word} {end / scale:.6g}{unit}" for word, end in ends.items() if end is not None]
            lines.append(f"  {name} {' and '.join(words)}")
        return "\n".join(lines)

    __repr__ = __str__


def load_scenario(name: str | Path) -> Scenario:
    """Load a scenario by catalogue name or path. Raises InputError with file and key."""
    path = scenarios.find(name)
    definition = validate(read_toml(path), ScenarioFile, str(path), context={"folder": path.parent})
    return Scenario(path.stem, definition, path)
