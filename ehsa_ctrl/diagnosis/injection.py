"""Simulations with unknown inputs injected, and the part of the squared gap that they close."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..plant.plant import Plant
from ..simulation.engine import initial_carry, initial_modes, run_open_loop, simulate_batch
from ..simulation.plant_code import plant_code
from .signals import SIGNALS, scored, signal_noise

#: Flows are injected in steps of at most this length [s]: what half a hydraulic period brings at once opens valves.
KICK = 5e-3

#: Unknown input -> (N - 1,) mean over each sample.
Injection = Mapping[str, np.ndarray]
#: Squared gap by signal (signals,), as a part of the nominal plant's.
Energy = np.ndarray


@dataclass(frozen=True)
class SquaredGap:
    """Squared gap of measured signals to simulations, by signal, noise subtracted.

    signals: measured. noise: of the scored signals. power: their variances. whole: squared gap of the nominal plant.
    """

    signals: Mapping[str, np.ndarray] = field(repr=False)
    noise: Mapping[str, float]
    power: Mapping[str, float]
    sample_time: float
    whole: float = 1.0

    @classmethod
    def of(cls, measured: Mapping[str, np.ndarray], noise: Mapping[str, float], sample_time: float) -> SquaredGap:
        signals = scored(measured, sample_time)
        power = {name: max(float(np.var(signals[name])), 1e-300) for name in SIGNALS if name in signals}
        return cls(signals, signal_noise(noise, sample_time), power, sample_time)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.power)

    def with_measured(self, measured: Mapping[str, np.ndarray]) -> SquaredGap:
        """The same measure for a log whose sensors were corrected."""
        return replace(self, signals=scored(measured, self.sample_time))

    def errors(self, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
        """(signals, N) measured less simulated, over the signal's standard deviation."""
        shown = scored(simulated, self.sample_time)
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
    compliance: Mapping[str, np.ndarray],
    tolerance: float = 1e-5,
    outside: np.ndarray | None = None,
) -> list[dict[str, np.ndarray]]:
    """Simulate the plant with unknown inputs: channel -> (N,) for each injection; NaN from where a run stopped.

    A torque acts as a current, a force as F_D, from the middle of a sample on where inputs are joined by lines. The
    engine has no input for flows: they act as half of their volume in a step at each end of a sample, or of a fraction
    of at most KICK. compliance: of `UnknownInputs`. outside: (N,) of the second input, to which a force adds; zero by
    default.
    """
    groups: dict[tuple[int, int], list[int]] = {}
    for i, one in enumerate(injections):
        groups.setdefault((id(one.get("torque")), id(one.get("force"))), []).append(i)
    equations, outputs = plant.structure.equations, plant.structure.system.outputs
    states = np.full((len(injections), current.size, start.size), np.nan)
    for members in groups.values():
        one = injections[members[0]]
        drive, force = current.copy(), np.zeros(current.size) if outside is None else outside.copy()
        if "torque" in one:
            drive[:-1] += one["torque"] / plant["K_T"]
        if "force" in one:
            force[:-1] += one["force"]
        with_flow = [i for i in members if "flow_1" in injections[i] or "flow_2" in injections[i]]
        without = [i for i in members if i not in with_flow]
        if without:
            batch = simulate_batch(
                plant, plant.vector[None, :], drive, force=force, hold=plant.structure.system.hold,
                start=start[None, :], sample_time=sample_time, tolerance=tolerance, jobs=1,
            )  # fmt: skip
            states[without] = batch.states[0]
        if with_flow:
            kicks = np.zeros((current.size, len(with_flow), start.size))
            for column, i in enumerate(with_flow):
                for chamber in "12":
                    if f"flow_{chamber}" in injections[i]:
                        half = 0.5 * sample_time * injections[i][f"flow_{chamber}"] / compliance[f"flow_{chamber}"]
                        kicks[:-1, column, equations.index(f"P_{chamber}")] = half
            states[with_flow] = _simulate_kicked(plant, drive, force, start, sample_time, kicks, tolerance)
    return [{channel: run[:, equations.index(s)] for channel, s in outputs.items()} for run in states]


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
    code, lines = plant_code(plant.structure), plant.structure.system.hold == "first_order"
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
