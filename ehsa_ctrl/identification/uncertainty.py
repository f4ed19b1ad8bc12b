"""How well a log determines each parameter: covariance, intervals, verdicts, correlated parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from .balances import BalanceEstimate
from .fit_result import Fit
from .parameters import FreeParameter

Verdict = Literal["well determined", "poorly determined", "not identifiable from this log"]

# The thresholds are engineering judgement.

#: Relative standard deviation up to which a parameter is well, and poorly, determined.
WELL, POOR = 0.10, 0.50
#: Correlation from which two parameters trade off against each other.
TRADES = 0.9
#: An eigenvalue of the scaled information below this share of the largest is a direction that the log does not show.
NULL = 1e-12
#: A component of a null direction above this makes a parameter part of it.
NULL_COMPONENT = 0.05
#: Excess of the worst tenth of a second from which it probably holds more than noise, in standard deviations of its
#: sum. By chance one in about ten logs of 20 s reaches it, which costs a second look and no more.
SLIP_DEVIATIONS = 3.8
#: Residuals within this many standard deviations of the noise's size are consistent with it.
CONSISTENT = 6.0
#: Half width of a 95 % interval in standard deviations.
QUANTILE = float(stats.norm.ppf(0.975))


@dataclass(frozen=True)
class Estimate:
    """One estimated parameter.

    value, sd in `unit`; sd is infinite if the log does not show the parameter. start: value before. interval: 95 %.
    trades: parameters with which it is strongly correlated, the strongest first. at_bound: "lower", "upper" or "".
    """

    name: str
    unit: str
    start: float
    value: float
    sd: float
    verdict: Verdict
    trades: tuple[str, ...] = ()
    at_bound: str = ""
    prior_sd: float | None = None

    @property
    def interval(self) -> tuple[float, float]:
        return self.value - QUANTILE * self.sd, self.value + QUANTILE * self.sd

    @property
    def identifiable(self) -> bool:
        """True if the log determines it well."""
        return self.verdict == "well determined"

    @property
    def relative_sd(self) -> float:
        return self.sd / abs(self.value) if self.value else math.inf


@dataclass(frozen=True)
class ParameterCovariance:
    """Covariance (k, k) in the order of `names`, and its origin.

    source: "noise" if the residuals agree with the sensors' noise; "residuals" if they are larger or correlated, so
    that the spread of half-second pieces of the gradient is used instead.
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


def within_noise(fit: Fit, deviations: float = CONSISTENT) -> bool:
    """Whether both costs are within so many standard deviations of pure noise; never if residuals were the weights."""
    return not fit.weighted and fit.noise_ratio < 1.0 + deviations * math.sqrt(2.0 / max(fit.residuals, 1))


def parameter_covariance(fit: Fit, spread: np.ndarray | None = None) -> ParameterCovariance:
    """Covariance of an estimate; `spread` (k, k), of starts that did not agree, is added.

    For residuals that are noise: the inverse of the information. Otherwise the sandwich estimator of H. White,
    Econometrica 50(1), 1982, with half-second pieces of the gradient as independent draws, at least as large as the
    former scaled by the noise ratio. A direction that the log does not show gets an infinite variance.
    """
    names = tuple(parameter.name for parameter in fit.parameters)
    inverse, null = invert(fit.information)
    source: Literal["noise", "residuals"] = "noise"
    covariance = inverse
    if not within_noise(fit) or not (fit.weighted or fit.worst_block[0] < SLIP_DEVIATIONS):
        source = "residuals"
        covariance = scaled = inverse * max(fit.noise_ratio, 1.0)
        blocks = len(fit.scores)
        if blocks > 2 * len(names):
            meat = fit.scores.T @ fit.scores * blocks / (blocks - len(names))
            covariance = inverse @ meat @ inverse
            # Never smaller than for white residuals of that size.
            ratio = np.sqrt(np.maximum(np.diag(scaled) / np.maximum(np.diag(covariance), 1e-300), 1.0))
            covariance = covariance * np.outer(ratio, ratio)
    covariance = covariance.copy() if spread is None else covariance + spread
    covariance[null, null] = np.inf
    return ParameterCovariance(names, covariance, source)


def estimates(fit: Fit, found: ParameterCovariance, sizes: np.ndarray, *, sure: bool = True) -> tuple[Estimate, ...]:
    """Estimates with verdicts. sizes: (k,) with which the standard deviations are compared.

    sure: the minimum is the global one. If not, no parameter is well determined.
    """
    out = []
    correlation, null = found.correlation, _null_directions(fit.information)
    for i, (parameter, value, sd, size) in enumerate(zip(fit.parameters, fit.values, found.sd, sizes, strict=True)):
        at_bound = _at_bound(parameter, float(value), float(sd))
        verdict: Verdict = "well determined"
        if not math.isfinite(sd) or sd > POOR * size:
            verdict = "not identifiable from this log"
        elif not sure or sd > WELL * size or (at_bound and not _natural_bound(parameter, at_bound)):
            verdict = "poorly determined"
        if math.isfinite(sd):
            trades = [j for j in np.argsort(-np.abs(correlation[i])) if abs(correlation[i, j]) > TRADES]
        else:
            shared = np.any((np.abs(null[i]) > NULL_COMPONENT) & (np.abs(null) > NULL_COMPONENT), axis=1)
            trades = list(np.flatnonzero(shared))
        out.append(
            Estimate(
                parameter.name, parameter.unit, parameter.value, float(value), float(sd), verdict,
                tuple(found.names[j] for j in trades if j != i), at_bound, parameter.prior_sd,
            )
        )  # fmt: skip
    return tuple(out)


def balance_estimates(parameters: Sequence[FreeParameter], found: BalanceEstimate) -> tuple[Estimate, ...]:
    """The same table for the estimates from balances; an undetermined parameter keeps its value with infinite sd.

    Each balance is solved by itself, so that correlations between parameters are not known.
    """
    out = []
    for parameter in parameters:
        if parameter.sensor is not None:
            continue
        known = found.parameters.get(parameter.name)
        value, sd = (known.value, known.sd) if known is not None else (parameter.value, math.inf)
        verdict: Verdict = "not identifiable from this log"
        if known is not None and sd <= POOR * abs(value):
            verdict = "well determined" if sd <= WELL * abs(value) else "poorly determined"
        out.append(Estimate(parameter.name, parameter.unit, parameter.value, value, sd, verdict))
    return tuple(out)


def _natural_bound(parameter: FreeParameter, at_bound: str) -> bool:
    """Whether the bound is a possible answer: a delay or filter of zero is, a mass at the end of its range is not."""
    return parameter.sensor is not None and parameter.sensor[0] in ("delay", "filter") and at_bound == "lower"


def _at_bound(parameter: FreeParameter, value: float, sd: float) -> str:
    near = 1e-3 * abs(value) if not math.isfinite(sd) else min(1e-3 * abs(value), 0.1 * sd)
    if value - parameter.lower <= near:
        return "lower"
    return "upper" if parameter.upper - value <= near else ""


def _scaled(information: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues and vectors of the information with unit diagonal, which of them are null, and the scale."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    safe = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(safe, safe))
    return values, vectors, values < NULL * max(values[-1], 1e-300), safe


def _null_directions(information: np.ndarray) -> np.ndarray:
    """(k, directions): what the log does not show, in scaled parameters."""
    if not information.size:
        return information
    _, vectors, null, _ = _scaled(information)
    return np.asarray(vectors[:, null])


def invert(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse over the directions that the log shows, and which parameters (k,) are part of a null direction."""
    if not information.size:
        return information, np.zeros(0, dtype=bool)
    values, vectors, hidden, size = _scaled(information)
    inverse = (vectors[:, ~hidden] / values[~hidden]) @ vectors[:, ~hidden].T / np.outer(size, size)
    return inverse, np.any(np.abs(vectors[:, hidden]) > NULL_COMPONENT, axis=1)
