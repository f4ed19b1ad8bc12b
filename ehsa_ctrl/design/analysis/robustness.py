"""Robustness of one controller over many plants: worst margins with their plants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.controller_interface import Controller
from ...core.errors import InputError
from ...core.plotting import draw
from ...core.result import Result, as_dict
from .loop import FIGURES, LoopAnalysis, analyse_loop

if TYPE_CHECKING:
    import control
    import pandas
    from matplotlib.figure import Figure

#: Margin -> 1 if it is bad when large, -1 if it is bad when small.
MARGINS = {"Ms": 1, "Mt": 1, "disk_margin": -1, "phase_margin": -1, "gain_margin": -1, "delay_margin": -1}


class WorstMargin(NamedTuple):
    """The worst value of a margin over many plants, and the label of that plant."""

    value: float
    label: str


@dataclass(frozen=True, repr=False)
class RobustMargins(Result):
    """Margins of one controller's loop with each of many plants.

    Attributes
    ----------
    controller: its name.
    loops: label of the plant -> its loop, in the given order.
    """

    controller: str
    loops: Mapping[str, LoopAnalysis]

    @cached_property
    def worst(self) -> dict[str, WorstMargin]:
        """The worst value of each margin with the plant's label; an unstable loop is the worst in all of them."""
        found = {}
        for name, sign in MARGINS.items():
            badness = {k: sign * getattr(loop, name) if loop.stable else inf for k, loop in self.loops.items()}
            label = max(badness, key=badness.__getitem__)
            found[name] = WorstMargin(float(getattr(self.loops[label], name)), label)
        return found

    @property
    def Ms(self) -> float:
        """The largest Ms; inf if a loop is unstable."""
        return self.worst["Ms"].value if self.stable else inf

    @property
    def disk_margin(self) -> float:
        """The smallest disk margin; 0 if a loop is unstable."""
        return self.worst["disk_margin"].value

    @property
    def stable(self) -> bool:
        """Whether every loop is stable."""
        return not self.unstable

    @property
    def unstable(self) -> tuple[str, ...]:
        """Labels of the plants with an unstable loop."""
        return tuple(label for label, loop in self.loops.items() if not loop.stable)

    def meets(self, *, Ms: float = 1.6, disk_margin: float = 0.6) -> bool:
        """Whether every loop is stable, with |S| at most Ms and a disk margin of at least disk_margin."""
        return self.stable and self.Ms <= Ms and self.disk_margin >= disk_margin

    def band(self, of: str = "S") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frequencies (n,) [rad/s] with the smallest and largest |S| or |T| (n,) of all stable loops.

        Raises InputError for another symbol, and where no loop is stable.
        """
        if of not in ("S", "T"):
            raise InputError(f"band of {of!r}: expected 'S' or 'T'")
        loops = [loop for loop in self.loops.values() if loop.stable]
        if not loops:
            raise InputError(f"no loop with {self.controller} is stable, so that there is no band")
        low = max(loop.omega[0] for loop in loops)
        omega = np.geomspace(low, min(loop.omega[-1] for loop in loops), 400)
        curves = []
        for loop in loops:
            curve = np.abs(loop.sensitivity if of == "S" else 1 - loop.sensitivity)
            curves.append(np.interp(np.log(omega), np.log(loop.omega), curve))
        return omega, np.min(curves, axis=0), np.max(curves, axis=0)

    def plot(self) -> Figure:
        """|S| and |T| over frequency: band of all plants, the first and the worst plant.

        Raises InputError where no loop is stable.
        """
        return draw(self)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per plant: stable, crossover [rad/s] and the margins in SI units (phase in deg)."""
        import pandas

        names = ("stable", "crossover", *MARGINS)
        rows = [{name: getattr(loop, name) for name in names} for loop in self.loops.values()]
        return pandas.DataFrame(rows, index=pandas.Index(list(self.loops), name="plant"))

    def to_dict(self) -> dict[str, Any]:
        """One of `robust` in analysis.json, SI units (phase in deg)."""
        return as_dict(
            self, "controller stable unstable", plants=len(self.loops),
            worst={name: {"value": worst.value, "plant": worst.label} for name, worst in self.worst.items()},
            quantiles={name: self._quantiles(name) for name in MARGINS},
        )  # fmt: skip

    def _quantiles(self, name: str) -> dict[str, float]:
        """Quantiles over the stable loops, by rank, because interpolation would average infinite margins."""
        values = np.sort([getattr(loop, name) for loop in self.loops.values() if loop.stable])
        if not values.size:
            values = np.array([np.nan])
        shares = {"5 %": 0.05, "50 %": 0.5, "95 %": 0.95}
        return {key: float(values[int(round(share * (values.size - 1)))]) for key, share in shares.items()}

    def __str__(self) -> str:
        head = f"{self.controller} with {len(self.loops)} plants: "
        if not self.stable:
            shown = "; ".join(self.unstable[:3]) + (" ..." if len(self.unstable) > 3 else "")
            return f"{head}{len(self.unstable)} NOT STABLE: {shown}"
        lines = [f"{head}all stable; the worst of each margin, and where"]
        for name, worst in self.worst.items():
            value, unit = (1e3 * worst.value, "ms") if name == "delay_margin" else (worst.value, FIGURES[name])
            lines.append(f"  {name.replace('_', ' '):<13} {value:8.3g} {unit:<4} {worst.label}")
        return "\n".join(lines)


def robust_margins(
    systems: Mapping[str, control.StateSpace],
    controller: Controller,
    *,
    lag: int = 0,
    delay: float = 0.0,
    points: int = 300,
) -> RobustMargins:
    """Analyse one controller's loop with each of many plants.

    Parameters
    ----------
    systems: label -> continuous linear model; `plant.draws` makes them from a plant's uncertainty and operating points.
    controller: one design for all plants.
    lag, delay, points: as in analyse_loop.

    Raises InputError if there is no plant.
    """
    if not systems:
        raise InputError("robust_margins got no plant; give at least one")
    return RobustMargins(
        controller.name,
        {name: analyse_loop(model, controller, lag=lag, delay=delay, points=points) for name, model in systems.items()},
    )
