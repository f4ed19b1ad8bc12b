"""What drove a plant, from what its log shows."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import simulate
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.identification.balance_signals import balance_signals
from ehsa_ctrl.identification.logged_inputs import acting_drive, undo_sensor
from ehsa_ctrl.identification.residuals import simulate_window
from ehsa_ctrl.identification.shooting import shooting_windows
from ehsa_ctrl.plant.plant import Sensor
from ehsa_ctrl.simulation.sensors import noise_free_reading

CURRENT = np.random.default_rng(1).uniform(-2.0, 2.0, 400)


def with_sensor(plant, sensor):
    return replace(plant, sensors={**plant.sensors, sensor.channel: sensor})


def test_what_a_drives_sensor_did_is_undone_exactly(truth):
    """Filter, delay of whole samples, scale and bias: the held current comes back but for its last samples."""
    sensor = Sensor("current", "A", filter=7e-3, delay=0.008, scale=1.1, bias=0.2)
    log = Log(0.004 * np.arange(400), {"current": noise_free_reading(sensor, CURRENT, 0.004, held=True)})

    undone = undo_sensor(with_sensor(truth, sensor), log, "current")

    np.testing.assert_allclose(undone[:-2], CURRENT[:-2], atol=1e-9)


def test_a_smooth_signals_filter_is_undone_to_the_slopes_error(truth):
    """3 Hz through 7 ms comes back within one per mille, the error of central differences; filtered it is 13 % off."""
    time = 0.004 * np.arange(500)
    sine = 1e5 * np.sin(2 * np.pi * 3.0 * time)
    sensor = Sensor("p1", "Pa", filter=7e-3)

    undone = undo_sensor(with_sensor(truth, sensor), Log(time, {"p1": noise_free_reading(sensor, sine, 0.004)}), "p1")

    np.testing.assert_allclose(undone[10:-1], sine[10:-1], atol=1e2)


def test_a_dead_time_within_a_sample_is_the_mean_of_two(truth):
    """2.25 samples late: three quarters of the current two samples ago and a quarter of the one before."""
    plant = truth.with_effects("drive_delay", "current_offset", T_d=0.009)

    prompt, late = acting_drive(plant, CURRENT, 0.004)

    assert prompt.structure.effects == ("current_offset",)
    np.testing.assert_allclose(late[3:], 0.75 * CURRENT[1:-2] + 0.25 * CURRENT[:-3], atol=1e-12)
    assert acting_drive(truth, CURRENT, 0.004)[1] is CURRENT


@pytest.mark.slow
@pytest.mark.parametrize("dead_time", [0.008, 0.0095])
def test_the_estimator_drives_a_plant_with_dead_time_as_the_engine_does(truth, noise_log, dead_time):
    """Its run is the engine's: of whole samples but for the tolerance, between them to less than the sensors' noise."""
    plant = truth.with_effects("drive_delay", T_d=dead_time)
    log = noise_log.segment(0.0, 2.0)
    run = simulate(plant, log["current"])

    found = simulate_window(plant, shooting_windows(plant, log, None)[0], plant.rest, ["J_M"], tolerance=1e-9)

    column = plant.structure.equations.index
    for channel, state in plant.structure.system.outputs.items():
        error = found.states[:, column(state)] - run[state]
        allowed = 1e-5 * np.ptp(run[state]) if dead_time == 0.008 else 0.7 * plant.sensors[channel].sd
        assert np.sqrt(np.mean(error**2)) <= allowed, channel


def test_the_balances_see_the_current_when_it_acts(truth):
    """Two samples of dead time: the mean over a held sample, two samples later."""
    plant = truth.with_effects("drive_delay", T_d=0.008)
    log = Log(0.004 * np.arange(400), {"current": CURRENT, "speed": np.zeros(400)})

    prompt, late = (balance_signals(rig, log, "weak", 100.0).values["current"] for rig in (truth, plant))

    np.testing.assert_allclose(late[3:], prompt[1:-2], atol=1e-12)
