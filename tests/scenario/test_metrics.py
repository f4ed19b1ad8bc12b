"""Metrics of a plant that sticks, compared with python-control's step_info where both apply."""

from dataclasses import replace

import control
import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.scenario.metrics import METRICS, loop_metrics
from ehsa_ctrl.scenario.reference import Steps
from ehsa_ctrl.scenario.response import hunting, step_metrics
from ehsa_ctrl.simulation.closed_loop import ClosedLoop

TIME = np.linspace(0, 5, 2001)


def second_order(damping):
    """Step response of a second-order system with 2 rad/s."""
    return control.step_response(control.tf([4], [1, 4 * damping, 4]), TIME).outputs


@pytest.mark.parametrize("damping", [0.3, 0.5, 0.7])
def test_a_full_step_agrees_with_step_info(damping):
    """For steps from 0 to 1 that end at 1 the numbers agree with python-control."""
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


@pytest.mark.parametrize("damping", [0.2, 0.5])
def test_overshoot_is_that_of_the_closed_form(damping):
    """exp(-pi d / sqrt(1 - d^2)), of any step."""
    y = 10e-3 + 10e-3 * second_order(damping)

    expected = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert step_metrics(TIME, y, 10e-3, 20e-3)["Overshoot"] == pytest.approx(expected, rel=1e-4)


def test_a_first_order_lag_settles_as_it_must():
    """Within 2 % after T ln 50, from 10 to 90 % in T ln 9, within 0.1 mm of a 20 mm step after T ln 200."""
    y = 20e-3 * (1 - np.exp(-TIME / 0.4))
    found = step_metrics(TIME, y, 0.0, 20e-3)

    assert found["SettlingTime"] == pytest.approx(0.4 * np.log(50), abs=1e-5)
    assert found["RiseTime"] == pytest.approx(0.4 * np.log(9), abs=1e-5)
    assert found["SettlingTimeAbs"] == pytest.approx(0.4 * np.log(200), abs=1e-5)


def test_overshoot_is_of_the_step_not_of_the_final_value():
    """10 to 20 mm with 1 mm too far is 10 %, not 5 %."""
    y = np.where(TIME < 1, 10 + 10 * TIME, 20.0) + np.where((TIME > 1) & (TIME < 2), 1.0, 0.0)

    assert step_metrics(TIME, y, 10.0, 20.0)["Overshoot"] == pytest.approx(0.1)


def test_undershoot_is_the_wrong_way_at_first():
    """(1 - s) / (1 + s)^2 has its largest undershoot at t = 1/2, where the derivative is zero."""
    y = 1 - np.exp(-TIME) - 2 * TIME * np.exp(-TIME)
    least = 1 - np.exp(-0.5) - np.exp(-0.5)

    assert step_metrics(TIME, y, 0.0, 1.0)["Undershoot"] == pytest.approx(-least, rel=1e-4)


def test_what_was_left_of_the_error_before_a_step_is_no_undershoot():
    """A rod that stuck 5 % short of the old target and then goes straight to the new one."""
    y = -0.05 + 1.05 * (1 - np.exp(-5 * TIME))

    assert step_metrics(TIME, y, 0.0, 1.0)["Undershoot"] == 0.0


def test_a_swing_back_beyond_the_start_is_no_undershoot():
    """A later oscillation below the initial value is no undershoot."""
    y = 1 - np.exp(0.1 * TIME) * (np.cos(4 * TIME) - 0.025 * np.sin(4 * TIME))
    found = step_metrics(TIME, y, 0.0, 1.0)

    assert np.min(y) < -0.05
    assert found["Undershoot"] == 0.0


def test_stuck_short_of_the_target_never_settles():
    """A rod that sticks at 90 % has not settled, and its standing error is 10 % of the step."""
    y = 0.9 * (1 - np.exp(-3 * TIME))
    found = step_metrics(TIME, y, 0.0, 1.0)

    assert np.isnan(found["SettlingTime"])
    assert np.isnan(found["RiseTime"])
    assert found["SteadyStateError"] == pytest.approx(0.1, abs=1e-3)


def test_a_step_back_to_zero_counts_like_one_away_from_it():
    """A final value of 0 causes no division by zero."""
    away = step_metrics(TIME, second_order(0.4), 0.0, 1.0)
    back = step_metrics(TIME, 1 - second_order(0.4), 1.0, 0.0)

    for name in ("RiseTime", "SettlingTime", "Overshoot", "Undershoot", "SteadyStateError"):
        assert back[name] == pytest.approx(away[name]), name


def test_crossings_are_interpolated():
    """A ramp sampled coarsely has the exact rise time."""
    time = np.array([0.0, 0.3, 0.6, 0.9, 1.2, 1.5])

    assert step_metrics(time, np.minimum(time, 1.0), 0.0, 1.0)["RiseTime"] == pytest.approx(0.8)


def test_no_step_gives_nan_not_an_exception():
    """Without a change of target only the steady-state error is defined."""
    found = step_metrics(TIME, np.full(TIME.size, 2.0), 1.0, 1.0)

    assert np.isnan(found["Overshoot"]) and found["SteadyStateError"] == 1.0


def test_hunting_is_amplitude_period_and_slips():
    """Slips to and fro every 0.5 s by 0.2 mm: period 1 s, ten slips in 5 s."""
    position = np.zeros(TIME.size)
    for k in range(10):
        way = np.clip((TIME - 0.5 * k - 0.1) / 0.05, 0, 1)
        position += (2e-4 if k % 2 == 0 else -2e-4) * way
    position = np.round(position, 12)
    found = hunting(TIME, position)

    assert found["Slips"] == 10
    assert found["HuntingAmplitude"] == pytest.approx(2e-4)
    assert found["HuntingPeriod"] == pytest.approx(1.0, rel=1e-2)


def test_creeping_one_way_is_no_hunting():
    """Slips in one direction are no limit cycle."""
    found = hunting(TIME[:-1], np.cumsum(np.where(TIME[:-1] % 1 < 0.1, 1.0, 0.0)))

    assert found["Slips"] == 5
    assert found["HuntingAmplitude"] == 0.0 and np.isnan(found["HuntingPeriod"])


def test_a_slip_between_two_samples_is_found():
    """A rod that sticks at both samples, but at different positions, has slipped in between."""
    assert hunting(np.arange(5.0), np.array([1.0, 1.0, 2.0, 2.0, 2.0]))["Slips"] == 1


def driven(current, target, plant=None):
    """A loop whose controller is a given current; its errors can be worked out by hand."""
    run = ehsa_ctrl.simulate(plant or ehsa_ctrl.load_plant("ehsa"), current)
    reference = np.column_stack([np.full(current.size, target), np.zeros((current.size, 2))])
    return ClosedLoop(run, reference, np.zeros((current.size, 5)), current)


def test_integral_measures_of_a_resting_rod_are_those_of_a_constant_error():
    """e constant over T: IAE = e T, ISE = e^2 T, ITAE = e T^2/2, ITSE = e^2 T^2/2."""
    loop = driven(np.zeros(1001), 2e-3)
    found = loop_metrics(loop, jumps=[], holds=[(0.0, np.inf)], current_limit=6.0)

    assert found["IAE"] == pytest.approx(2e-3 * 4, rel=2e-3)
    assert found["ISE"] == pytest.approx(4e-6 * 4, rel=2e-3)
    assert found["ITAE"] == pytest.approx(2e-3 * 8, rel=2e-3)
    assert found["ITSE"] == pytest.approx(4e-6 * 8, rel=2e-3)
    assert found["SteadyStateError"] == pytest.approx(2e-3) and found["SteadyStateErrorMax"] == pytest.approx(2e-3)
    assert found["StickShare"] == 1.0 and found["Slips"] == 0 and found["Energy"] == 0.0


def test_saturation_counts_the_controllers_limit_and_the_drives():
    """A quarter of the samples at the limit of 2 A; another half is cut by the drive."""
    current = np.repeat([0.5, 2.0, 1.0, 0.5], 100)
    loop = driven(current, 0.0)
    cut = replace(loop, trajectory=replace(loop.trajectory, current=np.minimum(current, 0.4)))

    def share(run, lag=0):
        return loop_metrics(run, jumps=[], holds=[], current_limit=2.0, lag=lag)["SaturationShare"]

    assert share(loop) == 0.25
    assert share(cut) == 1.0
    late = replace(loop, trajectory=replace(loop.trajectory, current=np.concatenate([[0.0], current[:-1]])))
    assert share(late, lag=1) == 0.25


def test_energy_is_the_positive_work_of_the_shaft():
    """Against the state equations: work = change of kinetic energy + friction + pump work, here by a finer sum."""
    loop = driven(np.full(251, 1.5), 0.0)
    found = loop_metrics(loop, jumps=[], holds=[], current_limit=6.0)
    angle = loop.trajectory["x"][-1] * loop.trajectory.plant["A"] / loop.trajectory.plant["D"]

    # Constant torque times the angle, which the rod's travel gives but for compression and leakage.
    assert found["Energy"] == pytest.approx(1.2 * 1.5 * angle, rel=0.03)


def test_hunting_is_not_looked_for_where_friction_does_not_stick(linear):
    """The linear plant never sticks: its moving rod is neither slipping nor hunting."""
    loop = driven(0.1 * np.sin(np.arange(500) / 20), 0.0, linear)
    found = loop_metrics(loop, jumps=[], holds=[(0.0, np.inf)], current_limit=6.0)

    assert found["Slips"] == 0 and found["HuntingAmplitude"] == 0 and found["StickShare"] == 0


def test_a_stop_is_told_from_the_fault_on():
    """Stopped at sample 60, the fault at sample 50: 40 ms, and the travel from there on."""
    loop = driven(np.full(200, 1.5), 0.0)
    status = np.where(np.arange(200) >= 60, 2.0, 0.0)
    found = loop_metrics(
        replace(loop, traces={"status": status}), jumps=[], holds=[], current_limit=6.0, first_fault=0.2
    )
    x = loop.trajectory["x"]

    assert found["StopTime"] == pytest.approx(0.04)
    assert found["TravelAfterStop"] == pytest.approx(x[-1] - x[60])


def test_settling_ratio_is_against_the_shortest_time():
    """An instant step would beat the shortest possible time; the ratio measures a real one."""
    result = ehsa_ctrl.run("steps_spring")
    pair = result.metrics

    assert pair["SettlingRatio"][1] > 1.0
    assert 0.05 < pair["ShortestTime"][1] < 0.1


def test_every_metric_is_shown_in_a_unit_that_fits():
    """SI unit and display unit convert, and each metric has an absolute tolerance for the regression."""
    for name, metric in METRICS.items():
        assert metric.format(1.0), name
        assert metric.absolute_tolerance > 0, name
        assert metric.meaning and metric.is_close(1.0, 1.0, 0.0)


def test_lengths_of_a_table_share_a_unit_and_so_do_times():
    """Metrics of one quantity share the display unit."""
    units = {}
    for metric in METRICS.values():
        units.setdefault(metric.unit, set()).add(metric.display_unit)

    assert units["m"] == {"mm"} and units["s"] == {"ms"}


def test_a_target_that_is_given_again_is_no_jump():
    """Step metrics need a step; a repeated target is none."""
    steps = Steps(kind="steps", times=["0 s", "1 s", "2 s"], positions=["0 mm", "5 mm", "5 mm"])

    assert steps.jumps() == [1.0]


@pytest.mark.parametrize(
    ("old", "new", "close"),
    [(1.0, 1.04, True), (1.0, 1.08, False), (np.nan, np.nan, True), (np.nan, 1.0, False), (1.0, np.nan, False),
     (np.inf, np.inf, True), (np.inf, 1.0, False), (0.0, 0.01, True)],
)  # fmt: skip
def test_values_are_close_within_absolute_tolerance_plus_share(old, new, close):
    """5 % and 12 ms; nan is close to nan only."""
    assert METRICS["SettlingTime"].is_close(old, new, 0.05) is close
