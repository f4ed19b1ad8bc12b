"""How well a log determines each parameter: covariance, intervals, verdicts, and which parameters trade places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from .balances import BalanceEstimate
from .estimator import Fit
from .free import FreeParameter

Verdict = Literal["well determined", "poorly determined", "not identifiable from this log"]

#: Relative standard deviation up to which a parameter is called well, and poorly, determined.
WELL, POOR = 0.10, 0.50
#: Correlation from which two parameters are said to trade places.
TRADES = 0.9
#: An eigenvalue of the scaled information below this share of the largest is a direction that the log doesn't show.
NULL = 1e-12


@dataclass(frozen=True)
class Estimate:
    """One estimated parameter.

    value, sd in `unit`; sd is infinite where the log shows nothing. interval: 95 %. verdict in words; trades: names of
    parameters with which it changes places, strongest first. at_bound: "lower", "upper" or "".
    """

    name: str
    unit: str
    start: float
    value: float
    sd: float
    interval: tuple[float, float]
    verdict: Verdict
    trades: tuple[str, ...]
    at_bound: str
    prior_sd: float | None

    @property
    def identifiable(self) -> bool:
        """True if the log determines it well."""
        return self.verdict == "well determined"

    @property
    def relative_sd(self) -> float:
        return self.sd / abs(self.value) if self.value else math.inf


@dataclass(frozen=True)
class Uncertainty:
    """Covariance (k, k) in the order of `names`, and where it comes from.

    source: "noise" if the residuals are what the sensors' noise makes them, "residuals" if they are larger or hang
    together, so that the spread of half-second pieces of the gradient is used instead.
    """

    names: tuple[str, ...]
    covariance: np.ndarray
    source: Literal["noise", "residuals"]

    @property
    def sd(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """(k, k); zero where a standard deviation is zero or infinite."""
        sd = self.sd
        fine = np.isfinite(sd) & (sd > 0.0)
        out = np.eye(len(self.names))
        inner = np.ix_(fine, fine)
        out[inner] = self.covariance[inner] / np.outer(sd[fine], sd[fine])
        return out


def consistent(fit: Fit, deviations: float = 6.0) -> bool:
    """Whether residuals are as small as the noise allows: both costs within so many standard deviations of 1.

    Never if the residuals themselves had to be the weights.
    """
    return not fit.weighted and fit.noise_ratio < 1.0 + deviations * math.sqrt(2.0 / max(fit.residuals, 1))


#: A tenth of a second that fits worse than this many standard deviations of its sum probably holds more than noise:
#: by chance one in some ten logs of 20 s gets there, which costs a second look and no more.
SPOTTED = 3.8


def spotless(fit: Fit) -> bool:
    """Whether no short piece of the logs fits plainly worse than noise makes it."""
    return fit.weighted or fit.worst_block[0] < SPOTTED


def uncertainty(fit: Fit, spread: np.ndarray | None = None) -> Uncertainty:
    """Covariance of an estimate; `spread` (k, k) is added: of starts that did not agree.

    With residuals that are noise: the inverse of the information. Otherwise the sandwich of H. White, Econometrica
    50(1), 1982, with the gradient's half-second pieces as independent draws, at least as large as the former scaled
    by the noise ratio. A direction that the log doesn't show gets an infinite variance.
    """
    names = tuple(parameter.name for parameter in fit.parameters)
    inverse, null = invert(fit.information)
    source: Literal["noise", "residuals"] = "noise"
    covariance = inverse
    if not consistent(fit) or not spotless(fit):
        source = "residuals"
        scaled = inverse * max(fit.noise_ratio, 1.0)
        blocks = len(fit.scores)
        covariance = scaled
        if blocks > 2 * len(names):
            meat = fit.scores.T @ fit.scores * blocks / (blocks - len(names))
            covariance = inverse @ meat @ inverse
            # Never surer than white residuals of that size would make it.
            ratio = np.sqrt(np.maximum(np.diag(scaled) / np.maximum(np.diag(covariance), 1e-300), 1.0))
            covariance = covariance * np.outer(ratio, ratio)
    covariance = covariance.copy() if spread is None else covariance + spread
    covariance[null, null] = np.inf
    return Uncertainty(names, covariance, source)


def estimates(fit: Fit, found: Uncertainty, sizes: np.ndarray, *, sure: bool = True) -> tuple[Estimate, ...]:
    """A verdict for each parameter; sizes (k,): against what a standard deviation is small or large.

    sure: that the minimum is the right one. If not, nothing is called well determined, however flat or steep it is.
    """
    out = []
    correlation = found.correlation
    null = _null_vectors(fit.information)
    quantile = float(stats.norm.ppf(0.975))
    for i, (parameter, value, sd, size) in enumerate(zip(fit.parameters, fit.values, found.sd, sizes, strict=True)):
        at_bound = _at_bound(parameter, float(value), float(sd))
        verdict: Verdict
        if not math.isfinite(sd) or sd > POOR * size:
            verdict = "not identifiable from this log"
        elif not sure or sd > WELL * size or (at_bound and not _natural(parameter, at_bound)):
            verdict = "poorly determined"
        else:
            verdict = "well determined"
        if math.isfinite(sd):
            order = np.argsort(-np.abs(correlation[i]))
            trades = tuple(found.names[j] for j in order if j != i and abs(correlation[i, j]) > TRADES)
        else:
            shared = np.any((np.abs(null[i]) > 0.05) & (np.abs(null) > 0.05), axis=1) if null.size else np.zeros(0)
            trades = tuple(found.names[j] for j in range(len(found.names)) if j != i and null.size and shared[j])
        out.append(
            Estimate(
                name=parameter.name,
                unit=parameter.unit,
                start=parameter.value,
                value=float(value),
                sd=float(sd),
                interval=(float(value - quantile * sd), float(value + quantile * sd)),
                verdict=verdict,
                trades=trades,
                at_bound=at_bound,
                prior_sd=parameter.prior_sd,
            )
        )
    return tuple(out)


def balance_estimates(parameters: Sequence[FreeParameter], found: BalanceEstimate) -> tuple[Estimate, ...]:
    """The same table for an estimate from balances: what they did not determine keeps its value, without a deviation.

    How parameters trade places is not known there: each balance is solved by itself.
    """
    quantile = float(stats.norm.ppf(0.975))
    out = []
    for parameter in parameters:
        if parameter.sensor is not None:
            continue
        known = found.parameters.get(parameter.name)
        value, sd = (known.value, known.sd) if known is not None else (parameter.value, math.inf)
        verdict: Verdict = "not identifiable from this log"
        if known is not None and sd <= POOR * abs(value):
            verdict = "well determined" if sd <= WELL * abs(value) else "poorly determined"
        out.append(
            Estimate(
                name=parameter.name,
                unit=parameter.unit,
                start=parameter.value,
                value=value,
                sd=sd,
                interval=(value - quantile * sd, value + quantile * sd),
                verdict=verdict,
                trades=(),
                at_bound="",
                prior_sd=None,
            )
        )
    return tuple(out)


def _natural(parameter: FreeParameter, at_bound: str) -> bool:
    """A delay or a filter of zero is an answer, a mass at the end of what was allowed is none."""
    return parameter.sensor is not None and parameter.sensor[0] in ("delay", "filter") and at_bound == "lower"


def _at_bound(parameter: FreeParameter, value: float, sd: float) -> str:
    near = 1e-3 * abs(value) if not math.isfinite(sd) else min(1e-3 * abs(value), 0.1 * sd)
    if value - parameter.lower <= near:
        return "lower"
    return "upper" if parameter.upper - value <= near else ""


def _scaled(information: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues and vectors of the information with unit diagonal, and the scale that was taken out."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    safe = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(safe, safe))
    return values, vectors, safe


def _null_vectors(information: np.ndarray) -> np.ndarray:
    """(k, directions): what the log doesn't show, in scaled parameters."""
    values, vectors, _ = _scaled(information)
    return vectors[:, values < NULL * max(values[-1], 1e-300)] if values.size else vectors


def invert(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse over the directions that the log shows, and which parameters (k,) the others touch."""
    if not information.size:
        return information, np.zeros(0, dtype=bool)
    values, vectors, size = _scaled(information)
    shown = values >= NULL * max(values[-1], 1e-300)
    inverse = (vectors[:, shown] / values[shown]) @ vectors[:, shown].T / np.outer(size, size)
    null = np.any(np.abs(vectors[:, ~shown]) > 0.05, axis=1)
    return inverse, null
