"""Many logs: rows in their order, what is done is not done again, a bad log is a sentence and stops nothing."""

from types import SimpleNamespace

import joblib
import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis import batch as module
from ehsa_ctrl.diagnosis.batch import Row, diagnose_many
from ehsa_ctrl.diagnosis.diagnosis import Cause

TIME = 0.004 * np.arange(1000)


def log(size=1.0):
    wave = size * np.sin(5.0 * TIME) ** 2
    return Log(
        TIME, {"current": wave, "speed": 80.0 * wave, "p1": 2e6 + wave, "p2": 2e6 - wave, "position": 0.1 * wave}
    )


@pytest.fixture
def calls(monkeypatch):
    """Diagnoses that take no time: a leak where the current is large, an error where it is negative at its largest."""
    done = []

    def diagnose(plant, log, *, threshold, jobs, check):
        size = float(log["current"][np.argmax(np.abs(log["current"]))])
        done.append(size)
        if size < 0.0:
            raise InputError("the current has the wrong sign")
        if size > 50.0:
            raise np.linalg.LinAlgError("singular")
        leaks = size > 2.0
        cause = Cause("internal_leakage", None, "flow", 0.9, {}, ("orifice_leakage",))
        return SimpleNamespace(
            verdict="ambiguous" if leaks else "no_gap", effects=(cause,) if leaks else (),
            where=(("flow", 1.0),) if leaks else (), gap={"nominal": {"total": 0.2}, "with_effects": {"total": 0.01}},
            improved_gap={"total": 0.01},
            seconds=1.0, size=size, jobs=jobs,
        )  # fmt: skip

    monkeypatch.setattr(module, "diagnose", diagnose)
    return done


@pytest.fixture
def files(tmp_path):
    for name, size in (("a", 1.0), ("b", 3.0), ("c", 1.5)):
        log(size).write(tmp_path / f"{name}.csv")
    return [tmp_path / f"{name}.csv" for name in "abc"]


def test_rows_are_in_the_order_of_the_logs(plant, calls, files):
    """Whoever is done first; one thread each; what was found is in the row."""
    with joblib.parallel_config(backend="threading"):
        found = diagnose_many(plant, files, jobs=2)

    assert [row.file for row in found.rows] == [str(file) for file in files]
    assert [row.verdict for row in found.rows] == ["no_gap", "ambiguous", "no_gap"]
    assert found.rows[1].set == ("internal_leakage", "orifice_leakage")
    assert found.counts == {"no_gap": 2, "internal_leakage": 1}
    assert {one.jobs for one in found.diagnoses.values()} == {1}
    assert found.to_pandas().loc[str(files[1]), "place"] == "flow"


def test_what_is_there_is_not_done_again(plant, calls, files, tmp_path):
    """A file of rows is continued; a log that has changed is done anew, and the rows are as from one call."""
    file = tmp_path / "out" / "rows.jsonl"
    diagnose_many(plant, files[:2], file=file)
    log(9.0).write(files[0])

    found = diagnose_many(plant, files, file=file)

    assert len(calls) == 4
    assert sorted(calls[2:]) == pytest.approx([1.5, 9.0], rel=1e-3)
    assert [row.verdict for row in found.rows] == ["ambiguous", "ambiguous", "no_gap"]
    again = diagnose_many(plant, files, file=file)
    assert len(calls) == 4
    assert str(again) == str(found)


def test_an_interrupt_keeps_what_is_done(plant, calls, files, tmp_path):
    """Also a line that was cut off does no harm; the second call does what is missing."""

    def stop(done, total):
        assert total == 3
        raise KeyboardInterrupt

    file = tmp_path / "rows.jsonl"
    part = diagnose_many(plant, files, file=file, watch=stop)
    with file.open("a") as end:
        end.write('{"file": "b.c')

    whole = diagnose_many(plant, files, file=file)

    assert part.interrupted
    assert [row.file for row in part.rows] == [str(files[0])]
    assert not whole.interrupted
    assert len(whole.rows) == len(calls) == 3


def test_a_bad_log_is_a_sentence_in_its_row(plant, calls, files, tmp_path):
    """One that is not there, one that is refused, one on which the numbers break down; the others are diagnosed. What
    failed is tried again."""
    logs = [tmp_path / "no.csv", log(-1.0), log(99.0), files[0]]
    file = tmp_path / "rows.jsonl"

    found = diagnose_many(plant, logs, file=file)

    assert [bool(row.error) for row in found.rows] == [True, True, True, False]
    assert "no such file" in found.rows[0].error
    assert found.rows[1].error == "the current has the wrong sign"
    assert "singular" in found.rows[2].error
    assert len(found.failed) == found.counts["failed"] == 3
    assert found.rows[3].verdict == "no_gap"
    diagnose_many(plant, logs, file=file)
    assert len(calls) == 5


def test_what_is_kept_elsewhere_is_not_kept_twice(plant, calls, files):
    kept = {}
    found = diagnose_many(plant, files, keep=kept.__setitem__)

    assert list(kept) == [str(file) for file in files]
    assert not found.diagnoses


def test_rows_of_another_plant_are_not_mixed(plant, calls, files, tmp_path):
    """Nor of another threshold; and a file that holds something else is left alone."""
    file = tmp_path / "rows.jsonl"
    diagnose_many(plant, files[:1], file=file)

    with pytest.raises(InputError, match="another plant or threshold"):
        diagnose_many(plant.set(K_T=1.3), files[:1], file=file)
    with pytest.raises(InputError, match="another plant or threshold"):
        diagnose_many(plant, files[:1], threshold=0.1, file=file)
    with pytest.raises(InputError, match="is not a file of diagnoses"):
        diagnose_many(plant, files[:1], file=files[1])


def test_a_row_survives_its_file():
    """Numbers that are not there are null in JSON and nan again."""
    row = Row("a.csv", "no_gap", gap_before=0.01, gap_after=0.01, seconds=2.0, digest="12")

    back = Row.from_line(row.to_line())

    assert str(back) == str(row)


def test_bad_arguments_are_sentences(plant, files):
    with pytest.raises(InputError, match="no log to diagnose"):
        diagnose_many(plant, [])
    with pytest.raises(InputError, match="is given twice"):
        diagnose_many(plant, [files[0], files[0]])
    with pytest.raises(InputError, match="threshold"):
        diagnose_many(plant, files, threshold=3)
    with pytest.raises(InputError, match="jobs = 0"):
        diagnose_many(plant, files, jobs=0)


@pytest.mark.slow
def test_processes_find_what_this_one_finds(tmp_path):
    """A leak and a log without a gap, diagnosed on two workers: the same rows as one by one."""
    nominal = ehsa_ctrl.load_plant("ehsa").set(K_S=50e3)
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=5.0, seed=1)
    logs = []
    for name, rig in (("fine", nominal), ("leak", nominal.set(K_L=8 * nominal["K_L"]))):
        ehsa_ctrl.record(rig, time, current, seed=2, centre=True)[0].write(tmp_path / f"{name}.csv")
        logs.append(tmp_path / f"{name}.csv")

    found = diagnose_many(nominal, logs, jobs=2)

    assert [row.verdict for row in found.rows] == ["no_gap", "effect"]
    assert found.rows[1].cause == "internal_leakage"
    alone = ehsa_ctrl.diagnose(nominal, ehsa_ctrl.read_plant_log(logs[1], nominal), jobs=1)
    assert found.rows[1].gap_after == pytest.approx(alone.gap["with_effects"]["total"], rel=1e-6)
    assert found.diagnoses[str(logs[1])].to_dict()["effects"] == alone.to_dict()["effects"]


def test_logs_of_one_name_are_told_apart_by_their_folders(plant, calls, files, tmp_path, monkeypatch):
    """Each knows what it is called beside the others."""
    paths = [tmp_path / folder / "log.csv" for folder in ("morning", "evening")]
    for file, path in zip(files, paths, strict=False):
        path.parent.mkdir()
        file.rename(path)
    plain, names = module.diagnose, []

    def diagnose(plant, log, **how):
        names.append(log.name)
        return plain(plant, log, **how)

    monkeypatch.setattr(module, "diagnose", diagnose)
    diagnose_many(plant, paths)

    assert names == ["morning/log.csv", "evening/log.csv"]
