"""`run` and `design` for a carriage under a drive force: the linear model is a mass with viscous friction."""

import re
import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.plant.conditions import linear_model

PID = {
    "kind": "pid",
    "sample_time": 1e-3,
    "current_limit": 150.0,
    "design": {"crossover": 35.0, "phase_margin": 1.05, "integral_ratio": 0.1, "filter_ratio": 8.0},
}
LQR = {"kind": "lqr", "sample_time": 1e-3, "current_limit": 150.0, "weights": {"position": 1e-3, "current": 50.0}}
MPC = {**LQR, "kind": "mpc", "horizon": 40, "limits": {"current_rate": 2e4}}
ADRC = {"kind": "adrc", "sample_time": 1e-3, "current_limit": 150.0, "adrc": {"bandwidth": 30.0}}
SCENARIO = {
    "title": "A move of the carriage",
    "why": "Its controller is designed on its own linear model.",
    "plant": "emps",
    "duration": 3.0,
    "reference": {"kind": "trapezoid", "times": [0.2], "positions": [0.2], "velocity": 0.2, "acceleration": 1.0},
    "limits": {"MaxError": {"max": 0.02}, "SteadyStateError": {"max": 1e-4}},
}


def test_the_linear_model_is_a_mass_with_viscous_friction():
    plant = ehsa_ctrl.load_plant("emps", model="linear")
    model = linear_model(plant)
    M, Fv = plant["M"], plant["Fv"]

    assert model.state_labels == ["v", "x"]
    assert np.allclose(model.A, [[-Fv / M, 0.0], [1.0, 0.0]], atol=1e-12)
    assert model.B[0, 0] == pytest.approx(1.0 / M)


@pytest.mark.parametrize("controller", [PID, LQR, MPC, ADRC], ids=lambda one: one["kind"])
def test_without_dry_friction_the_nonlinear_carriage_does_as_predicted(controller):
    """And with it, the loop needs more force and loses some accuracy."""
    free = ehsa_ctrl.run(SCENARIO, controller=controller, settings={"Fc": 0.0})
    rubbing = ehsa_ctrl.run(SCENARIO, controller=controller)

    paths = [loop.trajectory["x"] for loop in (free.linear, free.nonlinear)]
    assert np.max(np.abs(paths[0] - paths[1])) < 1e-5
    assert rubbing.passed, rubbing
    assert rubbing.metrics["Energy"][1] > free.metrics["Energy"][1] > 0.0
    # A and N are not mixed.
    assert np.isnan(rubbing.metrics["CurrentRMS"]).all()


def test_files_of_a_run_are_those_of_the_carriage(tmp_path, monkeypatch):
    """Design, run, baseline and page by the command line, from an empty project."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "controllers").mkdir()
    words = ["design", "emps", "--kind", "pid", "--bandwidth", "35 rad/s", "--phase-margin", "60 deg"]

    refused = CliRunner().invoke(app, words)
    designed = CliRunner().invoke(app, [*words, "--current-limit", "150 N", "-o", "controllers/carriage.toml"])
    (tmp_path / "move.toml").write_text(
        'schema = 1\ntitle = "Move"\nwhy = "Test."\nplant = "emps"\ncontroller = "carriage"\nduration = "3 s"\n'
        '[reference]\nkind = "trapezoid"\ntimes = ["0.2 s"]\npositions = ["200 mm"]\nvelocity = "200 mm/s"\n'
        'acceleration = "1 m/s2"\n'
    )
    recorded = CliRunner().invoke(app, ["run", "move.toml", "--update-baselines", "--reason", "first"])
    again = CliRunner().invoke(app, ["run", "move.toml", "--out", "out"])

    assert "--current-limit '100 N'" in str(refused.exception)
    assert designed.exit_code == recorded.exit_code == again.exit_code == 0, again.output
    header = (tmp_path / "out" / "move-carriage.csv").read_text().splitlines()[0].split(",")
    assert {"t", "drive_force", "position"} <= set(header) and "current" not in header
    assert "differs" not in again.output


def test_a_shipped_lqr_for_a_drive_in_newtons(tmp_path, monkeypatch):
    """What it has in A keeps its ratio to the largest drive: 1 A of 6 A is 25 N of 150 N. A and N are not mixed."""
    monkeypatch.chdir(tmp_path)
    words = ["design", "emps", "--kind", "lqr", "--current-limit", "150 N"]

    CliRunner().invoke(app, [*words, "-o", "found.toml"], catch_exceptions=False)
    mixed = CliRunner().invoke(app, [*words, "--weight", "current=1 A"])
    lax = CliRunner().invoke(app, [*words, "--weight", "current=50 N", "-o", "lax.toml"])

    found = tomllib.loads((tmp_path / "found.toml").read_text())
    assert found["weights"]["current"] == "25 N"
    assert found["observer"]["current"] == "2.5 N" and found["observer"]["friction"] == "12.5 N"
    assert "weights.current = '1 A', but the drive of this plant is in N" in str(mixed.exception)
    assert lax.exit_code == 0 and tomllib.loads((tmp_path / "lax.toml").read_text())["weights"]["current"] == "50 N"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("pid", r"k_p = \S+ N/m, k_i = \S+ N/\(m s\), k_d = \S+ N s/m, .*\|current\| <= 150 N,"),
        ("mpc", r"\|current\| <= 150 N, \|current rate\| <= 15000 N/s; without them .*\|current\| <= 150 N,"),
        ("adrc", r"on the position, b_0 = \S+ m/\(s2 N\), \|current\| <= 150 N,"),
    ],
)
def test_a_design_for_a_drive_in_newtons_speaks_in_newtons(kind, words, tmp_path, monkeypatch):
    """And no limit of the shipped actuator's shaft, pressures or stroke holds for a carriage."""
    monkeypatch.chdir(tmp_path)
    line = ["design", "emps", "--kind", kind, "--current-limit", "150 N", "-o", "found.toml"]

    shown = CliRunner().invoke(app, line, catch_exceptions=False).output

    text = (tmp_path / "found.toml").read_text()
    assert re.search(words, shown)
    assert not re.search(r" A\b| A/", shown + text)
    assert set(tomllib.loads(text).get("limits", {})) <= {"current_rate"}


def test_a_limit_of_what_a_carriage_lacks_is_refused():
    line = ["design", "emps", "--kind", "mpc", "--current-limit", "150 N"]

    speed = CliRunner().invoke(app, [*line, "--limit", "speed=100 rad/s"])
    rate = CliRunner().invoke(app, [*line, "--limit", "current_rate=100 A/s"])

    assert "the model has no speed; it has position" in str(speed.exception)
    assert "limits.current_rate = '100 A/s', but the drive of this plant is in N" in str(rate.exception)


def test_no_controller_is_designed_for_a_servo_with_its_own():
    refused = CliRunner().invoke(app, ["design", "xl330_pendulum", "--kind", "lqr"])

    assert "its position loop is the firmware's" in str(refused.exception)
