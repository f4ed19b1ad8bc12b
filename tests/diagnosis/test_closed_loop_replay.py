"""Closed-loop replay of a log that was recorded under a controller."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl import InputError, Log, load_controller, load_plant, log_controller, replay_closed_loop, three_state
from ehsa_ctrl.core.controller_interface import MEASURED
from ehsa_ctrl.core.files import read_toml
from ehsa_ctrl.diagnosis.diagnosis import MODELS, Diagnosis
from ehsa_ctrl.diagnosis.logged_reference import output_lag, reference_of
from ehsa_ctrl.diagnosis.signals import estimate_noise
from ehsa_ctrl.simulation.sensors import Sensors

GAPS = dict.fromkeys(("speed", "p1", "p2", "rod_velocity", "total"), 0.2)


@pytest.fixture(scope="module")
def pid():
    return load_controller("pid_position", three_state(load_plant("ehsa", model="linear")))


@pytest.fixture(scope="module")
def rig():
    """A rig with twice the friction on the rod, and quantised, filtered sensors."""
    plant = load_plant("ehsa", settings={"filter.speed": "4 ms", "delay.p1": "4 ms"})
    sensors = {**plant.sensors, "position": replace(plant.sensors["position"], step=2e-5)}
    return replace(plant, sensors=sensors).set(A_FR=2.0 * plant["A_FR"])


def reference(samples=1500, step=0.02):
    """Ramps and holds between 0 and `step` [m], at 250 Hz."""
    phase = 0.004 * np.arange(samples) % 2.0
    return step * np.clip(np.minimum(phase, 2.0 - phase) * 2.0, 0.0, 1.0)


def recorded(rig, controller, target, lag=0, seed=3):
    """The log of a run on a rig, with sensor noise."""
    columns = reference_of(Log(0.004 * np.arange(target.size), {"reference": target}), controller)
    loop = ehsa_ctrl.run_closed_loop(rig, controller, columns, sensors=Sensors.of(rig, seed=seed), lag=lag)
    channels = dict(zip(MEASURED, loop.measured.T, strict=True))
    return Log(loop.trajectory.time, {"current": loop.trajectory.current, **channels, "reference": target})


def diagnosis(plant, log, improved, held_spans=()):
    """One made by hand: nothing is searched for."""
    return Diagnosis(
        plant=plant, log=log, threshold=0.03, verdict="effect", where=(), effects=(),
        gap=dict.fromkeys(MODELS, GAPS), whole=GAPS, held_out="nothing", noise_sd=estimate_noise(log), values={},
        simulated={}, improved=improved, held_spans=held_spans,
    )  # fmt: skip


def test_the_true_plant_reaches_the_floor_of_the_noise(rig, pid):
    """The believed plant has a gap in closed loop, in the position too. The plant of the rig leaves what noise makes
    through the loop, and closes the gap of the drive."""
    log, believed = recorded(rig, pid, reference()), rig.set(A_FR=0.5 * rig["A_FR"])

    found = replay_closed_loop(diagnosis(believed, log, rig, held_spans=((4.0, 5.996),)), pid)

    loop = found.closed_loop
    assert list(loop.gap) == list(MODELS) and list(loop.gap["nominal"])[-2:] == ["position", "total"]
    assert loop.gap["nominal"]["total"] > 0.1
    assert loop.gap["with_effects"]["total"] < 2.0 * loop.floor["total"] + 0.01 < 0.3 * loop.gap["nominal"]["total"]
    assert loop.position_error["with_effects"] < 0.3 * loop.position_error["nominal"]
    assert loop.drive_gap["with_effects"] < 0.3 * loop.drive_gap["nominal"]
    assert loop.lag == 0 and loop.drive_difference < 0.05 and not found.findings
    content = found.to_dict()
    assert content["closed_loop"]["nominal"].keys() == {*GAPS, "position"}
    assert content["closed_loop_replay"]["controller"] == "pid_position"


def test_the_gap_is_that_of_the_held_out_samples(rig, pid):
    """A disturbance of the measured position before the held-out data changes nothing; within them, it does."""
    log = recorded(rig, pid, reference())
    early, late = (log["position"].copy() for _ in range(2))
    early[200:400] += 1e-3
    late[1200:1400] += 1e-3

    gaps = [
        replay_closed_loop(
            diagnosis(
                rig, replace(log, channels={**log.channels, "position": values}), None, held_spans=((4.0, 5.996),)
            ),
            pid,
        ).closed_loop.gap["nominal"]["position"]
        for values in (log["position"], early, late)
    ]

    assert gaps[1] == pytest.approx(gaps[0], rel=0.05) and gaps[2] > 3.0 * gaps[0]


def test_another_controller_is_a_finding(rig, pid):
    """The log was recorded with an LQR: the finding has the figure."""
    lqr = load_controller("lqr_position", three_state(load_plant("ehsa", model="linear")))
    log = recorded(rig, lqr, reference())

    found = replay_closed_loop(diagnosis(rig, log, None), pid)

    (sentence,) = [words for words in found.findings if "check that the log was recorded with" in words]
    assert f"differs by {100 * found.closed_loop.drive_difference:.0f} %" in sentence and "pid_position" in sentence


def test_a_late_drive_is_found_and_simulated(rig, pid):
    """Two samples between reading and current: the replay with this lag is that of the log."""
    log = recorded(rig, pid, reference(), lag=2)

    found = replay_closed_loop(diagnosis(rig, log, None), pid)

    assert found.closed_loop.lag == 2
    assert "follows the output of pid_position 8 ms later" in " ".join(found.findings)
    assert found.closed_loop.gap["nominal"]["total"] < 2.0 * found.closed_loop.floor["total"] + 0.01


def test_a_controller_at_its_limit_is_a_finding(rig, pid):
    """Steps of 80 mm saturate the current: position may drift there."""
    target = np.where(0.004 * np.arange(1500) % 2.0 < 1.0, 0.0, 0.08)

    found = replay_closed_loop(diagnosis(rig, recorded(rig, pid, target), None), pid)

    assert "pid_position is at its limit of 6 A for" in " ".join(found.findings)


def test_what_is_missing_or_does_not_fit_is_a_sentence(rig, pid):
    """A log without a reference, and one at another rate."""
    log = recorded(rig, pid, reference(400))
    without = Log(log.time, {name: values for name, values in log.channels.items() if name != "reference"})

    with pytest.raises(InputError, match="has no channel reference, which the closed-loop replay with pid_position"):
        replay_closed_loop(diagnosis(rig, without, None), pid)
    with pytest.raises(InputError, match=r"sample time of 0\.003 s, controller pid_position of 0\.004 s"):
        replay_closed_loop(diagnosis(rig, Log(0.75 * log.time, log.channels), None), pid)


def test_a_log_that_is_faster_than_its_controller(rig, pid):
    """Every second row of a log at 500 Hz is one at 250 Hz: the same gaps."""
    log = recorded(rig, pid, reference(600))
    twice = Log(0.002 * np.arange(2 * len(log)), {name: np.repeat(v, 2) for name, v in log.channels.items()})

    slow, fast = (replay_closed_loop(diagnosis(rig, each, None), pid).closed_loop for each in (log, twice))

    np.testing.assert_allclose(fast.simulated["nominal"]["position"], slow.simulated["nominal"]["position"])


def test_the_slope_of_a_step_is_zero(pid):
    """And that of a ramp exact, its acceleration zero except where the ramp begins and ends."""
    target = np.concatenate([np.zeros(10), np.full(10, 0.05), 0.05 + 0.1 * 0.004 * np.arange(20)])

    columns = reference_of(Log(0.004 * np.arange(40), {"reference": target}), pid)

    assert not columns[:20, 1].any()
    np.testing.assert_allclose(columns[21:39, 1], 0.1)
    np.testing.assert_allclose(columns[22:38, 2], 0.0, atol=1e-9)


def test_the_lag_of_an_output():
    """A shift of white noise by three samples, exactly; without an output nothing is known."""
    output = np.random.default_rng(0).standard_normal(500)
    drive = np.concatenate([np.zeros(3), output[:-3]])

    assert output_lag(drive, output) == (3, 0.0)
    assert output_lag(output, output) == (0, 0.0)
    assert output_lag(drive, None)[0] == 0 and np.isnan(output_lag(drive, None)[1])


def test_the_controller_of_a_plants_logs(tmp_path):
    """Gains inline or a file beside the plant; a mixture, another drive and a system without a position are refused."""
    text = (load_plant("emps").path).read_text()
    head = text[: text.index("[log.controller]")]

    def plant(table):
        path = tmp_path / "rig.toml"
        path.write_text(f"{head}[log.controller]\n{table}\n")
        return load_plant(path)

    law = log_controller(load_plant("emps")).law
    assert (law.gains.k_p, law.gains.k_d) == pytest.approx((160.18 * 8557.4, 8557.4))
    (tmp_path / "mine.toml").write_text(
        'schema = 1\nkind = "pid"\ntitle = "t"\nsample_time = "1 ms"\ncurrent_limit = "9 N"\n[gains]\nk_p = "2 N/m"\n'
    )
    assert log_controller(plant('file = "mine.toml"')).law.gains.k_p == 2.0
    with pytest.raises(InputError, match=r"\[log.controller\] has file and kind; expected file = NAME alone"):
        log_controller(plant('file = "mine.toml"\nkind = "pid"'))
    with pytest.raises(InputError, match=r"rig.toml: \[log.controller\]: kind = 'pd'"):
        log_controller(plant('kind = "pd"'))
    with pytest.raises(InputError, match=r"current_limit = '6 A', but the drive of this plant is in N"):
        log_controller(load_plant("emps"), "pid_position")
    with pytest.raises(InputError, match=r"has no \[log.controller\]; name the controller"):
        log_controller(load_plant("ehsa"))
    with pytest.raises(InputError, match="its position loop is the firmware's"):
        log_controller(load_plant("xl330_pendulum"), "pid_position")
    with pytest.raises(InputError, match="the motion of its rod is prescribed"):
        log_controller(load_plant("mbari_pto"), "pid_position")


def test_the_emps_controller_is_that_of_the_record(shared):
    """The published law asks for the recorded force on the recorded positions to 0.7 %, without delay; in closed loop
    the published plant follows the record to 2 um, and to a tenth of its tracking error."""
    plant = load_plant("emps")
    path = shared / "data" / "emps" / "train.csv"
    log = ehsa_ctrl.read_plant_log(path, plant)

    loop = replay_closed_loop(diagnosis(plant, log, None), log_controller(plant)).closed_loop

    assert loop.lag == 0 and loop.drive_difference < 0.01
    assert loop.position_error["nominal"] < min(2e-6, 0.1 * loop.tracking_error)
    assert read_toml(plant.path)["log"]["controller"]["gains"]["form"] == "velocity"
