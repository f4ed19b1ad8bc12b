"""Modes of a linear model that its inputs don't reach."""

from __future__ import annotations

import numpy as np

#: A mode is out of reach if the inputs move it by less than this share of what they move the most.
HIDDEN = 1e-9


def without_constants(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A model in fewer states, without what no input ever changes, as P_1 + P_2 in (6).

    w' A = 0 and w' B = 0 say that w' x keeps its value; deviations from rest start with 0, so that x stays in the
    plane w' x = 0.

    Parameters
    ----------
    a (n, n), b (n, m), c (p, n): in states of like size, with everything that comes in as a column of b.
    """
    left, sizes, _ = np.linalg.svd(np.hstack([a / max(float(np.linalg.norm(a, 2)), 1e-300), _unit(b)]))
    constant = left[:, sizes < HIDDEN]
    if constant.shape[1] == 0:
        return a, b, c
    plane = left[:, sizes >= HIDDEN]
    return plane.T @ a @ plane, plane.T @ b, c @ plane


def _unit(b: np.ndarray) -> np.ndarray:
    """Columns of length 1, without those that are zero."""
    columns = np.linalg.norm(b, axis=0)
    return b[:, columns > 0] / columns[columns > 0]


def hidden_modes(a: np.ndarray, b: np.ndarray) -> list[complex]:
    """Eigenvalues [rad/s] at which (s I - A, B) loses rank: modes that no input reaches, by the test of Popov,
    Belevitch and Hautus. With (A', C') those that no output shows.

    Parameters
    ----------
    a (n, n), b (n, m): in states of like size.
    """
    size = max(float(np.linalg.norm(a, 2)), 1e-300)
    found: list[complex] = []
    for mode in np.linalg.eigvals(a):
        mode = complex(mode) if abs(mode) > HIDDEN * size else 0j
        pencil = np.hstack([(mode * np.eye(a.shape[0]) - a) / size, _unit(b)])
        lost = int(np.count_nonzero(np.linalg.svd(pencil, compute_uv=False) < HIDDEN))
        # An eigenvalue that stands there twice may be out of reach only once.
        if sum(abs(mode - known) <= HIDDEN * size for known in found) < lost:
            found.append(mode)
    return found
