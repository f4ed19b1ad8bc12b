"""Shapes of the terms of a sum, such as location and width, fitted to an unknown input from those of the grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from .grammar import Term
from .law_fit import LawFit
from .sum_problem import SumProblem, SumTarget

#: A term is unstable if its factor is smaller than so many of its standard deviations. Engineering judgement.
STABLE = 2.0


def stable(target: SumTarget, fit: LawFit) -> LawFit | None:
    """The sum with its shapes off the grid and without unstable terms; None if none is left."""
    while True:
        sure = [abs(f) > STABLE * sd for f, sd in zip(fit.factors, fit.sd, strict=True)]
        terms = [term for term, one in zip(fit.terms, sure, strict=True) if one]
        if not terms:
            return None
        terms = shaped(target, terms)
        problem = SumProblem.of(target, terms)
        found = problem.fit(range(len(problem.terms)), problem.whole)
        if not np.isfinite([*found.factors, *found.sd]).all():
            # A location that has left the data, where the term is almost zero.
            return None
        if all(sure):
            return found
        fit = found


def shaped(target: SumTarget, terms: list[Term]) -> list[Term]:
    """Terms with the shapes that leave least, from those of the grid."""
    start = np.array([value for term in terms for value in term.shapes.values()])
    if start.size == 0:
        return terms
    reach = {v.text: float(np.ptp(v.values)) for v in target.grammar.variables}
    scale = []
    for term in terms:
        whole = max((reach[text] for text in term.variables if text in reach), default=0.0)
        scale += [_scale(name, value, term.units[name], whole) for name, value in term.shapes.items()]

    def moved(z: np.ndarray) -> list[Term]:
        given, out = iter((start + z * np.array(scale)).tolist()), []
        for term in terms:
            out.append(replace(term, shapes={name: next(given) for name in term.shapes}))
        return out

    fixed = {i: target.column(term) for i, term in enumerate(terms) if not term.shapes}

    def left(z: np.ndarray) -> float:
        others = moved(z)
        pairs = zip(others, terms, strict=True)
        # A step in time before the log begins is a constant.
        if any(new.shapes[n] <= 0.1 * old.shapes[n] for new, old in pairs for n in old.shapes if _is_positive(old, n)):
            return np.inf
        columns = [fixed[i] if i in fixed else target.column(term) for i, term in enumerate(others)]
        problem = SumProblem.of_columns(target, others, columns)
        return problem.left(range(len(problem.terms))) if len(problem.terms) == len(terms) else np.inf

    first = np.vstack([np.zeros(start.size), 0.3 * np.eye(start.size)])
    options = {"maxiter": 40 * start.size, "initial_simplex": first, "xatol": 0.01, "fatol": 1e-4 * left(first[0])}
    return moved(minimize(left, first[0], method="Nelder-Mead", options=options).x)


def _scale(name: str, value: float, unit: str, whole: float) -> float:
    """Step of the search for a shape. whole: range of the variables of its term."""
    if name == "at":
        return 1.0 if unit == "1" else 0.1 * (whole if unit != "s" else value)
    return 0.05 * value if unit == "1" else abs(value)


def _is_positive(term: Term, name: str) -> bool:
    """Whether a shape is: all but locations other than times."""
    return name != "at" or term.units[name] == "s"
