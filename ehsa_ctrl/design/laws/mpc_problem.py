"""The problem that an MPC solves each sample, condensed to currents.

Over the horizon i = 0 ... N - 1, with xi and mu as in regulator.py,

    minimise    sum  xi_i' Q xi_i + R mu_i^2 + R_rate (mu_i - mu_(i-1))^2  +  cost to come of (xi_N, mu_(N-1))
                + penalty (s + s^2 / 2) for each soft limit
    subject to  |u_i + extra| <= current limit,  |u_i - u_(i-1)| <= current rate T,
                |speed|, |pressure difference|, |position| <= (1 + s) their limits at i = 1 ... N,  s >= 0,

where u_i = mu_i + Gamma w_i and x_i = xi_i + Pi w_i, the planned motion going on as `ahead` says. The currents' limits
can always be kept: the current given before keeps them. The others may be out of reach (a rod that already is too
fast), so that passing them costs much but is possible, by one share s of each limit for the whole horizon. The cost to
come is that of the regulator: without an active limit the first current is that of the LQR.

The states are eliminated (condensed): theta = (mu_0 ... mu_(N-1), s ...).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.errors import InputError
from ..qp import NO_BOUND
from ..synthesis.model import DesignModel
from ..synthesis.regulator import Cost, Regulator
from ..synthesis.target import MOTION, Target

#: An error of the position [m] with which the penalty of soft limits is compared: as far as a rod gets.
FAR = 0.1


@dataclass(frozen=True)
class Limits:
    """Limits of an MPC beside its current's.

    Attributes
    ----------
    current_rate: A/s. speed: of the shaft [rad/s]. pressure: of p1 - p2 [Pa]. stroke: of the rod to either side [m].
        None leaves one out; all but current_rate are soft.
    penalty: cost of passing a soft limit by its own size, in that of being FAR off the target. It must outweigh what
        passing would gain, else a limit that could be kept is not.
    """

    current_rate: float | None = None
    speed: float | None = None
    pressure: float | None = None
    stroke: float | None = None
    penalty: float = 10.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not 0 < value < np.inf:
                raise InputError(f"limits: {name} = {value:g} leaves no room; expected a limit greater than 0")

    @property
    def soft(self) -> dict[str, float]:
        """Signal of the design model -> its limit."""
        pairs = ("speed", self.speed), ("pressure", self.pressure), ("position", self.stroke)
        return {signal: limit for signal, limit in pairs if limit is not None}


def ahead(position: float, velocity: float, acceleration: float, sample_time: float, motion: np.ndarray) -> None:
    """Fill motion (N + 1, 3) with a planned motion as it may go on: a law knows its plan of this sample alone.

    Braking goes on to standstill; otherwise the speed stays. An acceleration that went on would soon pass every limit
    of speed, which the plan will not.
    """
    x, v, a = position, velocity, acceleration
    motion[0, 0], motion[0, 1], motion[0, 2] = x, v, a
    for i in range(1, motion.shape[0]):
        later = v + sample_time * a
        if v * a >= 0.0 or later * v <= 0.0:
            later = v if v * a >= 0.0 else 0.0
            a = 0.0
        x += 0.5 * sample_time * (v + later)
        v = later
        motion[i, 0], motion[i, 1], motion[i, 2] = x, v, a


@dataclass(frozen=True)
class MpcProblem:
    """What defines the problem above, and how large it is.

    Attributes
    ----------
    model, target, cost, regulator: of the law without limits.
    horizon: N. current_limit: A. limits: the others.
    """

    model: DesignModel
    target: Target
    cost: Cost
    regulator: Regulator
    horizon: int
    current_limit: float
    limits: Limits

    def __post_init__(self) -> None:
        if self.horizon != int(self.horizon) or not 2 <= self.horizon <= 500:
            raise InputError(f"horizon = {self.horizon}; expected a whole number of samples from 2 to 500")
        if not 0 < self.current_limit < np.inf:
            raise InputError(f"current_limit = {self.current_limit:g} A; expected more than 0 A")
        for signal in self.limits.soft:
            self.model.row(signal)

    @property
    def penalty(self) -> float:
        """Cost of passing a soft limit by its own size, in the units of the cost."""
        c = self.model.row("position")
        far = c * (FAR / (c @ c))
        return float(self.limits.penalty * far @ self.regulator.P[: c.size, : c.size] @ far)

    @property
    def parameters(self) -> int:
        """How many numbers change each sample: states and disturbances (scaled), the motion ahead (row by row),
        mu_before, extra and the current given before."""
        return self.model.A.shape[0] + self.model.E.shape[1] + MOTION * (self.horizon + 1) + 3


@dataclass(frozen=True)
class Condensed:
    """minimise 1/2 theta' H theta + (F p)' theta subject to lower + T p <= (theta, G theta) <= upper + T p.

    Attributes
    ----------
    H (v, v), F (v, p), G (g, v), lower and upper (v + g,), T (v + g, p): as above; the first N of theta are mu.
    currents: (p,) row with u_0 = theta_0 + currents p.
    """

    H: np.ndarray
    F: np.ndarray
    G: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    T: np.ndarray
    currents: np.ndarray


def condense(problem: MpcProblem) -> Condensed:
    """Write the problem with the currents as its only unknowns, beside the shares of the soft limits."""
    model, target, regulator, N = problem.model, problem.target, problem.regulator, problem.horizon
    n, d = model.E.shape
    soft, k = problem.limits.soft, problem.parameters
    # The parameters' parts as matrices over p = (x, d, motion, mu_before, extra, given before).
    p = np.eye(k)
    x, before, extra, given = p[:n], p[-3], p[-2], p[-1]
    w = [np.vstack([p[n + d + MOTION * i : n + d + MOTION * (i + 1)], p[n : n + d]]) for i in range(N + 1)]
    # (xi, mu_before) along the horizon: free[i] p + forced[i] mu.
    a, b = regulator.A[: n + 1, : n + 1], regulator.B[: n + 1]
    free = [np.vstack([x - target.Pi @ w[0], before])]
    forced = [np.zeros((n + 1, N))]
    for i in range(N):
        free.append(a @ free[i])
        forced.append(a @ forced[i] + np.outer(b, np.eye(N)[i]))
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
    # Simple bounds: the currents and the shares.
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
        ahead = np.array([seen @ forced[i] for i in range(1, N + 1)])
        rest = np.array([seen @ free[i] + seen[:n] @ target.Pi @ w[i] for i in range(1, N + 1)])
        share = np.zeros((N, len(soft)))
        share[:, column - N] = 1.0
        for sign in (1.0, -1.0):
            G.append(np.hstack([sign * ahead, -share]))
            T.append(-sign * rest)
            lower.append(np.full(N, -NO_BOUND))
            upper.append(np.ones(N))
    # The constant part of f rides on p as well: p ends with a 1.
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
