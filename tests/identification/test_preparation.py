"""What is done to a log before use: only when asked for, right, and recorded."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import InputError, Preparation, excitation, load_plant, record
from ehsa_ctrl.core.log import Log


@pytest.fixture(scope="module")
def bench():
    """Steps at the bench: a quarter of a second of rest, then motion."""
    plant = load_plant("ehsa")
    time, current = excitation("steps", amplitude=3.0, duration=4.0)
    log, run = record(plant, time, current, seed=2)
    return plant, log, run


def moved(log, **shifts):
    return replace(log, channels=log.channels | {name: log[name] + shift for name, shift in shifts.items()})


def test_nothing_is_done_unasked(bench):
    """The log itself comes back, with no step."""
    plant, log, _ = bench

    assert Preparation().apply(log, plant) == (log, ())


def test_a_segment_is_cut_and_recorded(bench):
    """In the log's own time, what lies before it remembered."""
    plant, log, _ = bench
    part, (step,) = Preparation(from_=1.0, to=2.0).apply(log, plant)

    assert (part.time[0], part.time[-1]) == pytest.approx((1.0, 2.0))
    assert part.before.time[-1] == pytest.approx(0.996)
    assert str(step) == "segment from 1 to 2 s, 251 samples"
    assert step.to_dict()["kind"] == "segment"
    with pytest.raises(InputError, match="expected at least 25"):
        Preparation(from_=1.0, to=1.02).apply(log, plant)


@pytest.mark.parametrize("rest", [None, (0.0, 0.2)])
def test_zeros_are_taken_from_the_rest(bench, rest):
    """Given or found before the first step; also where the segment begins after it."""
    plant, log, _ = bench
    wrong = moved(log, p1=3e5, p2=-1e5, force=400.0)
    part, steps = Preparation(from_=1.0, zero=("p1", "p2", "force"), rest=rest).apply(wrong, plant)

    for channel, sd in (("p1", 15e3), ("p2", 15e3), ("force", 15.0)):
        difference = part[channel] - log.segment(1.0)[channel]
        assert np.ptp(difference) < 1e-6 * sd
        assert abs(difference[0]) < 5 * sd / np.sqrt(45), channel
    assert [step.figures["channel"] for step in steps[:3]] == ["p1", "p2", "force"]
    assert steps[0].figures["rest"][1] <= 0.25
    assert steps[0].figures["shift"] == pytest.approx(-3e5, abs=1e4)


def test_the_loads_force_at_rest_is_no_zero(bench):
    """A preload of 500 N is what the cell shows at rest."""
    plant, log, _ = bench
    part, _ = Preparation(zero=("force",)).apply(log, plant.set(F_pre=500.0))

    assert np.mean(part["force"][:50]) == pytest.approx(500.0, abs=10.0)


def test_no_rest_and_no_such_channel_are_sentences(bench):
    """What to do instead is said."""
    plant, log, _ = bench

    with pytest.raises(InputError, match=r"is not at rest for its first 0.1 s.*give start and end of a rest"):
        Preparation(zero=("p1",)).apply(replace(log.segment(0.3), before=None), plant)
    with pytest.raises(InputError, match="no zero of 'current'"):
        Preparation(zero=("current",)).apply(log, plant)


@pytest.mark.parametrize("rate", [1000.0, 100.0, 62.5, 333.0])
def test_resampling_keeps_slow_signals_and_the_drives_integral(plant, rate):
    """A 3 Hz sine stays one within a part in thousand; the held drive keeps its charge."""
    time = 0.004 * np.arange(1001)
    slow = np.sin(2 * np.pi * 3 * time)
    log = Log(time, {"current": np.sign(slow), "speed": slow})
    new, (step,) = Preparation(resample=rate).apply(log, plant)
    inner = slice(int(0.3 * rate), -int(0.3 * rate))

    np.testing.assert_allclose(np.diff(new.time), 1 / rate)
    np.testing.assert_allclose(new["speed"][inner], np.sin(2 * np.pi * 3 * new.time)[inner], atol=2e-3)
    charge = np.cumsum(new["current"]) / rate
    there = np.interp(new.time + 1 / rate, np.append(time, 4.004), np.append(0, np.cumsum(log["current"]) * 0.004))
    np.testing.assert_allclose(charge[:-1], there[:-1], atol=1e-9)
    assert "resampled from 250" in str(step)


def test_what_the_lower_rate_cannot_show_is_filtered_out(plant):
    """80 Hz would come back as 20 Hz at a rate of 100 Hz."""
    time = 0.004 * np.arange(2001)
    log = Log(time, {"current": np.zeros(2001), "speed": np.sin(2 * np.pi * 80 * time)})

    new, _ = Preparation(resample=100.0).apply(log, plant)

    assert np.std(new["speed"][50:-50]) < 0.01


def test_jittered_time_is_brought_to_a_grid(plant):
    """Samples that come up to a third early or late."""
    rng = np.random.default_rng(0)
    time = 0.004 * (np.arange(1001) + rng.uniform(-0.33, 0.33, 1001))
    log = Log(time, {"current": np.zeros(1001), "speed": np.sin(2 * np.pi * 3 * time)})

    new, _ = Preparation(resample=250.0).apply(log, plant)

    np.testing.assert_allclose(new["speed"], np.sin(2 * np.pi * 3 * new.time), atol=1e-3)


@pytest.mark.parametrize("rate", [0.0, -5.0, np.nan, np.inf, 1.0])
def test_a_rate_of_no_use_is_a_sentence(bench, rate):
    """Zero, negative, none, or leaving too little."""
    plant, log, _ = bench

    with pytest.raises(InputError, match="resample"):
        Preparation(resample=rate).apply(log, plant)


@pytest.mark.parametrize("delay", [0.004, 0.0105])
def test_alignment_finds_a_sensors_delay(delay):
    """To a tenth of a sample, and takes it away."""
    nominal = load_plant("ehsa")
    true = replace(nominal, sensors={**nominal.sensors, "speed": replace(nominal.sensors["speed"], delay=delay)})
    time, current = excitation("noise", amplitude=4.0, duration=6.0, seed=3)
    log, run = record(true, time, current, seed=3)

    new, (step,) = Preparation(align=("speed",)).apply(log, nominal)

    assert step.figures["delay"] == pytest.approx(delay, abs=4e-4)
    assert f"{1e3 * step.figures['delay']:.3g} ms" in str(step)
    assert 0 < len(log) - len(new) <= 3 and new.time[0] == log.time[0]
    true_speed = run["omega"][: len(new)]
    assert np.std((new["speed"] - true_speed)[10:-10]) < 0.1 * np.std(log["speed"] - run["omega"]) + 1.0


def test_a_weak_correlation_moves_nothing(bench):
    """Noise in the channel's place."""
    plant, log, _ = bench
    noise = np.cumsum(np.random.default_rng(1).standard_normal(len(log)))
    new, (step,) = Preparation(align=("position",)).apply(
        replace(log, channels=log.channels | {"position": noise}), plant
    )

    np.testing.assert_array_equal(new["position"], noise)
    assert "position: not aligned" in str(step) and step.figures["delay"] is None
    with pytest.raises(InputError, match="no alignment of 'force'"):
        Preparation(align=("force",)).apply(log, plant)
