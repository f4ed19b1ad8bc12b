"""What a refit minimises: the cost of a simulation over a log.

The cost is a -2 log-likelihood: a robust (Cauchy) loss of the residuals, scaled to their effective number, plus
Gaussian priors on the nominal parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..core.errors import InputError
from ..physics.effects import CandidateEffect, FreeNumber
from ..plant.arrays import needed_to_simulate
from .candidate_effects import wearing_parameters
from .hypothesis_model import HypothesisModel, Setting, lacks_dry_friction
from .records import Record, Runs, Segment, mean_square_root, run_records
from .signals import largest, signal_noise, slope

# The constants without another reason are engineering judgement.

#: Effective share of independent residuals: errors of a slightly wrong model are correlated. At 125 residuals a second
#: (every second sample at 250 Hz) this is one independent residual per 0.4 s.
TEMPER = 0.02
#: One prior deviation of a nominal parameter makes a gap of this share of the threshold, so that an error which reaches
#: the threshold, and is a cause, is beyond three deviations.
PRIOR_SHARE = 0.3
#: Relative step of derivatives by nominal parameters.
STEP = 0.02
#: Relative prior deviation for a model without dry friction: its fitted parameters compensate for the missing friction.
LUMPED = 0.3
#: Parameters with a smaller relative prior deviation, such as a torque constant, do not compensate for anything.
WELL_KNOWN = 0.1
#: A nominal parameter may be too large by at most this factor: the engine needs tiny steps for a rod without mass.
LARGEST_ERROR = 5.0
#: Length of the blocks in which residuals are weighted [s]: a slip that a simulation misses spoils many samples in a
#: row.
BLOCK = 0.1
#: Constant of Cauchy's loss, in units of the typical block: blocks beyond 2.5 standard deviations are weighted down.
CAUCHY = 6.25
#: Assumed model error as a share of a signal's standard deviation, added to the noise in quadrature.
MODEL_ERROR = 0.004
#: Residuals up to this share of the loss of noise alone are taken for it. On twelve fits of the tuning seeds with less,
#: a refit over windows lowered the cost by 1.5 at most; on 28 with more by up to 58.
AT_NOISE = 1.05
#: A fit has converged when a step lowers the cost by less than this.
CONVERGED = 0.05
#: A run whose residuals exceed so many scales has diverged; squares of larger ones would overflow.
DIVERGED = 1e8


@dataclass(frozen=True)
class ResidualScale:
    """Scale of the residuals of each channel or scored slope, and standard deviation of its noise, SI units."""

    scale: Mapping[str, float]
    noise: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, model: HypothesisModel, noise: Mapping[str, float]) -> ResidualScale:
        """Noise and assumed model error of each channel of a model, added in quadrature."""
        return cls.of_records([Record(model, noise)])

    @classmethod
    def of_records(cls, records: Sequence[Record]) -> ResidualScale:
        """The same for several records: RMS of their noise and of their standard deviations."""
        deviations = []
        for record in records:
            model = record.model
            signals = {channel: record.take(model.log[channel]) for channel in model.channels}
            signals |= record.signals(model.log.channels)
            deviations.append({name: float(np.std(values)) for name, values in signals.items()})
        model = records[0].model
        of_system = model.plant.structure.system.scored
        noise = mean_square_root([record.noise for record in records])
        sd = {**noise, **signal_noise(of_system, noise, model.log.sample_time)}
        spread = mean_square_root(deviations)
        scale = {name: float(np.hypot(sd[name], MODEL_ERROR * value)) for name, value in spread.items()}
        for one in of_system:
            if one.drift and one.channel in scale:
                scale[one.channel] = float(np.hypot(scale[one.channel], one.drift))
        return cls(scale, {name: sd[name] for name in scale})

    @property
    def noise_squares(self) -> np.ndarray:
        """(channels,) mean square of the residuals of noise alone."""
        return np.array([(self.noise[name] / scale) ** 2 for name, scale in self.scale.items()])

    def residual(self, model: HypothesisModel, simulated: Mapping[str, np.ndarray]) -> np.ndarray:
        """Residuals (n,) over a model's log: measured minus simulated, scaled, every second sample, by channel."""
        return self.residual_of([Record(model, {})], (simulated,))

    def residual_of(self, records: Sequence[Record], runs: Runs) -> np.ndarray:
        """The same over the scored samples of all records, channel by channel and in it record by record."""
        parts = []
        slopes = {one.name: one for one in records[0].model.plant.structure.system.scored if one.span}
        for channel, scale in self.scale.items():
            for record, simulated in zip(records, runs, strict=True):
                log = record.model.log
                if channel in slopes:
                    one = slopes[channel]
                    error = slope(log[one.channel] - simulated[one.channel], one.span, log.sample_time)
                else:
                    error = log[channel] - simulated[channel]
                parts += [error[part][::2] / scale for part in record.parts]
        return np.concatenate(parts)


@dataclass(frozen=True)
class NominalParameters:
    """Parameters that every hypothesis refits under priors: names, nominal values, prior standard deviations.

    typical: (k,) deviation of such a parameter on a typical rig, at least `sd`.
    """

    names: tuple[str, ...]
    values: np.ndarray
    sd: np.ndarray
    typical: np.ndarray


def nominal_parameters(
    training: Segment, scale: ResidualScale, threshold: float, *, lumped: bool = False
) -> tuple[NominalParameters, dict[str, np.ndarray]]:
    """Nominal parameters of a segment's model, and the derivative of the residual (n,) by each.

    The prior deviation of a parameter is the spread between units of a fleet, if the plant's file states it; else the
    change that makes a gap of PRIOR_SHARE of the threshold, or the deviation typical of its kind if that is smaller.

    lumped: the model lacks dry friction, and its parameters compensate for it; their prior deviation is LUMPED.
    Parameters that are set for single logs are not among them.

    Raises InputError if the nominal plant can't be simulated.
    """
    plant = training.model.plant
    kinds = [kind for kind in plant.structure.equations.parameters if kind.searched]
    prior = {kind.name: kind.prior for kind in kinds if kind.prior is not None}
    needed = needed_to_simulate(plant.structure.equations)
    names = [name for name in prior if name in needed and plant[name] != 0.0 and name not in training.own_parameters]
    base, *moved = training.run([{}, *({name: plant[name] * (1.0 + STEP)} for name in names)])
    if base is None:
        raise InputError(
            f"{training.paths}: the nominal plant can't be simulated with this log's current; check its "
            "parameters and the current's unit and sign"
        )
    residual = scale.residual_of(training.records, base)
    found, sensitivities, typical = {}, {}, []
    for name, run in zip(names, moved, strict=True):
        if run is None:
            continue
        change = max(largest(training.change(base, run)), 1e-9)
        relative = min(prior[name], PRIOR_SHARE * threshold / change * STEP)
        spread = plant.parameters[name].spread
        if spread is not None:
            relative = spread / abs(plant[name])
        elif lumped and prior[name] >= WELL_KNOWN:
            relative = LUMPED
        found[name] = relative * plant[name]
        typical.append((relative if spread is not None else max(prior[name], relative)) * plant[name])
        sensitivities[name] = (scale.residual_of(training.records, run) - residual) / (STEP * plant[name])
    values = np.array([plant[name] for name in found])
    return NominalParameters(tuple(found), values, np.array(list(found.values())), np.array(typical)), sensitivities


@dataclass
class RunCount:
    """Counts simulations."""

    total: int = 0


@dataclass(frozen=True)
class Objective:
    """What a refit minimises: Cauchy's loss of the residuals in blocks, plus the priors of the nominal parameters.

    level: typical mean square of a block; blocks far above it are weighted down. segment: what is fitted;
    by default the whole log of `model`. converged: a step of a fit that lowers the cost by less is the last one.
    """

    model: HypothesisModel
    scale: ResidualScale
    nominal: NominalParameters
    level: float = 1.0
    count: RunCount = field(default_factory=RunCount, repr=False)
    segment: Segment | None = field(default=None, repr=False)
    converged: float = CONVERGED

    @property
    def records(self) -> tuple[Record, ...]:
        """The records that are fitted."""
        return (Record(self.model, {}),) if self.segment is None else self.segment.records

    @property
    def block(self) -> int:
        """Number of residuals of a channel in a block."""
        return max(int(round(BLOCK / (2.0 * self.model.log.sample_time))), 1)

    def residuals(self, settings: Sequence[Setting]) -> list[np.ndarray | None]:
        """Residuals (n,) of each setting; None if the run stopped or diverged."""
        self.count.total += len(settings)
        out: list[np.ndarray | None] = []
        records = self.records
        for runs in run_records(records, settings):
            r = None if runs is None else self.scale.residual_of(records, runs)
            out.append(r if r is not None and np.max(np.abs(r)) < DIVERGED else None)
        return out

    def by_channel(self, r: np.ndarray) -> np.ndarray:
        """Residuals (n,) as (channels, n / channels)."""
        return r.reshape(len(self.scale.scale), -1)

    def at_noise(self, r: np.ndarray) -> bool:
        """Whether residuals (n,) are practically those of noise alone: no refit can lower their loss much."""
        return self.loss(r) <= AT_NOISE * float(np.mean(self.scale.noise_squares)) * r.size

    def blocks(self, r: np.ndarray) -> np.ndarray:
        """Mean squares (channels, blocks) of residuals (n,); an incomplete block at the end joins the last one."""
        parts = self.by_channel(r)
        edges = np.arange(0, max(parts.shape[1] - self.block + 1, 1), self.block)
        length = np.diff(np.append(edges, parts.shape[1]))
        return np.asarray(np.add.reduceat(parts**2, edges, axis=1) / length)

    def block_mean_squares(self, r: np.ndarray) -> np.ndarray:
        """Mean squares (channels,) of the block means of residuals (n,): the low-frequency error."""
        parts = self.by_channel(r)
        count = max(parts.shape[1] // self.block, 1)
        means = parts[:, : count * self.block].reshape(len(parts), count, -1).mean(axis=2)
        return np.asarray(np.mean(means**2, axis=1))

    def loss(self, r: np.ndarray, weight: np.ndarray | float = 1.0) -> float:
        """Cauchy's loss of residuals (n,), summed over blocks and multiplied by their length.

        weight: of each channel (channels, 1).
        """
        c = CAUCHY * self.level
        return float(np.sum(weight * c * np.log1p(self.blocks(r) / c))) * self.block

    def weights(self, r: np.ndarray) -> np.ndarray:
        """Square root of the weight of each residual (n,) in iteratively reweighted least squares."""
        parts = self.by_channel(r)
        w = 1.0 / np.sqrt(1.0 + self.blocks(r) / (CAUCHY * self.level))
        each = np.minimum(np.arange(parts.shape[1]) // self.block, w.shape[1] - 1)
        return np.asarray(w[:, each].ravel())

    def typical_level(self, r: np.ndarray) -> float:
        """Median over blocks of the mean square over channels, at least one."""
        return max(float(np.median(self.blocks(r).mean(axis=0))), 1.0)

    def free_numbers(self, candidates: Sequence[CandidateEffect]) -> tuple[FreeNumber, ...]:
        """Free parameters: those of the candidates, without priors, then the nominal ones, scaled by their priors."""
        own = [free for candidate in candidates for free in candidate.free]
        names, wearing = {free.name for free in own}, wearing_parameters()
        rest = [
            FreeNumber(name, value, sd, 0.0 if name in wearing else value / LARGEST_ERROR)
            for name, value, sd in zip(self.nominal.names, self.nominal.values, self.nominal.sd, strict=True)
            if name not in names
        ]
        return (*own, *rest)


def objective_of(training: Segment, threshold: float) -> tuple[Objective, dict[str, np.ndarray]]:
    """The objective on a segment, and the sensitivities of `nominal_parameters`."""
    scale = ResidualScale.of_records(training.records)
    lumped = lacks_dry_friction(training.model.plant)
    nominal, sensitivities = nominal_parameters(training, scale, threshold, lumped=lumped)
    return Objective(training.model, scale, nominal, segment=training), sensitivities
