"""The planned motion: within its limits, time-optimal, exact at its end."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ehsa_ctrl import InputError
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.design.stages.trajectory import MEMORY, TrajectoryLimits, plan, trajectory_settings

T = 0.004


def planned(reference, *, speed=0.15, acceleration=3.0, start=0.0):
    limits = trajectory_settings(TrajectoryLimits(speed=f"{speed} m/s", acceleration=f"{acceleration} m/s2"), T)
    memory, rows = np.zeros(MEMORY), []
    for row in reference:
        plan(row, start, memory, limits)
        rows.append(memory[:3].copy())
    return np.array(rows)


def jump(size, samples=600):
    reference = np.zeros((samples, 3))
    reference[5:, 0] = size
    return reference


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(
    size=st.floats(-0.08, 0.08).filter(lambda value: abs(value) > 1e-5),
    speed=st.floats(0.02, 0.3),
    acceleration=st.floats(0.5, 10.0),
)
def test_a_jump_becomes_a_motion_within_its_limits(size, speed, acceleration):
    """Speed and acceleration are kept, the target is reached exactly and not overshot by more than the landing."""
    motion = planned(jump(size, 4000), speed=speed, acceleration=acceleration)
    landing = 0.25 * acceleration * T**2

    assert np.max(np.abs(motion[:, 1])) <= speed * (1 + 1e-12)
    assert np.max(np.abs(motion[:, 2])) <= acceleration * (1 + 1e-9)
    assert motion[-1].tolist() == [size, 0.0, 0.0]
    assert np.max(motion[:, 0] * np.sign(size)) <= abs(size) + landing


@pytest.mark.slow
@settings(max_examples=50, deadline=None)
@given(size=st.floats(0.002, 0.08), speed=st.floats(0.05, 0.3), acceleration=st.floats(1.0, 10.0))
def test_it_takes_the_least_time(size, speed, acceleration):
    """Not more than three samples above the trapezoid's closed form."""
    motion = planned(jump(size, 4000), speed=speed, acceleration=acceleration)
    ramp = speed / acceleration
    least = size / speed + ramp if size > speed * ramp else 2 * np.sqrt(size / acceleration)
    took = T * (np.flatnonzero(motion[:, 0] != size)[-1] + 1 - 4)

    assert least - T <= took <= least + 3 * T


def test_position_speed_and_acceleration_belong_together():
    """Between two samples the planned motion has constant acceleration, but for the landing of some micrometres."""
    motion = planned(jump(0.01))
    x, v, a = motion.T

    flying = x[1:] != 0.01

    np.testing.assert_allclose(np.diff(v)[flying], T * a[1:][flying], atol=1e-12)
    np.testing.assert_allclose(np.diff(x), 0.5 * T * (v[1:] + v[:-1]), atol=0.25 * 3.0 * T**2 + 1e-12)


def test_a_smooth_reference_passes_unchanged():
    """A sine within the limits is given on as it is, from its first sample at rest on."""
    t = T * np.arange(1000)
    w = 2 * np.pi
    sine = 0.01 * np.column_stack([1 - np.cos(w * t), w * np.sin(w * t), w**2 * np.cos(w * t)])

    motion = planned(sine)
    np.testing.assert_array_equal(motion[:, 0], sine[:, 0])
    # What rounding leaves of the speed at its zeros is none.
    np.testing.assert_array_equal(motion[:, 1], np.where(np.abs(sine[:, 1]) < 1e-9, 0.0, sine[:, 1]))
    assert np.count_nonzero(motion[:, 1] == 0.0) > np.count_nonzero(sine[:, 1] == 0.0)


def test_a_jump_onto_a_moving_target_is_caught_up():
    """A ramp that begins 5 mm away: after the catch-up the plan is the ramp."""
    t = T * np.arange(500)
    ramp = np.column_stack([0.005 + 0.02 * t, np.full(500, 0.02), np.zeros(500)])
    motion = planned(ramp)

    assert motion[0, 0] == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_array_equal(motion[-200:], ramp[-200:])


def test_it_begins_where_the_rod_is():
    """A rod that stands at the reference before the first jump is not sent back to zero."""
    motion = planned(np.tile([0.03, 0.0, 0.0], (50, 1)), start=0.03)

    np.testing.assert_array_equal(motion, np.tile([0.03, 0.0, 0.0], (50, 1)))


def test_without_limits_nothing_changes():
    """Left out, the stage is neutral to the bit."""
    memory, row = np.zeros(MEMORY), np.array([0.1, 0.2, 0.3])
    plan(row, 0.7, memory, trajectory_settings(None, T))

    assert memory[:3].tolist() == row.tolist()


def test_limits_must_be_possible():
    """Zero speed is no limit."""
    with pytest.raises(InputError, match=r"rig\.toml: speed = 0.0; expected a value greater than 0"):
        validate({"speed": "0 m/s", "acceleration": "1 m/s2"}, TrajectoryLimits, "rig.toml")


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_rounding_decides_nothing(kind):
    """A ramp that begins on the grid of samples is caught at the same sample in floats and doubles; after a step the
    planned speed is exactly zero, which friction compensation takes for standstill."""
    limits = trajectory_settings(TrajectoryLimits(speed="0.15 m/s", acceleration="2 m/s2"), T).astype(kind)
    reference = np.zeros((700, 3))
    reference[50:300, 0] = 0.02
    ramp = np.arange(450, 551)
    reference[ramp, 0], reference[ramp, 1], reference[551:, 0] = 0.02 * T * (ramp - 450), 0.02, 0.008
    memory, rows = np.zeros(MEMORY, dtype=kind), []
    for row in reference.astype(kind):
        plan(row, kind(0.0), memory, limits)
        rows.append(memory[:3].copy())
    exact = planned(reference, acceleration=2.0)
    speed = exact[:, 1]

    assert rows[0].dtype == kind
    np.testing.assert_allclose(rows, exact, atol=2e-4)
    np.testing.assert_array_equal(np.array(rows)[:, 1] == 0.0, speed == 0.0)
    assert np.max(np.abs(speed)) > 0.1 and np.min(np.abs(speed[speed != 0.0])) > 1e-5
