"""`ehsa-ctrl export` as a user meets it."""

import json
import shutil
import subprocess

import numpy as np
import pandas
import pytest

from ehsa_ctrl import scenarios
from ehsa_ctrl.scenario import recorded_runs


def test_source_test_and_vector_are_written(run, tmp_path):
    """All files; the vector holds saturation, a reading that is lost for a moment and one that stays away."""
    status, out, err = run("export", "cascade_position", "--out", "deploy", "--json")
    result = json.loads(out)
    table = pandas.read_csv(tmp_path / "deploy" / "test_vector.csv")

    assert (status, err) == (0, "")
    expected = {"controller.c", "controller.h", "test.c", "Makefile", "README.md", "test_vector.csv"}
    expected |= {".ehsa_ctrl-export.json"}
    assert {path.name for path in (tmp_path / "deploy").iterdir()} == expected
    assert len(table) == result["samples"] == 750
    assert result["samples_limited"] >= 1 and np.isclose(table["current"].abs().max(), 6.0)
    lost = table["position"].isna().to_numpy()
    assert lost[75:80].all() and not lost[80:600].any() and lost[-1]
    assert table["current"].iloc[-1] == 0.0
    if shutil.which("cc") is None or shutil.which("make") is None:
        pytest.skip("there is no C compiler here")
    subprocess.run(["make", "-s", "-C", str(tmp_path / "deploy"), "test"], check=True, capture_output=True)


def test_what_is_believed_reaches_the_gains(run, tmp_path):
    """A design on another torque constant is another controller."""
    assert run("export", "pid_position", "--out", "one")[1].endswith("make -C one test\n")
    run("export", "pid_position", "--set", "K_T=1.0", "--out", "two")

    assert (tmp_path / "one" / "controller.c").read_text() != (tmp_path / "two" / "controller.c").read_text()


def test_an_unknown_controller_is_a_sentence(run):
    status, _, err = run("export", "pid_positon", "--out", "deploy")

    assert status == 2 and "did you mean" in err and "pid_position" in err


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler here")
def test_a_check_has_a_page(run, monkeypatch, tmp_path):
    """Word lengths of every signal and the error of every run; `report` finds it. One scenario will do."""
    runs = recorded_runs.recorded_runs
    monkeypatch.setattr(recorded_runs, "recorded_runs", lambda _, *given: runs([scenarios.saturated_step], *given))
    status, out, _ = run("export", "pid_position", "--number", "q31", "--check", "--out", "deploy")
    page = (tmp_path / "deploy" / "report.html").read_text()
    stored = json.loads((tmp_path / "deploy" / "check.json").read_text())

    assert status == 0 and "(open deploy/report.html)" in out
    assert all(
        name in page for name in (*stored["signals"], *stored["runs"], "headroom", "Usable: the current differs")
    )
    assert stored["controller"] == "pid_position" and stored["rests_on"]["files"]
    assert run("report", "deploy")[0] == 0
