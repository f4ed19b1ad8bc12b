"""Scores of hypotheses: deviance on training and held-out data, and which effects of each are causes.

An effect of a hypothesis is a cause if it alone changes a signal by about the threshold. A smaller one acts like a
slightly wrong nominal parameter and adds a penalty to the deviance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..core.errors import InputError
from ..physics.effects import EFFECTS, CandidateEffect
from ..plant.plant import Plant
from .candidate_effects import with_parameters
from .hypothesis_model import Setting
from .hypothesis_search import Hypotheses, Task, distinct_tasks
from .local_search import neighbours
from .objective import Objective
from .records import Record, Runs, Segment, mean_square_root
from .refit import HypothesisFit, deviations_of
from .signals import largest, signal_noise

# The constants without another reason are engineering judgement, chosen with the tuning seeds of the independent bench.

#: An effect is a cause if it changes a signal by this share of the threshold: its estimated size is uncertain.
CAUSE_SHARE = 0.85
#: The same for a nominal parameter with a prior: such parameters can compensate for each other.
NOMINAL_CAUSE_SHARE = 1.3
#: Penalty in deviance (-2 log-likelihood) of an effect that is not a cause, and of each parameter of an effect. The
#: latter is close to BIC's ln(n) for n = 150 independent residuals.
MINOR_EFFECT_PENALTY, PARAMETER_PENALTY = 20.0, 5.0
#: Realisations of the input noise; the largest effect of these counts.
REALISATIONS = 6
#: Nominal parameters that changed by more prior deviations are tested as causes.
LARGE_CHANGE = 1.5
#: Bounds of the weight of a squared residual, in units of an independent one.
MIN_WEIGHT, MAX_WEIGHT = 0.001, 0.5
#: Longest lag of the autocorrelation [s].
MAX_LAG = 1.0
#: Number of hypotheses of each size to score.
N_SCORED = 10
#: Best sets of causes that are refitted with exactly their causes free.
N_EXACT = 6
#: Best sets from which a local search starts.
N_BASES = 2
#: Hypotheses whose deviance is within this share of the nominal one's from the best are refined and scored again; at
#: most so many.
PROMISING, N_REFINE = 0.1, 4

#: A cause: id of the effect, and the channel for a sensor error.
CauseKey = tuple[str, str | None]


@dataclass(frozen=True)
class LowFrequencyError:
    """Low-frequency error of a hypothesis: RMS of the block means of its residuals, in which noise is small.

    share: RMS over the scored signals, as a share of that of the nominal model. rms: of the worst scored signal, in
    units of the residuals' scale. The position is not scored, because it integrates noise and missed slips, nor is the
    load cell.
    """

    share: float = 0.0
    rms: float = 0.0


@dataclass(frozen=True)
class InputNoiseEffect:
    """Error of a simulation with the true plant due to the noise of the logged current.

    This noise drives every simulation but did not drive the rig. Where the rod sticks and slips, it decides single
    slips. The values are the largest of several realisations.

    block_means: (channels,) mean squares of block means. square: mean square of residuals. gap: total gap.
    """

    block_means: np.ndarray
    square: float
    gaps: Mapping[str, float]


@dataclass(frozen=True)
class ScoredHypothesis:
    """A hypothesis with its score.

    deviance: -2 log-likelihood with all penalties; smaller is better. own_gaps: effect, or nominal parameter that
    changed much -> signal -> gap that it makes alone, with the others present. training_gap, held_out_gap: signal ->
    gap of the hypothesis. causes: the effects that are causes. low_frequency_errors: on training and held-out data.
    window_deviances: of training and held-out data in short windows, see `Scoring.windows`; None where these are not
    simulated.
    """

    fit: HypothesisFit
    deviance: float
    own_gaps: Mapping[CauseKey, Mapping[str, float]]
    training_gap: Mapping[str, float]
    held_out_gap: Mapping[str, float]
    causes: tuple[CauseKey, ...]
    low_frequency_errors: tuple[LowFrequencyError, LowFrequencyError] = (LowFrequencyError(), LowFrequencyError())
    window_deviances: tuple[float, float] | None = None

    @property
    def label(self) -> tuple[CauseKey, ...]:
        """The causes in a unique order."""
        return tuple(sorted(self.causes, key=str))


@dataclass(frozen=True)
class Scoring:
    """Computes scores.

    weight: (channels,) of a squared residual in the deviance. nominal: residuals of the nominal model on training and
    held-out data, None if its run stopped. input_noise: on training and held-out data. lumped: the model lacks dry
    friction; nominal parameters compensate for it and are no causes. windows: training and held-out data of each log in
    windows that begin at the state that the log shows; for laws, where one slip or a lost phase decides a free run.
    """

    objective: Objective
    training: Segment
    held_out: Segment
    threshold: float
    lumped: bool
    weight: np.ndarray
    nominal: tuple[np.ndarray, np.ndarray | None] = field(repr=False)
    input_noise: tuple[InputNoiseEffect, InputNoiseEffect]
    windows: tuple[Sequence[Segment], Sequence[Segment]] | None = None

    @classmethod
    def of(
        cls, hypotheses: Hypotheses, training: Segment, held_out: Segment, threshold: float, *, lumped: bool
    ) -> Scoring:
        """Weights from the residuals of the best fit so far."""
        objective, best = hypotheses.objective, hypotheses.best()[0]
        weighted = objective.by_channel(best.residual * objective.weights(best.residual))
        weight = residual_weights(weighted, 2.0 * objective.model.log.sample_time)
        nominal = hypotheses.residual, _error_on(objective, held_out)
        noise = _input_noise_effects(objective, training, held_out, best.values)
        return cls(objective, training, held_out, threshold, lumped, weight, nominal, noise)

    def on(self, training: Segment, held_out: Segment, values: Setting) -> Scoring | None:
        """The same scoring on other data of the same logs; None if the nominal plant can't be simulated on them.

        values: of the best fit so far, for the effect of the input's noise. The windows stay.
        """
        objective = replace(self.objective, model=training.model, segment=training)
        (fitted,) = objective.residuals([{}])
        if fitted is None:
            return None
        nominal = fitted, _error_on(objective, held_out)
        noise = _input_noise_effects(objective, training, held_out, values)
        return replace(
            self, objective=objective, training=training, held_out=held_out, nominal=nominal, input_noise=noise
        )

    def deviance(self, r: np.ndarray) -> float:
        """Deviance of residuals (n,): Cauchy's loss as in the fits, weighted by channel."""
        return self.objective.loss(r, self.weight[:, None])

    @property
    def nominal_deviance(self) -> float:
        """Deviance of the nominal model; if its run on held-out data stopped, twice that on training data."""
        fitted, held_out = self.nominal
        return self.deviance(fitted) + self.deviance(fitted if held_out is None else held_out)

    @property
    def noise_deviance(self) -> float:
        """Expected deviance of noise alone on both segments."""
        squares = self.objective.scale.noise_squares
        samples = self.nominal[0].size // len(squares) + self.held_out.samples
        return float(self.weight @ squares) * samples

    @property
    def noise_square(self) -> float:
        """Mean square of the training residuals that noise of sensors and input causes."""
        return float(np.mean(self.objective.scale.noise_squares)) + self.input_noise[0].square

    @cached_property
    def ids(self) -> dict[str, str]:
        """Parameter of the plant -> id of the effect under which a wrong value is reported."""
        return effect_id_by_parameter(self.objective.model.plant)

    def standard_deviations(self, fit: HypothesisFit) -> dict[str, float]:
        """Standard deviation of each effect parameter of a fit, with nominal parameters as uncertain as on a rig.

        `sizes.fit_sizes` has those of the final fit.
        """
        information, nominal = fit.information(self.objective), self.objective.nominal
        typical = dict(zip(nominal.names, nominal.typical, strict=True))
        for i, f in enumerate(fit.free[fit.n_effect :], fit.n_effect):
            information[i, i] += (f.scale / typical[f.name]) ** 2 - 1.0
        pairs = zip(fit.free[: fit.n_effect], deviations_of(information), strict=False)
        return {f.name: float(deviation) * f.scale for f, deviation in pairs}

    def score(self, fit: HypothesisFit) -> ScoredHypothesis:
        """Score a hypothesis: simulate it on both segments, and without each of its effects."""
        full = [segment.run([fit.values])[0] for segment in (self.training, self.held_out)]
        fitted = self.training.with_corrected_start(fit.values, full[0])
        simulated = self.held_out.with_corrected_start(fit.values, full[1])
        error = None if simulated is None else self.objective.scale.residual_of(self.held_out.records, simulated)
        deviance = self.deviance(fit.residual) + (np.inf if error is None else self.deviance(error)) + fit.prior_cost
        own = self.changes_of(fit.values, self._members(fit), full)
        members = {c.key for c in fit.candidates}
        limits = {key: (CAUSE_SHARE if key in members else NOMINAL_CAUSE_SHARE) * self.threshold for key in own}
        causes = tuple(key for key, gaps in own.items() if largest(gaps) >= limits[key])
        deviance += MINOR_EFFECT_PENALTY * len(members - set(causes)) + PARAMETER_PENALTY * fit.n_effect
        errors = self._low_frequency_error(0, fit.residual), self._low_frequency_error(1, error)
        training_gap, held_out_gap = self.training.gap_of(fitted), self.held_out.gap_of(simulated)
        windows = self._window_deviances(fit.values)
        return ScoredHypothesis(fit, deviance, own, training_gap, held_out_gap, causes, errors, windows)

    def _window_deviances(self, values: Setting) -> tuple[float, float] | None:
        return None if self.windows is None else (self.window_deviance(0, values), self.window_deviance(1, values))

    def window_deviance(self, segment: int, values: Setting) -> float:
        """Deviance above noise over windows of training (0) or held-out data (1); infinite where a run stops, or where
        there are no windows.
        """
        windows = self._joined_windows(segment)
        runs = None if windows is None else windows.simulate(values)
        if windows is None or runs is None:
            return np.inf
        noise = float(self.weight @ self.objective.scale.noise_squares) * windows.samples
        return max(self.deviance(self.objective.scale.residual_of(windows.records, runs)) - noise, 0.0)

    @property
    def objective_in_windows(self) -> Objective | None:
        """The objective over windows of the training data; None without them."""
        windows = self._joined_windows(0)
        return None if windows is None else replace(self.objective, segment=windows)

    def _joined_windows(self, segment: int) -> Segment | None:
        if self.windows is None:
            return None
        by_log = self.windows[segment]
        return Segment(tuple(record for one in by_log for record in one.records), by_log[0].name)

    def _low_frequency_error(self, segment: int, r: np.ndarray | None) -> LowFrequencyError:
        nominal = self.nominal[segment]
        if r is None or nominal is None:
            return LowFrequencyError(1.0, np.inf) if r is None else LowFrequencyError()
        objective = self.objective
        noise = objective.scale.noise_squares / objective.block
        signals = {one.name for one in objective.model.plant.structure.system.scored}
        counted = [i for i, name in enumerate(objective.scale.scale) if name in signals]
        input_noise = self.input_noise[segment].block_means
        left = np.maximum(objective.block_mean_squares(r) - noise - input_noise, 0.0)[counted]
        before = np.maximum(objective.block_mean_squares(nominal) - noise, 0.0)[counted]
        share = float(np.sqrt(np.sum(left) / max(np.sum(before), 1e-12)))
        return LowFrequencyError(share, float(np.sqrt(np.max(left))))

    def _members(self, fit: HypothesisFit) -> dict[CauseKey, set[str]]:
        """Effect or changed nominal parameter of a fit -> its numbers."""
        ids = self.ids
        members: dict[CauseKey, set[str]] = {}
        for c in fit.candidates:
            for name in c.names:
                # A nominal parameter that an effect sets free beside its own number counts under its own id.
                key = c.key if ids.get(name, c.id) == c.id else (ids[name], None)
                members.setdefault(key, set()).add(name)
        for f in fit.free[fit.n_effect :]:
            if not self.lumped and f.name in ids and abs(fit.values[f.name] - f.nominal) > LARGE_CHANGE * f.scale:
                members.setdefault((ids[f.name], None), set()).add(f.name)
        return members

    def changes_of(
        self,
        values: Setting,
        members: Mapping[CauseKey, set[str]],
        full: Sequence[Runs | None] = (),
    ) -> dict[CauseKey, dict[str, float]]:
        """By how much each set of numbers changes each signal beside all other values, on either segment.

        full: runs with all values on both segments, if they are known.
        """
        settings = [{n: v for n, v in values.items() if n not in names} for names in members.values()]
        out: dict[CauseKey, dict[str, float]] = {key: {} for key in members}
        # Both segments, because a valve or an end stop may be reached in one of them only.
        segments = self.training, self.held_out
        full = full or [segment.run([values])[0] for segment in segments]
        for segment, whole in zip(segments, full, strict=True):
            for key, other in zip(members, segment.run(settings), strict=True):
                scored_signals = segment.model.plant.structure.system.scored
                change = dict.fromkeys([*(one.name for one in scored_signals), "total"], np.inf)
                if whole is not None and other is not None:
                    change = segment.change(whole, other)
                out[key] = {name: max(out[key].get(name, 0.0), value) for name, value in change.items()}
        return out


def score_hypotheses(
    hypotheses: Hypotheses, scoring: Scoring, windows: Segment | None = None, searched: Segment | None = None
) -> tuple[Hypotheses, list[ScoredHypothesis], list[ScoredHypothesis]]:
    """Score the best hypotheses of each size, refine the most promising ones and score them again.

    windows: training data in short windows, see `refit_by_windows`. searched: data of the local search, by default the
    training data. Returns the hypotheses with the refined fits, the final scores, and the first ones.

    Raises InputError if no hypothesis can be simulated on the held-out data.
    """

    def score_best(hypotheses: Hypotheses, known: Sequence[ScoredHypothesis]) -> list[ScoredHypothesis]:
        best = [hypotheses.fits[()], *(fit for size in hypotheses.sizes for fit in hypotheses.best(size)[:N_SCORED])]
        scored = {id(one.fit): one for one in [*known, *new_scores(hypotheses, scoring, best, known)]}
        return [scored[id(fit)] for fit in best]

    first = score_best(hypotheses, [])
    ranked = rank(first)
    limit = ranked[0].deviance + PROMISING * abs(scoring.deviance(hypotheses.residual))
    promising = [one.fit for one in ranked[:N_REFINE] if one.deviance <= limit]
    hypotheses = hypotheses.refine(promising, steps=8)
    # Priors and minor effects favour one set over another: the best sets compete with exactly their causes free.
    refined = score_best(hypotheses, first)
    exact = distinct_tasks(
        Task(members, one.fit.values).from_nominal()
        for one in ([] if scoring.lumped else rank(refined))
        if (members := exact_members(one, hypotheses.candidates, scoring.ids))
    )[:N_EXACT]
    hypotheses = hypotheses.with_compared_refits(exact, "sets of causes", windows)
    found = new_scores(hypotheses, scoring, hypotheses.fits_of(exact), [])
    bases = [] if scoring.lumped else _bases(rank(found), rank([*found, *refined]))
    near = neighbours(hypotheses, [one.fit for one in bases], searched or scoring.training)
    hypotheses = hypotheses.with_compared_refits(near, "neighbouring sets", beside=exact)
    scores = score_best(hypotheses, refined)
    last = hypotheses.fits_of([*exact, *near])
    scores += [one for one in found if any(one.fit is fit for fit in last)]
    scores += new_scores(hypotheses, scoring, last, scores)
    if not any(np.isfinite(one.deviance) for one in scores):
        raise InputError(
            f"{scoring.held_out.paths}: neither the nominal plant nor any refit of it can be "
            "simulated on the held-out data; check units and signs of the log with ehsa-ctrl compare, and the plant's "
            "parameters"
        )
    return hypotheses, scores, first


def _bases(exact: Sequence[ScoredHypothesis], ranked: Sequence[ScoredHypothesis]) -> list[ScoredHypothesis]:
    """The best exact sets, and the best set of all without the largest cause of the best one.

    That cause may imitate another, and sets grown from it hold it all.
    """
    best = list(exact[:N_BASES])
    if best and best[0].causes:
        dominant = max(best[0].causes, key=lambda key: largest(best[0].own_gaps[key]))
        best += [one for one in ranked if one.causes and dominant not in one.causes][:1]
    return list({id(one.fit): one for one in best}.values())


def new_scores(
    hypotheses: Hypotheses, scoring: Scoring, fits: Sequence[HypothesisFit], known: Sequence[ScoredHypothesis]
) -> list[ScoredHypothesis]:
    """Scores of those fits that are not among the known scores."""
    before = {id(one.fit) for one in known}
    new = [fit for fit in fits if id(fit) not in before]
    return hypotheses.pool.map("scores", scoring.score, new, lambda fit: len(fit.candidates))


def exact_members(
    one: ScoredHypothesis, candidates: Sequence[CandidateEffect], ids: Mapping[str, str]
) -> tuple[CandidateEffect, ...]:
    """The effects of a scored hypothesis that are causes, and those that stand for its nominal parameters that are."""
    members = tuple(c for c in one.fit.candidates if c.key in one.causes)
    there = {c.key for c in members}
    moved = [f.name for f in one.fit.free[one.fit.n_effect :] if (ids.get(f.name), None) in {*one.causes} - there]
    return with_parameters(members, moved, candidates, ids)


def rank(scores: Sequence[ScoredHypothesis]) -> list[ScoredHypothesis]:
    """The hypothesis with the lowest deviance of each set of causes, the best first."""
    best: dict[tuple[CauseKey, ...], ScoredHypothesis] = {}
    for one in scores:
        if one.label not in best or one.deviance < best[one.label].deviance:
            best[one.label] = one
    return sorted(best.values(), key=lambda one: one.deviance)


def effect_id_by_parameter(plant: Plant) -> dict[str, str]:
    """Parameter of the plant -> id of the effect under which a wrong value is reported, the first of several."""
    own = plant.structure.system.own
    ids: dict[str, str] = {}
    for name, effect in EFFECTS.items():
        for symbol in (*effect.symbols, *effect.related_symbols):
            ids.setdefault(own(symbol), name)
    return ids


def _error_on(objective: Objective, held_out: Segment) -> np.ndarray | None:
    """Residuals of the nominal model on held-out data; None if its run stopped."""
    run = held_out.simulate({})
    return None if run is None else objective.scale.residual_of(held_out.records, run)


def _input_noise_effects(
    objective: Objective, training: Segment, held_out: Segment, values: Setting
) -> tuple[InputNoiseEffect, InputNoiseEffect]:
    return input_noise_effect(objective, training, values), input_noise_effect(objective, held_out, values)


def input_noise_effect(objective: Objective, segment: Segment, values: Setting) -> InputNoiseEffect:
    """Effect of the noise of the logged current on a simulation over a segment."""
    scale, runs = objective.scale, _runs_with_noise(segment, values)
    gaps = _largest_changes(segment, runs)
    if not runs:
        return InputNoiseEffect(np.zeros(len(scale.scale)), 0.0, gaps)
    residual, *noisy = (scale.residual_of(segment.records, run) for run in runs)
    block_means = [objective.block_mean_squares(r - residual) for r in noisy]
    square = max(float(np.mean((r - residual) ** 2)) for r in noisy)
    return InputNoiseEffect(np.max(block_means, axis=0), square, gaps)


def input_noise_gaps(segment: Segment, values: Setting) -> dict[str, float]:
    """The gaps of `input_noise_effect`."""
    return _largest_changes(segment, _runs_with_noise(segment, values))


def _runs_with_noise(segment: Segment, values: Setting) -> list[Runs]:
    """A simulation, then its realisations with noise of the logged current; empty without noise, or if one stopped."""
    plant = segment.model.plant
    drive = plant.structure.system.drive
    sensor = plant.sensors.get(drive)
    # The sensor's sd is an upper bound: a controller's response to sensor noise looks like noise, but drove the rig.
    most = sensor.sd if sensor is not None else np.inf
    sds = [min(record.noise.get(drive, 0.0), most) for record in segment.records]
    run = segment.simulate(values)
    if max(sds) == 0.0 or run is None:
        return []
    found = [run]
    for seed in range(REALISATIONS):
        random = np.random.default_rng(seed)
        noisy = tuple(_with_noise(r, drive, sd, random) for r, sd in zip(segment.records, sds, strict=True))
        other = replace(segment, records=noisy).simulate(values)
        if other is None:
            return []
        found.append(other)
    return found


def _largest_changes(segment: Segment, runs: Sequence[Runs]) -> dict[str, float]:
    """Signal -> largest change from the first run to another one; zero without runs."""
    if not runs:
        signals = [one.name for one in segment.model.plant.structure.system.scored]
        return dict.fromkeys([*signals, "total"], 0.0)
    changes = [segment.change(runs[0], other) for other in runs[1:]]
    return {name: max(one[name] for one in changes) for name in changes[0]}


def _with_noise(record: Record, channel: str, sd: float, random: np.random.Generator) -> Record:
    """The record with white noise added to a channel of its log."""
    log = record.model.log
    noisy = log[channel] + sd * random.standard_normal(len(log))
    return replace(record, model=replace(record.model, log=replace(log, channels={**log.channels, channel: noisy})))


def floor_of(segment: Segment, input_noise: Mapping[str, float]) -> dict[str, float]:
    """The gap that the best possible model leaves on a segment, of each signal and in total.

    Noise of the logged input with the slips that it decides, and what the declared sensors add to the noise that the
    log shows: a calibration, a screw's pitch or a converter's rounding is no white noise.

    input_noise: signal -> gap that the noise of the input makes, see `input_noise_gaps`.
    """
    tables = []
    for record in segment.records:
        plant, log = record.model.plant, record.model.log
        declared = {c: plant.sensors[c].sd if c in plant.sensors else 0.0 for c in log.channels}
        of_system = plant.structure.system.scored
        seen, stated = (signal_noise(of_system, sd, log.sample_time) for sd in (record.noise, declared))
        tables.append(
            {
                name: float(np.sqrt(max(stated[name] ** 2 - seen[name] ** 2, 0.0))) / max(float(np.std(values)), 1e-300)
                for name, values in record.measured.items()
            }
        )
    sensors = mean_square_root(tables)
    out = {name: float(np.hypot(sensor, input_noise.get(name, 0.0))) for name, sensor in sensors.items()}
    return out | {"total": float(np.sqrt(np.mean(np.square(list(out.values())))))}


def residual_weights(parts: np.ndarray, sample_time: float) -> np.ndarray:
    """Weight (channels,) of a squared residual in the deviance, from the residuals (channels, n) of the best model.

    1 / (mean square * (1 + 2 sum of autocorrelations)), summed up to the first negative one: the deviance counts the
    effective number of independent residuals (M. B. Priestley, "Spectral Analysis and Time Series", 1981, 5.3.2).
    """
    lags = max(int(MAX_LAG / sample_time), 1)
    out = np.empty(len(parts))
    for c, part in enumerate(parts):
        square = max(float(np.mean(part**2)), 1e-12)
        n = part.size
        correlation = np.fft.irfft(np.abs(np.fft.rfft(part, 2 * n)) ** 2)[: min(lags, n)] / (n * square)
        negative = np.flatnonzero(correlation < 0.0)
        correlation = correlation[: int(negative[0]) if negative.size else None]
        out[c] = 1.0 / (square * (1.0 + 2.0 * float(np.sum(correlation[1:]))))
    return np.clip(out, MIN_WEIGHT, MAX_WEIGHT)
