"""What the tests of exported code give to controllers, and how strictly they compile."""

from dataclasses import replace

import numpy as np

from ehsa_ctrl.design.stages.feedforward import Feedforward
from ehsa_ctrl.design.stages.rest import Dither, Knocker, Rest
from ehsa_ctrl.design.stages.trajectory import TrajectoryLimits

STRICT = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-pedantic"]
STRICT += ["-ffp-contract=off"]


def readings(samples, seed=0):
    """Reference and readings that wander, jump, get lost for a moment and at the end for good."""
    rng = np.random.default_rng(seed)
    reference = np.zeros((samples, 3))
    reference[samples // 10 :, 0] = 0.02
    reference[samples // 2 :, 0] = -0.06
    reference[2 * samples // 3 :, 1] = 0.03
    wander = np.cumsum(rng.normal(size=(samples, 5)), axis=0)
    measured = wander * [1.0, 2e4, 2e4, 1e-4, 20.0] + [0.0, 2e6, 2e6, 0.0, 0.0]
    # A rest at the target, so that friction compensation at rest acts.
    quiet = slice(samples // 5, samples // 2)
    measured[quiet] = [0.0, 2e6, 2e6, 0.02, 100.0] + rng.normal(size=(samples // 2 - samples // 5, 5)) * 1e-5
    measured[samples // 3 : samples // 3 + 4] = np.nan
    measured[-samples // 10 :, 3] = np.nan
    return reference, measured


def full(controller):
    """The same law with every stage around it."""
    return replace(
        controller,
        trajectory=TrajectoryLimits(speed="0.15 m/s", acceleration="3 m/s2", duration="0.2 s"),
        feedforward=Feedforward(coulomb="0.9 A", static="1 A", load="0.3 A/kN"),
        rest=Rest(band="40 um", knocker=Knocker(first="0.2 A", growth="0.1 A", largest="2 A")),
        dither=Dither(amplitude="0.1 A", frequency="60 Hz"),
    )


def loop_readings(controller):
    """Reference and readings of a loop on the nonlinear plant, with steps, ramps and lost readings."""
    from ehsa_ctrl import load_plant
    from ehsa_ctrl.simulation.exercise import exercise_controller

    return exercise_controller(load_plant("ehsa"), controller, controller.current_limit, 0)[:2]
