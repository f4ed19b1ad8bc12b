"""Scenarios with the user's own objects: laws, lists of controllers, definitions from Python."""

import control
import numpy as np
import pytest

import ehsa_ctrl as e


def damped(t, y, r):
    """Proportional to the error, damped by the shaft's speed."""
    return 2000.0 * (r.position - y.position) - 0.03 * y.speed


def test_several_controllers_in_one_call():
    """Results by name and position, each the one of a run of its own; a table of all."""
    lead = control.tf([12.0, 300.0], [0.004, 1.0], name="lead")
    found = e.run("steps_spring", controller=["pid_position", lead, damped])
    alone = e.run("steps_spring", controller=damped)

    assert [result.controller.name for result in found] == ["pid_position", "lead", "damped"]
    assert np.array_equal(found["damped"].nonlinear["x"], alone.nonlinear["x"])
    assert found[0].baseline is not None and found[1].baseline is None
    assert found["lead"].loop is not None and found["damped"].loop is None
    table = found.to_pandas()
    assert table.loc["SettlingTime", "pid_position"] == found[0].to_pandas().loc["SettlingTime", "nonlinear"]
    assert "lead" in str(found) and "<table" in found._repr_html_()
    assert found["damped"].controller.current_limit == pytest.approx(
        found["damped"].plant.limits["motor_torque"].value / found["damped"].plant["K_T"]
    )


def test_a_loop_is_indexed_as_a_trajectory():
    """Signals of the trajectory, and the loop's own by name."""
    run = e.run("steps_spring", controller="pid_position").nonlinear

    assert np.array_equal(run["x"], run.trajectory["x"])
    assert np.array_equal(run["dP"], run.trajectory["dP"])
    assert np.array_equal(run["reference_position"] - run["x"], run["error"])
    assert np.array_equal(run["measured_position"], run.measured[:, 3])
    assert np.array_equal(run["status"], run.traces["status"])
    assert len(run) == len(run.trajectory)
    with pytest.raises(e.InputError, match="'y' is not a state"):
        run["y"]


def test_a_scenario_from_keywords():
    """Changed keys of a shipped one, and one from nothing; numbers are SI, strings have units."""
    changed = e.load_scenario(
        "steps_spring", load={"stiffness": 80e3}, duration=4.0, limits={"MaxError": {"max": 0.02}}
    )
    new = e.load_scenario(
        {"plant": "ehsa", "controller": "pid_position", "duration": 1.0, "load": {"stiffness": "80 kN/m"}},
        reference={"kind": "steps", "times": [0.1], "positions": np.array([0.005])},
    )
    result = e.run(new)

    assert e.run(changed).plant["K_S"] == result.plant["K_S"] == 80e3
    assert changed.definition.limits["MaxError"].max == 0.02
    assert changed.definition.controller.endswith(".toml")
    assert result.verdict == "untested" and result.baseline is None
    assert result.nonlinear["reference_position"][-1] == 0.005


@pytest.mark.parametrize(
    ("scenario", "controller", "words"),
    [
        ({"duration": 1.0, "reference": {"kind": "sine", "amplitude": 0.01, "frequency": 1.0}}, None, "names no plant"),
        (
            {"plant": "ehsa", "duration": 1.0, "reference": {"kind": "sine", "amplitude": 0.01, "frequency": 1.0}},
            None,
            "names no controller",
        ),
        ({"plant": "ehsa", "lenght": 1.0}, "pid_position", "scenario own: lenght: unknown key"),
        ("steps_spring", [], "empty list"),
        ("steps_spring", [damped, damped], "several controllers are named 'damped'"),
        ("steps_spring", object(), "run: controller is an object; expected a controller"),
        ("steps_spring", {"kind": "pid", "current_limit": 60.0}, "controller own: "),
        ("steps_spring", control.tf([1.0], [1.0, 1.0], 0.001), "has dt = 0.001; expected the sample time"),
        (
            "steps_spring",
            {"kind": "pid", "current_limit": 60.0, "gains": {"k_p": 1.0, "k_i": 0.0, "k_d": 0.0, "T_f": 0.01}},
            "current_limit = 60 A exceeds the rating",
        ),
    ],
)
def test_wrong_input_is_one_sentence(scenario, controller, words):
    """With what was found, and what to do."""
    with pytest.raises(e.InputError, match=words) as caught:
        e.run(scenario, controller=controller)

    assert "\n" not in str(caught.value)


def test_monte_carlo_with_a_function():
    """Its draws are those of every controller; a function of another text is another campaign."""
    found = e.monte_carlo("spread_steps", runs=2, controller=damped)

    assert len(found.outcomes) == 2 and found.controller == "damped"
