"""The command line as a user meets it: right input, wrong input, exit status, one sentence."""

import json
import os
import re
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import get_args

import numpy as np
import pandas
import pytest

from ehsa_ctrl.cli.listing import Listed
from ehsa_ctrl.core.catalogue import scenarios
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS


def test_help_answers_at_once():
    """Half a second on a quiet machine; what would break it is a heavy import, and none is there."""
    program = "import sys, ehsa_ctrl.cli.main; print(sorted({m.split('.')[0] for m in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout

    for heavy in ("numpy", "scipy", "numba", "control", "matplotlib", "pandas", "cvxpy", "pydantic", "pint"):
        assert f"'{heavy}'" not in loaded


@pytest.mark.slow
def test_help_explains_every_command_with_an_example(run):
    """--help lists the commands; each command's help shows a call."""
    status, out, _ = run("--help")
    assert status == 0

    for command in ("run", "simulate", "analyse", "compare", "identify", "excite", "list", "check"):
        assert command in out
        status, text, _ = run(command, "--help")
        assert status == 0
        assert f"ehsa-ctrl {command}" in " ".join(text.split())


@pytest.mark.parametrize(
    ("command", "table"),
    [
        ("serve", "[watchdog]"), ("diagnose", "[log.controller]"), ("learn", "[reference]"), ("convert", "[log]"),
        ("simulate", "[log]"), ("design", "[weights]"),
    ],
)  # fmt: skip
def test_help_names_tables_of_files(run, command, table):
    """A table's brackets are no markup."""
    status, text, _ = run(command, "--help")

    assert status == 0 and table in text


def test_the_module_is_the_command_and_tells_its_versions():
    """`python -m ehsa_ctrl --version` names the package and what results depend on."""
    call = [sys.executable, "-m", "ehsa_ctrl", "--version"]
    told = subprocess.run(call, capture_output=True, text=True, check=True).stdout

    named = dict(line.split() for line in told.splitlines())
    assert named["ehsa_ctrl"] == version("ehsa_ctrl")
    assert named["numpy"] == np.__version__


def test_without_arguments_it_says_what_it_can(run):
    """A bare call is answered with the help."""
    assert "simulate" in run()[1]


@pytest.mark.slow
def test_run_does_the_main_job(run, tmp_path, monkeypatch):
    """All shipped scenarios: results, page and figures are there, the verdict is printed, exit status 0."""
    # To lay them out and to write them takes most of the time; other tests look at what is drawn.
    monkeypatch.setattr("ehsa_ctrl.report.style.Sheet.lay_out", lambda sheet: None)
    monkeypatch.setattr("ehsa_ctrl.report.result_figures.save", lambda _, path: Path(f"{path}.png").write_bytes(b""))
    status, out, _ = run("run", "--no-assumed", "--out", "results")
    summary = json.loads((tmp_path / "results" / "results.json").read_text())

    assert status == 0
    assert summary["passed"] and {s["scenario"] for s in summary["scenarios"]} == set(scenarios)
    assert f"{len(scenarios)} of {len(scenarios)} passed" in " ".join(out.split())
    assert (tmp_path / "results" / "report.html").stat().st_size > 10_000
    assert len(list((tmp_path / "results").glob("*.png"))) > len(scenarios)
    for scenario in summary["scenarios"]:
        assert scenario["metrics"]["RMSError"]["linear"] != scenario["metrics"]["RMSError"]["nonlinear"]


def scenario_text(**replaced):
    text = scenarios["steps_spring"].read_text()
    for old, new in replaced.values():
        assert old in text
        text = text.replace(old, new, 1)
    return text


@pytest.mark.slow
def test_a_limit_that_is_not_kept_fails_with_status_1(run, tmp_path):
    """The scenario ran, the plant did not do what was asked: 1, with metric, value and bound."""
    (tmp_path / "tight.toml").write_text(scenario_text(a=('max = "200 um"', 'max = "1 nm"')))
    status, out, _ = run("run", "tight.toml")

    assert status == 1
    assert "FAILED" in out and "SteadyStateError" in out and "at most 1e-06" in out
    assert json.loads((tmp_path / "results" / "results.json").read_text())["passed"] is False


@pytest.mark.slow
def test_a_load_beyond_the_stroke_is_a_trip(run, tmp_path):
    """40 kN push the rod out of its stroke: it fails, unless the scenario asserts that it trips."""
    force = ('stiffness = "50 kN/m"', 'stiffness = "0 N/m"\nforce = "40 kN"')
    limits = ("[limits]", "[limits]\nMaxError = { min = '0 mm' }")
    (tmp_path / "pushed.toml").write_text(scenario_text(a=force, b=limits))
    status, out, _ = run("run", "pushed.toml")
    assert status == 1
    assert "trip: stroke (distance from mid-stroke) reached" in " ".join(out.split())

    found = json.loads((tmp_path / "results" / "results.json").read_text())["scenarios"][0]["trips"]
    asserted = f"expect_trips = {json.dumps([trip['limit'] for trip in found])}\nplant ="
    text = scenario_text(a=force, b=("plant =", asserted)).split("[limits]")[0]
    (tmp_path / "pushed.toml").write_text(text)
    status, out, _ = run("run", "pushed.toml", "--force")

    assert status == 0


@pytest.mark.slow
def test_a_users_scenario_folder_is_what_run_takes(run, tmp_path):
    """With ./scenarios there, `run` alone runs those."""
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "scenarios" / "mine.toml").write_text(scenario_text())
    _, out, _ = run("run", "--json")

    assert [s["scenario"] for s in json.loads(out)["scenarios"]] == ["mine"]


@pytest.mark.slow
def test_simulate_writes_a_log_in_the_format(run, tmp_path):
    """Columns, sampling and rest state as the contract says; without noise the rest is exact."""
    status, *_ = run("simulate", "ehsa", "--excitation", "sine", "--duration", "1", "--no-noise", "--out", "log")
    table = pandas.read_csv(tmp_path / "log" / "log.csv")

    assert status == 0
    assert list(table.columns) == ["t", "current", "speed", "p1", "p2", "position", "force"]
    assert len(table) == 251 and table["t"].iloc[-1] == 1.0
    assert table.iloc[0].to_dict() == {
        "t": 0,
        "current": 0,
        "speed": 0,
        "p1": 2e6,
        "p2": 2e6,
        "position": 0,
        "force": 0,
    }
    assert (tmp_path / "log" / "simulation.png").is_file()


@pytest.mark.slow
def test_simulate_takes_an_input_file(run, tmp_path):
    """The log has the input's times and current, held over each sample; settings reach the plant."""
    time_ = 2.0 + 0.002 * np.arange(301)
    pandas.DataFrame({"t": time_, "current": np.full(301, 1.6)}).to_csv(tmp_path / "u.csv", index=False)
    base = ("simulate", "ehsa", "--input", "u.csv", "--no-noise")
    assert run(*base, "--out", "a")[0] == 0
    assert run(*base, "--set", "load.stiffness=200e3", "--out", "b")[0] == 0
    free, loaded = (pandas.read_csv(tmp_path / name / "log.csv") for name in ("a", "b"))

    np.testing.assert_allclose(free["t"], time_, atol=1e-9)
    assert loaded["position"].iloc[-1] < free["position"].iloc[-1]
    assert loaded["force"].iloc[-1] == pytest.approx(200e3 * loaded["position"].iloc[-1], rel=1e-3)


@pytest.mark.slow
def test_the_seed_makes_the_log(run, tmp_path):
    """Same seed, same bytes; another seed, another log."""
    base = ("simulate", "ehsa", "--excitation", "noise", "--duration", "1")
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run(*base, "--seed", seed, "--out", name)
    a, b, c = ((tmp_path / name / "log.csv").read_bytes() for name in ("a", "b", "c"))

    assert a == b != c


@pytest.mark.slow
def test_a_limit_passed_in_simulate_is_a_warning(run):
    """Beyond the stroke: said on standard error, status 0."""
    status, _, err = run("simulate", "ehsa", "--excitation", "ramp", "--amplitude", "5", "--out", "log")

    assert status == 0
    assert "warning: limit exceeded: stroke" in err


@pytest.mark.slow
def test_analyse_gives_the_figures_of_the_model(run, tmp_path):
    """Poles and DC gains as JSON, margins with a controller, figures on request."""
    status, out, _ = run("analyse", "ehsa", "--controller", "pid_position", "--json", "--out", "analysis")
    found = json.loads(out)

    assert status == 0
    assert found["dc_gain"]["speed"] == pytest.approx(1.2 * 308.43, rel=1e-3)
    assert found["loop"]["phase_margin"] == pytest.approx(60, abs=0.1)
    assert found["loop"]["crossover"] == pytest.approx(35, abs=0.1)
    assert (tmp_path / "analysis" / "bode.png").is_file()


def test_list_has_every_kind_of_definition(run, monkeypatch):
    """As JSON all of them; as a table the kinds of controllers too, each with its line."""
    monkeypatch.setenv("COLUMNS", "150")
    assert set(json.loads(run("list", "--json")[1])) == set(get_args(Listed))
    table = run("list", "kinds")[1]
    for name, kind in CONTROLLER_KINDS.items():
        assert re.search(rf"^{name} +{re.escape(kind.summary)}", table, re.MULTILINE)


@pytest.mark.slow
def test_list_and_check(run):
    """All of what there is is valid."""
    assert "stribeck" in run("list")[1]
    status, out, _ = run("check")
    assert status == 0 and "wrong" not in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["simulate", "ehsb", "--excitation", "sine", "--out", "x"], "no plant 'ehsb'; did you mean 'ehsa'"),
        (
            ["simulate", "ehsa", "--excitation", "sine", "--set", "M=-3", "--out", "x"],
            "M = -3 kg: must be greater than 0",
        ),
        (["simulate", "ehsa", "--excitation", "sine", "--set", "M=3 bar", "--out", "x"], "unit 'bar' does not fit"),
        (["simulate", "ehsa", "--excitation", "sine", "--set", "M", "--out", "x"], "expected KEY=VALUE"),
        (["simulate", "ehsa", "--excitation", "sin", "--out", "x"], "'sin' is not one of 'noise'"),
        (["simulate", "ehsa", "--out", "x"], "give either --input"),
        (["simulate", "ehsa", "--input", "none.csv", "--out", "x"], "none.csv: no such file"),
        (["simulate", "ehsa", "--excitation", "sine"], "Missing option '--out'"),
        (
            ["simulate", "ehsa", "--excitation", "sine", "--model", "quadratic", "--out", "x"],
            "not one of 'linear', 'nonlinear'",
        ),
        (["run", "no_such"], "no scenario 'no_such'"),
        (["run", "steps_spring", "--controller", "pid_positon"], "did you mean 'pid_position'"),
        (["list", "plant"], "'plant' is not one of 'plants'"),
        (["analyse", "ehsa", "--model", "nonlinear", "--velocity", "0"], "sticks at rest"),
        (["simulte"], "No such command 'simulte'"),
        (["run", "--frce"], "No such option"),
    ],
)
def test_wrong_input_is_one_sentence_and_status_2(run, arguments, says):
    """On standard error, without a traceback; standard output stays empty."""
    status, out, err = run(*arguments)

    assert status == 2
    assert says in err
    assert len(err.strip().splitlines()) == 1 and "Traceback" not in err
    assert out == ""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,current\n0,0\n0.004,nan\n0.008,1\n", "column 'current', row 3"),
        ("t,current\n0,0\n0.004,1\n0.008,1\n0.02,1\n0.024,1\n", "column 't', row 5: a gap of 0.012 s"),
        ("time,current\n0,0\n", "has no column 't'"),
    ],
)
def test_a_wrong_input_file_names_column_and_row(run, tmp_path, text, says):
    """NaN, a gap, a wrong header: file, column, row."""
    (tmp_path / "u.csv").write_text(text)
    status, _, err = run("simulate", "ehsa", "--input", "u.csv", "--out", "log")

    assert status == 2 and says in err and "u.csv" in err
    assert not (tmp_path / "log").exists()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('controller = "pid_position"', 'controller = "none_such"', "no controller 'none_such'"),
        ('plant = "ehsa"', 'plant = "none_such"', "no plant 'none_such'"),
        ('duration = "8 s"', 'duration = "8 m"', "unit 'm' does not fit"),
        ('duration = "8 s"', "duration = 8", "has no unit"),
        ('stiffness = "50 kN/m"', 'stifness = "50 kN/m"', "stifness"),
        ("Overshoot =", "Overshot =", "did you mean 'Overshoot'"),
        ('kind = "steps"', 'kind = "stairs"', "stairs"),
        ('positions = ["10 mm", "0 mm"]', 'positions = ["10 mm"]', "give one position per time"),
        ('why = "', 'whi = "', "did you mean 'why'"),
    ],
)
def test_a_wrong_scenario_names_file_and_key(run, tmp_path, old, new, says):
    """`run` and `check` say the same."""
    (tmp_path / "s.toml").write_text(scenario_text(a=(old, new)))
    for command in ("run", "check"):
        status, _, err = run(command, "s.toml")

        assert status == 2, command
        assert says in err and "s.toml" in err
        assert len(err.strip().splitlines()) == 1


@pytest.mark.slow
def test_the_wheel_carries_the_catalogue(tmp_path):
    """Built, unpacked and run from a folder elsewhere, without the checkout."""
    root = Path(__file__).resolve().parents[2]
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "-w", str(tmp_path / "dist"), str(root)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    subprocess.run([sys.executable, "-m", "zipfile", "-e", str(wheel), str(tmp_path / "site")], check=True)
    work = tmp_path / "work"
    work.mkdir()
    program = "import sys; sys.path.insert(0, sys.argv.pop(1)); from ehsa_ctrl.cli.main import main; main()"
    begun = time.time()
    done = subprocess.run(
        [sys.executable, "-P", "-c", program, str(tmp_path / "site"), "run", "force_step", "--json"],
        cwd=work,
        env={**os.environ, "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["passed"]
    assert (work / "results" / "results.json").stat().st_mtime > begun - 1
