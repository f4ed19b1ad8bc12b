"""`ehsa-ctrl report`, and the page that commands write beside their result."""

import json
import shutil
import sys

import pytest

from ehsa_ctrl.cli import main as entry


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a simulation, whose log is compared, and a design; made once, as simulating takes its time."""
    folder = tmp_path_factory.mktemp("made")
    calls = (
        ("simulate", "ehsa", "--excitation", "steps", "--duration", "2", "--centre", "--out", "all/bench"),
        ("compare", "all/bench/log.csv", "--plant", "ehsa", "--out", "all/beside"),
        ("design", "ehsa", "--kind", "pid", "--bandwidth", "35 rad/s", "--phase-margin", "60 deg", "--out", "all/pid"),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for arguments in calls:
            patch.setattr(sys, "argv", ["ehsa-ctrl", *arguments])
            with pytest.raises(SystemExit) as stopped:
                entry.main()
            assert not stopped.value.code
    return folder / "all"


@pytest.fixture
def results(made, tmp_path):
    """The same in the folder of a test."""
    shutil.copytree(made, tmp_path / "all")


def test_one_page_of_a_folder(run, results, tmp_path):
    """Every result below the folder is in it, and each command has left a page of its own."""
    status, out, err = run("report", "all")
    text = (tmp_path / "all" / "overview.html").read_text(encoding="utf-8")

    assert status == 0 and err == "" and out.endswith("written to all/overview.html\n")
    for place in ("bench", "beside", "pid"):
        assert (tmp_path / "all" / place / "report.html").is_file()
        assert f"in {place}<" in text
    assert text.count("<img") >= 5
    assert "ehsa-ctrl simulate ehsa --excitation steps" in text


def test_a_page_rests_on_what_its_json_says(run, results, tmp_path):
    """Hashes of plant and log, assumed parameters with their range, the command line."""
    rests_on = json.loads((tmp_path / "all" / "beside" / "comparison.json").read_text())["rests_on"]

    assert {name.rpartition("/")[2] for name in rests_on["files"]} == {"log.csv", "ehsa.toml"}
    assert all(len(digits) == 16 for digits in rests_on["files"].values())
    assert "0.87 to 1.6 N m/A" in {row["range"] for row in rests_on["assumed"]}
    assert rests_on["command"].startswith("ehsa-ctrl compare all/bench/log.csv")


def test_json_names_every_result(run, results, tmp_path):
    """Kind, file and sentences of each; the page goes to another folder if one is given."""
    status, out, _ = run("report", "all", "--json", "--out", "to_send")
    answer = json.loads(out)

    assert (tmp_path / "to_send" / "overview.html").is_file()
    assert status == 0 and answer["left_out"] == []
    assert [each["kind"] for each in answer["results"]] == ["simulation", "comparison", "design"]
    assert answer["results"][0]["good"] and "No plant limit was exceeded." in answer["results"][0]["sentences"]


def test_a_folder_without_results_is_one_sentence(run, tmp_path):
    """And so is one that is not there, and a JSON that is another program's."""
    (tmp_path / "results.json").write_text("{")
    for folder in (".", "absent"):
        status, out, err = run("report", folder)

        assert status == 2 and out == "" and err.count("\n") == 1
