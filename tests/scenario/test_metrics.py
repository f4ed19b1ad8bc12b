"""Metrics that are right for a plant that sticks; python-control's step_info where both apply."""

import control
import numpy as np
import pytest

from ehsa_ctrl.scenario.metrics import hunting, step_metrics

TIME = np.linspace(0, 5, 2001)


def second_order(damping):
    """Step response of a second-order system with 2 rad/s."""
    return control.step_response(control.tf([4], [1, 4 * damping, 4]), TIME).outputs


@pytest.mark.parametrize("damping", [0.3, 0.5, 0.7])
def test_a_full_step_agrees_with_step_info(damping):
    """Where python-control is right (0 to 1, ends at 1), the numbers agree."""
    time = np.linspace(0, 20, 4001)
    y = control.step_response(control.tf([4], [1, 4 * damping, 4]), time).outputs
    theirs = control.step_info(y, time, final_output=1.0)
    ours = step_metrics(time, y, 0.0, 1.0)

    for name in ("RiseTime", "SettlingTime", "PeakTime"):
        assert ours[name] == pytest.approx(theirs[name], abs=0.011), name
    assert 100 * ours["Overshoot"] == pytest.approx(theirs["Overshoot"], abs=1e-6)
    assert ours["Peak"] == pytest.approx(theirs["Peak"])
    assert ours["SettlingMax"] == pytest.approx(theirs["SettlingMax"])
    assert ours["SettlingMin"] == pytest.approx(theirs["SettlingMin"], abs=0.01)


def test_overshoot_is_of_the_step_not_of_the_final_value():
    """10 to 20 mm with 1 mm too far is 10 %, not 5 %."""
    y = np.where(TIME < 1, 10 + 10 * TIME, 20.0) + np.where((TIME > 1) & (TIME < 2), 1.0, 0.0)

    assert step_metrics(TIME, y, 10.0, 20.0)["Overshoot"] == pytest.approx(0.1)


def test_stuck_short_of_the_target_never_settles():
    """A rod that sticks at 90 % has not settled, and its standing error is 10 % of the step."""
    y = 0.9 * (1 - np.exp(-3 * TIME))
    found = step_metrics(TIME, y, 0.0, 1.0)

    assert np.isnan(found["SettlingTime"])
    assert np.isnan(found["RiseTime"])
    assert found["SteadyStateError"] == pytest.approx(0.1, abs=1e-3)


def test_a_step_back_to_zero_counts_like_one_away_from_it():
    """Final value 0 divides nothing by zero."""
    away = step_metrics(TIME, second_order(0.4), 0.0, 1.0)
    back = step_metrics(TIME, 1 - second_order(0.4), 1.0, 0.0)

    for name in ("RiseTime", "SettlingTime", "Overshoot", "SteadyStateError"):
        assert back[name] == pytest.approx(away[name]), name


def test_crossings_are_interpolated():
    """A ramp sampled coarsely has the exact rise time."""
    time = np.array([0.0, 0.3, 0.6, 0.9, 1.2, 1.5])

    assert step_metrics(time, np.minimum(time, 1.0), 0.0, 1.0)["RiseTime"] == pytest.approx(0.8)


def test_no_step_gives_nan_not_an_exception():
    """Target = old target: nothing to measure but the standing error."""
    found = step_metrics(TIME, np.full(TIME.size, 2.0), 1.0, 1.0)

    assert np.isnan(found["Overshoot"]) and found["SteadyStateError"] == 1.0


def test_hunting_is_amplitude_period_and_slips():
    """Slips to and fro every 0.5 s by 0.2 mm: period 1 s, ten slips in 5 s."""
    position, rod = np.zeros(TIME.size), np.zeros(TIME.size)
    for k in range(10):
        slip = (0.5 * k + 0.1 <= TIME) & (0.5 * k + 0.15 > TIME)
        rod[slip] = 1 if k % 2 == 0 else -1
        position[0.5 * k + 0.15 <= TIME] = 2e-4 if k % 2 == 0 else 0.0
    found = hunting(TIME, position, rod)

    assert found["Slips"] == 10
    assert found["HuntingAmplitude"] == pytest.approx(2e-4)
    assert found["HuntingPeriod"] == pytest.approx(1.0, rel=1e-3)


def test_creeping_one_way_is_no_hunting():
    """Slips that all go the same way are slips, not a limit cycle."""
    rod = np.where(TIME % 1 < 0.1, 1.0, 0.0)
    found = hunting(TIME, np.cumsum(rod), rod)

    assert found["Slips"] >= 4
    assert found["HuntingAmplitude"] == 0.0 and np.isnan(found["HuntingPeriod"])
