"""What sensors make of a signal: filters against scipy and closed forms, and the order of what they do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from ehsa_ctrl.plant.plant import Sensor
from ehsa_ctrl.simulation.sensors import Sensors, first_order, first_order_by_lag, noise_free_reading

DT = 0.004
SIGNAL = np.cumsum(np.random.default_rng(3).standard_normal((300, 2)), axis=0)


@pytest.mark.parametrize("lag", [1e-4, 3e-3, 0.1])
def test_the_filter_is_exact_for_a_signal_that_is_straight_between_samples(lag):
    """What scipy integrates from the settled state, column by column."""
    time = DT * np.arange(300)

    for column in SIGNAL.T:
        _, expected, _ = lsim(([1.0], [lag, 1.0]), column, time, X0=[column[0] * lag], interp=True)
        np.testing.assert_allclose(first_order(column, lag, DT), expected, atol=1e-9)
    both = first_order(SIGNAL, lag, DT)
    np.testing.assert_array_equal(both[:, 0], first_order(SIGNAL[:, 0], lag, DT))


def test_a_signal_that_has_always_moved_is_late_by_the_filter():
    """A ramp comes out as itself, `lag` seconds later, from the first sample on; without a filter nothing happens."""
    ramp = 2.0 + 5.0 * DT * np.arange(100)

    np.testing.assert_allclose(first_order(ramp, 0.02, DT, moving=True), ramp - 5.0 * 0.02, rtol=1e-12)
    assert first_order(ramp, 0.0, DT) is ramp


def test_a_held_drive_reaches_the_closed_form_at_the_end_of_its_sample():
    """A step of a held current: 1 - exp(-t / lag), t counted to the end of each sample."""
    step = np.concatenate([[0.0], np.ones(50)])

    out = first_order(step, 0.01, DT, held=True)

    np.testing.assert_allclose(out, 1.0 - np.exp(-DT * np.arange(51) / 0.01), atol=1e-14)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("lag", [0.0, 2e-3, 0.05])
def test_the_derivative_by_the_filter_is_its_difference_quotient(lag, moving):
    """One-sided at zero, where it is the slope's negative."""
    signal, h = SIGNAL[:, 0], 1e-7
    lower = max(lag - h, 0.0)
    quotient = (first_order(signal, lag + h, DT, moving=moving) - first_order(signal, lower, DT, moving=moving)) / (
        lag + h - lower
    )

    np.testing.assert_allclose(first_order_by_lag(signal, lag, DT, moving=moving), quotient, rtol=1e-3, atol=0.05)


def test_a_sensor_filters_then_delays_then_scales_and_biases():
    """Two whole samples late, doubled, and five on top."""
    sensor = Sensor("p1", "Pa", filter=6e-3, delay=2 * DT, scale=2.0, bias=5.0)

    out = noise_free_reading(sensor, SIGNAL[:, 0], DT)

    np.testing.assert_allclose(out[2:], 2.0 * first_order(SIGNAL[:, 0], 6e-3, DT)[:-2] + 5.0, atol=1e-12)
    np.testing.assert_allclose(out[:2], 2.0 * SIGNAL[0, 0] + 5.0, atol=1e-12)


def test_a_log_is_filtered_and_ideal_sensors_filter_nothing(plant):
    """The current as a held drive, a pressure as a straight signal; without noise only these remain."""
    from ehsa_ctrl import simulate

    current = 1.7 * np.sign(np.sin(np.linspace(0.0, 9.0, 200)))
    run = simulate(plant, current)
    filtered = {name: replace(plant.sensors[name], filter=5e-3) for name in ("current", "p1")}
    rig = replace(plant, sensors={**plant.sensors, **filtered})

    log = Sensors.of(rig, noise=False).log(run)

    np.testing.assert_array_equal(log["current"], first_order(current, 5e-3, DT, held=True))
    np.testing.assert_array_equal(log["p1"], first_order(run["P_1"], 5e-3, DT))
    np.testing.assert_array_equal(log["p2"], run["P_2"])
    np.testing.assert_array_equal(Sensors.of(rig, ideal=True).log(run)["p1"], run["P_1"])


def test_a_sensor_without_a_filter_is_written_as_ever():
    """Baselines know a plant by these words."""
    assert "filter" not in repr(Sensor("p1", "Pa", noise=1.0))
    assert "filter=0.005" in repr(Sensor("p1", "Pa", filter=5e-3))
