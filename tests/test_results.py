"""Results show themselves: in a terminal, in a notebook, as a table."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log import Log


@pytest.fixture(scope="module")
def results():
    """One of each that costs no time."""
    plant, linear = ehsa_ctrl.load_plant("ehsa"), ehsa_ctrl.load_plant("ehsa", model="linear")
    system = ehsa_ctrl.three_state(linear)
    pid = ehsa_ctrl.load_controller("pid_position", system)
    time = 0.004 * np.arange(50)
    return {
        "plant": plant,
        "run": ehsa_ctrl.simulate(plant, np.ones(50)),
        "loop": ehsa_ctrl.run_closed_loop(plant, pid, np.zeros((50, 3))),
        "log": Log(time, {"current": np.sin(time), "p1": np.full(50, 2e6)}, missing=("force",)),
        "poles": ehsa_ctrl.analyse(system),
        "margins": ehsa_ctrl.analyse_loop(system, pid),
    }


@pytest.mark.parametrize("name", ["plant", "run", "loop", "log", "poles", "margins"])
def test_a_result_is_shown_in_words(results, name):
    """Some lines, none of them an array, the same in a notebook."""
    result = results[name]
    shown = str(result)

    assert "array(" not in shown and 1 <= shown.count("\n") < 60
    assert result._repr_html_().startswith("<pre>")
    if name != "plant":  # its words tell one plant from another in baselines
        assert repr(result) == shown


def test_tables_have_a_row_each(results):
    """Parameters with their source, poles with their damping, samples."""
    parameters = results["plant"].to_pandas()
    poles = results["poles"].to_pandas()

    assert parameters.loc["K_T", "value"] == 1.2 and parameters.loc["K_T", "source"] == "assumed"
    assert list(parameters.index) == list(results["plant"].parameters)
    assert len(poles) == 4 and np.isnan(poles["damping"][0])
    assert len(results["run"].to_pandas()) == len(results["loop"].to_pandas()) == len(results["log"].to_pandas()) == 50


def test_a_log_says_what_it_holds(results):
    """Length, rate, range of every channel, and what is missing."""
    lines = str(results["log"]).splitlines()

    assert lines[0] == "a log: 50 samples from 0 to 0.196 s, 250 Hz"
    assert lines[1].split() == ["current", "0", "to", "0.19475", "A"] and lines[-1] == "  missing: force"


@pytest.fixture(scope="module")
def more(results):
    """What a public function gives back beside those."""
    from ehsa_ctrl.identification.refits import Profile

    system = ehsa_ctrl.three_state("ehsa")
    pid = ehsa_ctrl.load_controller("pid_position", system)
    robust = ehsa_ctrl.robust_margins({"one": system, "two": system}, pid)
    return {
        "scenario": ehsa_ctrl.load_scenario("steps_spring"),
        "controller": pid,
        "review": ehsa_ctrl.review(system, pid),
        "robust": robust,
        "profile": Profile("K_T", "N m/A", np.array([1.0, 1.1]), np.array([2.0, 0.0]), (1.05, 1.15)),
        "montecarlo": ehsa_ctrl.monte_carlo("force_step", runs=2),
    }


@pytest.mark.parametrize("name", ["scenario", "controller", "review", "robust", "profile", "montecarlo"])
def test_other_results_are_shown_in_words(more, name):
    """In a terminal as in a notebook: some lines, no array and no class of ours."""
    result = more[name]
    shown = str(result)

    assert "array(" not in shown and "ehsa_ctrl" not in shown and 0 <= shown.count("\n") < 60
    assert result._repr_html_().startswith("<pre>")
    if name != "controller":  # its words are its law's
        assert repr(result) == shown


def test_margins_and_profiles_are_tables(results, more):
    """Figures with their units; the values at which a parameter was held."""
    margins, profile = results["margins"].to_pandas(), more["profile"].to_pandas()

    assert margins.loc["phase_margin", "value"] == results["margins"].phase_margin
    assert margins.loc["phase_margin", "unit"] == "deg" and margins.loc["delay_margin", "unit"] == "s"
    assert list(profile.columns) == ["value", "rise"] and len(profile) == 2


def test_a_scenario_says_what_it_asks(more):
    """Plant, controller, load, and each limit in the unit that a person reads."""
    text = str(more["scenario"])

    assert text.startswith("steps_spring: ") and "pid_position on ehsa" in text
    assert "load.stiffness = 50" in text and "Overshoot at most" in text
