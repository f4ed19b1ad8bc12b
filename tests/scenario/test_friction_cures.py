"""Friction compensation: compensated controllers rest near the target; plain PIDs hunt."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import load_controller, load_plant, run_closed_loop, three_state
from ehsa_ctrl.scenario.response import hunting, settling_band, step_metrics
from ehsa_ctrl.simulation.minimum_time import shortest_time
from ehsa_ctrl.simulation.sensors import Sensors

DT = 0.004
CURED = ["pid_friction", "cascade_friction", "lqr_friction"]


@pytest.fixture(scope="module")
def spring():
    """The plant under the 50 kN/m spring."""
    return load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})


@pytest.fixture(scope="module")
def model():
    return three_state(load_plant("ehsa", model="linear"))


def hold(plant, controller, size, *, seconds=6.5, seed=2):
    """Time, position and the time of the step of a single step that is held."""
    reference = np.zeros((round(seconds / DT) + 50, 3))
    reference[50:, 0] = size
    run = run_closed_loop(plant, controller, reference, sensors=Sensors.of(plant, seed=seed)).trajectory
    return run.time[50:] - run.time[50], run["x"][50:]


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.001, 0.005, 0.02])
@pytest.mark.parametrize("name", CURED)
def test_cured_controllers_come_to_rest_and_stay(spring, model, name, size):
    """At most 100 um off and not a slip in five seconds, however long the step."""
    time, x = hold(spring, load_controller(name, model), size)
    held = time > 1.5

    assert np.max(np.abs(x[held] - size)) < 100e-6
    assert hunting(time[held], x[held])["Slips"] == 0


@pytest.mark.parametrize("name", ["cascade_friction", "lqr_friction"])
def test_a_long_step_is_nearly_as_fast_as_can_be(spring, model, name):
    """20 mm settle within 1.5 times the shortest time, overshoot below 2 %."""
    controller = load_controller(name, model)
    time, x = hold(spring, controller, 0.02, seconds=2)
    found = step_metrics(time, x, 0.0, 0.02)
    least = shortest_time(spring, 0.02, controller.current_limit, band=0.02 * settling_band(0.02))

    assert found["SettlingTime"] < 1.5 * least
    assert found["Overshoot"] < 0.02


@pytest.mark.slow
def test_a_plain_pid_hunts(spring, model):
    """With static friction above Coulomb friction the integral causes a limit cycle; where it slips is chance."""
    controller = load_controller("pid_tuned", model)
    found = []
    for seed in range(1, 6):
        time, x = hold(spring, controller, 0.02, seconds=25, seed=seed)
        found.append(hunting(time[time > 5], x[time > 5]))

    assert np.median([one["Slips"] for one in found]) >= 3
    assert np.median([one["HuntingAmplitude"] for one in found]) > 50e-6


def rms_error(plant, controller):
    """In a sine of 1 Hz and 10 mm, from the second period on."""
    t, w = DT * np.arange(750), 2 * np.pi
    reference = 0.01 * np.column_stack([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)])
    loop = run_closed_loop(plant, controller, reference, sensors=Sensors.of(plant, seed=0))
    return np.sqrt(np.mean(loop.error[250:] ** 2))


def test_friction_fed_forward_pays(spring, model):
    """With the same gains the PID's error falls to less than a third; the LQR's, whose observer does most of it, below
    a tenth of a millimetre."""
    pid, lqr = (load_controller(name, model) for name in ("pid_friction", "lqr_friction"))
    without = replace(pid, feedforward=pid.feedforward.model_copy(update={"coulomb": 0.0, "static": None}))

    assert rms_error(spring, pid) < rms_error(spring, without) / 3
    assert rms_error(spring, lqr) < 1e-4


@pytest.mark.parametrize("name", CURED)
def test_the_integral_forgets_what_it_wound_up_at_rest(spring, model, name):
    """After five seconds at rest the way back overshoots by less than half a millimetre."""
    controller = load_controller(name, model)
    reference = np.zeros((2000, 3))
    reference[50:1300, 0] = 0.005
    x = run_closed_loop(spring, controller, reference, sensors=Sensors.of(spring, seed=1)).trajectory["x"]

    assert np.min(x[1300:]) > -5e-4
