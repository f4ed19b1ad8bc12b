"""Predicted distance of candidates under other inputs, and inputs that keep the plant's limits.

The distance of two candidates is what is left of the difference of their outputs after a refit of the nominal
parameters and of the parameters of both effects, under their priors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import inf

import numpy as np

from ..core.log import Log
from ..identification.input_limits import limit_shares
from ..plant.file import LOAD_SYMBOLS
from ..plant.plant import Plant
from ..simulation.bench import CENTRING_TIME
from ..simulation.engine import simulate_batch
from ..simulation.limits import reached
from .acting_model import law_switches
from .excitation_library import LibraryInput
from .hypothesis_model import HypothesisModel, Setting, with_every_effect
from .objective import STEP, TEMPER, NominalParameters, Objective, ResidualScale

# The numbers below are engineering judgement.

#: Share of each limit that is kept in reserve.
MARGIN = 0.15
#: Amplitude that is tried first without a present log [A, or unit of the drive].
FIRST_AMPLITUDE = 2.0
#: Relative standard deviation of the stiffness of a spring that is mounted for the experiment.
SPRING_SD = 0.05
#: Standard deviation of an effect parameter as a share of its change, and step of its derivative in these deviations.
EFFECT_SD, EFFECT_STEP = 0.5, 0.3
#: A nominal parameter that changed by more prior deviations counts as a parameter of the effect.
LARGE_CHANGE = 3.0
#: Iterations of the reweighted refit.
N_REWEIGHT = 3
#: Time step of the centring loop [s], a fifth of its time constant.
CENTRING_STEP = 0.1
#: Parameter of a spring at the rod.
SPRING_STIFFNESS = LOAD_SYMBOLS["stiffness"]

Pair = tuple[str, str]


@dataclass(frozen=True)
class CandidateOutputs:
    """The outputs of all candidates under one current.

    change: load parameter -> change, -inf for one that becomes zero. model: its log has the current and the outputs of
    the first candidate. rows: (candidates, n) outputs of the first candidate minus those of each, scaled.
    """

    change: Setting
    model: HypothesisModel
    scale: ResidualScale
    rows: np.ndarray = field(repr=False)

    @property
    def largest_distances(self) -> np.ndarray:
        """Distance of each pair (pairs,) without a refit: an upper bound."""
        apart = [self.rows[a] - self.rows[b] for a, b in combinations(range(len(self.rows)), 2)]
        return np.asarray(np.sqrt(TEMPER) * np.linalg.norm(apart, axis=1))


@dataclass(frozen=True)
class ExperimentTrial:
    """An input at an amplitude [unit of the drive], with or without the loop that centres the rod, and the outputs."""

    input: LibraryInput
    amplitude: float
    centre: bool
    outputs: CandidateOutputs


@dataclass(frozen=True)
class CandidateModels:
    """Candidates of a diagnosis as models.

    plant: with every effect. hypotheses: name -> fitted values. noise: of the measured channels. plants_by_law:
    friction law -> the plant with it, see `HypothesisModel`. seen: channel of the drive or a position -> largest value
    in the present logs; an experiment on a plant without limits stays within it.
    """

    plant: Plant
    hypotheses: Mapping[str, Setting]
    noise: Mapping[str, float]
    nominal: NominalParameters
    plants_by_law: Mapping[str, Plant] = field(default_factory=dict)
    seen: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        plant: Plant,
        hypotheses: Mapping[str, Setting],
        noise: Mapping[str, float],
        nominal: NominalParameters,
        present: Sequence[Log] = (),
    ) -> CandidateModels:
        """With plants for the friction laws that the candidates use. present: the present logs."""
        used = [s.law for s in law_switches() if any(s.active(values) for values in hypotheses.values())]
        by_law = {law: with_every_effect(plant, law) for law in used}
        system = plant.structure.system
        channels = (system.drive, *system.positions)
        seen = (
            {c: max(float(np.max(np.abs(log[c]))) for log in present if c in log.channels) for c in channels}
            if present
            else {}
        )
        return cls(plant, hypotheses, noise, nominal, by_law, {} if plant.limits else seen)

    @property
    def first_amplitude(self) -> float:
        """Amplitude that is tried first [unit of the drive]."""
        return self.seen.get(self.plant.structure.system.drive, FIRST_AMPLITUDE)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        return tuple(combinations(self.hypotheses, 2))

    def with_load(self, values: Setting, change: Setting) -> dict[str, float]:
        """A setting with the changed load."""
        new = dict(values)
        for name, by in change.items():
            new[name] = 0.0 if by == -inf else new.get(name, self.plant[name]) + by
        return new

    def settings(self, change: Setting) -> list[dict[str, float]]:
        """All candidates with the changed load."""
        return [self.with_load(values, change) for values in self.hypotheses.values()]

    def largest_amplitude(
        self,
        input: LibraryInput,
        change: Setting,
        time: np.ndarray,
        *,
        centre: bool = False,
        begin: float | None = None,
    ) -> tuple[float, str]:
        """The largest amplitude within the limits, to about 20 %, and the limit that is reached first.

        For the first candidate; 0 if no amplitude keeps the limits. begin: amplitude that is tried first.
        """
        first = self.settings(change)[0]
        first_trial = self.first_amplitude
        low, high, amplitude, limit = 0.0, inf, max(begin or first_trial, 0.05 * first_trial), ""
        for _ in range(4):
            current = self._current(input.current(time, amplitude), first, centre)
            used = self._limit_shares(self._model(time, current).run([first])[0], current)
            # Without limits the amplitude that is tried first is kept.
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
        self, input: LibraryInput, amplitude: float, change: Setting, time: np.ndarray, *, centre: bool = False
    ) -> ExperimentTrial | None:
        """Simulate an input with all candidates; the amplitude is reduced until all keep the limits, else None."""
        settings = self.settings(change)
        for _ in range(5):
            # Rounded, so that the printed amplitude is the simulated one.
            amplitude = float(f"{amplitude:.3g}")
            current = self._current(input.current(time, amplitude), settings[0], centre)
            model = self._model(time, current)
            runs = model.run(settings)
            used = max(max(self._limit_shares(run, current).values(), default=0.0) for run in runs)
            if used <= 1.0 - MARGIN:
                outputs = self._outputs(model, change, runs)
                return None if outputs is None else ExperimentTrial(input, amplitude, centre, outputs)
            amplitude *= 0.85
        return None

    @property
    def _position(self) -> str:
        """State that is the position of the rod, the carriage or the arm."""
        return next(iter(self.plant.structure.system.positions.values()))

    def _model(self, time: np.ndarray, current: np.ndarray) -> HypothesisModel:
        system = self.plant.structure.system
        others = dict.fromkeys((*system.drives.values(), *system.outputs), np.zeros(time.size))
        log = Log(time, {**others, system.drive: current})
        return HypothesisModel(self.plant, log, None, self.plants_by_law)

    def _current(self, current: np.ndarray, values: Setting, centre: bool) -> np.ndarray:
        """The current (N,) with the contribution of the bench's centring loop for this candidate, step by step."""
        if not centre:
            return current
        known = self.plant.structure.equations.parameter_names
        plant, dt = self.plant.set(**{n: v for n, v in values.items() if n in known}), self.plant.sample_time
        out, state, low = current.copy(), plant.rest[None], 0.0
        gain, limit = plant.structure.system.centring
        length, x = max(int(round(CENTRING_STEP / dt)), 1), plant.structure.equations.index(self._position)
        for first in range(0, current.size - 1, length):
            block = out[first : first + length + 1]
            block -= np.clip(gain * low, -limit, limit)
            batch = simulate_batch(
                plant, plant.vector[None], block, start=state, sample_time=dt, jobs=1, hold=plant.structure.system.hold
            )
            if batch.status[0]:
                break
            state = batch.states[:, -1]
            if first + length < current.size - 1:
                # The last sample is the first one of the next block.
                block[-1] = current[first + length]
            low += (1.0 - np.exp(-CENTRING_STEP / CENTRING_TIME)) * (float(np.mean(batch.states[0, :, x])) - low)
        return out

    def _limit_shares(self, run: Mapping[str, np.ndarray] | None, current: np.ndarray) -> dict[str, float]:
        """Limit -> share of it that a run uses; inf for a run that stopped."""
        if run is None or not all(np.isfinite(values).all() for values in run.values()):
            return {**dict.fromkeys(self.plant.limits, inf), "range": inf}
        equations, shown = self.plant.structure.equations, self.plant.structure.system.outputs
        states = np.zeros((current.size, len(equations.states)))
        for channel in run.keys() & shown.keys():
            states[:, equations.index(shown[channel])] = run[channel]
        extremes = np.array([states.min(axis=0), states.max(axis=0)])
        shares = limit_shares(self.plant, reached(self.plant, current, states, extremes))
        used = {**run, self.plant.structure.system.drive: current}
        # The margin is kept of what the plant allows, not of what a rig has shown to stand.
        seen = {c: (1.0 - MARGIN) * float(np.max(np.abs(used[c]))) / most for c, most in self.seen.items()}
        return {**shares, **{"stroke" if c in shown else c: share for c, share in seen.items()}}

    def outputs(self, model: HypothesisModel, change: Setting) -> CandidateOutputs | None:
        """All candidates under the input of a model's log; None if one of them stops, or nothing moves."""
        return self._outputs(model, change, model.run(self.settings(change)))

    def _outputs(
        self, model: HypothesisModel, change: Setting, runs: Sequence[Mapping[str, np.ndarray] | None]
    ) -> CandidateOutputs | None:
        complete = [run for run in runs if run is not None]
        if len(complete) < len(runs):
            return None
        system = self.plant.structure.system
        shown = {
            **{c: model.log[c] for c in system.drives.values()},
            **{c: complete[0][c] for c in system.outputs if c in complete[0]},
        }
        model = replace(model, log=replace(model.log, channels=shown))
        scale = ResidualScale.of(model, {c: self.noise.get(c, 0.0) for c in model.channels}).scale
        measured = [one.name for one in system.scored if one.name in scale and one.channel in self.noise]
        scaled = ResidualScale({s: scale[s] for s in measured})
        if not measured or min(scaled.scale.values()) <= 0.0:
            return None
        return CandidateOutputs(change, model, scaled, np.array([scaled.residual(model, run) for run in complete]))

    def distances(self, outputs: CandidateOutputs) -> np.ndarray:
        """Distance of each pair (pairs,) after a refit with the cost of a diagnosis, linearised."""
        nominal, own = self._derivatives(outputs)
        objective = Objective(outputs.model, outputs.scale, self.nominal)
        out = []
        for a, b in combinations(range(len(outputs.rows)), 2):
            r, J = outputs.rows[a] - outputs.rows[b], np.concatenate([nominal, own[a], own[b]])
            w, least = np.ones(r.size), inf
            for _ in range(N_REWEIGHT):
                weighted = np.sqrt(TEMPER) * J * w
                z = np.linalg.solve(np.eye(len(J)) + weighted @ weighted.T, -np.sqrt(TEMPER) * weighted @ (w * r))
                left = r + z @ J
                least = min(least, TEMPER * objective.loss(left) + float(z @ z))
                w = objective.weights(left)
            out.append(np.sqrt(least))
        return np.array(out)

    def _derivatives(self, outputs: CandidateOutputs) -> tuple[np.ndarray, list[np.ndarray]]:
        """Sensitivities of the outputs to one prior deviation: (k, n) of the nominal parameters, then for each
        candidate (k, n) of its effect parameters."""
        settings = self.settings(outputs.change)
        prior = dict(zip(self.nominal.names, self.nominal.sd.tolist(), strict=True))
        sd = dict(prior)
        if SPRING_STIFFNESS in outputs.change:
            # The stiffness of a mounted spring is uncertain, that of a removed one is exactly zero.
            sd.pop(SPRING_STIFFNESS, None)
            if outputs.change[SPRING_STIFFNESS] > 0.0:
                sd[SPRING_STIFFNESS] = SPRING_SD * outputs.change[SPRING_STIFFNESS]
        asked: list[tuple[int, dict[str, float], float]] = []
        for name, deviation in sd.items():
            value = settings[0].get(name, self.plant[name])
            step = STEP * value if value else deviation
            asked.append((0, {**settings[0], name: value + step}, deviation / step))
        common = len(asked)
        for i, values in enumerate(self.hypotheses.values()):
            for name, value in values.items():
                neutral = outputs.model.nominal_value(name)
                change = value - neutral if np.isfinite(neutral) else value
                if (
                    abs(change) <= LARGE_CHANGE * prior.get(name, 0.0)
                    or name in outputs.change
                    or not np.isfinite(value)
                ):
                    continue
                # Towards the neutral value, because values between are within the bounds.
                asked.append((i, {**settings[i], name: value - EFFECT_STEP * EFFECT_SD * change}, 1.0 / EFFECT_STEP))
        runs = outputs.model.run([setting for _, setting, _ in asked])
        columns: list[list[np.ndarray]] = [[] for _ in range(len(settings) + 1)]
        for j, ((i, _, factor), run) in enumerate(zip(asked, runs, strict=True)):
            if run is not None:
                moved = (outputs.scale.residual(outputs.model, run) - outputs.rows[i]) * factor
                columns[0 if j < common else i + 1].append(moved)
        nominal, *own = (np.array(c).reshape(len(c), outputs.rows.shape[1]) for c in columns)
        return nominal, own
