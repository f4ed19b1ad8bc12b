"""Scenarios: runs, comparison and limits."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import InputError, load_controller, load_plant, load_scenario, run, three_state
from ehsa_ctrl.core.catalogue import scenarios
from ehsa_ctrl.scenario.metrics import METRICS

TEXT = scenarios["steps_spring"].read_text()


@pytest.fixture
def edited(tmp_path):
    """A scenario with one piece of text replaced."""

    def edit(old="", new="", add=""):
        assert old in TEXT
        path = tmp_path / "edited.toml"
        path.write_text((TEXT.replace(old, new, 1) if old else TEXT) + add)
        return path

    return edit


def test_prediction_and_outcome_share_one_time_base():
    """Every metric exists for both models. `pytest scenarios` tests that the shipped scenarios pass."""
    result = run("fault_stuck_position")

    assert np.array_equal(result.linear.trajectory.time, result.nonlinear.trajectory.time)
    assert set(result.metrics) == set(METRICS)


def test_the_prediction_knows_the_load_but_not_the_friction():
    """Both plants carry the spring; only the nonlinear one sticks."""
    result = run("steps_spring")

    assert result.linear.trajectory.plant["K_S"] == result.plant["K_S"] == 50e3
    assert not result.linear.trajectory.sticks("rod").any()
    assert result.nonlinear.trajectory.sticks("rod").mean() > 0.5


def test_the_design_does_not_depend_on_the_scenario():
    """The controller is tuned on the plant's own linear set, the same in every scenario."""
    assert run("steps_spring").controller == run("force_step").controller


def test_a_setting_changes_the_plant_that_is_checked_on(project):
    """Not the design and not the prediction, but for the load, which acts in both; no baseline is held against it."""
    path = project()
    plain, weak = run(path), run(path, settings={"K_T": 1.0})
    loaded, symbol = run(path, settings={"load.stiffness": "80 kN/m"}), run(path, settings={"K_S": 80e3})

    assert weak.plant["K_T"] == 1.0 and weak.linear.trajectory.plant["K_T"] == plain.plant["K_T"]
    assert np.array_equal(weak.linear.trajectory.states, plain.linear.trajectory.states)
    assert not np.array_equal(weak.nonlinear.trajectory.states, plain.nonlinear.trajectory.states)
    assert weak.controller == plain.controller == loaded.controller
    assert loaded.plant["K_S"] == loaded.linear.trajectory.plant["K_S"] == 80e3
    assert np.array_equal(symbol.nonlinear.trajectory.states, loaded.nonlinear.trajectory.states)
    (path.parent / "baselines").mkdir()
    (path.parent / "baselines" / "short-pid_position.json").write_text("{}")
    assert run(path, settings={"K_T": 1.0}).baseline is None


def test_a_controller_that_is_designed_already_is_run_as_it_is(project):
    """The one that the file describes gives the same run; one that asks for no current gives none, and neither is held
    against what was recorded under that name."""
    path, model = project(), three_state(load_plant("ehsa", model="linear"))
    ready = load_controller("pid_position", model)
    named, given = run(path, controller="pid_position"), run(path, controller=ready)
    idle = run(path, controller=replace(ready, law=replace(ready.law, current_limit=0.0), name="idle"))
    (path.parent / "baselines").mkdir()
    (path.parent / "baselines" / "short-pid_position.json").write_text("{}")

    assert np.array_equal(given.nonlinear.trajectory.states, named.nonlinear.trajectory.states)
    assert idle.controller.name == "idle" and not idle.nonlinear.trajectory.current.any()
    assert run(path, controller=ready).baseline is None


def test_what_is_no_controller_is_refused(project):
    """One sentence with the expected types."""
    with pytest.raises(InputError, match=r"run: controller is 5; expected a controller: its name, the path"):
        run(project(), controller=5)


def test_the_seed_makes_the_run(edited):
    """The same seed gives identical bits, another seed another run."""
    a, b = run("steps_spring"), run("steps_spring")
    c = run(edited(add="\n[sensors]\nseed = 7\n"))

    assert np.array_equal(a.nonlinear.trajectory.states, b.nonlinear.trajectory.states)
    assert not np.array_equal(a.nonlinear.trajectory.states, c.nonlinear.trajectory.states)


def test_a_scenario_can_change_a_sensor(edited):
    """Coarser steps and a delay of the position sensor reach the controller."""
    result = run(edited(add='\n[sensors]\nnoise = false\n\n[sensors.position]\nstep = "0.1 mm"\ndelay = "8 ms"\n'))
    position = result.nonlinear.measured[:, 3]
    late = np.concatenate([[0, 0], result.nonlinear.trajectory["x"][:-2]])

    np.testing.assert_allclose(position, np.round(late / 1e-4) * 1e-4, atol=1e-12)


def test_a_parameter_that_only_the_nonlinear_set_has_can_be_set(edited):
    """More rod friction affects the check, not the prediction."""
    result = run(edited(add='\n[settings]\nA_FR = "1500 N"\n'))

    assert result.plant["A_FR"] == 1500
    assert "A_FR" not in result.linear.trajectory.plant.parameters


def test_a_limit_on_what_never_happens_fails(edited):
    """A step that never settles violates its limit: nan is no success."""
    result = run(edited('max = "2.5 s"', 'max = "2.5 s"', add='\n[settings]\nA_FM = "8 N m"\n'))

    assert any("SettlingTime did not happen" in failure for failure in result.failures)


@pytest.mark.parametrize(
    ("add", "says"),
    [
        ('\n[sensors.position]\nstep = "1 bar"\n', "position.step: unit 'bar' does not fit"),
        ('\n[sensors.position]\ndelay = "-1 ms"\n', "position.delay must be at least 0"),
        ("\n[sensors]\nlag = -1\n", "lag"),
        ('\n[[disturbance]]\nforce = "1 kN"\nstart = "-1 s"\n', "start must be at least 0 s"),
        ('\n[settings]\nA_FX = "1 N"\n', "did you mean 'A_FR'"),
    ],
)
def test_a_mistake_is_a_sentence(edited, add, says):
    """File and key, in one sentence."""
    with pytest.raises(InputError, match=says) as caught:
        run(load_scenario(edited(add=add)))

    assert "edited" in str(caught.value)


def test_the_gap_between_prediction_and_outcome_is_told(edited):
    """For every metric, nonlinear minus linear; nan where one of them did not happen."""
    frame = run("steps_spring").to_pandas()

    np.testing.assert_allclose(frame.gap, frame.nonlinear - frame.linear)


def test_the_catalogue_covers_what_it_promises():
    """At least twelve scenarios; faults of each kind, references of each form, force steps and spread among them."""
    loaded = [load_scenario(name).definition for name in scenarios]

    assert len(loaded) >= 12
    assert {fault.kind for definition in loaded for fault in definition.fault} == {"stuck", "lost", "current_limit"}
    assert {definition.reference.kind for definition in loaded} == {
        "steps", "moves", "sine", "ramp", "trapezoid", "file",
    }  # fmt: skip
    assert any(definition.spread for definition in loaded) and any(definition.disturbance for definition in loaded)
    assert any(definition.sensors.lag for definition in loaded) and any(definition.supervision for definition in loaded)


def test_a_project_finds_its_own_files_wherever_it_is_run_from(project, tmp_path, monkeypatch):
    """Plant and controller of the project by name, a file beside the scenario by its path; not those of the folder
    in which one happens to be."""
    from ehsa_ctrl.core.catalogue import controllers, plants

    for kind, source in (("plants", plants["ehsa"]), ("controllers", controllers["pid_position"])):
        (tmp_path / kind).mkdir()
        (tmp_path / kind / "mine.toml").write_text(source.read_text())
    (tmp_path / "scenarios" / "near.toml").write_text(controllers["pid_position"].read_text())
    path = project(replace=('plant = "ehsa"', 'plant = "mine"'))
    path.write_text(path.read_text().replace('"pid_position"', '"mine"'))
    elsewhere = tmp_path / "elsewhere" / "controllers"
    elsewhere.mkdir(parents=True)
    (elsewhere / "mine.toml").write_text("kind = 'wrong'\n")
    monkeypatch.chdir(elsewhere.parent)
    result = run(path)

    assert result.plant.path == tmp_path / "plants" / "mine.toml" and result.controller.name == "mine"
    path.write_text(path.read_text().replace('controller = "mine"', 'controller = "near.toml"'))
    assert run(path).controller.name == "near"


def test_what_is_set_beyond_belief_is_told(edited):
    """The plausible range of K_T is 0.87 to 1.6 N m/A."""
    result = run(edited(add='\n[settings]\nK_T = "1.7 N m/A"\n'))

    assert result.to_dict()["warnings"] == [
        "K_T = 1.7 N m/A lies outside 0.87 to 1.6 N m/A, the plausible range of ehsa"
    ]
    assert result.nonlinear.trajectory.warnings == result.warnings
    assert not run("steps_spring").warnings


def test_the_sensors_noise_is_among_what_is_assumed():
    """By the source in the plant's file."""
    assert run("steps_spring").to_dict()["assumed"]["position noise"] == pytest.approx(20e-6)


def test_check_designs_the_controller_and_reads_what_is_uncertain(project, tmp_path):
    """A controller that can't be designed, a wrong spread and a broken baseline are found by `check`."""
    from ehsa_ctrl.core.catalogue import controllers
    from ehsa_ctrl.scenario.prepare import check_definition

    assert check_definition(project()) == "scenario"
    with pytest.raises(InputError, match=r"short\.toml: \[spread\] K_T"):
        check_definition(project(add='\n[spread]\nK_T = "1 bar"\n'))
    text = controllers["pid_position"].read_text()
    assert check_definition(controllers["pid_position"]) == "controller"
    wild = tmp_path / "wild.toml"
    wild.write_text(text.replace('"35 rad/s"', '"3500 rad/s"'))
    with pytest.raises(InputError, match=r"wild\.toml"):
        check_definition(wild)
    path = project()
    (path.parent / "baselines").mkdir()
    (path.parent / "baselines" / "short-pid_position.json").write_text("{}")
    with pytest.raises(InputError, match="is not a valid baseline"):
        check_definition(path)
