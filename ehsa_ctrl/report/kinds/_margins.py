"""Margins of a loop, as the JSON of several commands has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ._result import Table, written

#: Key -> what it is called, its unit, and how much of the JSON's unit is one of it.
MARGINS = {
    "crossover": ("crossover", "rad/s", 1.0),
    "phase_margin": ("phase margin", "°", 1.0),
    "gain_margin": ("gain margin", "", 1.0),
    "delay_margin": ("delay margin", "ms", 1e-3),
    "Ms": ("Ms", "", 1.0),
    "Mt": ("Mt", "", 1.0),
    "disk_margin": ("disk margin", "", 1.0),
    "current_noise": ("current from sensor noise, RMS", "mA", 1e-3),
}


def margin(loop: Mapping[str, Any], key: str) -> str:
    """A margin with its unit."""
    _, unit, scale = MARGINS[key]
    return f"{written(loop[key], scale, 3)} {unit}".rstrip().replace(" °", "°")


def margins_table(caption: str, loops: Sequence[Mapping[str, Any]]) -> Table:
    """A row a margin, a column a controller."""
    rows = [
        [words, *(written(loop.get(key), scale) for loop in loops), unit]
        for key, (words, unit, scale) in MARGINS.items()
        if any(loop.get(key) is not None for loop in loops)
    ]
    return Table(caption, ["margin", *(str(loop["controller"]) for loop in loops), "unit"], rows)
