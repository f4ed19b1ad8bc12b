"""Scores of hypotheses: which members of each matter, and what it leaves on training and held-out data.

A member matters if it alone changes a signal by the threshold or more: that is what a cause is. What a hypothesis
contains beside acts like a nominal parameter that is slightly wrong, and costs it a little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.errors import InputError
from ..physics.effects import EFFECTS
from ..plant.plant import Plant
from .hypothesis_model import Setting
from .hypothesis_search import Hypotheses
from .refit import HypothesisFit, Objective
from .signals import gap, largest
from .validation_segment import Segment

#: A member matters if it changes a signal by this share of the threshold: the measured change is not exact.
MATTERS = 0.85
#: The same for a nominal parameter that the hypothesis does not set free: these trade for each other within priors.
CLEARLY_MATTERS = 1.3
#: Deviance (-2 log-likelihood) that a member costs that does not matter, and that each number costs which it frees.
COMPANION, NUMBER = 20.0, 5.0
#: Realisations of the input noise.
REALISATIONS = 6
#: Nominal parameters this far from their values, in prior deviations, are examined one by one.
FAR = 1.5
#: Bounds of the weight of one residual, in independent ones.
LEAST_WEIGHT, MOST_WEIGHT = 0.001, 0.5
#: Priors of nominal parameters are wider by this where standard deviations are computed.
WIDER = 4.0
#: The autocorrelation is followed for this long [s].
MEMORY = 1.0
#: Hypotheses of each size that are scored.
SCORED = 10
#: Up to four sets within this share of the nominal model's deviance of the best one are refined and scored again.
PROMISING, REFINED = 0.1, 4

#: A cause: id of the effect and channel of a sensor's.
CauseKey = tuple[str, str | None]


@dataclass(frozen=True)
class SlowError:
    """What a hypothesis leaves of the residuals' block means, in which noise is small.

    Position is left out, which integrates noise and missed slips, and the load cell, which no gap counts.
    share: RMS over the other channels, of that of the nominal model. size: RMS of the worst channel, in units of the
    residuals' scale.
    """

    share: float = 0.0
    size: float = 0.0


@dataclass(frozen=True)
class InputNoiseEffect:
    """What the noise of the logged current does to a run: it did not drive the rig, and drives every simulation.

    Where the rod sticks and slips it decides single slips, so that the true plant leaves a gap too. The largest of
    several realisations: what noise can do does not prove a model wrong. block_means: (channels,) mean squares of block
    means. square: mean square of residuals. gap: in total.
    """

    block_means: np.ndarray
    square: float
    gap: float


@dataclass(frozen=True)
class ScoredHypothesis:
    """A hypothesis with what it leaves.

    deviance: -2 log-likelihood with all penalties, smaller is better. own: (id, channel) -> gap in each signal that it
    makes beside the others, of the members and of nominal parameters that changed much. fitted, held_out: gaps on
    training and held-out data. slow: on either of them.
    """

    fit: HypothesisFit
    deviance: float
    own: Mapping[CauseKey, Mapping[str, float]]
    fitted: Mapping[str, float]
    held_out: Mapping[str, float]
    causes: tuple[CauseKey, ...]
    slow: tuple[SlowError, SlowError] = (SlowError(), SlowError())

    @property
    def label(self) -> tuple[CauseKey, ...]:
        """The causes in one order."""
        return tuple(sorted(self.causes, key=str))


@dataclass(frozen=True)
class Scoring:
    """What scores are computed with.

    weight: (channels,) of one squared residual in the deviance. nominal: residuals of the nominal model on training
    and held-out data, None where its run stopped. input_noise: on both. lumped: nominal parameters stand for more than
    their names say, and are no causes.
    """

    objective: Objective
    training: Segment
    held_out: Segment
    threshold: float
    lumped: bool
    weight: np.ndarray
    nominal: tuple[np.ndarray, np.ndarray | None] = field(repr=False)
    input_noise: tuple[InputNoiseEffect, InputNoiseEffect]

    @classmethod
    def of(
        cls, hypotheses: Hypotheses, training: Segment, held_out: Segment, threshold: float, *, lumped: bool
    ) -> Scoring:
        """From the best fit so far and runs of the nominal model."""
        objective, best = hypotheses.objective, hypotheses.best()[0]
        weighted = objective.by_channel(best.residual * objective.weights(best.residual))
        weight = residual_weights(weighted, 2.0 * objective.model.log.sample_time)
        run = held_out.simulate({})
        error = None if run is None else residual_of(objective, held_out, run)
        noise = tuple(input_noise_effect(objective, segment, best.values) for segment in (training, held_out))
        return cls(
            objective, training, held_out, threshold, lumped, weight, (hypotheses.residual, error), (noise[0], noise[1])
        )

    def deviance(self, r: np.ndarray) -> float:
        """Of residuals (n,): Cauchy's loss as in the fits, each channel with its weight."""
        return self.objective.loss(r, self.weight[:, None])

    @property
    def nominal_deviance(self) -> float:
        """Of the nominal model; where its run stopped, as much again as on the training data."""
        fitted, held_out = self.nominal
        return self.deviance(fitted) + self.deviance(fitted if held_out is None else held_out)

    @property
    def noise_deviance(self) -> float:
        """What noise alone would leave on both segments."""
        squares, segment = self.objective.scale.noise_squares, self.held_out
        samples = self.nominal[0].size // len(squares) + (len(segment.model.log) - segment.first) // 2
        return float(self.weight @ squares) * samples

    @property
    def noise_square(self) -> float:
        """Mean square of training residuals that noise of sensors and input makes."""
        return float(np.mean(self.objective.scale.noise_squares)) + self.input_noise[0].square

    def score(self, fit: HypothesisFit) -> ScoredHypothesis:
        """A hypothesis simulated on both segments, and once without each of its members."""
        simulated = self.held_out.simulate(fit.values)
        error = None if simulated is None else residual_of(self.objective, self.held_out, simulated)
        deviance = self.deviance(fit.residual) + (np.inf if error is None else self.deviance(error)) + fit.prior_cost
        own = self._own_gaps(fit)
        members = {c.key for c in fit.candidates}
        limits = {key: (MATTERS if key in members else CLEARLY_MATTERS) * self.threshold for key in own}
        causes = tuple(key for key, gaps in own.items() if largest(gaps) >= limits[key])
        deviance += COMPANION * len(members - set(causes)) + NUMBER * fit.own
        slow = self._slow_error(0, fit.residual), self._slow_error(1, error)
        fitted, held_out = self.training.gap(fit.values), self.held_out.gap_of(simulated)
        return ScoredHypothesis(fit, deviance, own, fitted, held_out, causes, slow)

    def _slow_error(self, segment: int, r: np.ndarray | None) -> SlowError:
        nominal = self.nominal[segment]
        if r is None or nominal is None:
            return SlowError(1.0, np.inf) if r is None else SlowError()
        objective = self.objective
        noise = objective.scale.noise_squares / objective.block
        signals = {one.name for one in objective.model.plant.structure.system.scored}
        counted = [i for i, name in enumerate(objective.scale.scale) if name in signals]
        input_noise = self.input_noise[segment].block_means
        left = np.maximum(objective.block_mean_squares(r) - noise - input_noise, 0.0)[counted]
        before = np.maximum(objective.block_mean_squares(nominal) - noise, 0.0)[counted]
        share = float(np.sqrt(np.sum(left) / max(np.sum(before), 1e-12)))
        return SlowError(share, float(np.sqrt(np.max(left))))

    def _own_gaps(self, fit: HypothesisFit) -> dict[CauseKey, dict[str, float]]:
        """By how much each member changes each signal: the model with all of them against the one without it."""
        members: dict[CauseKey, set[str]] = {c.key: set(c.names) for c in fit.candidates}
        ids = reported_ids(self.objective.model.plant)
        for f in fit.free[fit.own :]:
            if not self.lumped and f.name in ids and abs(fit.values[f.name] - f.nominal) > FAR * f.scale:
                members.setdefault((ids[f.name], None), set()).add(f.name)
        settings = [{n: v for n, v in fit.values.items() if n not in names} for names in members.values()]
        out: dict[CauseKey, dict[str, float]] = {key: {} for key in members}
        # A valve or an end stop may be reached in one of the two segments only.
        for segment in (self.training, self.held_out):
            full, *without = segment.model.run([fit.values, *settings])
            for key, other in zip(members, without, strict=True):
                scored_signals = segment.model.plant.structure.system.scored
                change = dict.fromkeys([*(one.name for one in scored_signals), "total"], np.inf)
                if full is not None and other is not None:
                    signals = segment.scored(full)
                    change = gap(signals, segment.scored(other), dict.fromkeys(signals, 0.0))
                out[key] = {name: max(out[key].get(name, 0.0), value) for name, value in change.items()}
        return out


def score_hypotheses(
    hypotheses: Hypotheses, scoring: Scoring
) -> tuple[Hypotheses, list[ScoredHypothesis], list[ScoredHypothesis]]:
    """Scores of the best hypotheses of each size, the most promising ones refined; and the scores before that.

    Raises InputError if no hypothesis can be simulated on the held-out data.
    """

    def scored(hypotheses: Hypotheses, known: Sequence[ScoredHypothesis]) -> list[ScoredHypothesis]:
        best = [hypotheses.fits[()], *(fit for size in (1, 2, 3) for fit in hypotheses.best(size)[:SCORED])]
        before = {id(one.fit): one for one in known}
        return [before.get(id(fit)) or scoring.score(fit) for fit in best]

    first = scored(hypotheses, [])
    ranked = sorted(by_label(first).values(), key=lambda one: one.deviance)
    limit = ranked[0].deviance + PROMISING * abs(scoring.deviance(hypotheses.residual))
    promising = [one.fit for one in ranked[:REFINED] if one.deviance <= limit]
    hypotheses = hypotheses.refined(promising, steps=8)
    scores = scored(hypotheses, first)
    if not any(np.isfinite(one.deviance) for one in scores):
        raise InputError(
            f"{scoring.held_out.model.log.path or 'the log'}: neither the nominal plant nor any refit of it can be "
            "simulated on the held-out data; check units and signs (compare shows both side by side) and the plant's "
            "parameters"
        )
    return hypotheses, scores, first


def by_label(scores: Sequence[ScoredHypothesis]) -> dict[tuple[CauseKey, ...], ScoredHypothesis]:
    """The best hypothesis of each set of causes."""
    best: dict[tuple[CauseKey, ...], ScoredHypothesis] = {}
    for one in scores:
        if one.label not in best or one.deviance < best[one.label].deviance:
            best[one.label] = one
    return best


def reported_ids(plant: Plant) -> dict[str, str]:
    """The id under which a wrong parameter of this plant is reported."""
    own = plant.structure.system.own
    return {own(symbol): name for name, effect in EFFECTS.items() for symbol in (*effect.symbols, *effect.also)}


def residual_of(objective: Objective, segment: Segment, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
    """Measured minus simulated over the scored part of a segment, in units of the residuals' scale."""
    return objective.scale.residual(segment.model, simulated, segment.first)


def input_noise_effect(objective: Objective, segment: Segment, values: Setting) -> InputNoiseEffect:
    """The effect of the input noise on runs over a segment."""
    none = InputNoiseEffect(np.zeros(len(objective.scale.scale)), 0.0, 0.0)
    model = segment.model
    drive = model.plant.structure.system.drive
    sensor = model.plant.sensors.get(drive)
    # A controller's response to sensor noise looks like noise of the current, but did drive the rig.
    sd = min(segment.noise.get(drive, 0.0), sensor.sd if sensor is not None else np.inf)
    run = segment.simulate(values)
    if sd == 0.0 or run is None:
        return none
    block_means, squares, gaps = [], [], []
    for seed in range(REALISATIONS):
        noise = sd * np.random.default_rng(seed).standard_normal(len(model.log))
        driven = replace(model.log, channels={**model.log.channels, drive: model.log[drive] + noise})
        other = replace(segment, model=replace(model, log=driven)).simulate(values)
        if other is None:
            return none
        r = residual_of(objective, segment, other) - residual_of(objective, segment, run)
        block_means.append(objective.block_mean_squares(r))
        squares.append(float(np.mean(r**2)))
        signals = segment.scored(run)
        gaps.append(gap(signals, segment.scored(other), dict.fromkeys(signals, 0.0))["total"])
    return InputNoiseEffect(np.max(block_means, axis=0), max(squares), max(gaps))


def residual_weights(parts: np.ndarray, sample_time: float) -> np.ndarray:
    """Weight (channels,) of one squared residual in a deviance, from the residuals (channels, n) of the best model.

    1 / (mean square * (1 + 2 sum of autocorrelations)), the sum cut where it first turns negative: the effective sample
    size of correlated residuals (M. B. Priestley, "Spectral Analysis and Time Series", 1981, 5.3.2).
    """
    lags = max(int(MEMORY / sample_time), 1)
    out = np.empty(len(parts))
    for c, part in enumerate(parts):
        square = max(float(np.mean(part**2)), 1e-12)
        n = part.size
        correlation = np.fft.irfft(np.abs(np.fft.rfft(part, 2 * n)) ** 2)[: min(lags, n)] / (n * square)
        negative = np.flatnonzero(correlation < 0.0)
        correlation = correlation[: int(negative[0]) if negative.size else None]
        out[c] = 1.0 / (square * (1.0 + 2.0 * float(np.sum(correlation[1:]))))
    return np.clip(out, LEAST_WEIGHT, MOST_WEIGHT)


def standard_deviations(fit: HypothesisFit, weight: np.ndarray) -> dict[str, float]:
    """Standard deviation of each number of the candidates.

    The nominal parameters are free under priors that are WIDER than those of the fit: their uncertainty enters the
    deviations, and a modeller may be more wrong than usual.
    """
    own, k = fit.own, len(fit.free)
    weights = np.repeat(weight, fit.residual.size // weight.size)
    information = fit.jacobian.T @ (weights[:, None] * fit.jacobian)
    information[np.arange(own, k), np.arange(own, k)] += 1.0 / WIDER**2
    size = np.sqrt(np.maximum(np.diag(information), 1e-12))
    covariance = np.linalg.pinv(information / np.outer(size, size), rcond=1e-10) / np.outer(size, size)
    return {f.name: float(np.sqrt(max(covariance[i, i], 0.0))) * f.scale for i, f in enumerate(fit.free[:own])}
