"""Scenarios: what is run, compared and judged."""

import numpy as np
import pytest

from ehsa_ctrl import InputError, load_scenario, run
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


@pytest.mark.parametrize("name", scenarios)
def test_every_shipped_scenario_passes(name):
    """The catalogue keeps its own limits, and linear and nonlinear runs share one time base."""
    result = run(name)

    assert result.passed, result.failures
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


def test_the_seed_makes_the_run(edited):
    """The same seed gives the same bits, another one another run."""
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
    """More rod friction in the check; the prediction can't know it."""
    result = run(edited(add='\n[settings]\nA_FR = "1500 N"\n'))

    assert result.plant["A_FR"] == 1500
    assert "A_FR" not in result.linear.trajectory.plant.parameters


def test_a_limit_on_what_never_happens_fails(edited):
    """A step that never settles keeps no limit on its settling time: nan is no success."""
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
