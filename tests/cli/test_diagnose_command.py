"""`ehsa-ctrl diagnose` with several logs, an earlier log, or a scenario."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas
import pytest

import ehsa_ctrl
from ehsa_ctrl.cli.diagnose import _then, prepare_case
from ehsa_ctrl.core.controller_interface import MEASURED
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.closed_loop import check_replay, compare_loops
from ehsa_ctrl.diagnosis.diagnosis import MODELS, Diagnosis
from ehsa_ctrl.report.closed_loop import closed_table

SCENARIO = """\
schema = 1
title = "Two moves"
why = "Tests need a run that takes little time."
plant = "ehsa"
controller = "pid_position"
duration = "2 s"
load = { stiffness = "20 kN/m" }

[reference]
kind = "moves"
times = ["0.1 s", "1 s"]
positions = ["8 mm", "-4 mm"]
durations = ["0.3 s", "0.4 s"]

[limits]
MaxError = { max = "20 mm" }
"""
GAPS = {"speed": 0.1, "p1": 0.1, "p2": 0.1, "rod_velocity": 0.1, "total": 0.1}


@pytest.fixture
def scenario(tmp_path, monkeypatch):
    """A project's scenario with a spring of 20 kN/m."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "scenarios" / "moves.toml").write_text(SCENARIO)
    return "moves"


def bench(name, rig, seconds=4.0, seed=1):
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=seconds, seed=3)
    ehsa_ctrl.record(rig, time, current, seed=seed, centre=True)[0].write(name)


def diagnosis(plant, log, improved):
    """One made by hand: nothing is searched for."""
    return Diagnosis(
        plant=plant, log=log, threshold=0.03, verdict="effect", where=(), effects=(),
        gap=dict.fromkeys(MODELS, GAPS), whole=GAPS, held_out="nothing",
        noise_sd=dict.fromkeys(("speed", "p1", "p2", "position"), 0.0), values={}, simulated={}, improved=improved,
    )  # fmt: skip


def recorded(case, rig):
    """What a controller saw and asked for in a run of the case on a rig."""
    loop = case.simulate(rig)
    channels = dict(zip(MEASURED, loop.measured.T, strict=True)) | {"current": loop.asked}
    return Log(loop.trajectory.time, channels)


@pytest.fixture
def worn(plant):
    """A rig that differs from the plant by much friction on the rod, under the scenario's spring."""
    return plant.set(K_S=20e3, A_FR=2.0 * plant["A_FR"])


def test_an_improved_plant_that_is_the_rig_closes_the_gap_of_the_loop(scenario, plant, worn):
    """Simulated without noise it runs as the log, that of the believed plant does not; and it is the controller's own
    current."""
    case = prepare_case(scenario, None, plant)
    log = recorded(case, worn)

    found = compare_loops(case, diagnosis(plant.set(K_S=20e3), log, worn), replay=True)

    assert found.replay.gap["nominal"]["total"] > 0.1
    assert found.replay.gap["with_effects"]["total"] < 0.2 * found.replay.gap["nominal"]["total"]
    assert found.replay.seconds == pytest.approx(2.0)
    assert found.replay.drive_difference < 1e-9
    assert found.metrics["improved"]["Energy"] > found.metrics["believed"]["Energy"]
    assert closed_table(found.to_dict())[0] == ["nominal plant", "improved plant"]


def test_a_current_of_another_loop_is_seen(scenario, plant, worn):
    """What the LQR asked for is not what the PID asks for on the same measurements."""
    log = recorded(prepare_case(scenario, "lqr_position", plant), worn)

    found = compare_loops(prepare_case(scenario, None, plant), diagnosis(plant.set(K_S=20e3), log, worn), replay=True)

    assert found.replay.drive_difference > 0.2


def test_both_plants_have_the_scenarios_load(scenario, plant):
    """The same plant gives the same metrics whatever spring was there when the log was recorded; but a spring that the
    diagnosis found is there in the scenario."""
    case = prepare_case(scenario, None, plant)
    log = recorded(case, plant.set(K_S=20e3))

    same = compare_loops(case, diagnosis(plant.set(K_S=70e3), log, plant.set(K_S=70e3)))
    other = compare_loops(case, diagnosis(plant.set(K_S=0.0), log, plant.set(K_S=90e3)))

    assert same.metrics["believed"] == pytest.approx(same.metrics["improved"], nan_ok=True)
    assert same.metrics["believed"] == pytest.approx(other.metrics["believed"], nan_ok=True)
    stiff = case.metrics(case.simulate(plant.set(K_S=90e3)))
    assert other.metrics["improved"] == pytest.approx(stiff, nan_ok=True)
    assert stiff["CurrentRMS"] > 1.05 * other.metrics["believed"]["CurrentRMS"]
    assert other.to_dict()["metrics"]["Energy"].keys() == {"believed", "improved", "unit"}


def test_without_a_cause_there_is_one_plant(scenario, plant):
    case = prepare_case(scenario, None, plant)
    log = recorded(case, plant.set(K_S=20e3))

    found = compare_loops(case, diagnosis(plant, log, None), replay=False)

    assert list(found.metrics) == ["believed"]
    assert found.to_dict()["passed"] == {"believed": True}
    assert found.to_dict()["replay"] is None


def test_a_log_that_is_not_of_this_loop_is_refused(scenario, plant):
    case = prepare_case(scenario, None, plant)
    log = recorded(case, plant.set(K_S=20e3))

    check_replay(case, plant.set(K_S=20e3), log)
    with pytest.raises(
        InputError, match=r"K_S \(load.stiffness\) is 20000 in scenario moves and 0 in the plant of the log"
    ):
        check_replay(case, plant, log)
    slow = Log(2.0 * log.time, log.channels)
    with pytest.raises(InputError, match=r"has a sample time of 0\.008 s, controller pid_position of 0\.004 s"):
        check_replay(case, plant.set(K_S=20e3), slow)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("no.csv",), "no.csv: no such file"),
        (("log.csv", "--from", "9"), "log.csv: from 9 to 4 s there are 0 samples"),
        (("log.csv", "--zero", "p3"), "no zero of 'p3'"),
        (("p2", "--zero", "p1"), "p2: no such log; separate channels by commas without blanks"),
        (("log.csv", "--resample", "-1"), "the rate must be a number greater than 0"),
        (("log.csv", "--align", "force"), "no alignment of 'force'"),
        (("log.csv", "other.csv", "--from", "9"), "log.csv: from 9 to 4 s there are 0 samples"),
        (("log.csv", "other.csv", "--zero", "p3"), "log.csv: no zero of 'p3'"),
        (("log.csv", "--scenario", "moves", "--replay", "--to", "3"), "leave out --from and --to"),
        (("log.csv", "log.csv"), "log.csv: is given twice; give it once"),
        (("log.csv", "other.csv", "--before", "a.csv"), "--before is for a single log, but 2 are given"),
        (("log.csv", "other.csv", "--validate", "a.csv"), "--validate is for a single log, but 2 are given"),
        (("log.csv", "other.csv", "--scenario", "moves"), "--scenario is for a single log, but 2 are given"),
        (("log.csv", "other.csv", "--backend", "loki"), "backend 'loki' is not known"),
        (("log.csv", "--before", "no.csv"), "no.csv: no such file"),
        (("log.csv", "--before", "log.csv"), "is given as both the earlier and the later log"),
        (("log.csv", "--before", "a.csv", "--validate", "b.csv"), "--validate and --before exclude each other"),
        (("log.csv", "--replay"), "--replay needs a scenario; name it with --scenario"),
        (("log.csv", "--controller", "pid_position"), "has no channel reference, which the closed-loop replay with"),
        (("log.csv", "--controller", "pd"), "no controller 'pd'"),
        (("log.csv", "other.csv", "--controller", "pid_position"), "--controller is for a single log, but 2 are given"),
        (("log.csv", "--scenario", "mov"), "no scenario 'mov'; did you mean 'moves'?"),
        (("log.csv", "--scenario", "moves", "--controller", "pd"), "no controller 'pd'"),
        (("log.csv", "--scenario", "carriage"), "scenario carriage is for emps"),
        (("log.csv", "--scenario", "moves", "--replay"), "K_S (load.stiffness) is 20000 in scenario moves and 0"),
    ],
)
def test_what_is_wrong_is_a_sentence(run, scenario, tmp_path, plant, arguments, says):
    """Exit status 2 before any work is done."""
    bench("log.csv", plant)
    (tmp_path / "other.csv").write_bytes((tmp_path / "log.csv").read_bytes())
    (tmp_path / "scenarios" / "carriage.toml").write_text(SCENARIO.replace('"ehsa"', '"emps"'))

    status, out, err = run("diagnose", *arguments, "--plant", "ehsa")

    assert status == 2
    assert not out
    assert err.startswith("ehsa-ctrl: ")
    assert says in err


@pytest.mark.slow
def test_several_logs_get_a_folder_each(run, tmp_path, plant):
    """And a summary; one that is bad is a sentence, and the others are done. Called again nothing is done twice; status
    2 is for all bad."""
    bench("fine.csv", plant)
    bench("short.csv", plant, seconds=1.0)
    call = ("diagnose", "fine.csv", "short.csv", "no.csv", "--plant", "ehsa", "--jobs", 1, "--out", "out")

    status, out, _ = run(*call)

    assert status == 0
    assert "lasts 1 s; a diagnosis needs at least 3 s" in " ".join(out.split())
    assert json.loads((tmp_path / "out" / "fine" / "diagnosis.json").read_text())["verdict"] == "no_gap"
    rows = pandas.read_csv(tmp_path / "out" / "summary.csv").set_index("file")
    assert rows.loc["fine.csv", "verdict"] == "no_gap"
    assert rows.loc["no.csv", "error"] == "no.csv: no such file"
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written["counts"] == {"failed": 2, "no_gap": 1}

    page = tmp_path / "out" / "fine" / "diagnosis.html"
    page.unlink()
    status, out, _ = run(*call, "--json")
    again = json.loads(out)
    assert again["logs"][0] == written["logs"][0]
    assert not page.exists()
    assert run("diagnose", "short.csv", "no.csv", "--plant", "ehsa", "--jobs", 1)[0] == 2


def test_logs_of_one_name_go_by_their_folders(run, tmp_path, plant):
    """In the table and in the result's folders; the same file twice is refused by its path."""
    for folder in "ab":
        (tmp_path / folder).mkdir()
        bench(f"{folder}/log.csv", plant, seconds=1.0)
    status, out, err = run("diagnose", "a/log.csv", "b/log.csv", "--plant", "ehsa", "--jobs", 1, "--out", "out")

    assert status == 2 and "twice" not in err
    assert "a/log.csv  failed" in out and "b/log.csv  failed" in out
    status, out, err = run("diagnose", "a/log.csv", "./a/../a/log.csv", "--plant", "ehsa")
    assert (status, err) == (2, "ehsa-ctrl: a/log.csv: is given twice; give it once\n")


@pytest.mark.slow
def test_a_log_is_prepared_as_asked(run, tmp_path, plant):
    """As for identify: segment of the log alone, zero of both; in the JSON, on the page, and for several logs. The
    offset that --zero took off is no cause any more."""
    _, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=6.0, seed=3)
    drive = np.concatenate([np.zeros(100), current])
    for name, seed in (("log.csv", 1), ("other.csv", 2)):
        log, _ = ehsa_ctrl.record(plant, 0.004 * np.arange(drive.size), drive, seed=seed, centre=True)
        Log(log.time, {**log.channels, "p1": log["p1"] + 1.5e5}).write(tmp_path / name)
    call = ("--plant", "ehsa", "--to", "5.5", "--zero", "p1,p2", "--rest", "0:0.4")

    status, out, _ = run("diagnose", "log.csv", "--validate", "other.csv", *call, "--out", "out", "--json")

    found = json.loads(out)
    done = [(step["log"], step["kind"]) for step in found["preparation"]]
    assert status == 0 and found["verdict"] == "no_gap"
    assert done == [("log.csv", "zero")] * 2 + [("log.csv", "segment")] + [("other.csv", "zero")] * 2
    written = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert written["preparation"] == found["preparation"]
    assert written["preparation"][0]["shift"] == pytest.approx(-1.5e5, rel=0.05)
    page = (tmp_path / "out" / "diagnosis.html").read_text()
    assert "Preparation:" in page and "log.csv: segment from 0 to 5.5 s" in page

    status, _, err = run("diagnose", "log.csv", "no.csv", *call, "--resample", 200, "--threshold", 0.2, "--jobs", 1,
                         "--out", "all")  # fmt: skip
    rows = pandas.read_csv(tmp_path / "all" / "summary.csv").set_index("file")
    steps = json.loads((tmp_path / "all" / "log" / "diagnosis.json").read_text())["preparation"]
    assert status == 0 and "resampling alone causes a gap" in err
    assert rows.loc["log.csv", "verdict"] == "no_gap" and rows.loc["no.csv", "error"] == "no.csv: no such file"
    assert [step["kind"] for step in steps] == ["resample", "zero", "zero", "segment", "caution"]
    assert json.loads((tmp_path / "all" / "summary.json").read_text())["preparation"] == steps


@pytest.mark.slow
def test_an_earlier_log_and_a_scenario(run, scenario, tmp_path, plant):
    """Two logs of the plant as it is: nothing changed; what is said of the first log is written, and the closed loop
    beside it."""
    bench("then.csv", plant, seed=1)
    bench("now.csv", plant, seed=2)
    call = ("diagnose", "now.csv", "--before", "then.csv", "--plant", "ehsa", "--scenario", "moves", "--out", "out")

    status, out, _ = run(*call)

    assert status == 0
    assert out.startswith("No relevant change between the logs.")
    assert "moves with pid_position:" in out
    assert "No cause was named" in out
    found = {name: json.loads((tmp_path / "out" / f"{name}.json").read_text()) for name in
             ("diagnosis", "before", "closed_loop")}  # fmt: skip
    assert found["diagnosis"]["verdict"] == found["before"]["verdict"] == "no_gap"
    assert "now.csv" in found["diagnosis"]["held_out"]
    assert "then.csv" in found["before"]["held_out"]
    assert np.isfinite(found["closed_loop"]["metrics"]["Energy"]["before"])
    assert ehsa_ctrl.load_plant(tmp_path / "out" / "ehsa_before.toml")["J_M"] == pytest.approx(plant["J_M"], rel=0.05)
    assert json.loads(run(*call, "--force", "--json")[1]).keys() >= {"change", "closed_loop"}


@pytest.mark.parametrize(
    ("verdict", "refit", "words"),
    [
        ("effect", 0.3, "use the corrected plant as --plant x.toml"),
        ("partly", 0.3, "use the partly corrected plant"),
        ("outside_catalogue", 0.05, "use the refitted (no cause is named) plant"),
        ("outside_catalogue", 0.3, "the refitted plant x.toml leaves more of held-out data than the nominal one: keep"),
    ],
)
def test_a_plant_is_recommended_that_is_better_than_the_nominal_one(verdict, refit, words):
    """On held-out data, where the nominal plant leaves 10 %."""
    found = SimpleNamespace(law=None, verdict=verdict, gap={"nominal": {"total": 0.1}, "refit": {"total": refit}})

    assert words in _then(found, Path("x.toml"))
