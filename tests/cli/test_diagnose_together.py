"""`ehsa-ctrl diagnose --together`: several logs, one diagnosis."""

import json

import pytest

import ehsa_ctrl

SPRING = 20e3


@pytest.fixture
def logs(tmp_path, plant):
    """Logs of the nominal plant of the same name in two folders, the second with a spring."""
    for folder, stiffness, seed in (("free", 0.0, 1), ("spring", SPRING, 2)):
        (tmp_path / folder).mkdir()
        time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=4.0, seed=3)
        rig = plant.set(K_S=stiffness)
        ehsa_ctrl.record(rig, time, current, seed=seed, centre=True)[0].write(tmp_path / folder / "log.csv")
    return "free/log.csv", "spring/log.csv"


def test_what_was_set_for_one_log_belongs_to_it(run, tmp_path, logs):
    """Without its spring the second log has a gap; with it neither has, and files and page show both logs."""
    call = ("diagnose", *logs, "--together", "--plant", "ehsa", "--log-set", f"spring/*:load.stiffness={SPRING:g}")

    status, out, _ = run(*call, "--out", "out")

    assert status == 0
    assert out.startswith("No relevant gap")
    assert "free/log.csv: total gap" in out and "spring/log.csv: total gap" in out
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert [row["path"] for row in found["logs"]] == list(logs)
    assert [row["settings"] for row in found["logs"]] == [{}, {"K_S": SPRING}]
    assert len(found["rests_on"]["files"]) == 3
    page = (tmp_path / "out" / "diagnosis.html").read_text()
    assert "2 logs on ehsa together" in page
    assert "Total gap of each log" in page
    for name in ("signals.csv", "signals-2.csv", "signals.svg", "signals-2.svg"):
        assert (tmp_path / "out" / name).is_file()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--log-set", "log.csv:K_S=1"), "--log-set is for logs that are diagnosed together; add --together"),
        (("--together", "--before", "free/log.csv"), "--before is for a single log"),
        (("--together", "--log-set", "no.csv:K_S=1"), "fits no log"),
        (("--together", "free/../free/log.csv"), "is given twice"),
    ],
)
def test_options_that_exclude_each_other(run, logs, options, words):
    status, _, err = run("diagnose", *logs, "--plant", "ehsa", *options)

    assert status == 2
    assert words in err
