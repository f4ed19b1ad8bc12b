"""Scores of made-up logs with known parameters: a plant's parameters a and b, an effect's e."""

import numpy as np

from ehsa_ctrl.fleet.score import LogScore

NAMES = ("K_T", "J_M", "e")
CAUSES = {"torque_constant": ("K_T",), "rotor_inertia": ("J_M",), "leak": ("e",)}
SCALE = np.array([0.1, 1e-5, 2.0])


def made_up(x, random, *, size=400.0, dispersion=1.0):
    """The score of a log of deviations x (3,), in SI units, with an information of about `size`."""
    root = np.sqrt(size) * (np.eye(3) + 0.2 * random.standard_normal((3, 3)))
    information = root @ root.T
    noise = np.linalg.solve(root.T, random.standard_normal(3)) * np.sqrt(dispersion)
    return LogScore(
        NAMES, 2, SCALE, information @ (np.asarray(x) / SCALE + noise), information, dispersion, CAUSES, (2.0, 0.9)
    )


def fleet_of(random, rigs=60, logs=5, spread=(0.04, 2e-5), changed=None):
    """Rig -> scores. changed: rig number -> (first log, change (3,))."""
    found = {}
    for number in range(rigs):
        own = np.append(np.array(spread) * random.standard_normal(2), 0.0)
        first, change = (changed or {}).get(number, (logs, np.zeros(3)))
        found[f"rig {number}"] = [made_up(own + (log >= first) * np.asarray(change), random) for log in range(logs)]
    return found
