"""Runs that would not end: what is stiff is named within seconds, and an interrupt is seen inside the compiled loop."""

import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import (
    InputError,
    SimulationError,
    load_controller,
    run_closed_loop,
    sensitivities,
    simulate,
    simulate_batch,
    three_state,
)
from ehsa_ctrl.scenario.run import run
from ehsa_ctrl.simulation.stepped_run import SteppedRun


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ({"M": 1e-6}, "that of v, .*M = 1e-06 kg is 1/1.65e.07 of the file's"),
        ({"K_L": 1e-3}, r"that of P_[12], .*K_L = 0.001 m3/\(Pa s\)"),
        ({"J_M": 1e-13}, "omega changes by .* rad/s per second .*J_M = 1e-13 kg m2 is 1/3.3"),
        ({"V_10": 1e-12, "beta": 1e13}, "that of P_1, .*beta = 1e.13 Pa"),
    ],
)
def test_a_stiff_number_is_named(plant, setting, named):
    """A run that would not end says what changes fastest and the numbers that make it so."""
    with pytest.raises(SimulationError, match=f"ehsa: stopped at .* s: .*{named}"):
        simulate(plant.set(**setting), np.full(500, 2.0))


def test_a_load_is_named_by_what_a_user_types(linear):
    """A spring of 1e15 N/m is K_S in the equations and load.stiffness on the command line."""
    with pytest.raises(SimulationError, match=r"20000 steps.*set by K_S \(load.stiffness\) = 1e.15 N/m"):
        simulate(linear.set(K_S=1e15), np.full(500, 2.0))


def test_an_impossible_current_is_named(plant):
    """4.6e18 A, as a log in the wrong unit may say, is what makes the speed run away."""
    with pytest.raises(SimulationError, match=r"omega changes by .* rad/s per second under current = 4.6e\+18"):
        simulate(plant, np.full(500, 4.6e18))


def test_every_way_to_run_ends(plant, linear):
    """Closed loops, derivatives, batches and steps of a co-simulation have the same budget."""
    stiff = plant.set(M=1e-6)
    pid = load_controller("pid_position", three_state(linear))
    with pytest.raises(SimulationError, match=r"ehsa with pid_position: stopped .*M = 1e-06 kg"):
        run_closed_loop(stiff, pid, np.tile([0.01, 0, 0], (500, 1)))
    with pytest.raises(SimulationError, match="M = 1e-06 kg"):
        sensitivities(stiff, ["K_T"], np.full(500, 2.0))
    with pytest.raises(SimulationError, match="M = 1e-06 kg"):
        SteppedRun(stiff).advance(2.0, 0.0, 1.0)
    rows = np.array([plant.vector, stiff.vector])

    assert simulate_batch(plant, rows, np.full(200, 2.0)).status.tolist() == [0, 4]


def test_a_sample_time_in_the_wrong_unit_is_refused(linear):
    """A controller of 1 us makes millions of samples of a scenario."""
    pid = load_controller("pid_position", three_state(linear))
    fast = replace(pid, sample_time=1e-6)

    with pytest.raises(
        InputError, match=r"8e.06 samples of pid_position, whose sample_time is 1e-06 s; expected at most"
    ):
        run("steps_spring", controller=fast)


@pytest.mark.parametrize("way", ["simulate", "batch", "closed loop", "sensitivities"])
def test_an_interrupt_ends_a_long_run(plant, linear, way):
    """Half a minute of computing stops within moments of Ctrl-C."""
    current = np.random.default_rng(0).standard_normal(600_000)
    pid = load_controller("pid_position", three_state(linear))
    long = {
        "simulate": lambda: simulate(plant, current, tolerance=1e-13),
        "batch": lambda: simulate_batch(plant, np.tile(plant.vector, (4, 1)), current, tolerance=1e-13, jobs=2),
        "closed loop": lambda: run_closed_loop(plant, pid, np.outer(current, [1e-2, 0, 0]), tolerance=1e-13),
        "sensitivities": lambda: sensitivities(plant, ["K_T", "A_FR"], current[:200_000], tolerance=1e-13),
    }[way]
    # The engines are there before the clock runs.
    simulate(plant, current[:3])
    run_closed_loop(plant, pid, np.zeros((3, 3)))
    sensitivities(plant, ["K_T"], current[:3])

    def interrupt(number, frame):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    began = time.process_time()
    try:
        with pytest.raises(KeyboardInterrupt):
            long()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)

    assert time.process_time() - began < 5.0
