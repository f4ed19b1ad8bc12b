"""Simulation in steps of any length, for an external master, on the engine of `simulate`."""

from __future__ import annotations

from math import ceil
from typing import Any

import numpy as np

from ..core.errors import InputError, SimulationError, shown
from ..plant.plant import Plant
from .engine import DONE, LARGEST, checked_start, initial_carry, initial_modes, run_open_loop, why_stopped
from .plant_code import plant_code

#: Instants closer than this share of a step count as equal, because sums of steps are rounded.
TIME_TOLERANCE = 1e-9
#: The longest step [s]. Engineering judgement: a longer one is a mistake, such as a step in ms.
LONGEST = 3600.0


class SteppedRun:
    """A plant that is simulated step by step, by default from rest.

    Inputs are held over a step. The engine's memory (step length, sticking) is kept between steps, so that steps of one
    sample give the result of `simulate`, to the last bit if the drive has no dead time.

    Attributes
    ----------
    plant: the nominal plant.
    time: s since the start.
    states: (n,) in the order of the structure's states, SI units.
    modes: (contacts,) sliding direction, 0 while it sticks.
    tolerance: as for `simulate`.
    """

    def __init__(self, plant: Plant, *, start: np.ndarray | None = None, tolerance: float = 1e-6) -> None:
        if not 1e-13 <= tolerance <= 1e-1:
            raise InputError(f"tolerance = {tolerance:g}; expected 1e-13 to 0.1")
        first = checked_start(plant, start)
        self.plant, self.tolerance, self.time = plant, tolerance, 0.0
        self._code = plant_code(plant.structure.equations)
        # The engine reads a delayed current from earlier samples of the run, which a step lacks; they are stored here.
        self._dead_time = 0.0 if plant.structure.delay is None else plant[plant.structure.delay]
        late = {} if plant.structure.delay is None else {plant.structure.delay: 0.0}
        values = {**plant.values, **late}
        self._parameters = np.array([[values[name] for name in plant.structure.equations.parameter_names]])
        self._states = np.array(first[None, :])
        self._modes = initial_modes(plant, self._states)
        self._carry = initial_carry(plant, 1, plant.sample_time)
        self._extremes = np.stack([self._states, self._states], axis=1)
        #: Future changes of the delayed current (seconds from now, A), and the current that acts now.
        self._coming: list[tuple[float, float]] = []
        self._acting: float | None = None

    @property
    def states(self) -> np.ndarray:
        return self._states[0].copy()

    @property
    def modes(self) -> np.ndarray:
        return self._modes[0].copy()

    def advance(self, current: float, force: float, duration: float) -> None:
        """Advance by `duration` [s] with both inputs held: for the EHSA current [A] and external force [N].

        Raises
        ------
        InputError: an input that is not finite, a negative duration or one of more than LONGEST.
        SimulationError: the engine stopped; the message has time and cause. The run keeps its state before the step.
        """
        if not all(isinstance(value, int | float | np.number) for value in (current, force, duration)):
            raise InputError(
                f"current is {shown(current)}, force {shown(force)} and duration {shown(duration)}; expected numbers"
            )
        if not (abs(current) < LARGEST and abs(force) < LARGEST):
            raise InputError(f"inputs are {current} and {force} at {self.time:g} s; both must be finite numbers")
        if not 0.0 <= duration <= LONGEST:
            raise InputError(f"a step of {duration} s; expected 0 to {LONGEST:g} s")
        if duration == 0.0:
            return
        before = self.snapshot()
        for length, acting in self._pieces(float(current), duration):
            self._piece(acting, float(force), length, before)
        self.time += duration

    def _pieces(self, current: float, duration: float) -> list[tuple[float, float]]:
        """(length, acting current) of the parts of a step between changes of the delayed current."""
        if self._dead_time == 0.0:
            return [(duration, current)]
        # As in `simulate`, the current before the run equals its first value.
        acting = current if self._acting is None else self._acting
        coming = [*self._coming, (self._dead_time, current)]
        pieces, done = [], 0.0
        while coming and coming[0][0] < duration * (1.0 - TIME_TOLERANCE):
            at, value = coming.pop(0)
            if at > done + TIME_TOLERANCE * duration:
                pieces.append((at - done, acting))
                done = at
            acting = value
        pieces.append((duration - done, acting))
        self._coming = [(at - duration, value) for at, value in coming]
        self._acting = acting
        return pieces

    def _piece(self, current: float, force: float, duration: float, before: dict[str, Any]) -> None:
        # Divided into samples no longer than the plant's, because the engine limits the number of events per sample.
        parts = max(1, ceil(duration / self.plant.sample_time - 1e-6))
        states, _, _, status = self._run(current, force, duration / parts, parts + 1)
        if status != DONE:
            ended = self.time + duration / parts * max(int(np.count_nonzero(np.isfinite(states[:, 0]))) - 1, 0)
            why = why_stopped(self.plant, status, ended, self._states[0], np.array([current, force]), self._modes[0])
            self.restore(before)
            raise SimulationError(why)

    def _run(
        self, current: float, force: float, dt: float, samples: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Advance to the last sample; returns states, modes and load cell force at each sample, and a status."""
        states = np.full((1, samples, self._states.size), np.nan)
        modes = np.zeros((1, samples, self._modes.size), dtype=np.int8)
        cells, status = np.full((1, samples), np.nan), np.zeros(1, dtype=np.int64)
        run_open_loop(
            self._code, self._parameters, self._states, self._modes, self._carry, np.full(samples, current),
            np.full(samples, force), False, dt, self.tolerance, states, modes, cells, self._extremes, status=status,
        )  # fmt: skip
        return states[0], modes[0], cells[0], int(status[0])

    def cell_force(self, current: float, force: float) -> float:
        """Force in a load cell between rod and load [N] at this instant under these inputs; 0 without one."""
        acting = current if self._dead_time == 0.0 or self._acting is None else self._acting
        return float(self._run(acting, force, self.plant.sample_time, 1)[2][0])

    def sticks(self, contact: str) -> bool:
        """Whether friction holds the contact, "shaft" or "rod", at rest."""
        contacts = self.plant.structure.system.contacts
        column = [c.name for c in contacts].index(contact)
        return bool(self._modes[0, column] == 0 and self.plant.structure.law(contacts[column]).sticks)

    def snapshot(self) -> dict[str, Any]:
        """The complete state of the run as plain lists and numbers, for `restore`."""
        return {
            "time": self.time,
            "states": self._states[0].tolist(),
            "modes": self._modes[0].tolist(),
            "carry": self._carry[0].tolist(),
            "coming": [list(change) for change in self._coming],
            "acting": self._acting,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Return to the state of a snapshot, of this run or another one of the same plant."""
        self.time = float(snapshot["time"])
        self._states[0], self._modes[0], self._carry[0] = snapshot["states"], snapshot["modes"], snapshot["carry"]
        self._coming = [(float(at), float(value)) for at, value in snapshot["coming"]]
        self._acting = snapshot["acting"]
