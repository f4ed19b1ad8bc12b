"""Plants and laws with margins in closed form."""

from dataclasses import dataclass

import control
import numpy as np
from scipy.linalg import expm


@dataclass
class Made:
    """A controller with a given linear law, and the other attributes that a test needs."""

    law: control.StateSpace
    sample_time: float = 0.004
    name: str = "made"
    current_limit: float = 6.0
    rest: object = None

    def linear(self):
        return self.law


def proportional(k, h=0.004, **more):
    """current = k (reference - position)."""
    d = np.zeros((1, 8))
    d[0, 0], d[0, 6] = k, -k
    return Made(control.ss([], np.zeros((0, 8)), np.zeros((1, 0)), d, h), h, **more)


def integral(k_p, k_i, h=0.004, **more):
    """PI, the integral by forward differences."""
    b, d = np.zeros((1, 8)), np.zeros((1, 8))
    b[0, 0], b[0, 6] = h * k_i, -h * k_i
    d[0, 0], d[0, 6] = k_p, -k_p
    return Made(control.ss([[1.0]], b, [[1.0]], d, h), h, **more)


def integrator(gain=1.0):
    """x' = gain * current + F_D."""
    return control.ss([[0.0]], [[gain, 1.0]], [[1.0]], 0, inputs=["current", "F_D"], outputs=["x"], states=["x"])


def ripples(system, law, delay, seconds, *, parts=50):
    """Position at the samples of a loop that was pushed once, by small steps of time: current late by `delay` [s].

    An implementation apart from the package's: the held current is a signal of its own, looked up `delay` before.
    """
    h = float(law.dt)
    step = h / parts
    late = round(delay / step)
    n = system.nstates
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = system.A, system.B[:, system.input_labels.index("current")]
    moved = expm(block * step)
    names = list(system.output_labels)
    weights = np.zeros((8, len(names)))
    for row, (name, weight) in {3: ("omega", 1.0), 4: ("dP", 0.5), 5: ("dP", -0.5), 6: ("x", 1.0)}.items():
        if name in names:
            weights[row, names.index(name)] = weight
    x, state = np.zeros(n), np.zeros(law.nstates)
    x[names.index("x")] = 1e-3
    asked, found = [], []
    for k in range(round(seconds / h)):
        seen = weights @ system.C @ x
        found.append(seen[6])
        asked += [float((law.C @ state + law.D @ seen)[0])] * parts
        state = law.A @ state + law.B @ seen
        for j in range(k * parts, (k + 1) * parts):
            x = moved[:n, :n] @ x + moved[:n, n] * (asked[j - late] if j >= late else 0.0)
    return np.array(found)


def grows(position):
    """Whether the last quarter of a record is larger than the second one."""
    quarter = len(position) // 4
    return np.max(np.abs(position[-quarter:])) > np.max(np.abs(position[quarter : 2 * quarter]))
