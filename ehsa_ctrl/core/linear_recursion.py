"""Linear recursions along a run, compiled."""

from __future__ import annotations

import numpy as np

from .compiled import cached_njit


@cached_njit(nogil=True)
def add_product(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """out += a b; for matrices of a few rows a loop is faster than BLAS.

    Here and below loops replace slices and `np.outer`, which take seconds to compile.
    """
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            for m in range(a.shape[1]):
                out[i, j] += a[i, m] * b[m, j]


@cached_njit(nogil=True)
def linear_recursion(transition: np.ndarray, added: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Courses (N, n, q + k) of Y[s + 1] = transition[s] Y[s] + [0, added[s]] from Y[0] = [begin, 0].

    transition (N-1, n, n), added (N-1, n, k), begin (n, q).
    """
    n, q = begin.shape
    out = np.zeros((added.shape[0] + 1, n, q + added.shape[2]))
    for i in range(n):
        for j in range(q):
            out[0, i, j] = begin[i, j]
    for s in range(added.shape[0]):
        for i in range(n):
            for j in range(added.shape[2]):
                out[s + 1, i, q + j] = added[s, i, j]
        add_product(transition[s], out[s], out[s + 1])
    return out


@cached_njit(nogil=True)
def constant_recursion(transition: np.ndarray, added: np.ndarray) -> np.ndarray:
    """Course (N, n) of y[s + 1] = transition y[s] + added[s] from zero, with one transition (n, n); added (N, n).

    The last row of `added` has no effect.
    """
    out = np.zeros_like(added)
    for s in range(added.shape[0] - 1):
        for i in range(added.shape[1]):
            out[s + 1, i] = added[s, i]
            for m in range(added.shape[1]):
                out[s + 1, i] += transition[i, m] * out[s, m]
    return out
