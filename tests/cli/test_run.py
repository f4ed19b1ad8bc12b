"""`ehsa-ctrl run`: controllers side by side, baselines, files of an earlier result."""

import json

import pytest
from short_move import LIMITS, SHORT


@pytest.fixture
def scenario(tmp_path):
    """A project's scenario; call it with what stands below the short move."""

    def write(add=LIMITS):
        (tmp_path / "scenarios").mkdir(exist_ok=True)
        (tmp_path / "scenarios" / "short.toml").write_text(SHORT + add)

    write()
    return write


@pytest.fixture
def mine(tmp_path):
    """A second controller, of the project's own."""
    from ehsa_ctrl.core.catalogue import controllers

    text = controllers["pid_position"].read_text()
    (tmp_path / "controllers").mkdir()
    (tmp_path / "controllers" / "slow.toml").write_text(text.replace('"35 rad/s"', '"20 rad/s"'))


@pytest.mark.slow
def test_controllers_stand_side_by_side(run, scenario, mine):
    """One table with a column each; below it scenario, controller, verdict and why, and how many passed and failed."""
    scenario(LIMITS.replace("3 mm", "3.2 mm"))
    status, out, _ = run("run", "short", "--controller", "pid_position,slow")
    *_, heading, first, second, counts, _ = (line.split() for line in out.splitlines() + [""])

    assert status == 1
    assert heading == ["scenario", "controller", "verdict", "why"]
    assert first == ["short", "pid_position", "passed"]
    assert second[:4] == ["short", "slow", "FAILED", "MaxError"]
    assert " ".join(counts).startswith("1 of 2 passed, 1 failed; written to")
    assert any(line.split() == ["pid_position", "slow", "unit"] for line in out.splitlines())
    (row,) = [line for line in out.splitlines() if line.startswith("MaxError")]
    fast, slow = (float(word) for word in row.split()[1:3])
    assert fast < slow


@pytest.mark.slow
def test_what_is_untested_or_not_defined_is_said(run, scenario, tmp_path):
    """A run without limits neither passes nor fails, with status 0; a smooth move has no step to overshoot."""
    scenario("")
    status, out, _ = run("run", "short")

    assert status == 0
    assert "untested" in out and "0 of 1 passed, 1 untested" in out
    assert json.loads((tmp_path / "results" / "results.json").read_text())["scenarios"][0]["verdict"] == "untested"
    (row,) = [line for line in out.splitlines() if line.startswith("Overshoot")]

    assert row.split() == ["Overshoot", *3 * ["not", "defined"], "%"]
    assert "nan" not in out


def test_check_says_a_limit_on_what_is_not_defined(run, scenario, tmp_path):
    """Before anything runs, with file, key and the reason."""
    scenario('\n[limits]\nOvershoot = { max = "5 %" }\n')
    status, _, err = run("check", "scenarios/short.toml")

    assert status == 2
    assert "short.toml: [limits] Overshoot: is not defined here" in err and "'moves' does not jump" in err


@pytest.mark.slow
def test_who_names_no_folder_is_not_refused_and_loses_nothing(run, scenario, tmp_path):
    """A second run writes beside the first."""
    scenario("")
    assert run("run", "short")[0] == run("run", "short")[0] == 0

    assert (tmp_path / "results" / "results.json").is_file()
    assert (tmp_path / "results-2" / "results.json").is_file()
    status, _, err = run("run", "short", "--out", "results")
    assert status == 2
    assert "is part of an earlier result" in err


@pytest.mark.slow
def test_a_baseline_is_recorded_kept_and_left(run, scenario, tmp_path):
    """Recorded with a reason; another plant leaves it with status 1, a sentence and a figure; then recorded anew."""
    assert run("run", "short", "--update-baselines", "--reason", "first look")[0] == 0
    assert run("run", "short", "--force")[0] == 0

    scenario(LIMITS + '\n[settings]\nA_FR = "1300 N"\n')
    status, out, _ = run("run", "short", "--force")
    assert status == 1
    assert "x leaves its tube by" in " ".join(out.split())
    assert (tmp_path / "results" / "short-pid_position-baseline.png").is_file()

    status, out, _ = run("run", "short", "--force", "--update-baselines", "--reason", "stiffer seal")
    assert status == 0
    assert "SteadyStateError (nonlinear) was" in out
    file = tmp_path / "scenarios" / "baselines" / "short-pid_position.json"
    assert json.loads(file.read_text())["reason"] == "stiffer seal"
    # Its figure belonged to the result before.
    assert not (tmp_path / "results" / "short-pid_position-baseline.png").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--update-baselines"], "say why with --reason TEXT"),
        (["--update-baselines", "--reason", "x", "--plant", "ehsa"], "leave out --plant, --design and --set"),
    ],
)
def test_baselines_are_not_changed_by_the_way(run, scenario, monkeypatch, arguments, says):
    """One sentence, status 2."""
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    status, _, err = run("run", "short", *arguments)

    assert status == 2 and says in err and "Traceback" not in err


@pytest.mark.slow
def test_a_setting_of_one_run_is_in_its_results(run, scenario, tmp_path):
    """In the JSON and on the page; no baseline is held against it, and none is recorded of it."""
    scenario("")
    assert run("run", "short", "--set", "A_FR=1300", "--set", "load.stiffness=80 kN/m", "--no-assumed")[0] == 0
    (found,) = json.loads((tmp_path / "results" / "results.json").read_text())["scenarios"]
    assert found["settings"] == {"A_FR": "1300", "load.stiffness": "80 kN/m"}
    assert "A_FR = 1300, load.stiffness = 80 kN/m" in (tmp_path / "results" / "report.html").read_text()

    status, _, err = run("run", "short", "--set", "A_FR=1300", "--update-baselines", "--reason", "x")
    assert status == 2 and "leave out --plant, --design and --set" in err


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("A_XX=3", "A_XX: the nonlinear model of ehsa has no such parameter"),
        ("K_T", "--set 'K_T': expected KEY=VALUE"),
        ("K_T=3 bar", "K_T: unit 'bar' does not fit"),
        ("K_T=-1", "K_T = -1 N m/A: must be"),
    ],
)
def test_a_wrong_setting_is_one_sentence(run, scenario, setting, says):
    """Status 2, and not blamed on the scenario's file."""
    status, _, err = run("run", "short", "--set", setting)

    assert status == 2 and says in err and err.count("\n") == 1 and "short.toml" not in err


@pytest.mark.slow
def test_force_leaves_no_figure_of_another_controller(run, scenario, mine, tmp_path):
    """What the old result named as its own goes; a user's own file stays."""
    run("run", "short", "--controller", "pid_position,slow")
    out = tmp_path / "results"
    (out / "notes.png").write_text("mine")
    assert (out / "short-slow.png").is_file() and (out / "loop-slow.svg").is_file()
    run("run", "short", "--force")
    names = {path.name for path in out.iterdir()}

    assert "short-pid_position.png" in names and "notes.png" in names
    assert not any("slow" in name for name in names)


@pytest.mark.slow
def test_montecarlo_goes_on_where_it_was(run, scenario, tmp_path):
    """Ten runs, then fifteen: five more lines; the probability in words, the figure beside it."""
    scenario(LIMITS + '\n[spread]\nA_FR = "10 %"\n')
    status, out, _ = run("montecarlo", "short", "--runs", 10)
    assert status == 0 and "of 10 runs pass, probability" in out
    status, out, _ = run("montecarlo", "short", "--runs", 15, "--json")
    folder = tmp_path / "results" / "montecarlo"
    (campaign,) = json.loads(out)["campaigns"]

    assert campaign["runs"] == 15
    assert len((folder / "short.jsonl").read_text().splitlines()) == 16
    assert (folder / "short.png").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(("require", "expected"), [(0.5, 0), (0.999, 1)])
def test_montecarlo_can_require_a_probability(run, scenario, require, expected):
    """Judged by the interval's lower end, in words too: ten runs never prove 99.9 %."""
    status, out, _ = run("montecarlo", "short", "--runs", 10, "--require", require)

    assert status == expected
    assert f"required: at least {require} with 95 % confidence: {'NOT MET' if expected else 'met'}" in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere"], "no scenario 'nowhere'"),
        (["short", "--confidence", 2], "--confidence 2"),
        (["short", "--require", 7], "--require 7"),
        (["short", "--backend", "pvm"], "backend 'pvm'"),
        (["short", "--controller", ","], "names no controller"),
        (["short", "--set", "nix=3"], "nix: the nonlinear model of ehsa has no such parameter"),
    ],
)
def test_montecarlo_says_what_is_wrong(run, scenario, arguments, says):
    """One sentence, status 2."""
    status, _, err = run("montecarlo", *arguments)

    assert status == 2 and says in err and "Traceback" not in err


def test_what_is_set_beyond_belief_is_a_warning(run, tmp_path):
    """In every command that takes --set; the run goes on."""
    status, _, err = run(
        "simulate", "ehsa", "--excitation", "sine", "--duration", 1, "--set", "K_T=1.7", "--out", tmp_path / "s"
    )

    assert status == 0
    assert "warning: K_T = 1.7 N m/A lies outside 0.87 to 1.6" in err
