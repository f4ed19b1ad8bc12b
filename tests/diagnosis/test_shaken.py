"""What the noise of the logged current alone does to a run."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.fit import Bench, Metric, Nominal
from ehsa_ctrl.diagnosis.held_out import Stretch
from ehsa_ctrl.diagnosis.judge import Judge
from ehsa_ctrl.diagnosis.twin import Twin, with_every_effect

NOISE = {"speed": 0.5, "p1": 1.5e4, "p2": 1.5e4, "position": 2e-5, "force": 15.0}


@pytest.fixture
def shaken():
    """Function from the current's noise, and what its sensor is said to have, to its doing without dry friction."""
    plant = ehsa_ctrl.load_plant("ehsa", model="linear")
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=6.0, seed=1)
    log, _ = ehsa_ctrl.record(plant, time, current, seed=1)

    def run(sd, stated=1.0):
        sensors = {**plant.sensors, "current": replace(plant.sensors["current"], noise=stated, step=0.0)}
        twin = Twin(with_every_effect(replace(plant, sensors=sensors)), log)
        judge = object.__new__(Judge)
        judge.search = SimpleNamespace(bench=Bench(twin, Metric.of(twin, NOISE), Nominal((), np.zeros(0), np.zeros(0))))
        return judge._shaken(Stretch(twin, 0, {**NOISE, "current": sd}, "the log"), {})

    return run


def test_no_noise_does_nothing(shaken):
    found = shaken(0.0)

    assert (found.square, found.gap) == (0.0, 0.0)
    assert not found.slow.any()


def test_twice_the_noise_does_twice_as_much(shaken):
    """In a plant that is linear, to the engine's tolerance."""
    once, twice = shaken(0.005), shaken(0.010)

    assert twice.square == pytest.approx(4.0 * once.square, rel=0.02)
    assert twice.gap == pytest.approx(2.0 * once.gap, rel=0.02)
    np.testing.assert_allclose(twice.slow, 4.0 * once.slow, rtol=0.05)
    assert once.gap > 0.0


def test_the_sensor_says_how_much_of_it_is_noise(shaken):
    """A controller's answer to noise looks like noise in the log, and drove the rig."""
    assert shaken(0.05, stated=0.005).square == shaken(0.005, stated=1.0).square
