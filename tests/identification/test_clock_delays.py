"""Delays between the clocks of a log: found, told apart from lags of the plant, and taken away."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from ehsa_ctrl import InputError, Preparation, excitation, load_plant, read_plant_log, record, simulate
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.identification.clock_delays import find_clocks, shift_channels
from ehsa_ctrl.identification.signal_delay import estimate_delay

#: One channel, or several from one further logger.
GROUPS = [("position",), ("speed",), ("p1",), ("current",), ("p1", "p2"), ("current", "speed")]


@pytest.fixture(scope="module")
def bench():
    """Twelve seconds of noise at the bench."""
    plant = load_plant("ehsa")
    time, current = excitation("noise", amplitude=4.0, duration=12.0, seed=5)
    return plant, record(plant, time, current, seed=5)[0]


def late(log, plant, delay, *channels):
    """The log with channels that come late."""
    return shift_channels(log, plant, dict.fromkeys(channels, -delay))


@pytest.mark.parametrize("delay", [0.0, 0.003, 0.02, 0.3, 0.9])
@pytest.mark.parametrize("channels", GROUPS, ids="+".join)
def test_a_late_clock_is_found_with_its_channels(bench, channels, delay):
    """From less than a sample to almost a second, within four standard deviations and 2 % of a sample."""
    plant, log = bench
    clocks = find_clocks(plant, late(log, plant, delay, *channels))

    if delay == 0.0:
        assert clocks == ()
        return
    (clock,) = clocks
    assert set(clock.channels) == set(channels)
    assert set(clock.others) == {"current", "speed", "p1", "p2", "position"} - set(channels)
    assert clock.sd < 5e-4
    assert clock.delay == pytest.approx(delay, abs=4 * clock.sd + 8e-5)


def test_a_log_of_a_linear_model_and_steps(bench):
    """Another excitation, fewer channels."""
    plant = load_plant("ehsa", model="linear")
    time, current = excitation("steps", amplitude=2.0, duration=8.0)
    log, _ = record(plant, time, current, seed=2)
    log = replace(log, channels={name: log[name] for name in ("current", "speed", "position")})

    assert find_clocks(plant, log) == ()
    (clock,) = find_clocks(plant, late(log, plant, 0.3, "position"))
    assert clock.channels == ("position",) and clock.delay == pytest.approx(0.3, abs=0.004)


@pytest.mark.parametrize(
    "changes",
    [{"J_M": 1.2}, {"beta": 0.6}, {"B_FM": 1.5}, {"A_FR": 1.3}, {"K_L": 3.0}, {"V_10": 1.3}],
    ids=lambda changes: next(iter(changes)),
)
def test_a_wrong_parameter_is_no_clock(bench, changes):
    """It makes channels late too, but a shift does not explain them."""
    plant, log = bench
    believed = plant.set(**{name: factor * plant[name] for name, factor in changes.items()})

    assert find_clocks(believed, log) == ()


def test_a_ramp_that_breaks_away_once_shows_no_delay():
    """Wrong friction moves the time of breakaway."""
    plant = load_plant("ehsa")
    log, _ = record(plant, *excitation("ramp", amplitude=4.0, duration=10.0), seed=3)

    assert find_clocks(plant.set(A_FR=1.4 * plant["A_FR"]), log) == ()


@pytest.mark.parametrize("error", ["filter", "drive_lag"])
def test_a_lag_is_no_delay(bench, error):
    """A first-order filter in a sensor, or a first-order lag of the drive, of 6 ms."""
    plant, _ = bench
    if error == "filter":
        true = replace(plant, sensors={**plant.sensors, "speed": replace(plant.sensors["speed"], filter=6e-3)})
    else:
        true = plant.with_structure(replace(plant.structure, effects=("drive_lag",))).set(tau_I=6e-3)
    time, current = excitation("noise", amplitude=4.0, duration=12.0, seed=6)
    log, _ = record(true, time, current, seed=6)

    assert find_clocks(plant, log) == ()


def test_a_dead_time_of_the_drive_is_named_as_one(bench):
    """As `diagnose` names it; the current seems early."""
    plant, _ = bench
    true = plant.with_structure(replace(plant.structure, effects=("drive_delay",))).set(T_d=0.018)
    time, current = excitation("noise", amplitude=4.0, duration=12.0, seed=7)
    (clock,) = find_clocks(plant, record(true, time, current, seed=7)[0])

    assert clock.all_drives and clock.delay == pytest.approx(-0.018, abs=4 * clock.sd + 8e-5)
    assert "dead time (drive_delay)" in str(clock) and "--align current" in str(clock)


@pytest.mark.parametrize("channels", [("current",), ("position",), ("current", "speed")], ids="+".join)
def test_alignment_takes_a_delay_away(bench, channels):
    """Also of a drive, and of several channels together; the rows that a moved channel lacks are left out."""
    plant, log = bench
    new, steps = Preparation(align=channels).apply(late(log, plant, 0.3, *channels), plant)

    assert [step.figures["channel"] for step in steps] == list(channels)
    assert all(step.figures["delay"] == pytest.approx(0.3, abs=5e-4) for step in steps)
    assert len(log) - len(new) in (75, 76) and new.time[0] == log.time[0]
    assert find_clocks(plant, new) == ()


def test_an_early_channel_is_aligned_too(bench):
    """The rows at the beginning are left out then."""
    plant, log = bench
    new, (step,) = Preparation(align=("p1",)).apply(late(log, plant, -0.1, "p1"), plant)

    assert step.figures["delay"] == pytest.approx(-0.1, abs=5e-4)
    assert new.time[0] == pytest.approx(log.time[0] + 0.1, abs=0.0041) and new.time[-1] == log.time[-1]


def test_something_has_to_stay(bench):
    """All channels can't be aligned to nothing."""
    plant, log = bench
    everything = ("current", "speed", "p1", "p2", "position")

    with pytest.raises(InputError, match="name fewer channels"):
        Preparation(align=everything).apply(log, plant)


@pytest.mark.parametrize("delay", [-0.3, -0.0047, 0.0, 0.0123, 0.9])
def test_the_delay_of_two_signals(delay):
    """Smoothed noise, sampled at shifted times, with a hundredth of noise."""
    rng = np.random.default_rng(0)
    fine = np.convolve(rng.standard_normal(150_000), np.hanning(81), mode="same")
    time = 5.0 + 0.004 * np.arange(5000)
    at = 2e-4 * np.arange(fine.size)
    reference, signal = np.interp(time, at, fine), np.interp(time - delay, at, fine)
    found = estimate_delay(signal + 0.01 * np.std(signal) * rng.standard_normal(time.size), reference, 0.004)

    assert found.why == "" and found.period is None
    assert found.value == pytest.approx(delay, abs=4 * found.sd + 1e-5)
    assert found.sd < 1e-4
    assert found.gap < 0.1 or delay == 0.0


def test_a_standard_deviation_is_that_of_many_logs():
    """Within a factor of two of the scatter over 40 noises."""
    rng = np.random.default_rng(1)
    reference = np.cumsum(np.convolve(rng.standard_normal(3000), np.hanning(21), mode="same"))
    found = [estimate_delay(reference + 3.0 * rng.standard_normal(3000), reference, 0.004) for _ in range(40)]
    scatter = np.std([each.value for each in found])

    assert 0.5 < np.median([each.sd for each in found]) / scatter < 2.0


@pytest.mark.parametrize(
    ("signal", "says"),
    [
        (np.zeros(1000), "constant"),
        (np.sin(np.arange(50.0)), "50 samples are too few"),
        (np.random.default_rng(2).standard_normal(1000), "correlate by only"),
    ],
)
def test_signals_without_a_delay_say_why(signal, says):
    """Constant, too short, or unlike."""
    reference = np.cumsum(np.random.default_rng(3).standard_normal(signal.size))

    assert says in estimate_delay(signal, reference, 0.004).why


def test_a_periodic_signal_has_no_unique_delay():
    """A sine of 5 Hz that is 30 ms late may as well be 230 ms late."""
    time = 0.004 * np.arange(3000)
    found = estimate_delay(np.sin(10 * np.pi * (time - 0.03)), np.sin(10 * np.pi * time), 0.004)

    assert found.value == pytest.approx(0.03, abs=1e-3)
    assert found.period == pytest.approx(0.2, abs=0.004)


def test_a_periodic_excitation_is_said_to_be_one(bench):
    """And the sentence says by how much the delay may be off."""
    plant, _ = bench
    time, current = excitation("sine", amplitude=4.0, duration=10.0)
    log, _ = record(plant, time, current, seed=3)
    clocks = find_clocks(plant, late(log, plant, 0.05, "position"))

    assert [clock.channels for clock in clocks] == [("position",)]
    assert clocks[0].period is not None and "as the motion is periodic" in str(clocks[0])


def test_too_short_and_constant_logs_have_no_clocks(bench):
    """Nothing can be said, and nothing is."""
    plant, log = bench
    still = replace(log, channels={**log.channels, "position": np.zeros(len(log))})

    assert find_clocks(plant, log.rows(0, 60)) == ()
    assert find_clocks(plant, still) == ()


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.9])
@pytest.mark.parametrize("channels", [("current", "speed"), ("speed",), ("velocity", "position")], ids="+".join)
def test_two_drives_on_two_clocks(channels, delay):
    """A simulated take-off: rod velocity and current drive it, and either may have the late clock."""
    plant = load_plant("mbari_pto")
    rng = np.random.default_rng(4)
    time = 0.02 * np.arange(3000)

    def steps(size, every):
        return np.repeat(size * rng.uniform(-1.0, 1.0, 3000 // every + 1), every)[:3000]

    velocity = gaussian_filter1d(steps(0.4, 100), 10)
    current = gaussian_filter1d(steps(15.0, 60), 3)
    run = simulate(plant, current, force=velocity, hold="first_order", sample_time=0.02)
    signals = {"current": current, "velocity": velocity, "speed": run["omega"], "p1": run["P_1"], "p2": run["P_2"]}
    signals["position"] = np.concatenate([[0.0], 0.01 * np.cumsum(velocity[1:] + velocity[:-1])])
    noise = {"speed": 1.0, "p1": 2e4, "p2": 2e4, "position": 5e-5, "velocity": 2e-4, "current": 0.02}
    log = Log(time, {name: values + noise[name] * rng.standard_normal(3000) for name, values in signals.items()})
    clocks = find_clocks(plant, late(log, plant, delay, *channels))

    if delay == 0.0:
        assert clocks == ()
        return
    (clock,) = clocks
    assert set(clock.channels) == set(channels)
    assert clock.delay == pytest.approx(delay, abs=max(4 * clock.sd, 0.005))


@pytest.mark.parametrize(("name", "low", "high"), [("friction_id", 0.36, 0.46), ("vented_spring", 0.09, 0.15)])
def test_the_second_computer_of_the_take_off(shared_logs, name, low, high):
    """Current and speed of a real record come from a computer of their own, late by what earlier analyses found."""
    path = shared_logs.parents[1] / "data" / "mbari_pto" / f"{name}.csv"
    if not path.exists():
        pytest.skip(f"no {path}")
    plant = load_plant("mbari_pto")
    log = read_plant_log(path, plant)
    (clock,) = find_clocks(plant, log)

    assert clock.channels == ("current", "speed") and {"velocity", "position"} <= set(clock.others)
    assert low < clock.delay < high and clock.sd < 0.05
    delays = {channel: replace(plant.sensors[channel], delay=clock.delay) for channel in clock.channels}
    declared = replace(plant, sensors={**plant.sensors, **delays})
    assert find_clocks(declared, log) == ()
    assert find_clocks(plant, Preparation(align=clock.channels).apply(log, plant)[0]) == ()


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["labelled", "withheld", "hard/labelled", "hard/withheld"])
def test_other_benchs_logs_have_one_clock(shared_logs, folder):
    """Whatever effect is in them; W33 has a late drive and W41 a late position."""
    known = {"W33": (("current",), -0.0186), "W41": (("position",), 0.016)}
    for path in sorted((shared_logs.parent / folder).glob("*.csv")):
        belief = json.loads(path.with_suffix(".json").read_text())
        settings = {"load.stiffness": belief["spring_stiffness"]}
        plant = load_plant(belief["plant"], model=belief["model"], settings=settings)
        clocks = find_clocks(plant, read_plant_log(path, plant))

        assert len(clocks) == (path.stem in known), path.stem
        for clock in clocks:
            channels, delay = known[path.stem]
            assert clock.channels == channels and clock.delay == pytest.approx(delay, abs=5e-4)
