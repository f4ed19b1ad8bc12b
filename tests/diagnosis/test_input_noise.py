"""The effect of the logged current's noise on a run."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel, with_every_effect
from ehsa_ctrl.diagnosis.objective import NominalParameters, Objective, ResidualScale
from ehsa_ctrl.diagnosis.records import Record, Segment
from ehsa_ctrl.diagnosis.scoring import input_noise_effect

NOISE = {"speed": 0.5, "p1": 1.5e4, "p2": 1.5e4, "position": 2e-5, "force": 15.0}


@pytest.fixture
def effect_of():
    """Function from the current's noise, and what its sensor is said to have, to its doing without dry friction."""
    plant = ehsa_ctrl.load_plant("ehsa", model="linear")
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=6.0, seed=1)
    log, _ = ehsa_ctrl.record(plant, time, current, seed=1)

    def run(sd, stated=1.0):
        sensors = {**plant.sensors, "current": replace(plant.sensors["current"], noise=stated, step=0.0)}
        model = HypothesisModel(with_every_effect(replace(plant, sensors=sensors)), log)
        nominal = NominalParameters((), np.zeros(0), np.zeros(0), np.zeros(0))
        objective = Objective(model, ResidualScale.of(model, NOISE), nominal)
        return input_noise_effect(objective, Segment((Record(model, {**NOISE, "current": sd}),), "the log"), {})

    return run


def test_no_noise_does_nothing(effect_of):
    found = effect_of(0.0)

    assert (found.square, found.gaps["total"]) == (0.0, 0.0)
    assert not found.block_means.any()


def test_twice_the_noise_does_twice_as_much(effect_of):
    """In a plant that is linear, to the engine's tolerance."""
    once, twice = effect_of(0.005), effect_of(0.010)

    assert twice.square == pytest.approx(4.0 * once.square, rel=0.02)
    assert twice.gaps == pytest.approx({name: 2.0 * gap for name, gap in once.gaps.items()}, rel=0.05)
    np.testing.assert_allclose(twice.block_means, 4.0 * once.block_means, rtol=0.05)
    assert min(once.gaps.values()) > 0.0


def test_the_sensor_says_how_much_of_it_is_noise(effect_of):
    """A controller's answer to noise looks like noise in the log, and drove the rig."""
    assert effect_of(0.05, stated=0.005).square == effect_of(0.005, stated=1.0).square


def test_a_log_without_a_gap_has_a_floor_that_grows_with_the_noise():
    """The true plant leaves about as much; four times the noise of the current makes four times as much."""
    rig = ehsa_ctrl.load_plant("ehsa")
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=6.0, seed=1)
    floors = []
    for more in (1.0, 4.0):
        sensor = replace(rig.sensors["current"], noise=0.0025 * more, step=0.0)
        plant = replace(rig, sensors={**rig.sensors, "current": sensor})
        found = ehsa_ctrl.diagnose(plant, ehsa_ctrl.record(plant, time, current, centre=True)[0])
        assert found.verdict == "no_gap" and found.floor.keys() == found.gap["nominal"].keys()
        assert found.gap["nominal"]["total"] < 1.5 * found.floor["total"]
        floors.append(found.floor["speed"])

    assert floors[1] == pytest.approx(4.0 * floors[0], rel=0.5)
