"""Data that no fit has seen, and how a set of values does on it in free run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.log import Log
from ..identification.start import RUN_IN, find_start
from ..identification.window import REST, estimate_states
from ..plant.plant import Plant
from .fit import Metric
from .ripple import angle_of
from .signals import gap, scored, signal_noise
from .twin import Twin

#: The share of a log that is kept back where there is no second one.
KEPT_BACK = 1.0 / 3.0


@dataclass(frozen=True)
class Stretch:
    """A stretch of a log that is scored: a twin that runs over it, and the first of its samples that counts."""

    twin: Twin
    first: int
    noise: Mapping[str, float]
    words: str

    def simulate(self, values: Mapping[str, float]) -> dict[str, np.ndarray] | None:
        """What the sensors would show over the whole stretch; None where the run stopped.

        What integrates, the rod's position and the common level of the pressures, keeps an error of its first sample
        for good. Where there is a run before the part that counts, its mean takes that error off.
        """
        found = self.twin.run([values])[0]
        if found is None or self.first == 0 or self.twin.start is None:
            return found
        missed = {c: float(np.mean(self.twin.log[c][: self.first] - found[c][: self.first])) for c in found}
        start = dict(self.twin.start)
        if "position" in missed:
            start["x"] += missed["position"]
        if {"p1", "p2"} <= set(missed):
            level = 0.5 * (missed["p1"] + missed["p2"])
            start |= {"P_1": start["P_1"] + level, "P_2": start["P_2"] + level}
        return replace(self.twin, start=start).run([values])[0] or found

    def gap(self, values: Mapping[str, float]) -> dict[str, float]:
        """Gap of each scored signal and in total."""
        return self.gap_of(self.simulate(values))

    def gap_of(self, simulated: Mapping[str, np.ndarray] | None) -> dict[str, float]:
        log = self.twin.log
        shown = {channel: log[channel] for channel in self.twin.channels}
        measured = {n: v[self.first :] for n, v in scored(shown, log.sample_time).items()}
        noise = signal_noise(self.noise, log.sample_time)
        if simulated is None:
            return {**dict.fromkeys(measured, float("inf")), "total": float("inf")}
        return gap(measured, {n: v[self.first :] for n, v in scored(simulated, log.sample_time).items()}, noise)

    def residual(self, metric: Metric, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
        """Measured minus simulated of what counts, in the metric's units; see `Metric.residual`."""
        return metric.residual(self.twin, simulated, self.first)


def whole(plant: Plant, twin: Plant, log: Log, noise: Mapping[str, float]) -> Stretch:
    """A whole log from its own start: at rest where it begins so, else from its first samples."""
    found = find_start(plant, log, log.before)
    names = [state.name for state in plant.structure.equations.states]
    start = None if np.array_equal(found.state, plant.rest) else dict(zip(names, found.state.tolist(), strict=True))
    return Stretch(Twin(twin, log, start), 0, noise, log.name)


def last_part(plant: Plant, twin: Plant, log: Log, noise: Mapping[str, float]) -> tuple[Log, Stretch]:
    """What is left to fit with, and the last third, begun in the state that the second before it shows."""
    edge = int(round(len(log) * (1.0 - KEPT_BACK)))
    words = f"the last third of {log.name if log.path else 'the log'}, from {log.time[edge]:g} s on"
    if _hidden(plant, log):
        # A state that no sensor shows is known where the log begins, and from there on by the run alone.
        return log.rows(0, edge), replace(whole(plant, twin, log, noise), first=edge, words=words)
    back = max(edge - max(int(round(RUN_IN / log.sample_time)), 1), 0)
    estimate = estimate_states(plant, log)
    names = [state.name for state in plant.structure.equations.states]
    begin = _plainest(plant, estimate.values, estimate.sd, back, edge)
    start = dict(zip(names, estimate.values[begin].tolist(), strict=True))
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        if abs(estimate.values[begin, column]) < REST * estimate.sd[begin, column]:
            start[contact.velocity] = 0.0
    start["t_run"] = float(log.time[begin] - log.time[0])
    if "speed" in log.channels:
        start["theta"] = float(angle_of(log)[begin])
    piece = log.rows(begin, len(log))
    return log.rows(0, edge), Stretch(Twin(twin, piece, start), edge - begin, noise, words)


def _hidden(plant: Plant, log: Log) -> bool:
    """Whether a state of the system's own is shown by no channel; a rod's speed is the slope of its position."""
    shown = {state for channel, state in plant.structure.system.outputs.items() if channel in log.channels}
    shown |= {"v"} if "x" in shown else set()
    return any(state not in shown for state in plant.structure.system.outputs.values())


def _plainest(plant: Plant, values: np.ndarray, sd: np.ndarray, back: int, edge: int) -> int:
    """The sample near `back` at which every contact most plainly moves: what sticks hides its past."""
    low, high = max(back - (edge - back) // 2, 0), back + (edge - back) // 2
    if high <= low:
        return back
    plain = np.full(high - low, np.inf)
    for contact in plant.structure.system.contacts:
        column = plant.structure.equations.index(contact.velocity)
        plain = np.minimum(plain, np.abs(values[low:high, column]) / sd[low:high, column])
    return low + int(np.argmax(np.minimum(plain, 50.0) - np.abs(np.arange(low, high) - back) * 0.01))
