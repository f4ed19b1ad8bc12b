"""The quadratic programme of an MPC, condensed to the currents.

Over the horizon i = 0 ... N - 1, with xi and mu as in regulator.py,

    minimise    sum  xi_i' Q xi_i + R mu_i^2 + R_rate (mu_i - mu_(i-1))^2  +  cost to come of (xi_N, mu_(N-1))
                + penalty (s + s^2 / 2) for each soft limit
    subject to  |u_i + extra| <= current limit,  |u_i - u_(i-1)| <= current rate T,
                |speed|, |pressure difference|, |position| <= (1 + s) their limits at i = 1 ... N,  s >= 0,

where u_i = mu_i + Gamma w_i and x_i = xi_i + Pi w_i along the planned motion of `motion_ahead`. The limits of the
current are hard: they are always feasible, because the last current satisfies them. The others may be infeasible (a rod
that is already too fast) and are soft, with one slack s per limit, relative to it, for the whole horizon. The terminal
cost is the regulator's cost-to-go: without an active limit the first current is that of the LQR.

Condensing eliminates the states: theta = (mu_0 ... mu_(N-1), s ...).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core.definition import Definition, In, InDrive, Metre, RadianPerSecond
from ..qp import NO_BOUND
from .kalman import Pascal
from .model import DesignModel
from .regulator import MOTION, Cost, Regulator, Target

#: Position error [m] that scales the penalty of soft limits, about a full stroke: the penalty must exceed the cost that
#: a violation saves, or the optimum violates a feasible limit.
LARGE_ERROR = 0.1
DrivePerSecond = Annotated[float, InDrive("A/s")]


class Limits(Definition):
    """[limits] in addition to current_limit; a limit that is left out does not apply."""

    current_rate: DrivePerSecond | None = Field(
        default=None, gt=0, description="rate of change of the current; a hard limit"
    )
    speed: RadianPerSecond | None = Field(
        default=None,
        gt=0,
        description="shaft speed; a soft limit: exceeding it by its own size costs `penalty` times as much as a "
        "position error of 0.1 m",
    )
    pressure: Pascal | None = Field(
        default=None, gt=0, description="pressure difference p1 - p2; a soft limit as speed"
    )
    stroke: Metre | None = Field(default=None, gt=0, description="magnitude of the rod position; a soft limit as speed")
    penalty: Annotated[float, In("1")] = Field(default=10.0, gt=0, description="weight of soft limits, see speed")

    @property
    def soft(self) -> dict[str, float]:
        """Signal of the design model -> its soft limit [rad/s, Pa, m]."""
        pairs = ("speed", self.speed), ("pressure", self.pressure), ("position", self.stroke)
        return {signal: limit for signal, limit in pairs if limit is not None}


def motion_ahead(reference: np.ndarray, sample_time: float, horizon: int, motion: np.ndarray) -> None:
    """Extrapolate a planned motion over the horizon: motion (3 (N + 1),) of position, velocity, acceleration.

    A law knows only the present sample of the plan. Braking continues to standstill. Otherwise the speed is constant,
    because the plan stops accelerating at its speed limit.
    """
    x, v, a = reference[0], reference[1], reference[2]
    motion[0], motion[1], motion[2] = x, v, a
    for i in range(1, horizon + 1):
        later = v + sample_time * a
        if v * a >= 0.0 or later * v <= 0.0:
            later = v if v * a >= 0.0 else 0.0
            a = 0.0
        x += 0.5 * sample_time * (v + later)
        v = later
        motion[3 * i], motion[3 * i + 1], motion[3 * i + 2] = x, v, a


@dataclass(frozen=True)
class MpcProblem:
    """Definition of the problem above.

    Attributes
    ----------
    model, target, cost, regulator: of the law without limits.
    horizon: N. current_limit: A. limits: all others.
    """

    model: DesignModel
    target: Target
    cost: Cost
    regulator: Regulator
    horizon: int
    current_limit: float
    limits: Limits

    def __post_init__(self) -> None:
        for signal in self.limits.soft:
            self.model.row(signal)  # raises InputError for a signal that the model lacks

    @property
    def penalty(self) -> float:
        """Cost of exceeding a soft limit by its own size."""
        c = self.model.row("position")
        error = c * (LARGE_ERROR / (c @ c))
        return float(self.limits.penalty * error @ self.regulator.P[: c.size, : c.size] @ error)

    @property
    def parameters(self) -> int:
        """Length of p: scaled states and disturbances, planned motion (row by row), mu_before, extra, last current."""
        return self.model.A.shape[0] + self.model.E.shape[1] + MOTION * (self.horizon + 1) + 3


@dataclass(frozen=True)
class Condensed:
    """minimise 1/2 theta' H theta + (F p)' theta subject to lower + T p <= (theta, G theta) <= upper + T p.

    Attributes
    ----------
    H (v, v), F (v, p), G (g, v), lower and upper (v + g,), T (v + g, p): see above; the first N of theta are mu.
    currents: (p,) row with u_0 = theta_0 + currents p.
    """

    H: np.ndarray
    F: np.ndarray
    G: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    T: np.ndarray
    currents: np.ndarray


@dataclass(frozen=True)
class StatesAhead:
    """Prediction over the horizon: (xi_i, mu_(i-1)) = free[i] p + forced[i] mu, with p of `MpcProblem.parameters`.

    w: N + 1 rows of the planned motion and disturbances (3 + d, p). currents: (N, p), the current of each sample is
    mu + currents p.
    """

    free: list[np.ndarray]
    forced: list[np.ndarray]
    w: list[np.ndarray]
    currents: np.ndarray


def predict_states(problem: MpcProblem) -> StatesAhead:
    """States over the horizon as affine functions of the unknown currents and the parameters."""
    model, target, regulator, N = problem.model, problem.target, problem.regulator, problem.horizon
    n, d = model.E.shape
    # Rows over p = (x, d, motion, mu_before, extra, last current).
    p = np.eye(problem.parameters)
    x, before, extra = p[:n], p[-3], p[-2]
    w = [np.vstack([p[n + d + MOTION * i : n + d + MOTION * (i + 1)], p[n : n + d]]) for i in range(N + 1)]
    a, b = regulator.A[: n + 1, : n + 1], regulator.B[: n + 1]
    free = [np.vstack([x - target.Pi @ w[0], before])]
    forced = [np.zeros((n + 1, N))]
    for i in range(N):
        free.append(a @ free[i])
        forced.append(a @ forced[i] + np.outer(b, np.eye(N)[i]))
    return StatesAhead(free, forced, w, np.array([target.Gamma @ w[i] + extra for i in range(N)]))


def condense(problem: MpcProblem) -> Condensed:
    """Eliminate the states; the unknowns are currents and slacks."""
    model, target, regulator, N = problem.model, problem.target, problem.regulator, problem.horizon
    n, soft, k = model.A.shape[0], problem.limits.soft, problem.parameters
    ahead = predict_states(problem)
    free, forced, w = ahead.free, ahead.forced, ahead.w
    p = np.eye(k)
    extra, given = p[-2], p[-1]
    v = N + len(soft)
    H, F = np.zeros((v, v)), np.zeros((v, k))
    cross, Q, P = regulator.N_cross[: n + 1], regulator.Q[: n + 1, : n + 1], regulator.P[: n + 1, : n + 1]
    for i in range(N):
        pick = np.eye(N)[i]
        mixed = np.outer(forced[i].T @ cross, pick)
        H[:N, :N] += 2.0 * (forced[i].T @ Q @ forced[i] + mixed + mixed.T + regulator.R * np.outer(pick, pick))
        F[:N] += 2.0 * (forced[i].T @ Q @ free[i] + np.outer(pick, cross @ free[i]))
    H[:N, :N] += 2.0 * forced[N].T @ P @ forced[N]
    F[:N] += 2.0 * forced[N].T @ P @ free[N]
    penalty = problem.penalty
    H[range(N, v), range(N, v)] = penalty
    constant = np.r_[np.zeros(N), np.full(len(soft), penalty)]
    known = [target.Gamma @ w[i] for i in range(N)]
    # Simple bounds: currents and slacks.
    lower = [np.r_[np.full(N, -problem.current_limit), np.zeros(len(soft))]]
    upper = [np.r_[np.full(N, problem.current_limit), np.full(len(soft), NO_BOUND)]]
    T = [np.vstack([*(-row - extra for row in known), np.zeros((len(soft), k))])]
    G: list[np.ndarray] = []
    if problem.limits.current_rate is not None:
        rows = np.eye(N, v) - np.eye(N, v, -1)
        change = problem.limits.current_rate * model.sample_time
        first = given - extra - known[0]
        G.append(rows)
        T.append(np.vstack([first, *(earlier - later for earlier, later in zip(known, known[1:], strict=False))]))
        lower.append(np.full(N, -change))
        upper.append(np.full(N, change))
    for column, (signal, limit) in enumerate(soft.items(), start=N):
        seen = np.r_[model.row(signal), 0.0] / limit
        moved = np.array([seen @ forced[i] for i in range(1, N + 1)])
        rest = np.array([seen @ free[i] + seen[:n] @ target.Pi @ w[i] for i in range(1, N + 1)])
        share = np.zeros((N, len(soft)))
        share[:, column - N] = 1.0
        for sign in (1.0, -1.0):
            G.append(np.hstack([sign * moved, -share]))
            T.append(-sign * rest)
            lower.append(np.full(N, -NO_BOUND))
            upper.append(np.ones(N))
    # p ends with a 1, for the constant part of f.
    F = np.hstack([F, constant[:, None]])
    T_all = np.hstack([np.vstack(T), np.zeros((sum(len(part) for part in T), 1))])
    return Condensed(
        H=0.5 * (H + H.T),
        F=F,
        G=np.vstack(G) if G else np.zeros((0, v)),
        lower=np.concatenate(lower),
        upper=np.concatenate(upper),
        T=T_all,
        currents=np.r_[known[0], 0.0],
    )
