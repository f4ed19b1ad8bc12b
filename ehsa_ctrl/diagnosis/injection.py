"""Simulations with injected unknown inputs, and the squared gap that they leave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..plant.plant import Plant
from ..plant.system import System
from ..simulation.engine import initial_carry, initial_modes, run_open_loop, simulate_batch
from ..simulation.plant_code import plant_code
from ..simulation.threads import in_threads
from .signals import scored_signals, signal_noise

#: Longest time between two impulses by which a flow is injected [s]: the flow of half a hydraulic period in a single
#: impulse would raise the pressure enough to open a relief valve.
IMPULSE_SPACING = 5e-3

#: Unknown input -> (N - 1,) mean over each sample.
Injection = Mapping[str, np.ndarray]
#: Squared gap of each signal (signals,).
SquaredGaps = np.ndarray


@dataclass(frozen=True)
class GapMeasure:
    """Measures the squared gap between measured and simulated signals.

    system: declares the scored signals. signals: measured (N,) each. noise: their noise, standard deviation. variance:
    their variances. nominal: total squared gap of the nominal plant.
    """

    system: System
    signals: Mapping[str, np.ndarray] = field(repr=False)
    noise: Mapping[str, float]
    variance: Mapping[str, float]
    sample_time: float
    nominal: float = 1.0

    @classmethod
    def of(
        cls, system: System, measured: Mapping[str, np.ndarray], noise: Mapping[str, float], sample_time: float
    ) -> GapMeasure:
        signals = scored_signals(system.scored, measured, sample_time)
        variance = {name: max(float(np.var(values)), 1e-300) for name, values in signals.items()}
        return cls(system, signals, signal_noise(system.scored, noise, sample_time), variance, sample_time)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.variance)

    def with_measured(self, measured: Mapping[str, np.ndarray]) -> GapMeasure:
        """The same measure for other measurements, for example with a sensor error corrected."""
        return replace(self, signals=scored_signals(self.system.scored, measured, self.sample_time))

    def errors(self, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
        """(signals, N) measured minus simulated, divided by the signal's standard deviation."""
        shown = scored_signals(self.system.scored, simulated, self.sample_time)
        return np.array([(self.signals[n] - shown[n]) / np.sqrt(self.variance[n]) for n in self.names])

    @property
    def noise_floor(self) -> np.ndarray:
        """(signals,) squared gap of noise alone."""
        return np.array([self.noise[n] ** 2 / self.variance[n] for n in self.names])

    def squared_gap(self, simulated: Mapping[str, np.ndarray]) -> SquaredGaps:
        """(signals,) squared gap with the noise subtracted; a thousand times the nominal one if the run stopped."""
        errors = self.errors(simulated)
        if not np.isfinite(errors).all():
            return np.full(len(self.names), 1e3 * self.nominal)
        return np.maximum(np.mean(errors**2, axis=1) - self.noise_floor, 0.0)

    def share(self, squared_gap: SquaredGaps) -> float:
        """The total as a share of the nominal plant's squared gap."""
        return float(squared_gap.sum()) / self.nominal


def simulate_injections(
    plant: Plant,
    current: np.ndarray,
    start: np.ndarray,
    sample_time: float,
    injections: Sequence[Injection],
    capacity: Mapping[str, np.ndarray],
    tolerance: float = 1e-5,
    second_input: np.ndarray | None = None,
) -> list[dict[str, np.ndarray]]:
    """Simulate the plant with unknown inputs: channel -> (N,) for each injection; NaN if the run stopped.

    The system declares where each unknown input enters (`Entry`). One that adds to an input (a torque to the current, a
    force to F_D) is added to the sampled input. One that adds to the rate of a state (a flow) is injected as impulses:
    half of its integral at each end of a sample, or of a fraction of a sample of at most IMPULSE_SPACING.

    current, second_input: (N,) inputs of the system; the second is zero by default. start: (n,). capacity: see
    `UnknownInputs`.
    """
    equations, system = plant.structure.equations, plant.structure.system
    to_inputs = {name: entry.target for name, entry in system.entries.items() if entry.target in system.inputs}
    to_states = {name: entry.target for name, entry in system.entries.items() if name not in to_inputs}
    outer = np.zeros(current.size) if second_input is None else second_input

    def mean(injection: Injection, name: str) -> np.ndarray:
        return injection[name] / (capacity[name] if system.entries[name].capacity else 1.0)

    def simulate(injection: Injection) -> np.ndarray:
        inputs = [current.copy(), outer.copy()]
        for name, target in to_inputs.items():
            if name in injection:
                inputs[system.inputs.index(target)][:-1] += mean(injection, name)
        drive, force = inputs
        if to_states.keys().isdisjoint(injection):
            batch = simulate_batch(
                plant, plant.vector[None, :], drive, force=force, hold=system.hold,
                start=start[None, :], sample_time=sample_time, tolerance=tolerance, jobs=1,
            )  # fmt: skip
            return batch.states[0]
        halves = np.zeros((current.size, start.size))
        for name, target in to_states.items():
            if name in injection:
                halves[:-1, equations.index(target)] = 0.5 * sample_time * mean(injection, name)
        return _simulate_impulses(plant, drive, force, start, sample_time, halves, tolerance)

    states = in_threads(simulate, injections)
    return [{channel: run[:, equations.index(s)] for channel, s in system.outputs.items()} for run in states]


def _simulate_impulses(
    plant: Plant,
    current: np.ndarray,
    force: np.ndarray,
    start: np.ndarray,
    dt: float,
    halves: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """States (N, n) with impulses `halves` (N, n) on them at start and end of each sample; NaN if the run stopped."""
    code, lines = plant_code(plant.structure.equations), plant.structure.system.hold == "first_order"
    samples, n = halves.shape
    steps = max(int(np.ceil(dt / IMPULSE_SPACING - 1e-9)), 1)
    fine = np.arange((samples - 1) * steps + 1) / steps
    driven, pushed = (np.interp(fine if lines else fine // 1, np.arange(samples), u) for u in (current, force))
    parts = halves / steps
    # At a sample the impulse at the end of the one before joins that at the start of the next one.
    impulses = np.repeat(2.0 * parts, steps, axis=0)[: fine.size]
    impulses[::steps] = parts
    impulses[steps::steps] += parts[:-1]
    y = start[None, :].copy()
    modes, status = initial_modes(plant, y), np.zeros(1, dtype=np.int64)
    states, cells = np.full((1, fine.size, n), np.nan), np.empty((1, fine.size))
    run_open_loop(
        code, plant.vector[None, :], y, modes, initial_carry(plant, 1, dt / steps), driven, pushed, lines,
        dt / steps, tolerance, states, np.zeros((1, fine.size, modes.shape[1]), dtype=np.int8), cells,
        np.stack([y, y], axis=1), status=status, impulses=np.ascontiguousarray(impulses[None]),
    )  # fmt: skip
    if status.any():
        return np.full((samples, n), np.nan)
    out = states[0, ::steps].copy()
    out[1:] += parts[:-1]
    return out
