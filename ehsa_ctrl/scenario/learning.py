"""Iterative learning control: a scenario is repeated, and each run corrects the reference by the error of the last one.

Correction and convergence are those of design/analysis/learning.py. As on a rig, every trial starts at rest, has noise
of its own, and the measured position is what is learnt from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.controller_interface import MEASURED
from ..core.errors import InputError, SimulationError
from ..core.plotting import draw
from ..core.result import Result, as_dict, as_table
from ..design.analysis.learning import Learning, design_learning
from ..design.controller import has_linear_law
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .definition import Scenario
from .prepare import prepare

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


#: Largest number of trials, a limit on time.
MOST_TRIALS = 1000
#: RMS error of the last trial over that of the best one from which on the error counts as growing. Engineering
#: judgement: noise and single slips alone change it by less.
GROWN = 1.5


@dataclass(frozen=True)
class Trial:
    """One run: number from 0, error of the position [m] (RMS and largest), RMS current [A] or other drive in its unit,
    largest correction [m]."""

    number: int
    rms: float
    largest: float
    current: float
    correction: float


@dataclass(frozen=True, repr=False)
class LearntReference(Result):
    """A reference that was learnt over several runs of a scenario.

    Attributes
    ----------
    scenario, controller: names. learning: filter, gain and convergence.
    trials: in their order; the first has no correction. time: (N,) s.
    reference: (N, 3) position [m], velocity, acceleration of the scenario.
    correction: (N,) m, of the best trial.
    errors: trial -> error (N,) [m], of the first and the best one. plant: that was simulated. files: input files.
    """

    scenario: str
    controller: str
    learning: Learning
    trials: tuple[Trial, ...]
    time: np.ndarray
    reference: np.ndarray
    correction: np.ndarray
    errors: dict[int, np.ndarray]
    plant: Plant
    files: tuple[Path, ...] = ()

    @property
    def best(self) -> Trial:
        """The trial with the smallest RMS error."""
        return min(self.trials, key=lambda one: one.rms)

    @property
    def grows(self) -> bool:
        """Whether the error of the last trial is clearly larger than that of the best one."""
        return self.trials[-1].rms > GROWN * self.best.rms

    def trajectory(self) -> pandas.DataFrame:
        """The corrected reference with the columns of a trajectory file: t, position, velocity, acceleration."""
        import pandas

        rows = self.reference.copy()
        rows[:, 0] += self.correction
        return pandas.DataFrame(
            np.column_stack([self.time, rows]), columns=["t", "position", "velocity", "acceleration"]
        )

    def to_pandas(self) -> pandas.DataFrame:
        """One row per trial, SI units."""
        return as_table(self.trials, "rms largest current correction", index="number")

    def to_dict(self) -> dict[str, Any]:
        """Content of learning.json, SI units."""
        return as_dict(
            self, "scenario controller trials", gain=self.learning.gain, lead=self.learning.lead,
            cutoff=self.learning.cutoff, contraction=self.learning.contraction, contraction_at=self.learning.at,
            best=self.best.number, grows=self.grows, words=str(self.learning), provenance=versions(),
        )  # fmt: skip

    def plot(self) -> Figure:
        """RMS error over the trials; error of the first and the best one over time."""
        return draw(self)

    def __str__(self) -> str:
        unit = self.plant.structure.system.drive_unit
        drive = "RMS current" if unit == "A" else "RMS drive"
        lines = [f"{self.scenario} with {self.controller}: {self.learning}", f"  trial  RMS error  largest  {drive}"]
        lines += [
            f"  {one.number:5d}  {1e6 * one.rms:6.1f} um  {1e6 * one.largest:6.0f} um  {one.current:.3f} {unit}"
            for one in self.trials
        ]
        lines.append(f"  the reference is that of trial {self.best.number}, the best one")
        if self.grows:
            lines.append(
                "  the error grows again: the linear loop converges, but friction or a limit does not let this one; "
                "lower the gain or the cutoff, or give a deadband"
            )
        return "\n".join(lines)


def learn_reference(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    controller: Any = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
    trials: int = 8,
    gain: float = 0.5,
    cutoff: float = 10.0,
    lead: int | None = None,
    deadband: float = 0.0,
) -> LearntReference:
    """Run a scenario several times, each time with the reference that the last run taught: iterative learning control.

    Each run corrects the reference of the last one, w_next = Q (w + gain z^lead e), with the measured error e and a
    low-pass filter Q without phase.

    Parameters
    ----------
    scenario, controller, plant, design, settings: as for `run`, with one controller.
    trials: number of corrections; there is one run more.
    gain: 1 learns in one trial, less averages noise. cutoff: frequency up to which is learnt [Hz].
    lead: samples by which the error is advanced; by default those that converge fastest.
    deadband: error that is not learnt [m].

    Returns
    -------
    The trials and the reference of the best one; `trajectory()` is a table for a scenario with [reference] kind =
    "file".

    Raises
    ------
    InputError: as `run`; for a reference that jumps, a controller without a linear law, and a correction that would
        grow at any frequency.
    SimulationError: a trial stops early.
    """
    case = prepare(scenario, controller=controller, plant=plant, design=design, settings=settings)
    definition, where = case.scenario.definition, case.scenario.name
    if not 1 <= trials <= MOST_TRIALS:
        raise InputError(f"trials = {trials}; expected 1 to {MOST_TRIALS}")
    if not (np.isfinite(deadband) and deadband >= 0.0):
        raise InputError(f"deadband = {deadband:g} m; expected 0 or more")
    if definition.reference.jumps():
        raise InputError(
            f"{where}: its target jumps, and no correction makes the rod follow a jump; take a reference of kind "
            "moves, trapezoid, ramp, sine or file"
        )
    if not has_linear_law(case.controller):
        raise InputError(f"{case.controller.name} has no linear law, so that the convergence can't be checked")
    learning = design_learning(case.model, case.controller, gain=gain, cutoff=cutoff, lead=lead)
    found: list[Trial] = []
    errors: dict[int, np.ndarray] = {}
    correction = best = np.zeros(0)
    least = np.inf
    for number in range(trials + 1):
        loop = case.simulate(case.nonlinear, definition.sensors.seed + number, correction)
        run = loop.trajectory
        rows = definition.reference.rows(run.time)
        if run.stopped:
            raise SimulationError(f"{where}: trial {number} stopped: {run.stopped}; lower the gain or the cutoff")
        correction = correction if correction.size else np.zeros(run.time.size)
        error = rows[:, 0] - run["x"]
        current = float(np.sqrt(np.mean(run.current**2)))
        sizes = float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error)))
        found.append(Trial(number, *sizes, current, float(np.max(np.abs(correction)))))
        if number == 0 or sizes[0] < least:
            least, best = sizes[0], correction
            errors = {0: errors.get(0, error), number: error}
        if number < trials:
            measured = rows[:, 0] - loop.measured[:, MEASURED.index("position")]
            # A lost reading teaches nothing.
            measured = np.where(np.isfinite(measured) & (np.abs(measured) > deadband), measured, 0.0)
            correction = learning.next_correction(correction, measured)
    return LearntReference(
        scenario=where,
        controller=case.controller.name,
        learning=learning,
        trials=tuple(found),
        time=run.time,
        reference=rows[:, :3],
        correction=best,
        errors=errors,
        plant=run.plant,
        files=case.files,
    )
