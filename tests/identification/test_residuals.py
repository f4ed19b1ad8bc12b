"""The derivatives that the estimator uses, against differences of the simulation."""

import numpy as np
import pytest

from ehsa_ctrl import simulate
from ehsa_ctrl.identification.initial_state import estimate_states
from ehsa_ctrl.identification.parameters import with_values
from ehsa_ctrl.identification.residuals import simulate_window
from ehsa_ctrl.identification.shooting import shooting_windows

STEP = {
    "J_M": 1e-8,
    "A_FR": 0.05,
    "V_10": 1e-7,
    "bias.p1": 1.0,
    "scale.speed": 1e-5,
    "delay.position": 1e-5,
    "filter.speed": 1e-6,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STEP)
def test_derivatives_by_symbols_and_sensors(truth, noise_log, name):
    """Each column is the difference quotient of the simulated channels, to two per cent of the largest.

    By a delay it is the slope between samples, which is rough where the rod starts within one: twelve per cent.
    """
    plant = with_values(truth, ["delay.position", "scale.speed", "filter.speed"], [0.003, 1.1, 0.005])
    window = shooting_windows(plant, noise_log, 1.0)[3]
    base = simulate_window(plant, window, window.start, [name], tolerance=1e-11)
    word = getattr(plant.sensors[name.split(".")[1]], name.split(".")[0]) if "." in name else plant[name]

    moved = [
        simulate_window(with_values(plant, [name], [word + s * STEP[name]]), window, window.start, [], tolerance=1e-11)
        for s in (1, -1)
    ]

    quotient = (moved[1].residual - moved[0].residual) / (2 * STEP[name])
    size = np.max(np.abs(base.by_parameter[:, :, 0]), axis=0)
    error = np.max(np.abs(quotient - base.by_parameter[:, :, 0]), axis=0)
    assert np.all(error <= (0.12 if name.startswith("delay") else 0.02) * size + 1e-9)


def test_windows_cover_a_log_and_begin_where_motion_is_plain(truth, noise_log):
    """Neighbours share a sample, none is lost, and each start is near the true state."""
    windows = shooting_windows(truth, noise_log, 0.4)
    run = simulate(truth, noise_log["current"])

    assert windows[0].first == 0 and windows[-1].last == len(noise_log) - 1
    assert all(a.last == b.first for a, b in zip(windows[:-1], windows[1:], strict=True))
    for window in windows[1:]:
        assert abs(window.start[0] - run["omega"][window.first]) < 8.0


def test_states_are_estimated_with_their_deviation(truth, noise_log):
    """Measured states within their stated deviation of the truth, on average over the log."""
    run = simulate(truth, noise_log["current"])
    found = estimate_states(truth, noise_log)

    at_rest = run.sticks("shaft") & run.sticks("rod")
    inner = np.convolve(at_rest, np.ones(15), "same") == 15
    z = ((found.values - run.states) / found.sd)[inner][:, [0, 3]]
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3
