"""`ehsa-ctrl excite` as a user meets it."""

import json
import shlex

import pandas
import pytest

QUICK = ("excite", "ehsa", "--kind", "sine", "--duration", "3", "--rehearsals", "2")


@pytest.mark.slow
def test_the_table_is_for_people(run):
    """Parameters with their sd, limits, candidates, and how to go on; nothing on standard error."""
    status, out, err = run(*QUICK)

    assert (status, err) == (0, "")
    assert "expected sd" in out and "at worst" in out
    assert "stroke" in out and "% of the way to 100" in out
    assert sum(line.split()[0] in ("J_M", "A_FM", "A_FR", "K_L") for line in out.splitlines() if line.strip()) == 4
    assert "--out DIR" in out


@pytest.mark.slow
def test_files_are_written_and_not_overwritten(run, tmp_path):
    """JSON, the current and figures; an existing result stays unless --force is said."""
    status, out, _ = run(*QUICK, "--out", "out", "--json")
    result = json.loads(out)
    table = pandas.read_csv(tmp_path / "out" / "current.csv")

    assert status == 0
    assert json.loads((tmp_path / "out" / "excitation.json").read_text()) == result
    assert list(table.columns) == ["t", "current"] and len(table) == 751
    assert table["current"].abs().max() == pytest.approx(result["peak"], abs=1e-6)
    assert all(use["share"] <= 0.85 and use["worst_share"] <= 1.0 for use in result["limits"].values())
    assert {"excitation.png", "excitation.svg"} <= {path.name for path in (tmp_path / "out").iterdir()}
    status, _, err = run(*QUICK, "--out", "out")
    assert status == 2 and "is part of an earlier result" in err
    assert run(*QUICK, "--out", "out", "--force")[0] == 0


@pytest.mark.slow
def test_the_commands_it_names_work(run, tmp_path):
    """The bench run passes no limit, and what is identified from it has the sd that was promised."""
    _, out, _ = run(*QUICK, "--set", "K_T=1.3", "--fix", "C_FM,C_FR,K_L", "--out", "my folder", "--json")
    promised = json.loads(out)
    simulate, identify = (shlex.split(line)[1:] for line in promised["next"])
    status, out, err = run(*simulate)
    assert (status, err) == (0, "") and "stopped" not in out
    status, out, _ = run(*identify, "--json")
    found = json.loads(out)["parameters"]

    assert status == 0 and set(found) == set(promised["parameters"])
    for name, expected in promised["parameters"].items():
        assert found[name]["sd"] == pytest.approx(expected["sd"], rel=0.3), name
        assert abs(found[name]["value"] - expected["believed"]) < 5 * expected["sd"], name


@pytest.mark.slow
def test_what_is_not_determined_is_a_warning(run):
    """Of the linear plant only V/beta shows."""
    status, _, err = run(*QUICK, "--model", "linear", "--free", "beta")

    assert status == 0
    assert "V is not determined by this input; it trades off against beta: --fix one of them" in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nothing",), "nothing"),
        (("ehsa", "--model", "cubic"), "not one of 'linear', 'nonlinear'"),
        (("ehsa", "--kind", "sin"), "did you mean 'sine'"),
        (("ehsa", "--duration", "0.1"), "expected 1 to 600 s"),
        (("ehsa", "--free", "K_X"), "can't be estimated"),
        (("ehsa", "--set", "load.preload=50e3", "--duration", "2"), "is passed without any input"),
        (("ehsa", "--amplitude", "0.2", "--kind", "sine", "--duration", "2"), "no input of no more than 0.2 A moves"),
        (("emps",), "has no [limits], so any input is allowed; give an amplitude"),
        (("mbari_pto",), "the motion of its rod is prescribed"),
    ],
)
def test_a_wrong_call_is_one_sentence(run, arguments, says):
    """Exit status 2, no traceback."""
    status, _, err = run("excite", *arguments)

    assert status == 2
    assert says in err and err.count("\n") == 1
