"""A rig's log, as its data logger wrote it, read for a plant."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import InputError, excitation, load_plant, read_plant_log, record, replay
from ehsa_ctrl.core.log import Column, Log
from ehsa_ctrl.core.log_reader import read_log

#: Channel -> its group, rate [Hz] and column, unit and SI units per unit, as the rig writes them.
RIG = {
    "current": ("drive", 4800.0, "i_soll", "A", 1.0),
    "speed": ("drive", 500.0, "n", "rpm", np.pi / 30),
    "p1": ("hydraulics", 500.0, "p_A", "bar", 1e5),
    "p2": ("hydraulics", 500.0, "p_B", "bar", 1e5),
    "position": ("rod", 500.0, "s", "mm", 1e-3),
    "force": ("load cell", 100.0, "F", "kN", 1e3),
}


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Three seconds of the bench at 4800 Hz under a current held for 4 ms, and its TDMS at three rates."""
    nptdms = pytest.importorskip("nptdms")
    plant = load_plant("ehsa")
    _, held = excitation("noise", amplitude=3, duration=3, sample_time=0.004)
    time = np.arange(3 * 4800) / 4800
    fast, _ = record(plant, time, held[(250 * time + 1e-9).astype(int)], seed=1)
    path = tmp_path_factory.mktemp("rig") / "rig.tdms"
    with nptdms.TdmsWriter(path) as file:
        for channel, (group, rate, column, unit, scale) in RIG.items():
            at = np.round(np.arange(0, time.size, 4800 / rate)).astype(int)
            properties = {"wf_increment": 1 / rate, "wf_start_offset": 0.0, "unit_string": unit}
            values = fast[channel][at[at < time.size]] / scale
            file.write_segment([nptdms.ChannelObject(group, column, values, properties)])
    columns = {channel: Column(column) for channel, (_, _, column, _, _) in RIG.items()}
    return replace(plant, log=columns), fast, path


def test_a_log_at_three_rates_fits_as_well_as_at_the_fastest(rig):
    """Brought to the plant's 250 Hz; with the current filtered like the others, speed would lose 4 % or more."""
    plant, fast, path = rig
    log = read_plant_log(path, plant)
    filtered = read_log(path, ["current"], columns=plant.log, rate=250.0)

    before, after, worse = (replay(plant, each).fit_percent for each in (fast, log, filtered))
    assert log.sample_time == pytest.approx(plant.sample_time) and log.rates.held == ("current",)
    assert all(after[name] > before[name] - 0.5 for name in before)
    assert worse["speed"] < after["speed"] - 4.0


def test_a_rate_may_be_given(rig):
    """Half of the plant's, for a slow analysis."""
    plant, _, path = rig

    assert read_plant_log(path, plant, rate=125.0).sample_time == pytest.approx(0.008)


def test_a_default_increment_asks_for_the_sample_time(rig, tmp_path):
    """LabVIEW writes 1 where nobody set it: there is no column that a scale could correct."""
    nptdms = pytest.importorskip("nptdms")
    _, fast, _ = rig
    with nptdms.TdmsWriter(tmp_path / "u.tdms") as file:
        properties = {"wf_increment": 1.0, "wf_start_offset": 0.0}
        channels = {name: fast[name][:500] for name in ("current", "speed")}
        file.write_segment([nptdms.ChannelObject("g", name, v, properties) for name, v in channels.items()])

    with pytest.raises(InputError, match=r"by wf_increment the sample time is 1 s, 250 times .*; give .*-time 0.004$"):
        read_plant_log(tmp_path / "u.tdms", load_plant("ehsa"))
    with pytest.raises(InputError, match=r"by the given sample time the sample time is 4 s, 1e\+03 times"):
        read_plant_log(tmp_path / "u.tdms", load_plant("ehsa"), sample_time=4.0)


def test_steps_of_one_ask_for_the_sample_time(rig, tmp_path):
    """Whichever format they come in; given, the log is read, and nonsense is refused."""
    plant, fast, _ = rig
    slow = Log(np.arange(500.0), {name: values[:500] for name, values in fast.channels.items()})
    slow.write(tmp_path / "u.csv")

    with pytest.raises(InputError, match=r"steps of 1 s, 250 times .* row numbers.* --sample-time 0.004"):
        read_plant_log(tmp_path / "u.csv", load_plant("ehsa"))
    assert read_plant_log(tmp_path / "u.csv", plant, sample_time=0.004).sample_time == pytest.approx(0.004)
    with pytest.raises(InputError, match="sample time of -1 s: must be a number greater than 0"):
        read_plant_log(tmp_path / "u.csv", plant, sample_time=-1.0)
