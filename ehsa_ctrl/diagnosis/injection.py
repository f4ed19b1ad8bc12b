"""Simulations with unknown inputs injected, and the part of the squared gap that they close."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..plant.plant import Plant
from ..plant.system import System
from ..simulation.engine import initial_carry, initial_modes, run_open_loop, simulate_batch
from ..simulation.plant_code import plant_code
from .signals import scored, signal_noise

#: Flows are injected in steps of at most this length [s]: what half a hydraulic period brings at once opens valves.
KICK = 5e-3

#: Unknown input -> (N - 1,) mean over each sample.
Injection = Mapping[str, np.ndarray]
#: Squared gap by signal (signals,), as a part of the nominal plant's.
Energy = np.ndarray


@dataclass(frozen=True)
class SquaredGap:
    """Squared gap of measured signals to simulations, by signal, noise subtracted.

    system: declares the signals. signals: measured. noise: of the scored signals. power: their variances. whole:
    squared gap of the nominal plant.
    """

    system: System
    signals: Mapping[str, np.ndarray] = field(repr=False)
    noise: Mapping[str, float]
    power: Mapping[str, float]
    sample_time: float
    whole: float = 1.0

    @classmethod
    def of(
        cls, system: System, measured: Mapping[str, np.ndarray], noise: Mapping[str, float], sample_time: float
    ) -> SquaredGap:
        signals = scored(system.scored, measured, sample_time)
        power = {name: max(float(np.var(values)), 1e-300) for name, values in signals.items()}
        return cls(system, signals, signal_noise(system.scored, noise, sample_time), power, sample_time)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.power)

    def with_measured(self, measured: Mapping[str, np.ndarray]) -> SquaredGap:
        """The same measure for a log whose sensors were corrected."""
        return replace(self, signals=scored(self.system.scored, measured, self.sample_time))

    def errors(self, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
        """(signals, N) measured less simulated, over the signal's standard deviation."""
        shown = scored(self.system.scored, simulated, self.sample_time)
        return np.array([(self.signals[n] - shown[n]) / np.sqrt(self.power[n]) for n in self.names])

    @property
    def floor(self) -> np.ndarray:
        """(signals,) what noise alone leaves."""
        return np.array([self.noise[n] ** 2 / self.power[n] for n in self.names])

    def energy(self, simulated: Mapping[str, np.ndarray]) -> Energy:
        """(signals,) squared gap; large for a run that stopped."""
        errors = self.errors(simulated)
        if not np.isfinite(errors).all():
            return np.full(len(self.names), 1e3 * self.whole)
        return np.maximum(np.mean(errors**2, axis=1) - self.floor, 0.0)

    def share(self, energy: Energy) -> float:
        """Its part of the nominal plant's squared gap."""
        return float(energy.sum()) / self.whole


def simulate_injections(
    plant: Plant,
    current: np.ndarray,
    start: np.ndarray,
    sample_time: float,
    injections: Sequence[Injection],
    capacity: Mapping[str, np.ndarray],
    tolerance: float = 1e-5,
    outside: np.ndarray | None = None,
) -> list[dict[str, np.ndarray]]:
    """Simulate the plant with unknown inputs: channel -> (N,) for each injection; NaN from where a run stopped.

    The system declares where each enters (`Entry`). What adds to an input (a torque to the current, a force to F_D)
    acts from the middle of a sample on where inputs are joined by lines. What adds to the rate of a state (a flow) acts
    as half of its integral in a step at each end of a sample, or of a fraction of at most KICK. capacity: of
    `UnknownInputs`. outside: (N,) second input; zero by default.
    """
    equations, system = plant.structure.equations, plant.structure.system
    to_inputs = {name: entry.target for name, entry in system.entries.items() if entry.target in system.inputs}
    to_states = {name: entry.target for name, entry in system.entries.items() if name not in to_inputs}
    groups: dict[tuple[int, ...], list[int]] = {}
    for i, one in enumerate(injections):
        groups.setdefault(tuple(id(one.get(name)) for name in to_inputs), []).append(i)

    def divisor(name: str) -> np.ndarray | float:
        return capacity[name] if system.entries[name].capacity else 1.0

    states = np.full((len(injections), current.size, start.size), np.nan)
    for members in groups.values():
        one = injections[members[0]]
        inputs = [current.copy(), np.zeros(current.size) if outside is None else outside.copy()]
        for name, target in to_inputs.items():
            if name in one:
                inputs[system.inputs.index(target)][:-1] += one[name] / divisor(name)
        drive, force = inputs
        kicked = [i for i in members if not to_states.keys().isdisjoint(injections[i])]
        without = [i for i in members if i not in kicked]
        if without:
            batch = simulate_batch(
                plant, plant.vector[None, :], drive, force=force, hold=system.hold,
                start=start[None, :], sample_time=sample_time, tolerance=tolerance, jobs=1,
            )  # fmt: skip
            states[without] = batch.states[0]
        if kicked:
            kicks = np.zeros((current.size, len(kicked), start.size))
            for column, i in enumerate(kicked):
                for name, target in to_states.items():
                    if name in injections[i]:
                        half = 0.5 * sample_time * injections[i][name] / divisor(name)
                        kicks[:-1, column, equations.index(target)] = half
            states[kicked] = _simulate_kicked(plant, drive, force, start, sample_time, kicks, tolerance)
    return [{channel: run[:, equations.index(s)] for channel, s in system.outputs.items()} for run in states]


def _simulate_kicked(
    plant: Plant,
    current: np.ndarray,
    force: np.ndarray,
    start: np.ndarray,
    dt: float,
    halves: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Runs (runs, N, n) whose states are moved by `halves` (N, runs, n) in the halves of each sample."""
    code, lines = plant_code(plant.structure.equations), plant.structure.system.hold == "first_order"
    samples, runs, n = halves.shape
    steps = max(int(np.ceil(dt / KICK - 1e-9)), 1)
    fine = np.arange((samples - 1) * steps + 1) / steps
    driven, pushed = (np.interp(fine if lines else fine // 1, np.arange(samples), u) for u in (current, force))
    halves = halves / steps
    rows, y = np.tile(plant.vector, (runs, 1)), np.tile(start, (runs, 1))
    modes, carry = initial_modes(plant, y), initial_carry(plant, runs, dt / steps)
    out = np.full((samples, runs, n), np.nan)
    states, cells = np.empty((runs, 2, n)), np.empty((runs, 2))
    chosen, extremes = np.zeros((runs, 2, modes.shape[1]), dtype=np.int8), np.stack([y, y], axis=1)
    status = np.zeros(runs, dtype=np.int64)
    out[0] = y
    kicks = halves.copy()
    kicks[1:] += halves[:-1]
    for k in range(samples - 1):
        for step in range(steps):
            y += 2.0 * halves[k] if step else kicks[k]
            # The rates that the engine keeps from the end of a step are invalid after a kick.
            carry[:, 1] = np.nan
            at = slice(k * steps + step, k * steps + step + 2)
            run_open_loop(
                code, rows, y, modes, carry, driven[at], pushed[at], lines, dt / steps, tolerance, states, chosen,
                cells, extremes, status=status,
            )  # fmt: skip
        out[k + 1] = y
        if not k % 64 and status.any():
            break
    out[1:] += halves[:-1]
    out[:, status != 0] = np.nan
    return out.swapaxes(0, 1)
