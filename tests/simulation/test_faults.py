"""Faults of sensors and drive in the sampled loop."""

import numpy as np
import pytest

from ehsa_ctrl import InputError, load_controller, run_closed_loop, three_state
from ehsa_ctrl.simulation.faults import DriveLimit, Faults, SensorFault


@pytest.fixture
def pid(linear):
    return load_controller("pid_position", three_state(linear))


def steps(samples=500):
    reference = np.zeros((samples, 3))
    reference[20:, 0] = 0.005
    return reference


def test_no_faults_change_nothing(plant, pid):
    """An empty set of faults is neutral to the bit."""
    a, b = (run_closed_loop(plant, pid, steps(), faults=faults) for faults in (None, Faults()))

    assert np.array_equal(a.trajectory.states, b.trajectory.states)


def test_a_stuck_sensor_stays_and_comes_back(plant, pid):
    """From 0.2 s for 0.1 s the position that the controller gets does not move; before and after it is the truth."""
    loop = run_closed_loop(plant, pid, steps(), faults=Faults([SensorFault("position", "stuck", 0.2, 0.1)]))
    seen, true = loop.measured[:, 3], loop.trajectory["x"]

    assert np.all(seen[50:75] == seen[49]) and np.ptp(true[50:75]) > 1e-6
    np.testing.assert_array_equal(seen[:50], true[:50])
    np.testing.assert_array_equal(seen[75:], true[75:])


def test_a_lost_sensor_ends_in_a_safe_current(plant, pid):
    """The loop goes on with the last value, then with no current; nothing is nan but the reading."""
    loop = run_closed_loop(plant, pid, steps(), faults=Faults([SensorFault("position", "lost", 0.12)]))
    status = loop.traces["status"]

    assert np.isnan(loop.measured[30:, 3]).all() and np.isfinite(loop.asked).all()
    assert set(status[:30]) == {0.0} and np.all(status[30:40] == 1.0) and np.all(status[40:] == 2.0)
    assert not loop.asked[40:].any()


def test_plain_and_compiled_see_the_same_faults(plant, pid):
    """The engine does the faults, whoever does the control."""
    faults = Faults([SensorFault("position", "stuck", 0.2, 0.1)], [DriveLimit(1.2, 0.1)])
    a = run_closed_loop(plant, pid, steps(), faults=faults)
    b = run_closed_loop(plant, pid, steps(), faults=faults, compiled=False)

    assert np.array_equal(a.trajectory.states, b.trajectory.states)
    for name, values in a.traces.items():
        np.testing.assert_array_equal(values, b.traces[name])


def test_the_drive_gives_no_more_than_its_limit(plant, pid):
    """The motor sees the limited current: an open loop run with it gives the same motion."""
    from ehsa_ctrl import simulate

    loop = run_closed_loop(plant, pid, steps(), faults=Faults(drive=[DriveLimit(1.2)]))
    acting = np.clip(loop.asked, -1.2, 1.2)

    assert np.max(np.abs(loop.asked)) > 1.2
    np.testing.assert_array_equal(loop.trajectory.current, acting)
    assert np.array_equal(loop.trajectory.states, simulate(plant, acting).states)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (lambda: SensorFault("postion", "stuck", 0.1), "did you mean 'position'"),
        (lambda: SensorFault("position", "dead", 0.1), "lost, stuck"),
        (lambda: SensorFault("position", "lost", -0.1), "at least 0 s"),
        (lambda: DriveLimit(-1.0), "at least 0 A"),
    ],
)
def test_wrong_faults_are_told(fault, words):
    """One sentence each."""
    with pytest.raises(InputError, match=words):
        fault()
