"""Gap and noise: closed forms."""

import numpy as np
import pytest

from ehsa_ctrl import diagnose, excitation, record
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.signals import (
    estimate_noise,
    gap,
    largest,
    noise_of,
    scored_signals,
    signal_noise,
    slope,
    slow_channels,
)
from ehsa_ctrl.plant.systems import SYSTEMS

EHSA = SYSTEMS["ehsa"].scored


def test_the_slope_of_a_ramp():
    """Over 20 ms, five samples at 250 Hz; a rate that 20 ms are no multiple of takes the nearest number."""
    for rate in (250.0, 240.0, 30.0):
        x = 0.07 * np.arange(200) / rate

        assert slope(x, 0.02, 1.0 / rate)[10:] == pytest.approx(0.07)


def test_noise_alone_is_no_gap(rng):
    """What the sensor adds is taken off in quadrature; a sine that is off by 10 % of itself has a gap of 0.1."""
    time = np.arange(20000) * 0.004
    true = np.sin(3.0 * time)
    measured = {"speed": true + rng.normal(0.0, 0.05, time.size)}

    assert gap(measured, {"speed": true}, {"speed": 0.05})["speed"] < 0.02
    assert gap(measured, {"speed": 0.9 * true}, {"speed": 0.05})["speed"] == pytest.approx(0.1, abs=0.005)


def test_total_is_the_rms_of_the_signals():
    """And the largest leaves the total out."""
    wave = np.sin(2.0 * np.pi * np.arange(4000) / 500.0)
    measured = {"speed": wave, "p1": 1e5 * wave}
    gaps = gap(measured, {"speed": 0.97 * wave, "p1": 0.96e5 * wave}, {"speed": 0.0, "p1": 0.0})

    assert gaps["total"] == pytest.approx(np.sqrt((0.03**2 + 0.04**2) / 2), rel=1e-3)
    assert largest(gaps) == pytest.approx(0.04, rel=1e-3)


def test_a_run_that_stopped_has_an_infinite_gap():
    """nan in a simulation is not passed over; a signal that does not move has no gap."""
    wave = np.sin(np.linspace(0.0, 9.0, 100))

    assert gap({"p1": wave}, {"p1": np.full(100, np.nan)}, {"p1": 0.0})["p1"] == np.inf
    assert gap({"p1": np.ones(100)}, {"p1": wave}, {"p1": 0.0})["p1"] == 0.0


@pytest.mark.parametrize("step", [0.0, 1e-5])
def test_noise_is_read_off_the_log(rng, step):
    """Beside a signal that moves, and where a converter's steps hold it still for half of the log."""
    time = np.arange(12000) * 0.004
    x = np.where(time < 24.0, 0.0, 0.02 * np.sin(2.0 * (time - 24.0))) + rng.normal(0.0, 2e-5, time.size)
    log = Log(time, {"position": np.round(x / step) * step if step else x})

    assert estimate_noise(log)["position"] == pytest.approx(2e-5, rel=0.1)


def test_velocity_noise_follows_from_the_position():
    """Difference of two samples over 20 ms."""
    assert signal_noise(EHSA, {"position": 2e-5}, 0.004)["rod_velocity"] == pytest.approx(2e-5 * np.sqrt(2) / 0.02)
    assert set(scored_signals(EHSA, {"position": np.zeros(9), "p1": np.zeros(9)}, 0.004)) == {"rod_velocity", "p1"}


@pytest.mark.parametrize("times", [1.0, 6.0])
def test_a_fast_log_shows_its_own_noise(plant, rng, times):
    """Also that of a sensor which is six times as noisy as the plant states."""
    log, _ = record(plant, *excitation("noise", amplitude=3.0, duration=6.0, sample_time=0.004), sensor_noise=False)
    sd = times * plant.sensors["p1"].sd
    noisy = Log(log.time, log.channels | {"p1": log["p1"] + rng.normal(0.0, sd, len(log))})

    assert slow_channels(plant, noisy) == []
    assert noise_of(plant, noisy)["p1"] == pytest.approx(sd, rel=0.1)


@pytest.mark.slow
def test_a_slow_log_does_not_hide_a_gap_in_its_noise(plant):
    """At 20 Hz the shaft's speed is another one in each sample; its noise is that of the sensor. Ten times the leakage
    is named, with a warning of the slow log."""
    rig = plant.set(K_L=10.0 * plant["K_L"])
    log, _ = record(rig, *excitation("noise", amplitude=3.0, duration=16.0, sample_time=0.05), centre=True)
    found = diagnose(plant, log)

    assert estimate_noise(log)["speed"] > 0.3 * np.std(log["speed"])
    assert noise_of(plant, log)["speed"] == plant.sensors["speed"].sd
    assert found.verdict == "effect" and found.effects[0].id == "internal_leakage"
    assert any("too far between two samples (50 ms)" in words for words in found.findings)
