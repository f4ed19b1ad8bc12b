"""Candidates of a diagnosis under inputs that they were not fitted to: how far apart they are, and within which limits.

The distance of two candidates is what a refit could not make up: what is left of the difference of their outputs after
the nominal parameters, and the numbers of the two, have moved as far as is believed of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import inf

import numpy as np

from ..core.log import Log
from ..identification.admissible import shares
from ..physics.effects.presliding import DAMPING, HARD, SOFTNESS
from ..plant.plant import Plant
from ..simulation.bench import CENTRING_GAIN, CENTRING_LIMIT, CENTRING_TIME
from ..simulation.engine import simulate_batch
from .fit import STEP, TEMPER, Bench, Metric, Nominal
from .probes import Probe
from .signals import SIGNALS
from .twin import Twin, with_every_effect

#: Share of each limit that is left.
MARGIN = 0.15
#: Amplitude that is tried first [A].
FIRST = 2.0
#: How well the stiffness of a spring is known that is mounted for the experiment.
SPRING_SD = 0.05
#: A candidate's own numbers are known to this share of their change, and are moved by this share of that.
OWN, OWN_STEP = 0.5, 0.3
#: A nominal parameter that went so many prior deviations away is a number of the candidate's own.
FAR = 3.0
#: So often is the refit weighed anew, with large errors held down.
REWEIGHED = 3
#: The slow loop is followed in steps of this length [s].
LOOP = 0.1
#: What all simulations show.
CHANNELS = ("speed", "p1", "p2", "position")

Pair = tuple[str, str]
Setting = Mapping[str, float]


@dataclass(frozen=True)
class Outputs:
    """What the candidates make of one current.

    change: symbols of the load and what they are changed by, -inf for what is removed. twin: with the current and the
    first candidate's outputs for a log. rows (candidates, R): these less each one's, in the scale of the metric.
    """

    change: Setting
    twin: Twin
    metric: Metric
    rows: np.ndarray = field(repr=False)

    @property
    def most(self) -> np.ndarray:
        """Distance of each pair (pairs,) if a refit makes up nothing; it can't be more."""
        apart = [self.rows[a] - self.rows[b] for a, b in combinations(range(len(self.rows)), 2)]
        return np.asarray(np.sqrt(TEMPER) * np.linalg.norm(apart, axis=1))


@dataclass(frozen=True)
class Trial:
    """A probe at an amplitude [A], with the slow loop around the rod or not, and what the candidates make of it."""

    probe: Probe
    amplitude: float
    centre: bool
    outputs: Outputs


class Rivals:
    """Candidates, by name the symbols and sensor words that were fitted, and what each may still move."""

    def __init__(
        self, plant: Plant, hypotheses: Mapping[str, Setting], noise: Mapping[str, float], nominal: Nominal
    ) -> None:
        self.plant, self.hypotheses, self.noise, self.nominal = plant, hypotheses, noise, nominal
        soft = any(values.get(SOFTNESS, 0.0) > HARD for values in hypotheses.values())
        self.bristles = with_every_effect(plant, "lugre") if soft else None
        self.pairs: tuple[Pair, ...] = tuple(combinations(hypotheses, 2))

    def loaded(self, values: Setting, change: Setting) -> dict[str, float]:
        """A candidate's setting with the changed load; what is removed is zero, whatever it was."""
        new = dict(values)
        for name, by in change.items():
            new[name] = 0.0 if by == -inf else new.get(name, self.plant[name]) + by
        return new

    def settings(self, change: Setting) -> list[dict[str, float]]:
        """All candidates with the changed load."""
        return [self.loaded(values, change) for values in self.hypotheses.values()]

    def largest(
        self, probe: Probe, change: Setting, time: np.ndarray, *, centre: bool = False, begin: float = FIRST
    ) -> tuple[float, str]:
        """The largest amplitude [A] that keeps the limits, within a fifth or so, and the limit that is nearest.

        The first candidate stands for all; 0 if there is none. begin: what is tried first.
        """
        first = self.settings(change)[0]
        low, high, amplitude, limit = 0.0, inf, max(begin, 0.1), ""
        for _ in range(4):
            current = self._current(probe.current(time, amplitude), first, centre)
            run = self._twin(time, current).run([first])[0]
            used = self._used(run, current)
            # A plant without limits is driven with what is tried first.
            share = max(used.values(), default=1.0 - MARGIN) / (1.0 - MARGIN)
            if share <= 1.0:
                low = amplitude
                if share > 0.8:
                    break
            else:
                high = amplitude
            limit = max(used, key=lambda name: used[name], default="")
            amplitude *= float(np.clip(0.95 / max(share, 1e-3), 0.4, 2.5))
            if not low < amplitude < high:
                amplitude = float(np.sqrt(low * high))
        return low, limit

    def trial(
        self, probe: Probe, amplitude: float, change: Setting, time: np.ndarray, *, centre: bool = False
    ) -> Trial | None:
        """An input with all candidates, smaller if one of them passes a limit; None if that does not help."""
        settings = self.settings(change)
        for _ in range(5):
            # Few digits, so that what is said is what is meant.
            amplitude = float(f"{amplitude:.3g}")
            current = self._current(probe.current(time, amplitude), settings[0], centre)
            twin = self._twin(time, current)
            runs = twin.run(settings)
            used = max(max(self._used(run, current).values(), default=0.0) for run in runs)
            if used <= 1.0 - MARGIN:
                outputs = self._outputs(twin, change, runs)
                return None if outputs is None else Trial(probe, amplitude, centre, outputs)
            amplitude *= 0.85
        return None

    def _twin(self, time: np.ndarray, current: np.ndarray) -> Twin:
        log = Log(time, {"current": current, **dict.fromkeys(CHANNELS, np.zeros(time.size))})
        return Twin(self.plant, log, None, self.bristles)

    def _current(self, current: np.ndarray, values: Setting, centre: bool) -> np.ndarray:
        """The current with what the bench's slow loop adds, block by block, around this candidate's rod."""
        if not centre:
            return current
        symbols = {n: v for n, v in values.items() if "." not in n and n not in (SOFTNESS, DAMPING)}
        plant, dt = self.plant.set(**symbols), self.plant.sample_time
        out, state, low = current.copy(), plant.rest[None], 0.0
        length, x = max(int(round(LOOP / dt)), 1), plant.structure.equations.index("x")
        for first in range(0, current.size - 1, length):
            block = out[first : first + length + 1]
            block -= np.clip(CENTRING_GAIN * low, -CENTRING_LIMIT, CENTRING_LIMIT)
            batch = simulate_batch(plant, plant.vector[None], block, start=state, sample_time=dt, jobs=1)
            if batch.status[0]:
                break
            state = batch.states[:, -1]
            if first + length < current.size - 1:
                # The last sample belongs to the next block.
                block[-1] = current[first + length]
            low += (1.0 - np.exp(-LOOP / CENTRING_TIME)) * (float(np.mean(batch.states[0, :, x])) - low)
        return out

    def _used(self, run: Mapping[str, np.ndarray] | None, current: np.ndarray) -> dict[str, float]:
        """Limit -> share of the way to it; a run that did not last passed all of them."""
        if run is None or not all(np.isfinite(run[c]).all() for c in CHANNELS):
            return {**dict.fromkeys(self.plant.limits, inf), "range": inf}
        torque, speed = self.plant["K_T"] * current, run["speed"]
        pressures = np.stack([run["p1"], run["p2"]])
        fastest = float(np.max(np.abs(speed)))
        return shares(
            self.plant,
            {
                "pump_speed": fastest,
                "motor_speed": fastest,
                "motor_torque": float(np.max(np.abs(torque))),
                "motor_power": float(np.mean(np.abs(torque * speed))),
                "current_rms": float(np.sqrt(np.mean(current**2))),
                "pressure_max": float(np.max(pressures)),
                "pressure_min": float(np.min(pressures)),
                "stroke": 2.0 * float(np.max(np.abs(run["position"]))),
            },
        )

    # Distances

    def outputs(self, twin: Twin, change: Setting) -> Outputs | None:
        """All candidates under the input of a twin's log; None if one of them stops, or if nothing moves."""
        return self._outputs(twin, change, twin.run(self.settings(change)))

    def _outputs(self, twin: Twin, change: Setting, runs: Sequence[Mapping[str, np.ndarray] | None]) -> Outputs | None:
        if runs[0] is None or any(run is None for run in runs):
            return None
        shown = {"current": twin.log["current"], **{c: runs[0][c] for c in CHANNELS if c in runs[0]}}
        twin = replace(twin, log=replace(twin.log, channels=shown))
        scale = Metric.of(twin, {c: self.noise.get(c, 0.0) for c in twin.channels}).scale
        measured = [s for s in SIGNALS if s in scale and ("position" if s == "rod_velocity" else s) in self.noise]
        metric = Metric({s: scale[s] for s in measured})
        if not measured or min(metric.scale.values()) <= 0.0:
            return None
        return Outputs(change, twin, metric, np.array([metric.residual(twin, run) for run in runs if run is not None]))

    def apart(self, outputs: Outputs) -> np.ndarray:
        """Distance of each pair (pairs,) after a refit, as the refits of a diagnosis count it."""
        nominal, own = self._columns(outputs)
        bench = Bench(outputs.twin, outputs.metric, self.nominal)
        out = []
        for a, b in combinations(range(len(outputs.rows)), 2):
            r, J = outputs.rows[a] - outputs.rows[b], np.concatenate([nominal, own[a], own[b]])
            w, least = np.ones(r.size), inf
            for _ in range(REWEIGHED):
                weighed = np.sqrt(TEMPER) * J * w
                z = np.linalg.solve(np.eye(len(J)) + weighed @ weighed.T, -np.sqrt(TEMPER) * weighed @ (w * r))
                left = r + z @ J
                least = min(least, TEMPER * bench.loss(left) + float(z @ z))
                w = bench.weights(left)
            out.append(np.sqrt(least))
        return np.array(out)

    def _columns(self, outputs: Outputs) -> tuple[np.ndarray, list[np.ndarray]]:
        """What the outputs change by one prior deviation: of the nominal parameters, and of each candidate's own."""
        settings = self.settings(outputs.change)
        prior = dict(zip(self.nominal.names, self.nominal.sd.tolist(), strict=True))
        sd = dict(prior)
        if "K_S" in outputs.change:
            # A spring that is mounted for the experiment is known as well as springs are, one that is gone is none.
            sd.pop("K_S", None)
            if outputs.change["K_S"] > 0.0:
                sd["K_S"] = SPRING_SD * outputs.change["K_S"]
        asked: list[tuple[int, dict[str, float], float]] = []
        for name, deviation in sd.items():
            value = settings[0].get(name, self.plant[name])
            step = STEP * value if value else deviation
            asked.append((0, {**settings[0], name: value + step}, deviation / step))
        common = len(asked)
        for i, values in enumerate(self.hypotheses.values()):
            for name, value in values.items():
                neutral = _nominal_value(self.plant, name)
                change = value - neutral if np.isfinite(neutral) else value
                if abs(change) <= FAR * prior.get(name, 0.0) or name in outputs.change or not np.isfinite(value):
                    continue
                # Towards what is neutral, where every number is allowed.
                asked.append((i, {**settings[i], name: value - OWN_STEP * OWN * change}, 1.0 / OWN_STEP))
        runs = outputs.twin.run([setting for _, setting, _ in asked])
        columns: list[list[np.ndarray]] = [[] for _ in range(len(settings) + 1)]
        for j, ((i, _, factor), run) in enumerate(zip(asked, runs, strict=True)):
            if run is not None:
                moved = (outputs.metric.residual(outputs.twin, run) - outputs.rows[i]) * factor
                columns[0 if j < common else i + 1].append(moved)
        nominal, *own = (np.array(c).reshape(len(c), outputs.rows.shape[1]) for c in columns)
        return nominal, own


def _nominal_value(plant: Plant, name: str) -> float:
    """What a symbol or a sensor's word is without a candidate."""
    if name in plant.parameters:
        return plant[name]
    return 1.0 if name.startswith("scale.") else 0.0
