"""The result of a run: states over time, sticking of each contact, exceeded limits, solver and versions."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import SimulationError
from ..core.log import CHANNELS
from ..core.plotting import draw
from ..core.result import Result
from ..plant.plant import Plant
from .law_range import Extrapolation, extrapolations
from .limits import Exceedance, exceedances

if TYPE_CHECKING:
    import control
    import pandas
    from matplotlib.figure import Figure


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of the packages that a simulation result depends on."""
    names = ("ehsa_ctrl", "numpy", "numba", "scipy", "control")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}


@dataclass(frozen=True, repr=False)
class Trajectory(Result):
    """A sampled run of a plant.

    Attributes
    ----------
    plant: the plant of this run.
    time: (N,) s.
    current: (N,) A, that acts on the motor from each sample on; for a system other than the EHSA its first input.
    outer_force: (N,) N, F_D(t), positive when it resists extension; for another system its second input.
    states: (N, n) in the order of the structure's states, SI units.
    modes: (N, contacts) sliding directions of shaft and rod, 0 while they stick.
    cell_force: (N,) N, force in a load cell between rod and load; zero for a system without one.
    extremes: (2, n) smallest and largest value of each state, also between samples.
    hold: "zero_order" or "first_order".
    tolerance: tolerance of the engine, see `simulate`.
    stopped: sentence on why the run stopped early; empty for a finished run.
    """

    plant: Plant
    time: np.ndarray
    current: np.ndarray
    outer_force: np.ndarray
    states: np.ndarray
    modes: np.ndarray
    cell_force: np.ndarray
    extremes: np.ndarray
    hold: str
    tolerance: float
    stopped: str = ""
    provenance: dict[str, str] = field(default_factory=versions)

    def __getitem__(self, name: str) -> np.ndarray:
        """A signal by name (N,): a state (omega, P_1, P_2, v, x ...), an input (current, F_D), dP, F_cell or time."""
        extra = {**self._inputs, "time": self.time}
        if self.plant.structure.system.cell is not None:
            extra["F_cell"] = self.cell_force
        if name in extra:
            return extra[name]
        if name == "dP":
            return self["P_1"] - self["P_2"]
        return self.states[:, self.plant.structure.equations.index(name)]

    @property
    def _inputs(self) -> dict[str, np.ndarray]:
        """The two inputs, by their names in the system."""
        first, second = self.plant.structure.system.inputs
        return {first: self.current, second: self.outer_force}

    @property
    def units(self) -> dict[str, str]:
        """Driven inputs, then states -> SI unit."""
        drives = self.plant.structure.system.drives
        units = {name: CHANNELS[channel].unit for name, channel in drives.items()}
        return units | {state.name: state.unit for state in self.plant.structure.equations.states}

    def shown(self) -> dict[str, Any]:
        """What a figure needs: units of the states and of the inputs that are not zero throughout, names of the inputs,
        and contacts that can stick.
        """
        structure = self.plant.structure
        idle = [name for name in structure.system.inputs if not self[name].any()]
        # The linear model has no dry friction, so that nothing sticks.
        contacts = structure.system.contacts if self.plant.model == "nonlinear" else ()
        return {
            "signals": {name: unit for name, unit in self.units.items() if name not in idle},
            "inputs": list(structure.system.drives),
            "contacts": [contact.name for contact in contacts if structure.law(contact).sticks],
        }

    def __len__(self) -> int:
        return len(self.time)

    def sticks(self, contact: str) -> np.ndarray:
        """(N,) bool: whether friction holds the contact, "shaft" or "rod", at rest."""
        names = [c.name for c in self.plant.structure.system.contacts]
        column = names.index(contact)
        held = self.plant.structure.law(self.plant.structure.system.contacts[column]).sticks
        return (self.modes[:, column] == 0) & held

    @cached_property
    def exceeded(self) -> tuple[Exceedance, ...]:
        """Limits of the plant that this run exceeded."""
        return tuple(exceedances(self.plant, self.time, self.current, self.states, self.extremes))

    @cached_property
    def extrapolated(self) -> tuple[Extrapolation, ...]:
        """Variables that left the range of the logs from which a law of the plant was found."""
        structure = self.plant.structure
        names = [state.name for state in structure.equations.states]
        extremes = {name: (float(a), float(b)) for name, a, b in zip(names, *self.extremes, strict=True)}
        # A controller that fails may end a run with an input that is no number.
        extremes |= {n: (float(np.nanmin(one)), float(np.nanmax(one))) for n, one in self._inputs.items()}
        directions = [contact.direction for contact in structure.system.contacts]
        sampled = {**dict(zip(names, self.states.T, strict=True)), **dict(zip(directions, self.modes.T, strict=True))}
        return tuple(extrapolations(self.plant, extremes, {**sampled, **self._inputs}))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes this run doubtful: implausible values, and laws beyond the range of their logs."""
        return (*self.plant.implausible, *map(str, self.extrapolated))

    def explained(self) -> Trajectory:
        """This run, if it was finished or exceeded a limit of the plant before it stopped.

        Raises SimulationError, with the reason, for a run that stopped within all limits.
        """
        if self.stopped and not self.exceeded:
            raise SimulationError(self.stopped)
        return self

    @property
    def pressure_level_drift(self) -> float:
        """(P_1 + P_2) / 2 - P_0 at the end [Pa]; in (12) it grows with the pumping work. nan without pressures."""
        if "P_0" not in self.plant.parameters:
            return float("nan")
        return float((self["P_1"][-1] + self["P_2"][-1]) / 2 - self.plant["P_0"])

    def to_pandas(self) -> pandas.DataFrame:
        """One row a sample: time, current, states, force, sliding directions."""
        import pandas

        names = [state.name for state in self.plant.structure.equations.states]
        system = self.plant.structure.system
        # F_cell contains an external force; a prescribed motion needs its own column.
        inputs = system.inputs if system.cell is None else system.inputs[:1]
        columns: dict[str, Any] = {"time": self.time} | {name: self._inputs[name] for name in inputs}
        columns |= {name: self[name] for name in names}
        columns |= {} if system.cell is None else {"F_cell": self.cell_force}
        columns |= {contact.name: self.modes[:, column] for column, contact in enumerate(system.contacts)}
        return pandas.DataFrame(columns)

    def to_response(self) -> control.TimeResponseData:
        """Time response for python-control: inputs, states and outputs named as in `to_iosystem`, SI units."""
        from .response import to_response

        return to_response(self)

    def plot(self) -> Figure:
        """Figure of current, speed, pressures and position over time; sticking is shaded."""
        return draw(self)

    def summary(self) -> str:
        """Length, range of each state and share of sticking, without the exceeded limits."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        yield (
            f"{self.plant.name} ({self.plant.model}): {len(self)} samples, {self.time[-1] - self.time[0]:g} s, "
            f"{self.hold.replace('_', '-')} hold, tolerance {self.tolerance:g}"
        )
        units = {state.name: state.unit for state in self.plant.structure.equations.states}
        for index, (name, unit) in enumerate(units.items()):
            low, high = self.extremes[:, index]
            yield f"  {name:<6} {low:>12.5g} to {high:>12.5g} {unit}, ends at {self.states[-1, index]:.5g}"
        for contact in self.plant.structure.system.contacts:
            yield f"  {contact.name} sticks {100 * np.mean(self.sticks(contact.name)):.1f} % of the samples"

    def __str__(self) -> str:
        passed = [f"  limit exceeded: {exceedance}" for exceedance in self.exceeded]
        beyond = [f"  {one}" for one in self.extrapolated]
        return "\n".join([self.summary(), *passed, *beyond, *([f"  {self.stopped}"] if self.stopped else [])])
