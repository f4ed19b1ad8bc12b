"""python-control's time responses, in and out."""

import control
import numpy as np
import pytest

from ehsa_ctrl import InputError, SteppedRun, four_state, simulate, three_state, to_iosystem

TIME = 0.004 * np.arange(251)
SIZES = np.array([100.0, 5e5, 5e5, 0.05, 0.02])


def test_a_run_becomes_a_response_with_all_names(plant):
    """States, inputs and dP by label; a table of it holds the run's columns."""
    run = simulate(plant, 1.6 * np.sin(6 * TIME), force=np.full(251, 100.0))
    response = run.to_response()
    table = response.to_pandas()

    assert response.input_labels == ["current", "F_D"] and response.state_labels == to_iosystem(plant).state_labels
    assert response.sysname == "ehsa" and response.outputs.shape == (6, 251)
    for name in ("omega", "P_1", "x", "current", "F_D", "dP"):
        assert np.array_equal(table[name], run[name]), name


def test_a_response_drives_a_run(linear):
    """forced_response joins samples by lines: with the same hold the engine gives (6) back, sample time included."""
    system = four_state(linear)
    inputs = [1.5 * np.sin(6 * TIME), np.where(TIME > 0.5, 200.0, 0.0)]
    response = control.forced_response(system, TIME, inputs)
    run = simulate(linear, response, hold="first_order", tolerance=1e-9)

    assert np.max(np.abs(run.states.T - linear.rest[:, None] - response.outputs) / SIZES[:, None]) < 1e-6
    assert np.array_equal(run["F_D"], inputs[1])


def test_the_output_of_a_controller_drives_a_run(linear):
    """A signal that is called current may be an output too; the step of one input and one output is squeezed."""
    gain = control.ss([], [], [], [[0.5]], inputs=["error"], outputs=["current"])
    run = simulate(linear, control.forced_response(gain, TIME, np.ones(251)))

    assert np.all(run["current"] == 0.5) and not run["F_D"].any()


def test_the_io_system_is_the_engine_where_nothing_is_dry(linear):
    """python-control's own integration of to_iosystem beside ours."""
    system = to_iosystem(linear)
    response = control.input_output_response(
        system, TIME, [np.sin(6 * TIME), 0 * TIME], linear.rest, solve_ivp_kwargs={"rtol": 1e-9, "atol": 1e-9}
    )
    run = simulate(linear, response, hold="first_order", tolerance=1e-9)

    assert np.max(np.abs(run.states.T - response.states) / SIZES[:, None]) < 1e-5


def test_a_loop_closed_by_python_control_is_the_loop_closed_by_hand(linear):
    """interconnect finds x and current by name; the same law, step by step around the engine, ends where it does."""
    law = control.ss([], [], [], [[60.0, -60.0]], inputs=["r", "x"], outputs=["current"], name="law")
    loop = control.interconnect([three_state(linear), law], inputs=["r"], outputs=["x"], check_unused=False)
    response = control.step_response(loop, np.linspace(0.0, 1.0, 1001))
    run = SteppedRun(linear, tolerance=1e-8)
    position = [0.0]
    for _ in range(1000):
        run.advance(60.0 * (0.01 - run.states[4]), 0.0, 0.001)
        position.append(run.states[4])

    # Holding the current over a millisecond is half a millisecond of delay.
    assert np.max(np.abs(np.array(position) - 0.01 * response.outputs)) < 0.01 * 0.02


def test_a_response_that_does_not_fit_is_a_sentence(linear):
    """No current, two traces, time that jumps, two sample times."""
    system = four_state(linear)
    with pytest.raises(InputError, match="no signal 'current', which drives ehsa; it has u, y"):
        simulate(linear, control.step_response(control.tf([1], [1, 1], inputs="u", outputs="y"), TIME))
    with pytest.raises(InputError, match="has 2 traces"):
        simulate(linear, control.step_response(system, TIME))
    with pytest.raises(InputError, match="sample_time is given twice"):
        simulate(linear, simulate(linear, np.zeros(5)).to_response(), sample_time=0.004)
    uneven = control.TimeResponseData([0.0, 0.1, 0.4], [0.0, 0, 0], inputs=[1.0, 1, 1], input_labels=["current"])
    with pytest.raises(InputError, match="the time response: column 't'"):
        simulate(linear, uneven)
