"""What cvxpy's canonical form of an MPC's problem is as a function of the sample's parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.errors import InputError
from .mpc_terms import MpcTerms

#: Relative size below which a number that cvxpy and an elimination give is rounding.
ROUNDING = 1e-10

#: Matrices, vectors and cvxpy's program for one value of the parameter.
Data = tuple[list[np.ndarray], list[np.ndarray], Any]


def affine_in_parameter(at: Callable[[np.ndarray], Data], size: int) -> tuple[list[np.ndarray], list[np.ndarray], Any]:
    """Constant matrices, the matrices V of the vectors V (p, 1), and cvxpy's program. size: of the parameter.

    Raises InputError if a matrix depends on the parameter.
    """
    matrices, origin, program = at(np.zeros(size))
    others = at(np.random.default_rng(0).normal(size=size))[0]
    if any(m.shape != o.shape or not np.allclose(m, o, rtol=ROUNDING) for m, o in zip(matrices, others, strict=True)):
        raise InputError("problem: a weight changes from sample to sample; expected numbers as weights")
    columns = [at(unit)[1] for unit in np.eye(size)]
    vectors = [np.column_stack([*(column[k] - first for column in columns), first]) for k, first in enumerate(origin)]
    return matrices, vectors, program


def currents_first(program: Any, terms: MpcTerms, unknowns: int) -> np.ndarray:
    """Order (n,) of cvxpy's unknowns that puts the currents before all others."""
    first = program.var_id_to_col[terms.effort.id]
    places = np.arange(first, first + terms.horizon)
    return np.r_[places, np.delete(np.arange(unknowns), places)]


def symmetric(P: np.ndarray) -> np.ndarray:
    """P whole, of which some solvers take the upper triangle alone."""
    return P + P.T - np.diag(np.diag(P)) if np.allclose(P, np.triu(P)) else P
