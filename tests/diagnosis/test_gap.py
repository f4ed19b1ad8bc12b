"""The gap of a plant to a log."""

import numpy as np
import pytest

import ehsa_ctrl


@pytest.fixture(scope="module")
def plant():
    return ehsa_ctrl.load_plant("ehsa")


def test_it_is_that_of_a_diagnosis_and_follows_its_definition(plant):
    """RMS of the error over the spread, noise taken off; the total is the RMS of the four."""
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=6.0, seed=1)
    log, _ = ehsa_ctrl.record(plant, time, current, sensor_noise=False, centre=True)
    wrong = plant.set(K_T=1.1)

    found = ehsa_ctrl.gap(wrong, log)
    run = ehsa_ctrl.simulate(wrong, log["current"], sample_time=log.sample_time)

    speed = np.sqrt(np.mean((log["speed"] - run["omega"]) ** 2)) / np.std(log["speed"])
    assert found["speed"] == pytest.approx(speed, rel=0.01)
    parts = [found[name] for name in ("speed", "p1", "p2", "rod_velocity")]
    assert found["total"] == pytest.approx(np.sqrt(np.mean(np.square(parts))))


def test_the_true_plant_has_next_to_none(plant):
    """Under the sensors' noise it is less than a hundredth."""
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=6.0, seed=1)
    log, _ = ehsa_ctrl.record(plant, time, current, seed=2, centre=True)

    assert max(ehsa_ctrl.gap(plant, log).values()) < 0.01
