"""`ehsa-ctrl learn`: its files, and a scenario with the learnt trajectory."""

import json
from pathlib import Path

import pandas
from short_move import SHORT

MOVE = SHORT.replace("pid_position", "cascade_friction")


def test_the_trajectory_that_it_writes_is_one_that_a_scenario_follows(run):
    Path("short.toml").write_text(MOVE)
    status, out, _ = run("learn", "short.toml", "--trials", "2", "--out", "learnt", "--json")

    content = json.loads(out)
    assert status == 0 and content["trials"][2]["rms"] < content["trials"][0]["rms"]
    assert {path.name for path in Path("learnt").iterdir()} >= {
        "learning.json",
        "report.html",
        "trajectory.csv",
        "learning.png",
    }
    assert list(pandas.read_csv("learnt/trajectory.csv")) == ["t", "position", "velocity", "acceleration"]
    head, _, _ = MOVE.partition("[reference]")
    text = f'{head}[reference]\nkind = "file"\nfile = "learnt/trajectory.csv"\n'
    Path("again.toml").write_text(text.replace("1.2 s", "1.3 s"))
    assert run("check", "again.toml")[0] == 0
    assert run("learn", "short.toml", "--out", "learnt")[0] == 2


def test_wrong_input_is_one_sentence(run):
    for arguments, says in (
        (("steps_spring",), "its target jumps"),
        (("press_cycle", "--cutoff", "10 mm"), "Hz"),
        (("press_cycle", "--controller", "pid_position,lqr_position"), "one controller at a time"),
    ):
        status, _, err = run("learn", *arguments)
        assert status == 2 and says in err and len(err.strip().splitlines()) == 1
