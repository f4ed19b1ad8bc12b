"""What a controller does with sensors that can't be trusted."""

import numpy as np
import pytest

from ehsa_ctrl.design.stages.supervision import MEMORY, SETTINGS, Supervision, supervise

T = 0.004
ALL = ("speed", "p1", "p2", "position")


def run(rows, supervision, reads=ALL):
    """Status and trusted readings, sample by sample."""
    memory, numbers = supervision.initial_memory(), supervision.settings(T, reads)
    assert memory.size == MEMORY and numbers.size == SETTINGS
    status, trusted = [], []
    for row in rows:
        status.append(supervise(row, memory, numbers))
        trusted.append(memory[1:6].copy())
    return np.array(status), np.array(trusted)


def readings(samples=100):
    return np.tile([10.0, 2e6, 1e6, 0.01, 0.0], (samples, 1))


def test_sound_readings_are_passed_on():
    """Nothing is changed and nothing is reported."""
    rows = readings()
    status, trusted = run(rows, Supervision())

    assert not status.any()
    np.testing.assert_array_equal(trusted, rows)


def test_a_short_loss_is_bridged_by_the_last_value():
    """Ten lost samples at 4 ms are within 40 ms: bridged, reported, forgotten."""
    rows = readings()
    rows[20:, 3] = 0.02
    rows[20:30, 3] = np.nan
    status, trusted = run(rows, Supervision(lost=0.04))

    assert np.all(status[20:30] == 1.0) and status[30] == 0.0
    assert np.all(trusted[20:30, 3] == 0.01) and trusted[30, 3] == 0.02


def test_a_long_loss_stops_for_good():
    """The eleventh lost sample stops the loop, and the sensor's return does not start it again."""
    rows = readings()
    rows[20:31, 0] = np.nan
    status, _ = run(rows, Supervision(lost=0.04))

    assert np.all(status[20:30] == 1.0) and np.all(status[30:] == 2.0)


def test_a_channel_that_the_law_does_not_read_may_be_absent():
    """A position loop runs on when a pressure is lost."""
    rows = readings()
    rows[20:, 1] = np.nan
    status, trusted = run(rows, Supervision(), reads=("position",))

    assert not status.any() and np.isfinite(trusted).all()


@pytest.mark.parametrize(
    ("limits", "channel", "value"),
    [
        (Supervision(position=0.095), 3, -0.0951),
        (Supervision(speed=480.0), 0, 481.0),
        (Supervision(pressure_max=2e7), 2, 2.01e7),
        (Supervision(pressure_min=0.0), 1, -1.0),
    ],
)
def test_what_is_out_of_range_stops(limits, channel, value):
    """One reading beyond its limit is enough."""
    rows = readings()
    rows[40, channel] = value
    status, _ = run(rows, limits)

    assert not status[:40].any() and np.all(status[40:] == 2.0)


def test_a_stuck_position_contradicts_the_speed():
    """The shaft turns at 100 rad/s, the position stays: at 3.86e-4 m/rad that is 3 mm after 78 ms, at most a bit
    later for what is forgotten; while both move together nothing happens."""
    travel, omega = 3.8569e-4, 100.0
    rows = readings(200)
    rows[:, 0] = omega
    rows[:, 3] = travel * omega * T * np.arange(200)
    rows[100:, 3] = rows[99, 3]
    status, _ = run(rows, Supervision(contradiction=3e-3, travel=travel))
    first = np.flatnonzero(status)[0]

    assert not status[:100].any()
    assert 0.078 <= T * (first - 99) <= 0.1


def test_a_rod_that_does_not_start_in_zero_is_no_contradiction():
    """The first position is where counting begins."""
    rows = readings()
    rows[:, 0], rows[:, 3] = 0.0, 0.08
    status, _ = run(rows, Supervision(contradiction=1e-3, travel=3.9e-4))

    assert not status.any()
