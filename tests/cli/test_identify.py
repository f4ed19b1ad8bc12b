"""`ehsa-ctrl identify` as a user meets it."""

import json

import pandas
import pytest

import ehsa_ctrl


@pytest.fixture
def logs(run, tmp_path):
    """Two logs of the virtual bench: noise to identify from, steps to hold against."""
    for kind, amplitude, seconds in (("noise", 3, 10), ("steps", 1.5, 5)):
        arguments = ("--excitation", kind, "--amplitude", amplitude, "--duration", seconds, "--centre", "--out", kind)
        assert run("simulate", "ehsa", *arguments)[0] == 0
    return tmp_path / "noise" / "log.csv", tmp_path / "steps" / "log.csv"


@pytest.mark.slow
def test_from_logs_to_a_plant_that_can_be_used(run, logs, tmp_path):
    """Files of the contract, a plant that run and compare take as it is, the fit that was promised."""
    noise, steps = logs

    status, out, _ = run(
        "identify", noise, "--plant", "ehsa", "--validate", steps, "--set", "J_M=4e-4", "--set", "A_FR=600",
        "--linear", "sliding", "--out", "rig",
    )  # fmt: skip

    assert status == 0 and "well determined" not in out and "A_FR" in out
    answer = json.loads((tmp_path / "rig" / "identification.json").read_text())
    assert set(answer["parameters"]) == {
        "J_M", "A_FM", "B_FM", "C_FM", "V_10", "V_20", "K_L", "M", "A_FR", "B_FR", "C_FR",
    }  # fmt: skip
    assert answer["parameters"]["J_M"]["value"] == pytest.approx(3.312e-4, rel=0.01)
    assert answer["fit_percent"]["validate"]["speed"] > 99
    for name in ("report.html", "fit.png", "parameters.svg", "correlation.png", "residuals.png", "parameters.csv"):
        assert (tmp_path / "rig" / name).stat().st_size > 0, name
    assert pandas.read_csv(tmp_path / "rig" / "parameters.csv")["verdict"].eq("well determined").all()
    plant = tmp_path / "rig" / "ehsa_identified.toml"
    assert ehsa_ctrl.load_plant(plant, model="linear").parameters["B_FR"].source == "derived"
    assert run("compare", steps, "--plant", plant)[0] == 0
    assert run("run", "steps_spring", "--plant", plant, "--out", "checked")[0] in (0, 1)
    status, _, err = run("identify", noise, "--plant", "ehsa", "--out", "rig")
    assert status == 2 and "--force" in err


@pytest.mark.slow
def test_both_models_beside_each_other(run, logs):
    """--model both: one table, one JSON with both, the nonlinear one in front."""
    noise, steps = logs

    status, out, _ = run("identify", noise, "--plant", "ehsa", "--model", "both", "--validate", steps, "--json")

    answer = json.loads(out)
    assert status == 0 and answer["model"] == "nonlinear"
    fits = {word: answer["models"][word]["fit_percent"]["validate"]["speed"] for word in ("linear", "nonlinear")}
    assert fits["nonlinear"] > fits["linear"] + 20


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.csv"], "no such file"),
        (["LOG", "--model", "cubic"], "not one of 'linear', 'nonlinear', 'both'"),
        (["LOG", "--method", "guess"], "not one of 'simulation', 'balances'"),
        (["LOG", "--free", "K_X"], "K_X: can't be estimated"),
        (["LOG", "--bounds", "K_L"], "expected KEY=LOW:HIGH"),
        (["LOG", "--free", "K_T", "--prior", "K_T"], "needs a standard deviation"),
        (["LOG", "--from", "50"], "there are 0 samples"),
        (["LOG", "--validate", "LOG"], "give --validate another log"),
        (["LOG", "--linear", "curved"], "not one of 'keep', 'sliding'"),
        (["LOG", "--model", "both", "--linear", "sliding"], "use --model nonlinear, not both"),
        (["LOG", "--starts", "0"], "Invalid value for '--starts'"),
    ],
)
def test_wrong_calls_are_sentences(run, tmp_path, arguments, said):
    """Exit status 2 and one sentence, before any work."""
    assert run("simulate", "ehsa", "--excitation", "steps", "--duration", 2, "--centre", "--out", "a")[0] == 0
    log = tmp_path / "a" / "log.csv"

    status, _, err = run("identify", *[log if a == "LOG" else a for a in arguments], "--plant", "ehsa")

    assert status == 2
    assert said in " ".join(err.split()), err


@pytest.mark.slow
def test_a_finding_says_of_which_log_it_is(run, tmp_path):
    """Two logs of one name, both without speed: each by its folder."""
    log, _ = ehsa_ctrl.record(ehsa_ctrl.load_plant("ehsa"), *ehsa_ctrl.excitation("noise", amplitude=3, duration=4))
    for folder in "ab":
        (tmp_path / folder).mkdir()
        log.to_pandas().drop(columns="speed").to_csv(tmp_path / folder / "log.csv", index=False)
    fixed = "J_M,A_FM,C_FM,V_10,V_20,K_L,M,A_FR,B_FR,C_FR"
    status, out, err = run("identify", "a/log.csv", "b/log.csv", "--plant", "ehsa", "--starts", 1, "--fix", fixed)

    assert status == 0 and "identified from a/log.csv, b/log.csv" in out
    assert all(f"warning: {folder}/log.csv: without speed the log does not show" in err for folder in "ab")
    assert "without speed" not in out
