"""The tube around a recorded signal, compared with a union of rectangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ehsa_ctrl.scenario.baseline import signal_tube


def by_rectangles(time, recorded, at, value_tolerance, time_tolerance):
    """What a rectangle covers whose centre goes along the line in very small steps (held before and after)."""
    centres = np.linspace(at[0] - time_tolerance, at[-1] + time_tolerance, 4_001)
    heights = np.interp(centres, time, recorded)
    lower, upper = [], []
    for t in at:
        covered = heights[np.abs(centres - t) <= time_tolerance + 1e-12]
        lower.append(covered.min() - value_tolerance)
        upper.append(covered.max() + value_tolerance)
    return np.array(lower), np.array(upper)


@given(
    st.lists(st.tuples(st.floats(0.01, 1.0), st.floats(-5, 5)), min_size=2, max_size=12),
    st.floats(0.0, 0.5),
    st.floats(0.05, 1.0),
)
@settings(max_examples=25, deadline=None)
def test_the_tube_is_what_the_rectangle_covers(points, value_tolerance, time_tolerance):
    """For any line, whether its points are close or far apart."""
    time = np.cumsum([gap for gap, _ in points])
    recorded = np.array([value for _, value in points])
    at = np.linspace(time[0] - 0.3, time[-1] + 0.3, 37)
    found = signal_tube(time, recorded, at, value_tolerance=value_tolerance, time_tolerance=time_tolerance)
    lower, upper = by_rectangles(time, recorded, at, value_tolerance, time_tolerance)

    # The small steps miss a peak by at most its slope times half a step.
    slope = np.max(np.abs(np.diff(recorded) / np.diff(time)))
    missed = slope * (at[-1] - at[0] + 2 * time_tolerance) / 4_000 + 1e-9
    assert np.all(np.abs(found.lower - lower) <= missed)
    assert np.all(np.abs(found.upper - upper) <= missed)


def test_a_late_flank_stays_within_and_a_later_one_does_not():
    """A flank of 1 m/s, 10 ms late, keeps to a tube of 12 ms; 20 ms late it is outside by 8 mm."""
    time = np.linspace(0, 2, 501)
    flank = np.clip(time - 0.5, 0, 1)

    def late(by):
        bounds = signal_tube(time, flank, time, value_tolerance=0.0, time_tolerance=0.012)
        return bounds.worst_exit(time, np.interp(time - by, time, flank))

    assert late(0.010) is None
    assert late(-0.010) is None
    assert late(0.020).distance == pytest.approx(0.008, abs=1e-9)
    assert late(-0.020).distance == pytest.approx(0.008, abs=1e-9)


def test_the_worst_exit_is_said_with_its_time():
    """One sample 0.3 too high."""
    time = np.arange(10.0)
    values = np.zeros(10)
    values[6] = 0.5
    left = signal_tube(time, np.zeros(10), time, value_tolerance=0.2, time_tolerance=1.0).worst_exit(time, values)

    assert (left.time, left.value) == (6.0, 0.5) and left.distance == pytest.approx(0.3)
