"""The reference simulation: SciPy's integrators with events, on the physics functions, in plain Python.

It is a thousand times slower than the engine and shares only the equations with it: no tape, no generated code, another
integrator (DOP853, Radau, LSODA), another event location.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from ..core.errors import InputError, SimulationError
from ..plant.plain import evaluator
from ..plant.plant import Plant
from ..plant.system import Contact
from .engine import Hold, checked_inputs, checked_start, initial_modes

METHODS = ("DOP853", "RK45", "RK23", "Radau", "BDF", "LSODA")


@dataclass(frozen=True)
class ReferenceRun:
    """States (N, n), sliding directions (N, contacts), and mode changes as (time, contact, new direction)."""

    states: np.ndarray
    modes: np.ndarray
    events: tuple[tuple[float, str, int], ...]

    def __repr__(self) -> str:
        samples, states = self.states.shape
        return f"ReferenceRun of {states} states over {samples} samples, {len(self.events)} changes of a contact's mode"


def simulate_reference(
    plant: Plant,
    current: np.ndarray | Sequence[float],
    *,
    force: np.ndarray | Sequence[float] | None = None,
    hold: Hold = "zero_order",
    start: np.ndarray | None = None,
    sample_time: float | None = None,
    method: str = "DOP853",
    rtol: float = 1e-10,
) -> ReferenceRun:
    """Simulate the plant with SciPy. Arguments as for `simulate`.

    method: integrator, one of METHODS. rtol: relative tolerance; the absolute one is rtol times the states' scales.

    Raises InputError as `simulate` does, and SimulationError if the integrator stops.
    """
    current, outer = checked_inputs(current, force)
    dt = plant.sample_time if sample_time is None else sample_time
    y = checked_start(plant, start)
    if not dt > 0.0 or not 1e-13 <= rtol <= 0.1 or method not in METHODS:
        raise InputError(
            f"sample_time = {dt:g} s, rtol = {rtol:g}, method = {method!r}; expected more than 0 s, 1e-13 to 0.1 and "
            f"one of {', '.join(METHODS)}"
        )
    machine = _ModeMachine(plant, method, rtol)
    modes = initial_modes(plant, y)
    states = np.empty((current.size, y.size))
    directions = np.zeros((current.size, modes.size), dtype=np.int8)
    events: list[tuple[float, str, int]] = []
    for k in range(current.size):
        states[k], directions[k] = y, modes
        if k + 1 == current.size:
            break
        end = k + 1 if hold == "first_order" else k
        slopes = np.array([current[end] - current[k], outer[end] - outer[k]]) / dt
        inputs = np.array([current[k], outer[k]])
        changes = machine.advance(y, modes, inputs, slopes, dt)
        events += [(k * dt + at, contact, direction) for at, contact, direction in changes]
    return ReferenceRun(states, directions, tuple(events))


class _ModeMachine:
    """Integrates between mode changes; `y` and `modes` are updated in place."""

    def __init__(self, plant: Plant, method: str, rtol: float) -> None:
        equations = plant.structure.equations
        self.names = [state.name for state in equations.states]
        self.rates = equations.rates
        self.inputs = equations.inputs
        self.signals = evaluator(equations, plant.values)
        self.contacts = plant.structure.system.contacts
        self.laws = [plant.structure.law(contact) for contact in self.contacts]
        self.bands = [
            0.0 if law.band is None else plant[contact.symbol(law.band)]
            for contact, law in zip(self.contacts, self.laws, strict=True)
        ]
        self.columns = [self.names.index(contact.velocity) for contact in self.contacts]
        self.kinks = list(plant.structure.system.kinks)
        #: Sign of each kink's signal; 0 for one that is never reached.
        self.sides: list[float] = []
        self.method, self.rtol = method, rtol
        self.atol = rtol * np.array([state.scale for state in equations.states])

    def evaluate(self, y: np.ndarray, inputs: np.ndarray, modes: np.ndarray) -> dict[str, float]:
        directions = {contact.direction: mode for contact, mode in zip(self.contacts, modes, strict=True)}
        states = dict(zip(self.names, y.tolist(), strict=True))
        return self.signals(**states, **dict(zip(self.inputs, inputs, strict=True)), **directions)

    def held(self, index: int, y: np.ndarray, inputs: np.ndarray, modes: np.ndarray) -> tuple[float, float]:
        """Net effort on a contact at rest, and breakaway effort in its direction."""
        contact: Contact = self.contacts[index]
        trial = modes.copy()
        trial[index] = 1.0 if self.evaluate(y, inputs, modes)[contact.net] > 0 else -1.0
        signals = self.evaluate(y, inputs, trial)
        return signals[contact.net], trial[index] * signals[contact.friction]

    def advance(
        self, y: np.ndarray, modes: np.ndarray, inputs: np.ndarray, slopes: np.ndarray, dt: float
    ) -> list[tuple[float, str, int]]:
        """Advance one sample from the state y; returns the mode changes."""
        changes: list[tuple[float, str, int]] = []
        t = 0.0
        signals = self.evaluate(y, inputs, modes)
        self.sides = [0.0 if np.isinf(signals[name]) else float(np.sign(signals[name])) for name in self.kinks]
        for index, contact in enumerate(self.contacts):
            if modes[index] == 0 and self.laws[index].sticks and self._decide(index, y, inputs, modes):
                changes.append((t, contact.name, int(modes[index])))
        while t < dt:
            found, watched = self._integrate(t, dt, y, modes, inputs, slopes)
            t = float(found.t[-1])
            y[:] = found.y[:, -1]
            if found.status == 0:
                break
            for index, times in enumerate(found.t_events[len(watched) :]):
                if times.size:
                    self.sides[index] = -self.sides[index]
            for index, times in zip(watched, found.t_events[: len(watched)], strict=True):
                if times.size:
                    if modes[index] != 0:
                        y[self.columns[index]] = 0.0
                    self._decide(index, y, inputs + slopes * t, modes, released=modes[index] == 0)
                    changes.append((t, self.contacts[index].name, int(modes[index])))
            if len(changes) > 1000:
                raise SimulationError("a contact changed its mode more than 1000 times within one sample")
        return changes

    def _integrate(
        self, t: float, dt: float, y: np.ndarray, modes: np.ndarray, inputs: np.ndarray, slopes: np.ndarray
    ) -> tuple[Any, list[int]]:
        def rates(s: float, state: np.ndarray) -> list[float]:
            try:
                signals = self.evaluate(state, inputs + slopes * s, modes)
            except OverflowError:
                # A trial step far beyond the stop of the contact; the integrator rejects nan.
                return [np.nan] * state.size
            return [signals[rate] for rate in self.rates]

        watched = [index for index, law in enumerate(self.laws) if law.sticks]
        surfaces = [self._surface(index, modes, inputs, slopes) for index in watched]
        surfaces += [self._kink(index, modes, inputs, slopes) for index in range(len(self.kinks))]
        found = solve_ivp(
            rates,
            (t, dt),
            y,
            method=self.method,
            rtol=self.rtol,
            atol=self.atol,
            events=surfaces,
            first_step=min(1e-5, dt - t),
        )
        if found.status < 0:
            raise SimulationError(f"{self.method} stopped: {found.message}")
        return found, watched

    def _surface(
        self, index: int, modes: np.ndarray, inputs: np.ndarray, slopes: np.ndarray
    ) -> Callable[[float, np.ndarray], float]:
        """Positive while the contact stays in its mode."""

        def surface(s: float, state: np.ndarray) -> float:
            if modes[index] == 0:
                net, held = self.held(index, state, inputs + slopes * s, modes)
                return held - abs(net)
            return float(modes[index] * state[self.columns[index]] - self.bands[index])

        surface.terminal = True  # type: ignore[attr-defined]
        surface.direction = -1.0  # type: ignore[attr-defined]
        return surface

    def _kink(
        self, index: int, modes: np.ndarray, inputs: np.ndarray, slopes: np.ndarray
    ) -> Callable[[float, np.ndarray], float]:
        """Positive while a kink's signal keeps its sign."""
        side = self.sides[index]

        def surface(s: float, state: np.ndarray) -> float:
            return side * self.evaluate(state, inputs + slopes * s, modes)[self.kinks[index]] if side else 1.0

        surface.terminal = True  # type: ignore[attr-defined]
        surface.direction = -1.0  # type: ignore[attr-defined]
        return surface

    def _decide(
        self, index: int, y: np.ndarray, inputs: np.ndarray, modes: np.ndarray, *, released: bool = False
    ) -> bool:
        """Decide at rest between sticking and sliding; True for sliding. released: an event located a breakaway."""
        net, held = self.held(index, y, inputs, modes)
        moves = released or abs(net) > held
        modes[index] = np.sign(net) if moves else 0.0
        return moves
