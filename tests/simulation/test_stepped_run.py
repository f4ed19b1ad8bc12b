"""A run advanced from outside: the same plant as in `simulate`, whatever the steps."""

import json

import numpy as np
import pytest

from ehsa_ctrl import InputError, SimulationError, SteppedRun, load_plant, simulate


def driven(run, current, force, dt):
    states, modes = [run.states], [run.modes]
    for u, f in zip(current[:-1], force[:-1], strict=True):
        run.advance(u, f, dt)
        states.append(run.states)
        modes.append(run.modes)
    return np.array(states), np.array(modes)


@pytest.fixture
def inputs():
    """Current that turns around, a blow of the outer force, and rest in between."""
    time = 0.004 * np.arange(201)
    return np.where(time < 0.2, 1.6, np.where(time < 0.5, -1.6, 0.0)), np.where(time > 0.6, 900.0, 0.0)


def test_steps_of_a_sample_are_the_engines_own_to_the_last_bit(plant, inputs):
    """States and sticking of one run in 200 calls and in one."""
    current, force = inputs
    loaded = plant.set(K_S=5e4)
    run = simulate(loaded, current, force=force)
    states, modes = driven(SteppedRun(loaded), current, force, loaded.sample_time)

    assert np.array_equal(states, run.states)
    assert np.array_equal(modes, run.modes) and run.sticks("rod")[1:].any()


@pytest.mark.parametrize("step", [0.001, 0.01, 0.05])
def test_steps_of_another_length_follow_the_same_input(plant, step):
    """Finer and coarser steps than the sample, one current throughout: the same end within the tolerance."""
    run = SteppedRun(plant, tolerance=1e-9)
    for _ in range(round(0.2 / step)):
        run.advance(1.6, 0.0, step)
    end = simulate(plant, np.full(51, 1.6), tolerance=1e-9).states[-1]

    np.testing.assert_allclose(run.states, end, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("delay", [0.004, 0.0103])
def test_a_late_drive_is_as_late_as_in_a_run(plant, inputs, delay):
    """A whole and a broken number of samples; before the first step the current was the first one."""
    late = plant.with_effects("drive_delay", T_d=delay)
    current, force = inputs
    run = simulate(late, current, force=force, tolerance=1e-9)
    states, _ = driven(SteppedRun(late, tolerance=1e-9), current, force, late.sample_time)
    size = np.ptp(run.states, axis=0)

    assert np.max(np.abs(states - run.states) / size) < 1e-6


def test_a_snapshot_goes_through_text_and_back(plant, inputs):
    """What follows a restored snapshot is what followed the first time, to the last bit."""
    current, force = inputs
    run = SteppedRun(plant)
    driven(run, current[:60], force[:60], 0.004)
    kept = json.dumps(run.snapshot())
    first, _ = driven(run, current[60:], force[60:], 0.004)
    run.restore(json.loads(kept))
    again, _ = driven(run, current[60:], force[60:], 0.004)

    assert np.array_equal(first, again)


def test_the_load_cell_feels_the_force_of_the_moment(plant):
    """At rest without spring and mass it reads the force from outside, with it the spring's too."""
    start = plant.rest
    start[4] = 0.01

    assert SteppedRun(plant).cell_force(0.0, 300.0) == pytest.approx(300.0)
    assert SteppedRun(plant.set(K_S=5e4), start=start).cell_force(0.0, 300.0) == pytest.approx(800.0)


def test_a_step_that_fails_leaves_the_run_where_it_was(plant):
    """A force that no oil can carry ends the equations; the sentence says when."""
    run = SteppedRun(plant)
    run.advance(0.0, 0.0, 0.004)
    before = run.states
    with pytest.raises(SimulationError, match="ehsa: stopped at"):
        run.advance(0.0, 1e12, 5.0)

    assert np.array_equal(run.states, before) and run.time == pytest.approx(0.004)


def test_wrong_inputs_are_sentences():
    """No number, a step backwards, a tolerance out of range."""
    run = SteppedRun(load_plant("ehsa"))
    with pytest.raises(InputError, match="both must be finite"):
        run.advance(float("nan"), 0.0, 0.004)
    with pytest.raises(InputError, match="expected 0 to 3600 s"):
        run.advance(0.0, 0.0, -0.1)
    with pytest.raises(InputError, match="tolerance = 1"):
        SteppedRun(load_plant("ehsa"), tolerance=1.0)
