"""What is wrong with a log is named with its remedy; a log that is right raises no alarm."""

import json
import re
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
# White noise hardly moves a plant with friction, which the checks say.
@pytest.mark.parametrize("name", [name for name in EXCITATIONS if name != "white"])
def test_a_right_log_raises_no_alarm(plant, name, sensor_noise, stiffness):
    """All excitations, loaded and not, with noise and without; a ramp indeed never reverses."""
    loaded = plant.set(K_S=stiffness)
    time, current = excitation(name, amplitude=1.5, duration=4.0)
    log, _ = record(loaded, time, current, sensor_noise=sensor_noise)

    kinds = {finding.kind for finding in check_log(log, loaded)}

    assert kinds == ({"no_reversal"} if name == "ramp" else set())


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["labelled", "withheld", "hard/labelled", "hard/withheld"])
def test_the_other_benchs_logs_raise_no_alarm(shared_logs, folder):
    """Whatever effect is in them: it is neither a unit, nor a sign, nor a dead or clipped channel."""
    logs = sorted((shared_logs.parent / folder).glob("*.csv"))
    for path in logs:
        belief = json.loads(path.with_suffix(".json").read_text())
        settings = {"load.stiffness": belief["spring_stiffness"]}
        plant = load_plant(belief["plant"], model=belief["model"], settings=settings)

        # Late clocks: test_clock_delays.py knows which of these logs have one.
        assert {finding.kind for finding in check_log(read_plant_log(path, plant), plant)} <= {"late"}, path.name


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
    assert "100 mm to each side of its middle: is the zero at an end" in str(
        found(shifted, plant)["stroke", "position"]
    )


def test_time_in_s_that_is_mapped_as_ms_is_named(bench):
    """Steps of 4 us are no sample time; without a mapping nobody asked for that scale."""
    plant, log = bench
    short = replace(log, time=1e-3 * log.time)
    mapped = replace(plant, log={**plant.log, "t": Column("Zeit", 1e-3)})

    (finding,) = check_log(short, mapped)

    assert finding.kind == "time_unit" and 'probably in s already: write t = { column = "Zeit", scale = 1 }' in str(
        finding
    )


@pytest.mark.parametrize("channel", ["current", "speed", "position"])
def test_a_swapped_sign_is_named(bench, channel):
    """The one channel that runs against all others."""
    plant, log = bench
    findings = found(changed(log, **{channel: -log[channel]}), plant)

    assert set(findings) == {("sign", channel)}
    assert f'{channel} = {{ column = "{channel}", scale = -1 }}' in str(findings["sign", channel])
    assert findings["sign", channel].severity == "error"


@pytest.mark.parametrize(("scale", "kind", "words"), [(-1.0, "sign", "scale = -1"), (1e-3, "unit", "in kN")])
def test_a_load_cell_with_another_sign_or_unit_is_named(plant, scale, kind, words):
    """Against a spring that the plant has, its force is known."""
    loaded = plant.set(K_S=5e4)
    log, _ = record(loaded, *excitation("steps", amplitude=1.5, duration=8.0))
    findings = found(changed(log, force=scale * log["force"]), loaded)

    assert set(findings) == {(kind, "force")} and findings[kind, "force"].severity == "error"
    assert words in str(findings[kind, "force"])


def test_the_force_of_an_unknown_spring_is_no_wrong_sign(plant):
    """In a sine, that of a spring opposes that of a known payload, sample by sample."""
    rig = plant.set(m_L=100.0, K_S=5e4)
    log, _ = record(rig, *excitation("sine", amplitude=2.0, duration=8.0))

    assert not {kind for kind, channel in found(log, plant.set(m_L=100.0)) if channel == "force"}


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


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (1 / 60, ("has steps of 0.0667 ms", "are 4 ms", "in minutes; write t = {", "scale = 60 }")),
        (1 / 3600, ("in h: write t = {", "scale = 3600 }")),
        (0.5, ("has steps of 2 ms", "are 4 ms", "the logger probably had another sampling rate", "scale = 2 }")),
        (0.8, ("has steps of 3.2 ms", "are 4 ms", "scale = 1.25 }")),
        (10.0, ("has steps of 40 ms", "are 4 ms", "scale = 0.1 }")),
    ],
)
def test_time_that_is_not_the_motions_is_named_alone(bench, factor, says):
    """In minutes, in hours, at a rate that the logger did not have: whatever follows from it is not said."""
    plant, log = bench
    (finding,) = check_log(replace(log, time=factor * log.time), plant)

    assert (finding.kind, finding.severity) == ("time_unit", "error")
    assert all(part in str(finding) for part in says)


def test_time_in_minutes_is_seen_without_speed_too(bench):
    """Then the motion of rod and pressures tells it."""
    plant, log = bench
    channels = {name: values for name, values in log.channels.items() if name != "speed"}
    findings = found(replace(log, time=log.time / 60, channels=channels), plant)

    assert set(findings) == {("missing", "speed"), ("time_unit", "t")}


def test_a_log_at_another_rate_than_the_plants_is_right(plant):
    """1 kHz where the bench has 250 Hz; and a pump that delivers a fifth less is no question of the clock."""
    time, current = excitation("noise", amplitude=4.0, duration=4.0, seed=1, sample_time=0.001)
    weak = plant.set(D=0.8 * plant["D"])

    assert check_log(record(plant, time, current)[0], plant) == ()
    assert check_log(record(weak, time, current)[0], plant) == ()


@pytest.mark.parametrize("level", [0.1, -3.0])
def test_a_constant_current_under_a_plant_that_turns_round_is_another_column(bench, level):
    """With the logger's noise or without."""
    plant, log = bench
    noise = 0.005 * np.random.default_rng(0).standard_normal(len(log))
    for current in (np.full(len(log), level), level + noise):
        finding = found(changed(log, current=current), plant)["drive_constant", "current"]

        assert finding.severity == "error"
        assert re.search(r"current is [-.0-9]+ A throughout while speed reverses \d+ times", str(finding))


def test_a_step_of_current_is_right_where_the_rod_goes_one_way(plant):
    """Constant from the first sample on."""
    log, _ = record(plant, *excitation("steps", amplitude=1.5, duration=1.0))
    log, _ = record(plant, log.time, np.full(len(log), 1.5))

    assert {finding.kind for finding in check_log(log, plant)} == {"no_reversal"}


@pytest.mark.parametrize(
    ("channel", "value", "severity"),
    [("p1", 9e7, "error"), ("p1", 0.0, "warning"), ("position", 0.9, "error"), ("current", 100.0, "error")],
)
def test_a_single_spike_is_named_with_its_time(bench, channel, value, severity):
    """900 bar; a lost sample that is logged as zero. Nothing else is said because of it."""
    plant, log = bench
    values = log[channel].copy()
    values[1000] = value
    findings = found(changed(log, **{channel: values}), plant)

    assert set(findings) == {("spike", channel)}
    assert findings["spike", channel].severity == severity
    assert f"{channel} jumps to {value:.4g} " in str(findings["spike", channel])
    assert "at 4 s and back" in str(findings["spike", channel])


def test_a_pulse_of_current_out_of_rest_is_no_spike(plant):
    """It is what one sends to find the smallest slip."""
    current = np.zeros(1000)
    current[300:302] = 6.0
    log, _ = record(plant, 0.004 * np.arange(1000), current)

    assert "spike" not in {finding.kind for finding in check_log(log, plant)}


def test_a_log_without_speed_says_what_it_does_not_tell(bench):
    """And that is all that is wrong with it."""
    plant, log = bench
    channels = {name: values for name, values in log.channels.items() if name != "speed"}
    (finding,) = check_log(replace(log, channels=channels), plant)

    assert (finding.kind, finding.channel, finding.severity) == ("missing", "speed", "warning")
    assert "motor friction and inertia can't be separated" in str(finding)


@pytest.mark.parametrize("channel", ["speed", "p1", "position"])
@pytest.mark.parametrize("samples", [5, 25])
def test_a_channel_that_comes_late_is_named_with_its_delay(bench, channel, samples):
    """20 ms and 0.1 s; what to do is said, and nothing else found."""
    plant, log = bench
    values = np.concatenate([np.full(samples, log[channel][0]), log[channel][:-samples]])
    findings = found(changed(log, **{channel: values}), plant)

    assert set(findings) == {("late", channel)}
    finding = findings["late", channel]
    assert finding.figures["delay"] == pytest.approx(0.004 * samples, abs=4 * finding.figures["sd"] + 1e-4)
    assert re.search(rf"{channel} is 0\.\d+ s late \(sd .* s\) relative to current", str(finding))
    assert f"--align {channel}" in str(finding) and f"--set delay.{channel}=" in str(finding)


def test_a_late_current_is_not_four_early_channels(bench):
    """And no swapped sign."""
    plant, log = bench
    current = np.concatenate([np.zeros(100), log["current"][:-100]])
    findings = found(changed(log, current=current), plant)

    assert set(findings) == {("late", "current")}
    assert "--set delay.current=0.4" in str(findings["late", "current"])


def test_one_column_read_for_both_pressures_is_an_error(bench):
    """Its sign is not swapped."""
    plant, log = bench

    assert set(found(changed(log, p1=log["p2"]), plant)) == {("same", "p2")}


@pytest.mark.parametrize(("channels", "rows"), [(("position",), 5), (("current", "speed", "p1", "p2", "position"), 2)])
def test_rows_that_repeat_each_value_are_named_with_the_rate(bench, channels, rows):
    """A slow bus under a fast logger, or duplicated rows."""
    plant, log = bench
    at = np.arange(len(log)) // rows * rows
    (finding,) = check_log(changed(log, **{name: log[name][at] for name in channels}), plant)

    assert finding.kind == "held" and f"is repeated in {rows} rows: sampled every {4 * rows} ms" in str(finding)
    assert f"--resample {250 / rows:g}" in str(finding)


def test_a_logger_that_stops_is_one_finding(bench):
    """All channels repeat one row for 0.8 s, however short that is in a long log."""
    plant, log = bench
    frozen = {
        name: np.where((log.time > 4) & (log.time < 4.8), values[1000], values) for name, values in log.channels.items()
    }
    finding = found(replace(log, channels=frozen), plant)["stuck", None]

    assert "speed, p1, p2, position repeat one row from 4 to 4.796 s" in str(finding)


def test_rows_that_are_missing_are_seen_by_the_rod(bench):
    """A second was cut out and time numbered anew."""
    plant, log = bench
    kept = np.r_[0:1000, 1250 : len(log)]
    shorter = replace(log, time=log.time[: kept.size], channels={n: v[kept] for n, v in log.channels.items()})

    assert "within one sample at 4 s" in str(found(shorter, plant)["rows_missing", "position"])


def test_a_pressure_below_vacuum_has_a_wrong_zero(bench):
    """Gauge pressures, 30 bar too low."""
    plant, log = bench

    assert "--zero p1" in str(found(changed(log, p1=log["p1"] - 3e6), plant)["vacuum", "p1"])
