"""Several logs of one rig in one diagnosis."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.diagnose import diagnose
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel, with_every_effect
from ehsa_ctrl.diagnosis.objective import ResidualScale, objective_of
from ehsa_ctrl.diagnosis.records import Record, Segment, joint_gap
from ehsa_ctrl.diagnosis.signals import estimate_noise
from ehsa_ctrl.diagnosis.together import check_other, check_together


@pytest.fixture(scope="module")
def plant():
    """With a mean pressure at which neither chamber cavitates under the loads below."""
    return ehsa_ctrl.load_plant("ehsa").set(P_0=80e5)


def recorded(rig, load, seed, seconds=8.0):
    """A log of slow motion under a constant force [N], which the current carries, with that force as its setting."""
    time, current = ehsa_ctrl.excitation("sine", amplitude=1.5, duration=seconds, seed=seed)
    holding = load * rig["D"] / (rig["A"] * rig["K_T"])
    log, _ = ehsa_ctrl.record(rig.set(F_0=load), time, current + holding, seed=seed, centre=True)
    return replace(log, settings={"F_0": load}, path=Path(f"{load:g}N.csv"))


@pytest.fixture(scope="module")
def leaking(plant):
    """Two logs of a rig whose leak grows with the root of the pressure, each under one load."""
    rig = plant.with_effects("orifice_leakage", K_t=6e-10)
    return [recorded(rig, load, seed) for seed, load in ((3, 4e3), (4, 12e3))]


@pytest.fixture(scope="module")
def alone(plant, leaking):
    """The diagnosis of each of them."""
    return [diagnose(plant.set(**log.settings), replace(log, settings={})) for log in leaking]


def test_the_joint_gap_is_a_mean_of_squares():
    """A signal that stands still in one log counts in the others alone; the total is the RMS of the signals."""
    found = joint_gap([{"p1": 0.03, "speed": 0.1, "total": 0.07}, {"p1": 0.04, "total": 0.04}])

    assert found["p1"] == pytest.approx(np.sqrt(0.5 * (0.03**2 + 0.04**2)))
    assert found["speed"] == pytest.approx(0.1)
    assert found["total"] == pytest.approx(np.sqrt(0.5 * (found["p1"] ** 2 + 0.01)))


def test_the_gap_of_one_log_is_its_own():
    """To the last bit, which a root of a square is not always."""
    one = {"p1": 0.1 + 1e-17, "total": 0.3}

    assert joint_gap([one]) == one


@pytest.fixture(scope="module")
def segment(leaking, plant):
    """Both logs as one segment, of the second the last quarter alone."""
    models = [HypothesisModel(with_every_effect(plant.set(**log.settings)), log) for log in leaking]
    records = [Record(model, estimate_noise(model.log)) for model in models]
    last = slice(len(leaking[1]) * 3 // 4, None)
    return Segment((records[0], replace(records[1], parts=(last,))), "both")


def test_residuals_of_records_stand_channel_by_channel(segment):
    """Those of the first log and then those of the second within each channel, as each alone."""
    scale = ResidualScale.of_records(segment.records)
    (runs,) = segment.run([{}])
    both = scale.residual_of(segment.records, runs).reshape(len(scale.scale), -1)
    alone = [
        scale.residual_of([record], (run,)).reshape(len(scale.scale), -1)
        for record, run in zip(segment.records, runs, strict=True)
    ]

    np.testing.assert_array_equal(both, np.hstack(alone))
    assert alone[0].shape[1] == pytest.approx(4 * alone[1].shape[1], abs=4)


def test_what_is_set_for_single_logs_is_not_estimated(segment):
    """The two loads differ, so that no single value of the load exists."""
    objective, _ = objective_of(segment, 0.03)

    assert segment.own_parameters == {"F_0"}
    assert {"K_L", "M"} <= set(objective.nominal.names)
    assert "F_0" not in objective.nominal.names


@pytest.mark.slow
def test_two_loads_tell_what_one_does_not(plant, leaking, alone):
    """At one pressure a leak that is proportional to it and one that grows with its root are the same.

    Alone, the first log has no relevant gap, and the second can't separate the two.
    """
    small, large = alone
    together = diagnose(plant, leaking)

    assert small.verdict == "no_gap"
    assert large.verdict == "ambiguous"
    assert {large.effects[0].id, *large.effects[0].ambiguous_with} >= {"internal_leakage", "orifice_leakage"}
    assert together.verdict == "effect"
    (cause,) = together.effects
    assert cause.id == "orifice_leakage"
    assert cause.parameters["K_t"].value == pytest.approx(6e-10, rel=0.1)
    content = together.to_dict()
    assert [row["path"] for row in content["logs"]] == [str(log.path) for log in leaking]
    for model in ("nominal", "with_effects"):
        squares = [row["gap"][model]["p1"] ** 2 for row in content["logs"]]
        assert content["gap"][model]["p1"] ** 2 == pytest.approx(np.mean(squares))
    assert content["location"]["log"] == "12000N.csv"
    assert "4000N.csv" in str(together) and "12000N.csv" in content["held_out"]


@pytest.mark.slow
def test_a_list_of_one_log_is_that_log(plant, leaking, alone):
    """The same result, and no `logs` beside it."""
    listed = diagnose(plant.set(**leaking[1].settings), [replace(leaking[1], settings={})]).to_dict()
    one = alone[1].to_dict()

    for content in (one, listed):
        content.pop("seconds")
        assert "logs" not in content
    assert one == listed


def short(seconds=4.0, step=0.004, channels=("current", "speed", "p1", "p2", "position"), path="a.csv"):
    time = step * np.arange(int(seconds / step))
    return Log(time, {name: np.sin(time) for name in channels}, path=Path(path))


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (short(step=0.005, path="b.csv"), "b.csv: has a sample time of 5 ms, but a.csv one of 4 ms"),
        (short(channels=("current", "speed", "position"), path="b.csv"), "b.csv: has no channel p1 and p2, but a.csv"),
        (short(channels=("current", "speed", "p1", "p2", "position", "force"), path="b.csv"), "a.csv: has no channel"),
        (short(path="./a.csv"), "is given twice"),
    ],
    ids=["sample time", "channels", "more channels", "twice"],
)
def test_logs_that_do_not_go_together(second, words):
    """A sentence with the file and what to do."""
    with pytest.raises(InputError, match=words):
        check_together([short(), second])


def test_each_log_must_be_long_enough(plant, leaking):
    """The sentence names the one that is not."""
    log = replace(leaking[1].rows(0, 500), path=Path("short.csv"))

    with pytest.raises(InputError, match=r"short.csv: lasts 2 s; a diagnosis needs at least 3 s"):
        diagnose(plant, [leaking[0], log])


def test_a_log_does_not_validate_itself():
    """By its file, or the same in Python; another log of the same length may."""
    log = short()
    for same in (log, short(path="./a.csv")):
        with pytest.raises(InputError, match="is also the log that is fitted; give another log"):
            check_other([log], same)
    check_other([log], short(path="b.csv"))


def test_no_log_is_an_error(plant):
    with pytest.raises(InputError, match="give at least one"):
        diagnose(plant, [])


@pytest.mark.slow
def test_offsets_may_differ_from_log_to_log(plant):
    """A pressure sensor that was zeroed by each of two days: one cause with a number for each log, no other."""
    free = {"p1@a.csv": 1.5e5, "p1@b.csv": -1e5}
    logs = []
    for seed, (name, bias) in enumerate(free.items()):
        log = recorded(plant, 0.0, seed, seconds=6.0)
        path = Path(name.partition("@")[2])
        logs.append(replace(log, settings={}, path=path, channels={**log.channels, "p1": log["p1"] + bias}))

    together = diagnose(plant, logs)

    (cause,) = together.effects
    assert (cause.id, cause.channel) == ("sensor_bias", "p1")
    found = {name: number.value for name, number in cause.parameters.items()}
    assert found == pytest.approx({"value@a.csv": 1.5e5, "value@b.csv": -1e5}, abs=1e4)
    assert together.gap["with_effects"]["total"] < 0.05 * together.gap["nominal"]["total"]
    content = together.to_dict()["effects"][0]["parameters"]
    assert [number["name"] for number in content.values()] == ["bias (a.csv)", "bias (b.csv)"]
    assert "value@b.csv = -1" in str(together)


def test_a_number_of_one_log_acts_there_alone(segment):
    """The other record is simulated with the shared numbers, to the last bit."""
    first, second = (
        replace(record, model=replace(record.model, label=name))
        for record, name in zip(segment.records, "ab", strict=True)
    )
    both = replace(segment, records=(first, second))

    own, shared, none = both.run([{"bias.p1@a": 1e5, "I_0@b": 0.1}, {"bias.p1": 1e5}, {"I_0": 0.1}])

    for channel in own[0]:
        np.testing.assert_array_equal(own[0][channel], shared[0][channel])
        np.testing.assert_array_equal(own[1][channel], none[1][channel])
