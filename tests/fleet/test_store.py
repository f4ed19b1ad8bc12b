"""The store: continued after any end, each log once, one plant, damage and a full disk in one sentence."""

import errno
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core import files as files_module
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.fleet import analyse as module
from ehsa_ctrl.fleet.store import Store

from .scores import made_up

pytest.importorskip("pyarrow")
pytest.importorskip("duckdb")

#: A second process that scores slowly, so that it is killed in the middle.
SLOW = """
import sys, time
import numpy as np
from ehsa_ctrl.fleet import analyse as module
from tests.fleet.test_store import scored
import ehsa_ctrl as e

def slow(plant, log, *, check):
    time.sleep(0.3)
    return scored(plant, log, check=check)

module.log_score = slow
e.analyse_fleet("ehsa", sys.argv[1], store=sys.argv[2], diagnose=False)
"""


def scored(plant, log, *, check=True):
    """A score that takes no time: the mean of the current is the effect."""
    seed = int(abs(log["speed"][0]) * 1e3)
    return made_up([0.0, 0.0, float(np.mean(log["current"]))], np.random.default_rng(seed))


def write(folder, name, day, current, seed=0):
    t = 0.004 * np.arange(50)
    path = folder / name / f"2026-01-{day:02d}.csv"
    channels = {"current": np.full(50, current) + 0.01 * np.sin(t), "speed": np.full(50, float(seed)) + np.sin(t)}
    Log(t, channels | {"position": 0.01 * np.cos(t)}).write(path)
    return path


@pytest.fixture
def logs(tmp_path):
    """Three rigs with three logs each; the second changes before its last log."""
    for number, rig in enumerate(("a", "b", "c")):
        for day in range(1, 4):
            write(tmp_path / "logs", rig, day, 30.0 if (rig, day) == ("b", 3) else 0.0, seed=10 * number + day)
    return tmp_path / "logs"


@pytest.fixture
def calls(monkeypatch):
    done = []

    def score(plant, log, *, check):
        done.append(log.path.parent.name + log.path.stem[-2:])
        return scored(plant, log)

    monkeypatch.setattr(module, "log_score", score)
    return done


def analyse(logs, **more):
    return e.analyse_fleet("ehsa", logs, store=logs.parent / "store", diagnose=False, **more)


def test_what_is_finished_is_not_computed_again(logs, calls):
    """But a log that has changed, and a new one, are."""
    first = analyse(logs)
    assert (first.computed, first.kept, len(calls)) == (9, 0, 9)
    assert [(rig.name, rig.cause, rig.since[:10]) for rig in first.changed] == [("b", "leak", "2026-01-03")]

    again = analyse(logs)
    assert (again.computed, again.kept, len(calls)) == (0, 9, 9)
    assert again.to_pandas().equals(first.to_pandas())

    write(logs, "a", 2, 0.0, seed=77)
    write(logs, "c", 4, 0.0, seed=78)
    third = analyse(logs)
    assert (third.computed, third.kept) == (2, 8) and calls[9:] == ["a02", "c04"]


def test_stamps_of_a_log_date_it(tmp_path, monkeypatch):
    """A name without a date leaves it to the log's own stamps; the time of the file counts for a log without any."""
    monkeypatch.setattr(module, "log_score", lambda plant, log, *, check: replace(scored(plant, log), start=log.start))
    t = 0.004 * np.arange(50)
    for name, start in (("late", 1.77e9), ("early", 1.76e9), ("none", None)):
        path = tmp_path / "logs" / "a" / f"{name}.csv"
        Log(t, {"current": np.sin(t), "speed": np.cos(t) + len(name)}).write(path)
        if start is not None:
            head, *rows = path.read_text().splitlines()
            stamps = (f"{1000 * start + 4 * i:.0f}," + row.partition(",")[2] for i, row in enumerate(rows))
            path.write_text("\n".join([head, *stamps]) + "\n")

    found = analyse(tmp_path / "logs")

    assert [(Path(log.file).stem, log.dated) for log in found.rigs[0].logs] == [
        ("early", "stamps"), ("late", "stamps"), ("none", "file time")
    ]  # fmt: skip
    assert found.rigs[0].logs[0].date == "2025-10-09T08:53:20+00:00"
    assert "no date but the time at which the file was written: 1" in found.notes[-1]


@pytest.mark.slow
def test_a_killed_computation_continues(logs, calls, tmp_path):
    """kill -9 in the middle: no half part is left, and what was finished is kept."""
    root = Path(__file__).parents[2]
    paths = os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])])
    words = [sys.executable, "-c", SLOW, str(logs), str(tmp_path / "store")]

    def finished():
        return len([p for p in tmp_path.glob("store/scores/*/*.parquet") if not p.name.startswith(".")])

    process = subprocess.Popen(words, env=os.environ | {"PYTHONPATH": paths}, cwd=root)
    try:
        until = time.monotonic() + 60.0
        while finished() < 2:
            assert time.monotonic() < until and process.poll() is None
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    kept = finished()

    found = analyse(logs)

    assert 2 <= kept < 9
    assert (found.computed, found.kept) == (9 - kept, kept)
    assert [rig.name for rig in found.changed] == ["b"]


def test_a_store_holds_one_plant(logs, calls):
    """With other values it is another one."""
    analyse(logs)

    with pytest.raises(InputError, match=r"store: holds the fleet of a plant with other values; give another folder"):
        e.analyse_fleet(e.load_plant("ehsa").set(K_T=1.3), logs, store=logs.parent / "store")


def test_a_damaged_part_is_a_sentence(logs, calls):
    """And deleting it is enough."""
    analyse(logs)
    part = sorted(logs.parent.glob("store/scores/*/*.parquet"))[0]
    part.write_bytes(part.read_bytes()[:300])

    with pytest.raises(InputError, match=r"parquet: is damaged \(.*\); delete this file, and the same command"):
        analyse(logs)
    part.unlink()
    assert analyse(logs).computed == 1


def test_a_full_disk_is_a_sentence(logs, calls, monkeypatch):
    """What was written before is kept."""
    real, written = files_module.Path.replace, []

    def replace(self, target):
        if target.suffix == ".parquet":
            written.append(target)
            if len(written) > 4:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(files_module.Path, "replace", replace)
        with pytest.raises(InputError, match=r"can't be written \(No space left on device\)"):
            analyse(logs)
    assert analyse(logs).kept == 4


def test_a_bad_log_stops_no_other(logs, calls):
    """It is in the result with its sentence."""
    (logs / "a" / "2026-01-02.csv").write_text("nothing\n1\n")

    found = analyse(logs)

    ((file, why),) = found.failed.items()
    assert file.endswith("2026-01-02.csv") and "2026-01-02.csv" in why
    assert found.log_count == 8 and len(found.rig("a").logs) == 2


def test_only_bad_logs_are_a_sentence(tmp_path, calls):
    (tmp_path / "logs" / "a").mkdir(parents=True)
    (tmp_path / "logs" / "a" / "x.csv").write_text("nothing\n1\n")

    with pytest.raises(InputError, match="no log could be used; the first: "):
        analyse(tmp_path / "logs")


def test_a_copy_counts_once(logs, calls):
    """Under another name, with a note."""
    (logs / "a" / "2026-01-09.csv").write_bytes((logs / "a" / "2026-01-01.csv").read_bytes())

    found = analyse(logs)

    assert found.log_count == 9 and "it counts once" in found.notes[0]


def test_the_store_is_asked_in_sql(logs, calls):
    """The tables of the result; nothing else can be read or changed."""
    found = analyse(logs)

    began = time.perf_counter()
    answer = found.query("select rig, cause from rigs where changed")
    assert time.perf_counter() - began < 5.0  # a fraction of a second on an idle machine
    assert answer.values.tolist() == [["b", "leak"]]
    count = e.query_store(logs.parent / "store", "select count(*) as n from estimates where name = 'K_T'")
    assert count["n"].tolist() == [9]
    for wrong in ("select nix from rigs", "select * from read_csv('/etc/passwd')", "copy rigs to 'x.csv'", "drop"):
        with pytest.raises(InputError, match="its tables are drifts, estimates, logs, parameters, rigs"):
            found.query(wrong)
    assert sorted(found.query("select * from rigs")["rig"]) == ["a", "b", "c"]


def test_no_store_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match="has no tables to ask; expected the store of a fleet"):
        e.query_store(tmp_path, "select 1")
    with pytest.raises(InputError, match="is not the store of a fleet"):
        Store(tmp_path)
    (tmp_path / "fleet-store.json").write_text("[1]")
    with pytest.raises(InputError, match="is not the head of a store"):
        Store(tmp_path)


def test_a_score_is_stored_as_it_is(tmp_path, plant):
    """The information in single precision."""
    store = Store(tmp_path / "store", plant)
    store.begin()
    score = made_up([0.1, 0.0, 2.0], np.random.default_rng(1))

    store.put("ab" * 16, score)
    found = store.get("ab" * 16)

    assert (found.names, found.nominal, found.causes, found.rms) == (score.names, 2, score.causes, score.rms)
    assert found.score == pytest.approx(score.score, rel=1e-12)
    assert found.information == pytest.approx(score.information, rel=1e-6)


@pytest.mark.slow
def test_a_dask_cluster_computes_the_same(logs, tmp_path):
    """A real scheduler with a worker of its own, through joblib's context."""
    pytest.importorskip("dask.distributed")
    from dask.distributed import Client, LocalCluster

    with pytest.MonkeyPatch.context() as patch:
        # The worker is a thread of this process, so that it sees the fast score.
        patch.setattr(module, "log_score", scored)
        alone = analyse(logs)
        with (
            LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster,
            Client(cluster),
            joblib.parallel_config(backend="dask"),
        ):
            found = e.analyse_fleet("ehsa", logs, store=tmp_path / "other", diagnose=False)

    assert found.computed == 9
    assert found.to_pandas().equals(alone.to_pandas())
