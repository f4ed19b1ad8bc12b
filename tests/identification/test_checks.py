"""What is wrong with a log is named with its remedy; a log that is right raises no alarm."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import check_log, excitation, load_plant, read_plant_log, record
from ehsa_ctrl.core.log import CHANNELS, Column
from ehsa_ctrl.core.unit import factor
from ehsa_ctrl.simulation.excitation import EXCITATIONS

PSI = 6894.757293168


@pytest.fixture(scope="module")
def bench():
    """Eight seconds of noise at the bench."""
    plant = load_plant("ehsa")
    time, current = excitation("noise", amplitude=4.0, duration=8.0, seed=1)
    return plant, record(plant, time, current, seed=1)[0]


def changed(log, **channels):
    return replace(log, channels=log.channels | channels)


def found(log, plant):
    return {(finding.kind, finding.channel): finding for finding in check_log(log, plant)}


@pytest.mark.parametrize("stiffness", [0.0, 5e4])
@pytest.mark.parametrize("sensor_noise", [True, False])
@pytest.mark.parametrize("name", EXCITATIONS)
def test_a_right_log_raises_no_alarm(plant, name, sensor_noise, stiffness):
    """All excitations, loaded and not, with noise and without; a ramp truly never turns round."""
    loaded = plant.set(K_S=stiffness)
    time, current = excitation(name, amplitude=1.5, duration=4.0)
    log, _ = record(loaded, time, current, sensor_noise=sensor_noise)

    kinds = {finding.kind for finding in check_log(log, loaded)}

    assert kinds == ({"no_reversal"} if name == "ramp" else set())


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["labelled", "withheld"])
def test_the_other_benchs_logs_raise_no_alarm(shared_logs, folder):
    """Whatever effect is in them: it is neither a unit, nor a sign, nor a dead or clipped channel."""
    logs = sorted((shared_logs.parent / folder).glob("*.csv"))
    for path in logs:
        belief = json.loads(path.with_suffix(".json").read_text())
        settings = {"load.stiffness": belief["spring_stiffness"]}
        plant = load_plant(belief["plant"], model=belief["model"], settings=settings)

        assert check_log(read_plant_log(path, plant), plant) == (), path.name


@pytest.mark.parametrize(
    ("channels", "scale", "unit"),
    [
        (("p1", "p2"), 1e-5, "bar"),
        (("p1", "p2"), 1e-6, "MPa"),
        (("p1",), 1e-3, "kPa"),
        (("p2",), 1 / PSI, "psi"),
        (("position",), 1e3, "mm"),
        (("speed",), 30 / np.pi, "rpm"),
        (("current",), 1e3, "mA"),
    ],
)
def test_a_wrong_unit_is_named_with_the_scale_to_write(bench, channels, scale, unit):
    """And nothing else is."""
    plant, log = bench
    findings = found(changed(log, **{name: scale * log[name] for name in channels}), plant)

    assert set(findings) == {("unit", name) for name in channels}
    for finding in findings.values():
        assert f"probably in {unit};" in str(finding) and "[log]" in str(finding)
        written = float(str(finding).partition("scale = ")[2].partition(" ")[0])
        assert written * scale == pytest.approx(1.0, rel=1e-6)


def test_the_line_to_write_builds_on_the_mapping_there_is(bench):
    """A column that is mapped with a scale keeps its name, and its scale is corrected."""
    from ehsa_ctrl.core.log import Column

    plant, log = bench
    mapped = replace(plant, log={"p1": Column("p_up", -2.0)})
    findings = found(changed(log, p1=log["p1"] * 1e-5), mapped)

    assert 'p1 = { column = "p_up", scale = -200000 }' in str(findings["unit", "p1"])


@pytest.mark.parametrize(
    ("channel", "mapped", "unit"),
    [("p1", 1e5, "Pa"), ("speed", 2.0 * np.pi / 60.0, "rad/s"), ("position", 1e-3, "m"), ("speed", 1.0 / 60.0, "rpm")],
)
def test_a_unit_that_the_mapping_has_wrong_is_named(bench, channel, mapped, unit):
    """A factor for a column that is in another unit, SI or not: the line to write has the right one, and the offset."""
    plant, log = bench
    right = factor(unit, CHANNELS[channel].unit)
    plant = replace(plant, log={**plant.log, channel: Column("c", mapped, 0.25)})
    finding = found(changed(log, **{channel: log[channel] * mapped / right}), plant)["unit", channel]

    assert f'probably in {unit}; write {channel} = {{ column = "c", scale = {right:.7g}, offset = 0.25 }}' in str(
        finding
    )


def test_a_rod_beyond_its_stroke_is_counted_from_elsewhere(bench):
    """From an end, say; within the stroke nothing is said."""
    plant, log = bench
    shifted = changed(log, position=log["position"] + 0.1)

    assert ("stroke", "position") not in found(log, plant)
    assert "100 mm to each side of its middle: is it counted from an end" in str(
        found(shifted, plant)["stroke", "position"]
    )


def test_time_in_s_that_is_mapped_as_ms_is_named(bench):
    """Steps of 4 us are no sample time; without a mapping nobody asked for that scale."""
    plant, log = bench
    short = replace(log, time=1e-3 * log.time)
    mapped = replace(plant, log={**plant.log, "t": Column("Zeit", 1e-3)})

    (finding,) = check_log(short, mapped)

    assert finding.kind == "time_unit" and 'probably in s already: write t = { column = "Zeit" }' in str(finding)


@pytest.mark.parametrize("channel", ["current", "speed", "position"])
def test_a_swapped_sign_is_named(bench, channel):
    """The one channel that runs against all others."""
    plant, log = bench
    findings = found(changed(log, **{channel: -log[channel]}), plant)

    assert set(findings) == {("sign", channel)}
    assert f'{channel} = {{ column = "{channel}", scale = -1 }}' in str(findings["sign", channel])
    assert findings["sign", channel].severity == "error"


def test_exchanged_pressures_are_named_together(bench):
    """The line to write names the other's column."""
    plant, log = bench
    findings = found(changed(log, p1=log["p2"], p2=log["p1"]), plant)

    assert set(findings) == {("sign", "p1")}
    assert 'p1 = { column = "p2" } and p2 = { column = "p1" }' in str(findings["sign", "p1"])


@pytest.mark.parametrize(("channel", "value"), [("p1", 2e6), ("speed", 0.0), ("position", 0.01), ("current", 0.0)])
def test_a_dead_channel_is_an_error(bench, channel, value):
    """Constant throughout while others move."""
    plant, log = bench
    findings = found(changed(log, **{channel: np.full(len(log), value)}), plant)

    assert findings["dead", channel].severity == "error"


def test_a_channel_that_gets_stuck_is_a_warning_with_its_times(bench):
    """From 4.8 s on."""
    plant, log = bench
    speed = np.where(log.time > 4.8, log["speed"][1200], log["speed"])
    finding = found(changed(log, speed=speed), plant)["stuck", "speed"]

    assert finding.severity == "warning"
    assert "from 4.8 to 8 s" in str(finding)


@pytest.mark.parametrize("limit", [1.0, 2.0])
def test_a_clipped_drive_is_a_warning(plant, limit):
    """Noise cut at a third and at a half of what it would reach; says how much of the log it is."""
    time, current = excitation("noise", amplitude=4.0, duration=8.0, seed=1)
    log, _ = record(plant, time, np.clip(current, -limit, limit))
    findings = found(log, plant)

    assert set(findings) == {("drive_clipped", "current")}
    assert f"at {limit:g} A (" in str(findings["drive_clipped", "current"])
    assert f"and -{limit:g} A (" in str(findings["drive_clipped", "current"])


@pytest.mark.parametrize(("channel", "low", "high"), [("speed", -80.0, 80.0), ("p1", 0.0, 2.3e6), ("p2", 1.8e6, 1e8)])
def test_a_clipped_output_is_a_warning(bench, channel, low, high):
    """Its extreme repeats exactly where nothing else does."""
    plant, log = bench
    findings = found(changed(log, **{channel: np.clip(log[channel], low, high)}), plant)

    assert set(findings) == {("output_clipped", channel)}


def test_no_motion_is_an_error_and_hides_the_rest(plant):
    """0.3 A do not overcome the shaft's friction."""
    time, current = excitation("noise", amplitude=0.3, duration=4.0)
    (finding,) = check_log(record(plant, time, current)[0], plant)

    assert (finding.kind, finding.channel, finding.severity) == ("no_motion", None, "error")


def test_little_motion_is_a_warning(plant):
    """Hardly beyond breaking away."""
    time, current = excitation("noise", amplitude=1.2, duration=4.0, seed=1)

    assert ("weak", "speed") in found(record(plant, time, current)[0], plant)


def test_time_in_ms_is_named_alone(bench):
    """Nothing else can be said of such a log."""
    plant, log = bench
    findings = found(replace(log, time=1e3 * log.time), plant)

    assert set(findings) == {("time_unit", "t")}
    assert "scale = 0.001" in str(findings["time_unit", "t"])


def test_a_finding_is_a_sentence_and_a_dictionary(bench):
    """For the screen and for the JSON."""
    plant, log = bench
    (finding,) = check_log(changed(log, speed=-log["speed"]), plant)

    assert finding.to_dict() == {
        "kind": "sign", "channel": "speed", "severity": "error", "sentence": str(finding),
    }  # fmt: skip
