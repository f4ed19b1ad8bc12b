"""Several rates become one: what the new rate can show keeps gain and phase, what it can't is gone."""

import numpy as np
import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log_reader import read_log
from ehsa_ctrl.core.resampling import Sampled, merge, resample_signal

RATE = 250.0
#: Inner samples: half the length of the filter from the ends, where a signal is continued by reflection.
INNER = slice(60, -60)


def sine(frequency, rate, seconds=4.0, start=0.0):
    time = start + np.arange(int(seconds * rate)) / rate
    return Sampled(time, np.sin(2 * np.pi * frequency * time))


@pytest.mark.parametrize("rate", [4800.0, 1000.0, 500.0, 333.0, 251.0, 250.0, 200.0])
@pytest.mark.parametrize("frequency", [1.0, 20.0, 77.0])
def test_a_sine_below_the_nyquist_frequency_keeps_amplitude_and_phase(rate, frequency):
    """To 0.2 %: within 0.8 of the lower Nyquist frequency, from any rate, on a grid between the samples."""
    new = 0.0113 + np.arange(900) / RATE
    got = resample_signal(sine(frequency, rate), new, RATE)

    np.testing.assert_allclose(got[INNER], np.sin(2 * np.pi * frequency * new)[INNER], atol=0.002)


@pytest.mark.parametrize("rate", [4800.0, 1000.0, 500.0])
@pytest.mark.parametrize("frequency", [127.0, 175.0, 240.0])
def test_a_sine_above_the_nyquist_frequency_is_attenuated_by_60_db(rate, frequency):
    """It would come back as another frequency."""
    new = np.arange(900) / RATE
    got = resample_signal(sine(frequency, rate), new, RATE)

    assert np.std(got[INNER]) < 0.001 * np.sqrt(0.5)


@pytest.mark.parametrize("rate", [4800.0, 300.0, 100.0])
def test_a_constant_and_a_ramp_stay_to_the_ends(rate):
    """The filter has a gain of 1 at each of its phases; reflection continues a ramp."""
    time = np.arange(int(2 * rate)) / rate
    new = np.arange(0.0, time[-1], 1 / RATE)

    np.testing.assert_allclose(resample_signal(Sampled(time, np.full(time.size, 3e6)), new, RATE), 3e6, rtol=1e-12)
    np.testing.assert_allclose(resample_signal(Sampled(time, 5 * time), new, RATE), 5 * new, atol=1e-3)


def test_the_steps_of_a_held_drive_are_found_again():
    """Steps at the loop's rate, recorded 20 times as fast: averaging gives them back, a filter would smooth them."""
    steps = np.random.default_rng(0).normal(size=200)
    time = np.arange(200 * 20) / 5000
    merged = merge({"current": Sampled(time, steps[(time * RATE + 1e-9).astype(int)])}, RATE, held=["current"])

    assert merged.change.held == ("current",) and not merged.change.delay
    np.testing.assert_allclose(merged.channels["current"], steps, atol=1e-9)


def test_three_rates_in_one_file_become_one_and_say_so(tmp_path):
    """Current at 4800 Hz, position at 500 Hz and force at 100 Hz, the last from half a second later on."""
    nptdms = pytest.importorskip("nptdms")
    start = np.datetime64("2024-05-31T12:00:00")
    with nptdms.TdmsWriter(tmp_path / "u.tdms") as file:
        for name, rate, late in (("current", 4800.0, 0.0), ("position", 500.0, 0.0), ("force", 100.0, 0.5)):
            begins = start + np.timedelta64(int(1000 * late), "ms")
            properties = {"wf_increment": 1 / rate, "wf_start_offset": 0.0, "wf_start_time": begins}
            values = sine(10.0, rate, start=late).values
            file.write_segment([nptdms.ChannelObject(f"{name}s", name, values, properties)])

    with pytest.raises(InputError, match=r"several rates \(current at 4800 Hz, position at 500 Hz, force at 100 Hz\)"):
        read_log(tmp_path / "u.tdms", ["current"])
    with pytest.raises(InputError, match=r"different numbers of samples \(current 19200, position 2000, force 400\)"):
        read_log(tmp_path / "u.tdms", ["current"], sample_time=0.004)
    log = read_log(tmp_path / "u.tdms", ["current", "position", "force"], rate=RATE)

    assert log.sample_time == pytest.approx(1 / RATE) and log.time[0] == pytest.approx(0.5)
    for name in ("current", "position", "force"):
        np.testing.assert_allclose(log[name][INNER], np.sin(2 * np.pi * 10 * log.time)[INNER], atol=0.01)
    assert "current at 4800 Hz, position at 500 Hz, force at 100 Hz" in str(log.rates)
    figures = log.rates.to_dict()
    assert figures["delay_removed"]["current"] == pytest.approx(0.073, abs=0.001)
    assert figures["rates_before"] == pytest.approx({"current": 4800.0, "position": 500.0, "force": 100.0})


def test_a_signal_at_the_new_rate_is_not_touched():
    """Its samples are the grid, also where another begins in between and ends earlier."""
    own = sine(20.0, RATE, start=0.001)
    merged = merge({"fast": sine(10.0, 1000.0, seconds=3.0, start=0.2503), "own": own}, RATE)

    first = int(np.flatnonzero(own.time > 0.2503)[0])
    np.testing.assert_array_equal(merged.channels["own"], own.values[first : first + merged.time.size])
    assert list(merged.change.delay) == ["fast"]


def test_groups_that_do_not_overlap_are_a_sentence(tmp_path):
    """One was started after the other had ended."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "u.tdms") as file:
        for name, begins in (("current", "2024-05-31T12:00:00"), ("position", "2024-05-31T12:01:00")):
            properties = {"wf_increment": 0.004, "wf_start_offset": 0.0, "wf_start_time": np.datetime64(begins)}
            file.write_segment([nptdms.ChannelObject(name, name, np.arange(500.0), properties)])

    with pytest.raises(
        InputError, match=r"not recorded at the same time: current from 0 to 1.996 s and position from 60"
    ):
        read_log(tmp_path / "u.tdms", ["current"], rate=RATE)
