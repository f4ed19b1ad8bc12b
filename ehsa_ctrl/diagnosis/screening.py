"""Screening: by how much the cost of a fit is predicted to fall if an effect is added to it.

A score test with the nuisance parameters projected out: all other numbers of the fit are refitted in the linear model.
It takes one simulation for each number of each candidate, at one setting, and serves all fits near it. Source: A. K.
Bera, Y. Bilias, "Three score and 15 years (1948-2023) of Rao's score test: a brief history", arXiv 2406.19956, 2024.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ..physics.effects import CandidateEffect, FreeNumber
from .hypothesis_model import Setting
from .objective import TEMPER, Objective
from .pool import Pool
from .refit import HypothesisFit

#: Weight of the numbers without a prior: it keeps normal equations regular. Engineering judgement.
RIDGE = 1e-6


@dataclass(frozen=True)
class Response:
    """Linear response of the residual to a candidate, from one of its starts.

    values: of the candidate's parameters at which it was linearised. base: (n,) residual there: that of the screening,
    or that at the start if the neutral value is infinite. sensitivities: name -> (n,) derivative by one scale.
    """

    candidate: CandidateEffect
    values: Setting
    base: np.ndarray = field(repr=False)
    sensitivities: Mapping[str, np.ndarray] = field(repr=False)

    @property
    def moving(self) -> list[FreeNumber]:
        """The numbers with a derivative, in the order of `sensitivities`."""
        free = {f.name: f for f in self.candidate.free}
        return [free[name] for name in self.sensitivities]

    def origin(self, number: FreeNumber) -> float:
        """The value from which a step of this number counts."""
        return number.nominal if self.candidate.shaped else self.values[number.name]


class Gain(NamedTuple):
    """Predicted decrease of the cost by an effect, and the step (k,) of its numbers in their scales."""

    decrease: float
    response: Response
    step: np.ndarray

    @property
    def candidate(self) -> CandidateEffect:
        """The effect that is added."""
        return self.response.candidate

    def start(self, values: Setting) -> dict[str, float]:
        """Start values of a set: `values`, and those of the new effect after the predicted step."""
        out = {**values, **{f.name: self.response.values[f.name] for f in self.candidate.free}}
        for f, z in zip(self.response.moving, self.step, strict=True):
            out[f.name] = float(np.clip(self.response.origin(f) + z * f.scale, f.lower, f.upper))
        return out


@dataclass(frozen=True)
class Screening:
    """Responses of all candidates at one setting.

    columns: (n, c) sensitivities of all responses side by side, because one matrix product is many times faster than
    one per response; then the shift of each response, its base minus the residual of the setting.
    """

    responses: tuple[Response, ...]
    columns: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, responses: Sequence[Response], residual: np.ndarray) -> Screening:
        moved = [column for r in responses for column in r.sensitivities.values()]
        return cls(tuple(responses), np.column_stack([*moved, *(r.base - residual for r in responses)]))

    @cached_property
    def _products(self) -> np.ndarray:
        """(c, c) of all columns with each other."""
        return np.asarray(TEMPER * (self.columns.T @ self.columns))

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of each response: columns of its numbers (m, K), lowest and highest steps (m, K), column of its shift (m,).

        Responses with fewer than K numbers are padded with the column -1.
        """
        m, widest = len(self.responses), max(len(r.sensitivities) for r in self.responses)
        columns = np.full((m, widest), -1)
        low, high = np.zeros((m, widest)), np.zeros((m, widest))
        end = 0
        for i, response in enumerate(self.responses):
            for k, f in enumerate(response.moving):
                at = response.origin(f)
                columns[i, k], low[i, k], high[i, k] = end, (f.lower - at) / f.scale, (f.upper - at) / f.scale
                end += 1
        return columns, low, high, end + np.arange(m)

    def gains(self, fit: HypothesisFit) -> list[Gain]:
        """Predicted decrease of the cost by each response added to a fit, the largest first.

        Responses of effects and numbers that the fit has are left out.
        """
        keys, names = {c.key for c in fit.candidates}, {f.name for f in fit.free[: fit.n_effect]}
        of_fit = [r.candidate.key in keys or bool(names & {*r.candidate.names}) for r in self.responses]
        rows = np.flatnonzero(~np.array(of_fit))
        columns, low, high, shift = (table[rows] for table in self._table)
        among, here, constant = self._projection(fit).quadratic(columns, shift, self._freed(fit)[rows])
        z = -np.linalg.solve(among, here[:, :, None])[:, :, 0]
        z = np.clip(z, low, high)
        change = constant + 2.0 * np.sum(here * z, axis=1) + np.einsum("ij,ijk,ik->i", z, among, z)
        found = []
        for i in np.argsort(change, kind="stable"):
            response = self.responses[rows[i]]
            found.append(Gain(-float(change[i]), response, z[i, : len(response.sensitivities)]))
        return found

    def _freed(self, fit: HypothesisFit) -> np.ndarray:
        """Places (m, J) in `free` of the nominal parameters that each response sets free, padded with -1."""
        places = {f.name: i for i, f in enumerate(fit.free)}
        rows = [[places[name] for name in r.sensitivities if name in places] for r in self.responses]
        out = np.full((len(rows), max(1, *map(len, rows))), -1)
        for row, found in zip(out, rows, strict=True):
            row[: len(found)] = found
        return out

    def _projection(self, fit: HypothesisFit) -> _Projection:
        N, r, own = fit.jacobian, fit.residual, fit.n_effect
        ridge = np.where(np.arange(len(fit.free)) < own, RIDGE, 1.0)
        prior = np.array([*np.zeros(own), *((fit.values[f.name] - f.nominal) / f.scale for f in fit.free[own:])])
        # By Cholesky's factor: two effects of the fit may be nearly the same, and an inverse would lose what differs.
        L = np.linalg.cholesky(TEMPER * (N.T @ N) + np.diag(ridge))
        inverse, across, there = (
            solve_triangular(L, right, lower=True)
            for right in (np.eye(len(L)), TEMPER * (N.T @ self.columns), TEMPER * (N.T @ r) + ridge * prior)
        )
        products = self._products - across.T @ across
        gradient = TEMPER * (self.columns.T @ r) - across.T @ there
        found = products, gradient, inverse.T @ inverse, inverse.T @ across, inverse.T @ there, prior
        return _Projection(*(np.pad(one, (0, 1)) for one in found))


@dataclass(frozen=True)
class _Projection:
    """Change of the cost of a fit by columns (n, c) times factors, with all numbers of the fit free to follow.

    products: (c, c) and gradient (c,) of half that change. covariance: (k, k) of the fit's numbers; response: (k, c)
    and step (k,), by which these follow the columns, with the opposite sign, and reach their own optimum. prior: (k,).
    All are padded with a zero at the end.
    """

    products: np.ndarray
    gradient: np.ndarray
    covariance: np.ndarray
    response: np.ndarray
    step: np.ndarray
    prior: np.ndarray

    def quadratic(
        self, places: np.ndarray, shift: np.ndarray, freed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix (m, K, K), gradient (m, K) and constant (m,) of the change of the cost by columns at places (m, K).

        Half the gradient, as in normal equations. shift: (m,) column that is added whole. freed: (m, J) numbers of the
        fit that do not follow, and have no prior any more, because columns at these places stand for them.
        """
        S, g = self.products, self.gradient
        among = S[places[:, :, None], places[:, None, :]] + RIDGE * np.eye(places.shape[1])
        here = g[places] + S[places, shift[:, None]]
        constant = 2.0 * g[shift] + S[shift, shift]
        # Inverse of a matrix without some rows and columns, from that of the whole one.
        held = self.covariance[freed[:, :, None], freed[:, None, :]]
        held = np.linalg.inv(held + np.eye(freed.shape[1]) * (freed < 0)[:, :, None])
        follow = self.response[freed[:, :, None], places[:, None, :]]
        ahead = self.step[freed] + self.response[freed, shift[:, None]]
        among = among + np.swapaxes(follow, 1, 2) @ held @ follow
        here = here + np.einsum("ijk,ijl,il->ik", follow, held, ahead)
        constant = constant + np.einsum("ij,ijk,ik->i", ahead, held, ahead) - np.sum(self.prior[freed] ** 2, axis=1)
        return among, here, constant


def screen(
    objective: Objective, candidates: Sequence[CandidateEffect], pool: Pool, zero: np.ndarray, at: Setting
) -> Screening:
    """Simulate the response to every candidate from each of its starts.

    at: values at which the screening is done. zero: (n,) residual there.
    """

    def respond(item: tuple[CandidateEffect, tuple[float, ...]]) -> Response | None:
        candidate, start = item
        if candidate.shaped:
            # Location and shape have no derivative at the neutral value: one secant from neutral to the start.
            values = dict(zip(candidate.names, start, strict=True))
            (moved,) = objective.residuals([{**at, **values}])
            if moved is None:
                return None
            column = (moved - zero) / (start[0] / candidate.free[0].scale)
            return Response(candidate, values, zero, {candidate.names[0]: column})
        base: np.ndarray | None
        if all(np.isfinite(f.nominal) for f in candidate.free):
            # Secants from the neutral values, or from those of `at`, with steps as long as to the start.
            others = {f.name: f.nominal for f in candidate.free if f.fixed}
            base, values = zero, {f.name: others.get(f.name, at.get(f.name, f.nominal)) for f in candidate.free}
            steps = [max(s - f.nominal, 0.0) or f.scale for s, f in zip(start, candidate.free, strict=True)]
        else:
            values = dict(zip(candidate.names, start, strict=True))
            base, others, steps = (
                objective.residuals([{**at, **values}])[0],
                values,
                [0.5 * f.scale for f in candidate.free],
            )
        if base is None:
            return None
        moving = [(f, h) for f, h in zip(candidate.free, steps, strict=True) if not f.fixed]
        settings = [{**at, **others, f.name: values[f.name] + h} for f, h in moving]
        sensitivities = {
            f.name: (r - base) / (h / f.scale)
            for (f, h), r in zip(moving, objective.residuals(settings), strict=True)
            if r is not None
        }
        return Response(candidate, values, base, sensitivities) if sensitivities or others else None

    items = [(candidate, start) for candidate in candidates for start in candidate.starts]
    return Screening.of([r for r in pool.map("screening", respond, items) if r is not None], zero)
