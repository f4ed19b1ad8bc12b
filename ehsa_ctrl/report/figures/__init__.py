"""One figure a file. Every function returns a matplotlib Figure that is the caller's own; none of them uses pyplot."""

from .bode import bode_figure
from .loop import loop_figure
from .overlay import overlay_figure
from .save import save, to_svg
from .scenario import scenario_figure
from .trajectory import trajectory_figure

__all__ = [
    "bode_figure",
    "loop_figure",
    "overlay_figure",
    "save",
    "scenario_figure",
    "to_svg",
    "trajectory_figure",
]
