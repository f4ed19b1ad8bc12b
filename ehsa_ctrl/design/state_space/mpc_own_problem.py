"""An MPC whose cost and constraints the user states in cvxpy, as the quadratic programme of every other MPC.

cvxpy canonicalises the problem once. Its vectors are affine in the sample's parameters, its matrices constant: both are
read off, variables that equations determine are eliminated, and what is left has the form of `Condensed`. So the loop,
the solvers, the status, the fallback and the export to C are those of the MPC from a file. The solver is one of those,
or OSQP in C code that cvxpygen writes, or Clarabel for a problem with cones.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.errors import InputError, shown
from ..qp import NO_BOUND, SOLVED, QpSolver, is_strictly_convex
from .mpc import Mpc
from .mpc_canonical import ROUNDING, Data, affine_in_parameter, currents_first, symmetric
from .mpc_compiled import compiled_qp, has_cvxpygen
from .mpc_cones import cone_programme
from .mpc_problem import Condensed
from .mpc_terms import MpcTerms

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class CanonicalForm:
    """minimise 1/2 z' P z + (q p)' z subject to A z = b p, F z <= g p; p ends with a 1. z begins with the currents."""

    P: np.ndarray
    q: np.ndarray
    A: np.ndarray
    b: np.ndarray
    F: np.ndarray
    g: np.ndarray


def with_own_problem(law: Any, state: Callable[[MpcTerms], Any], compiled: bool | None = None) -> Mpc:
    """The MPC with the cost and constraints that `state(terms)` returns; arguments as in `load_controller`.

    The hard limits of the current, and of its rate if the file has one, apply as well.

    Raises InputError for a law that is no MPC, for a problem that is not convex or whose parameters do not enter
    linearly, for one that is infeasible at rest, and if `compiled` is True and it can't be compiled.
    """
    if not isinstance(law, Mpc):
        raise InputError('problem: is for a controller of kind = "mpc"; expected one, such as "mpc_position"')
    terms = MpcTerms(law.problem)
    problem = complete_problem(law, terms, state)
    external: QpSolver | None = None
    if problem.is_qp():
        found = condense_form(canonical_form(problem, terms), terms.horizon)
        solver, external = _solver_of(found, law, compiled)
    elif compiled:
        raise InputError("problem: has cones, which are not compiled; leave compiled out, and Clarabel solves it")
    else:
        found, external = cone_programme(problem, terms, law.iteration_limit, law.deadline)
        solver = "clarabel"
    own = replace(law, own=found, solver=solver, external=external)
    rest = np.zeros(found.F.shape[1])
    rest[-1] = 1.0
    trial = own.qp.solve(
        found.F @ rest,
        found.lower + found.T @ rest,
        found.upper + found.T @ rest,
        np.zeros(len(found.F)),
        np.zeros(found.lower.size),
    )
    if trial.status != SOLVED:
        raise InputError(
            "problem: has no solution at rest in mid-stroke with the reference there; make limits that a sample may "
            "violate soft, by a variable that the cost weighs"
        )
    return own


def _solver_of(found: Condensed, law: Mpc, compiled: bool | None) -> tuple[str, QpSolver | None]:
    """Name of the solver, and the compiled one, if it is that."""
    if compiled or (compiled is None and has_cvxpygen()):
        try:
            return "osqp, compiled by cvxpygen", compiled_qp(found, law.iteration_limit)
        except InputError as error:
            if compiled:
                raise
            log.warning("%s; it is solved without", error)
    return (law.solver if is_strictly_convex(found.H) else "osqp"), None


def complete_problem(law: Mpc, terms: MpcTerms, state: Callable[[MpcTerms], Any]) -> Any:
    """The user's problem with the hard limits of the current. Raises InputError for one that is none."""
    import cvxpy

    cp: Any = cvxpy
    given = state(terms)
    cost, rules = given if isinstance(given, tuple) and len(given) == 2 else (given, [])
    if not isinstance(cost, cp.Expression | int | float) or not isinstance(rules, Iterable):
        raise InputError(
            f"problem: returned {shown(given)}; expected a cost, or (cost, constraints), expressions of cvxpy"
        )
    rules = list(rules)
    if isinstance(cost, cp.Expression):
        cost, rules = with_numbers(cost, rules, terms)
    wrong = [rule for rule in rules if not isinstance(rule, cp.constraints.constraint.Constraint)]
    if wrong:
        raise InputError(f"problem: one of the constraints is {shown(wrong[0])}; expected expressions such as x <= 1")
    rules += [terms.current <= law.problem.current_limit, terms.current >= -law.problem.current_limit]
    if law.problem.limits.current_rate is not None:
        change = law.problem.limits.current_rate * terms.sample_time
        rules += [terms.current_change <= change, terms.current_change >= -change]
    try:
        problem = cp.Problem(cp.Minimize(cost), rules)
    except (ValueError, cp.error.DCPError) as error:
        raise InputError(f"problem: {' '.join(str(error).split())}; expected a scalar cost") from None
    if not problem.is_dcp():
        raise InputError("problem: is not convex by cvxpy's rules; expected a convex cost and convex constraints")
    if problem.is_mixed_integer():
        raise InputError("problem: has an integer or boolean variable; expected continuous ones")
    if not problem.is_dcp(dpp=True):
        raise InputError(
            "problem: a term is multiplied by another one that changes from sample to sample; expected numbers as "
            "weights"
        )
    return problem


def with_numbers(cost: Any, rules: list[Any], terms: MpcTerms) -> tuple[Any, list[Any]]:
    """Cost and constraints with the user's own parameters as constants. Raises InputError for one without a value."""
    import cvxpy

    cp: Any = cvxpy
    numbers: dict[int, Any] = {}
    for each in [cost, *(rule for rule in rules if hasattr(rule, "parameters"))]:
        for own in each.parameters():
            if own.id != terms.parameter.id and own.value is None:
                raise InputError(f"problem: its parameter {own.name()} has no value; set {own.name()}.value before")
            if own.id != terms.parameter.id:
                numbers.setdefault(id(own), cp.Constant(own.value))
    if not numbers:
        return cost, rules
    return cost.tree_copy(numbers), [rule.tree_copy(numbers) if hasattr(rule, "tree_copy") else rule for rule in rules]


def canonical_form(problem: Any, terms: MpcTerms) -> CanonicalForm:
    """Matrices of the problem and the affine dependence of its vectors on the parameter.

    Raises InputError if a matrix depends on the parameter.
    """
    import cvxpy

    size = terms.parameter.size

    def at(p: np.ndarray) -> Data:
        terms.parameter.value = p
        data = problem.get_problem_data(cvxpy.OSQP)[0]
        rows, sides = [data["F"].toarray()], [data["G"]]
        n = data["q"].size
        for sign, word in ((1.0, "upper_bounds"), (-1.0, "lower_bounds")):
            bound = data.get(word)
            there = np.zeros(n, dtype=bool) if bound is None else np.isfinite(bound)
            rows.append(sign * np.eye(n)[there])
            sides.append(np.zeros(0) if bound is None else sign * bound[there])
        matrices = [data["P"].toarray(), data["A"].toarray(), np.vstack(rows)]
        return matrices, [data["q"], data["b"], np.concatenate(sides)], data["param_prob"]

    matrices, (q, b, g), program = affine_in_parameter(at, size)
    order = currents_first(program, terms, len(q))
    P, A, F = matrices
    return CanonicalForm(symmetric(P)[np.ix_(order, order)], q[order], A[:, order], b, F[:, order], g)


def condense_form(form: CanonicalForm, horizon: int) -> Condensed:
    """Eliminate the variables that equations determine; the currents stay the first unknowns."""
    from scipy.linalg import qr, solve_triangular

    m, (n, size) = horizon, form.q.shape
    rotation, upper, pivots = qr(form.A[:, m:], pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.count_nonzero(diagonal > ROUNDING * np.max(diagonal, initial=0.0)))
    gone, kept = m + pivots[:rank], m + np.sort(pivots[rank:])
    free = np.r_[np.arange(m), kept]
    top, rest = rotation[:, :rank].T, rotation[:, rank:].T
    # z = S y + s p with y the free unknowns.
    S, s = np.zeros((n, free.size)), np.zeros((n, size))
    S[free, np.arange(free.size)] = 1.0
    if rank:
        S[gone] = -solve_triangular(upper[:rank, :rank], top @ form.A[:, free])
        s[gone] = solve_triangular(upper[:rank, :rank], top @ form.b)
    left = rest @ form.A[:, free]
    real = np.max(np.abs(left), axis=1, initial=0.0) > ROUNDING
    H, linear = S.T @ form.P @ S, S.T @ (form.q + form.P @ s)
    keep, G, sides = eliminate_bounds(H, linear, form.F @ S, form.g - form.F @ s, left[real], horizon)
    H, linear = H[np.ix_(keep, keep)], linear[keep]
    equal = (rest @ form.b)[real]
    v, count, same = keep.size, len(sides), len(equal)
    G = np.vstack([G[:, keep], left[real][:, keep]])
    # NO_BOUND for the unknowns themselves; constant parts of the sides are in T, whose last column belongs to p = 1.
    none = np.full(v, NO_BOUND)
    return Condensed(
        H=0.5 * (H + H.T),
        F=linear,
        G=G,
        lower=np.concatenate([-none, np.full(count, -NO_BOUND), np.zeros(same)]),
        upper=np.concatenate([none, np.zeros(count), np.zeros(same)]),
        T=np.vstack([np.zeros((v, size)), sides, equal]),
        currents=np.zeros(size),
    )


def eliminate_bounds(
    H: np.ndarray, linear: np.ndarray, G: np.ndarray, sides: np.ndarray, equations: np.ndarray, horizon: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eliminate unknowns that cost nothing and stand in inequalities alone, as cvxpy makes them of abs(x) <= 1.

    By Fourier and Motzkin: each upper bound of such an unknown must not be below each of its lower bounds. Unknowns
    whose elimination would give more rows than before stay. Returns the kept columns and the rows G y <= sides p.
    """
    keep = []
    size = np.max(np.abs(H), initial=1.0)
    for k in range(len(H)):
        column = G[:, k]
        tiny = ROUNDING * np.max(np.abs(column), initial=0.0)
        above, below = np.flatnonzero(column > tiny), np.flatnonzero(column < -tiny)
        costs = np.any(np.abs(H[k]) > ROUNDING * size) or np.any(linear[k] != 0.0) or np.any(equations[:, k] != 0.0)
        if k < horizon or costs or above.size * below.size > above.size + below.size:
            keep.append(k)
            continue
        pairs = [(i, j) for i in above for j in below]
        new = [G[i] / column[i] - G[j] / column[j] for i, j in pairs]
        new_sides = [sides[i] / column[i] - sides[j] / column[j] for i, j in pairs]
        others = np.setdiff1d(np.arange(len(G)), np.r_[above, below])
        G = np.vstack([G[others], *new])
        sides = np.vstack([sides[others], *new_sides])
    return np.array(keep), G, sides
