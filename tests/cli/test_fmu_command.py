"""`ehsa-ctrl fmu` as a user meets it."""

import json

import pytest

pytest.importorskip("pythonfmu")


def test_a_file_or_a_folder(run, tmp_path):
    """The file is where it was asked for; what is believed is its start value; a second one needs --force."""
    status, out, err = run("fmu", "ehsa", "--set", "load.stiffness=50e3", "--out", "rig.fmu", "--json")
    variables = {variable["name"]: variable for variable in json.loads(out)["variables"]}

    assert (status, err) == (0, "") and (tmp_path / "rig.fmu").is_file()
    assert variables["K_S"]["start"] == 50e3 and variables["current"]["kind"] == "input"
    assert run("fmu", "ehsa", "--out", "deploy")[0] == 0 and (tmp_path / "deploy" / "ehsa.fmu").is_file()
    status, _, err = run("fmu", "ehsa", "--out", "deploy")
    assert status == 2 and "--force" in err
    status, out, _ = run("fmu", "ehsa", "--out", "deploy", "--force")
    assert status == 0 and "rod_sticks" in out


def test_a_wrong_model_is_a_sentence(run):
    status, _, err = run("fmu", "ehsa", "--model", "linera", "--out", "rig.fmu")

    assert status == 2 and "not one of 'linear', 'nonlinear'" in err
