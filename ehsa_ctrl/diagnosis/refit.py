"""Refits: effect parameters and all nominal parameters are fitted together to a log by free-run simulation.

The cost is a -2 log-likelihood: a robust (Cauchy) loss of the residuals, scaled to their effective number, plus
Gaussian priors on the nominal parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

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
#: A thorough fit renews its Jacobian at most so often, and takes so many steps with each.
MOST_ROUNDS, STEPS_A_ROUND = 6, 3
#: A fit has converged when a step lowers the cost by less than this; it is small against `model_selection.MARGIN`.
CONVERGED = 0.05


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

    The prior deviation of a parameter is the change that makes a gap of PRIOR_SHARE of the threshold, or the deviation
    typical of its kind if that is smaller.

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
        if lumped and prior[name] >= WELL_KNOWN:
            relative = LUMPED
        found[name] = relative * plant[name]
        typical.append(max(prior[name], relative) * plant[name])
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

    level: typical mean square of a block; blocks far above it are weighted down. jobs: threads for the
    runs of a Jacobian, for fits that are not made in parallel. segment: what is fitted; by default the whole log of
    `model`.
    """

    model: HypothesisModel
    scale: ResidualScale
    nominal: NominalParameters
    level: float = 1.0
    jobs: int = 1
    count: RunCount = field(default_factory=RunCount, repr=False)
    segment: Segment | None = field(default=None, repr=False)

    @property
    def records(self) -> tuple[Record, ...]:
        """The records that are fitted."""
        return (Record(self.model, {}),) if self.segment is None else self.segment.records

    @property
    def block(self) -> int:
        """Number of residuals of a channel in a block."""
        return max(int(round(BLOCK / (2.0 * self.model.log.sample_time))), 1)

    def residuals(self, settings: Sequence[Setting]) -> list[np.ndarray | None]:
        """Residuals (n,) of each setting; None if the run stopped."""
        self.count.total += len(settings)
        out: list[np.ndarray | None] = []
        records = self.records
        for runs in run_records(records, settings, self.jobs):
            r = None if runs is None else self.scale.residual_of(records, runs)
            out.append(r if r is not None and np.isfinite(r).all() else None)
        return out

    def by_channel(self, r: np.ndarray) -> np.ndarray:
        """Residuals (n,) as (channels, n / channels)."""
        return r.reshape(len(self.scale.scale), -1)

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


@dataclass(frozen=True)
class HypothesisFit:
    """A hypothesis at its optimum.

    values: free parameters by name. cost: loss times TEMPER, plus priors. residual: (n,). jacobian: (n, k) derivatives
    by one scale of each of `free`, which lists the candidates' parameters first. settled: another refinement would not
    lower the cost.
    """

    candidates: tuple[CandidateEffect, ...]
    values: Mapping[str, float]
    cost: float
    residual: np.ndarray = field(repr=False)
    jacobian: np.ndarray = field(repr=False)
    free: tuple[FreeNumber, ...] = ()
    settled: bool = False

    @property
    def n_effect(self) -> int:
        """Number of free parameters of the candidate effects."""
        return sum(len(c.free) for c in self.candidates)

    @property
    def rms(self) -> float:
        """RMS of the residuals."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def prior_cost(self) -> float:
        """Sum of squares of the changes of the nominal parameters, in prior deviations."""
        return float(sum(((self.values[f.name] - f.nominal) / f.scale) ** 2 for f in self.free[self.n_effect :]))

    @property
    def sensitivities(self) -> dict[str, np.ndarray]:
        """Free parameter -> (n,) derivative of the residual."""
        return {f.name: column / f.scale for f, column in zip(self.free, self.jacobian.T, strict=True)}

    def information(self, objective: Objective) -> np.ndarray:
        """Information matrix (k, k) of data and priors, by the scales of `free`."""
        weighted = self.jacobian * objective.weights(self.residual)[:, None]
        # The level discounts residuals that errors of the model enlarge.
        information = TEMPER / objective.level * (weighted.T @ weighted)
        prior = np.arange(self.n_effect, len(self.free))
        information[prior, prior] += 1.0
        return np.asarray(information)

    def with_level_of(self, objective: Objective) -> HypothesisFit:
        """The same fit with its cost under an objective with another level."""
        return replace(self, cost=TEMPER * objective.loss(self.residual) + self.prior_cost)


class _HypothesisProblem:
    """The least-squares problem of a hypothesis: parameter vector x (k,), residuals (n,), derivatives by one scale."""

    def __init__(self, objective: Objective, candidates: Sequence[CandidateEffect]) -> None:
        self.objective, self.candidates = objective, tuple(candidates)
        self.free = objective.free_numbers(candidates)
        self.names = [f.name for f in self.free]
        self.nominal, self.scale, self.lower, self.upper = (
            np.array([getattr(f, field) for f in self.free]) for field in ("nominal", "scale", "lower", "upper")
        )
        self.n_effect = sum(len(c.free) for c in candidates)

    def setting(self, x: np.ndarray) -> dict[str, float]:
        return dict(zip(self.names, x.tolist(), strict=True))

    def residual(self, x: np.ndarray) -> np.ndarray | None:
        return self.objective.residuals([self.setting(x)])[0]

    def prior_residual(self, x: np.ndarray) -> np.ndarray:
        return np.asarray((x[self.n_effect :] - self.nominal[self.n_effect :]) / self.scale[self.n_effect :])

    def cost(self, r: np.ndarray, x: np.ndarray) -> float:
        p = self.prior_residual(x)
        return TEMPER * self.objective.loss(r) + float(p @ p)

    def differentiate(self, which: Sequence[int], x: np.ndarray, r: np.ndarray, J: np.ndarray) -> None:
        """Fill these columns of J (n, k) by finite differences, with steps towards the interior of the bounds."""
        settings, steps = [], []
        for i in which:
            h = (
                0.3 * self.scale[i]
                if i < self.n_effect
                else min(0.3 * self.scale[i], STEP * abs(self.nominal[i]) or np.inf)
            )
            h = -h if x[i] + h > self.upper[i] else h
            moved = x.copy()
            moved[i] += h
            settings.append(self.setting(moved))
            steps.append(h)
        for i, h, changed in zip(which, steps, self.objective.residuals(settings), strict=True):
            J[:, i] = 0.0 if changed is None else (changed - r) * (self.scale[i] / h)

    def normal_equations(
        self, J: np.ndarray, r: np.ndarray, x: np.ndarray, w: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Gauss-Newton matrix (k, k) and gradient (k,) of half the cost, with weights w (n,)."""
        weighted = J * w[:, None]
        G = TEMPER * (weighted.T @ weighted)
        g = TEMPER * (weighted.T @ (w * r))
        prior = np.arange(self.n_effect, len(self.free))
        G[prior, prior] += 1.0
        g[self.n_effect :] += self.prior_residual(x)
        return G, g

    def fit(
        self, x: np.ndarray, r: np.ndarray, J: np.ndarray, steps: int, renew_after: int = 0, *, exact: bool = False
    ) -> HypothesisFit:
        """Steps from x (k,) with residuals r (n,) and Jacobian J (n, k); see `refit`. exact: J was computed there."""
        fixed = [i for i, number in enumerate(self.free) if number.fixed]
        self.lower[fixed] = self.upper[fixed] = x[fixed]
        cost, damping, drop, gained, settled = self.cost(r, x), 1e-3, np.inf, False, False
        renewed = exact or not renew_after
        for step in range(steps):
            if step == renew_after and not renewed:
                self.differentiate(range(len(self.free)), x, r, J)
                exact = renewed = True
            w = self.objective.weights(r)
            G, g = self.normal_equations(J, r, x, w)
            gained, settled = False, exact
            for _ in range(4):
                z = _bounded_step(G, g, damping, (self.lower - x) / self.scale, (self.upper - x) / self.scale)
                trial = np.clip(x + z * self.scale, self.lower, self.upper)
                z = (trial - x) / self.scale
                new = self.residual(trial)
                if new is None:
                    damping = max(10.0 * damping, 1e-2)
                    continue
                J += np.outer(new - r - J @ z, z / max(float(z @ z), 1e-12))
                c = self.cost(new, trial)
                if c < cost:
                    gained, exact = True, False
                    drop = cost - c
                    x, r, cost = trial, new, c
                    damping = max(0.2 * damping, 1e-6)
                    break
                G, g = self.normal_equations(J, r, x, w)
                damping = max(10.0 * damping, 1e-2)
            if not gained and not renewed:
                # The Jacobian may be too far off: it was computed at another point and updated.
                self.differentiate(range(len(self.free)), x, r, J)
                exact = renewed = True
                damping = 1e-2
                continue
            if not gained or drop < CONVERGED:
                break
        settled = settled and (not gained or drop < CONVERGED)
        return HypothesisFit(self.candidates, self.setting(x), cost, r, J, self.free, settled)


def refit(
    objective: Objective,
    candidates: Sequence[CandidateEffect],
    start: Setting,
    sensitivities: Mapping[str, np.ndarray],
    *,
    steps: int = 6,
    renew_after: int = 0,
) -> HypothesisFit | None:
    """Damped Gauss-Newton from `start` with Broyden's update of the Jacobian; None if the start can't be simulated.

    sensitivities: parameter -> (n,) derivative of the residual near the start; others are computed. renew_after: number
    of steps after which the Jacobian is recomputed, or before if a step fails (0: it is not).

    Sources: K. Levenberg, "A method for the solution of certain non-linear problems in least squares", Quarterly of
    Applied Mathematics 2 (1944); C. G. Broyden, "A class of methods for solving nonlinear simultaneous equations",
    Mathematics of Computation 19 (1965).
    """
    problem = _HypothesisProblem(objective, candidates)
    x = np.array([start.get(f.name, f.nominal) for f in problem.free])
    r = problem.residual(x)
    if r is None:
        return None
    J = np.zeros((r.size, len(problem.free)))
    for i, name in enumerate(problem.names):
        if name in sensitivities:
            J[:, i] = sensitivities[name] * problem.scale[i]
    problem.differentiate([i for i, name in enumerate(problem.names) if name not in sensitivities], x, r, J)
    return problem.fit(x, r, J, steps, renew_after)


def refine(objective: Objective, fit: HypothesisFit, steps: int) -> HypothesisFit:
    """Continue a fit with a new Jacobian."""
    problem = _HypothesisProblem(objective, fit.candidates)
    x = np.array([fit.values[name] for name in problem.names])
    J = np.empty_like(fit.jacobian)
    problem.differentiate(range(len(problem.free)), x, fit.residual, J)
    return problem.fit(x, fit.residual, J, steps, exact=True)


def refit_until_converged(
    objective: Objective, candidates: Sequence[CandidateEffect], start: Setting
) -> HypothesisFit | None:
    """A fit from `start` until its cost no longer falls with a new Jacobian; None if the start can't be simulated."""
    fit = refit(objective, candidates, start, {}, steps=STEPS_A_ROUND)
    for _ in range(MOST_ROUNDS):
        if fit is None or fit.settled:
            break
        before, fit = fit.cost, refine(objective, fit, STEPS_A_ROUND)
        if fit.cost > before - CONVERGED:
            break
    return fit


def refit_thoroughly(
    objective: Objective, windows: Segment | None, candidates: Sequence[CandidateEffect], start: Setting
) -> HypothesisFit | None:
    """The better of two converged fits: from `start`, and from where a fit over short windows leads.

    The cost of a long free run is a rough function of the parameters where the rod sticks and slips: a slip that comes
    late spoils all that follows. Over windows that begin with measured states it is smoother. That is the idea of
    multiple shooting (F. Carbonell et al., arXiv:1507.00975, 2015, with further references).

    windows: training data in short windows, None to do without.
    """
    fits = [refit_until_converged(objective, candidates, start)]
    if windows is not None:
        over_windows = refit_until_converged(replace(objective, segment=windows), candidates, start)
        if over_windows is not None:
            fits.append(refit_until_converged(objective, candidates, over_windows.values))
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.cost, default=None)


def refit_nominal(objective: Objective, sensitivities: Mapping[str, np.ndarray], prior_factor: float = 1.0) -> Setting:
    """Fit the nominal parameters alone, with prior deviations times `prior_factor`; empty if that fails.

    sensitivities: see `objective_of`.
    """
    nominal = replace(objective.nominal, sd=objective.nominal.sd * prior_factor)
    wide = replace(objective, nominal=nominal, level=1.0, count=RunCount())
    found = refit(wide, (), {}, sensitivities, steps=8, renew_after=2)
    return {} if found is None else found.values


def _bounded_step(G: np.ndarray, g: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step within bounds, and within 20 scales, that minimises the damped quadratic model."""
    D = np.diag(np.maximum(np.diag(G), 1e-9))
    H = G + damping * D + 1e-10 * np.eye(len(G))
    L = np.linalg.cholesky(H)
    target = -np.linalg.solve(L, g)
    low, high = np.minimum(np.maximum(low, -20.0), -1e-12), np.maximum(np.minimum(high, 20.0), 1e-12)
    return np.asarray(lsq_linear(L.T, target, bounds=(low, high), method="bvls").x)
