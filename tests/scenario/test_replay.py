"""The worst run of a campaign again."""

import pytest

import ehsa_ctrl as e
from ehsa_ctrl.scenario.outcome import Outcome
from ehsa_ctrl.scenario.replay import read_draw, worst


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    file = tmp_path_factory.mktemp("campaign") / "runs.jsonl"
    return file, e.monte_carlo("spread_steps", runs=12, seed=3, controller="pid_position", file=file)


def test_a_replayed_run_is_the_run_of_the_campaign(campaign):
    """Every metric to the last bit, the same limits violated, no baseline; and the result says which draw it is."""
    _, found = campaign
    outcome = found.worst
    again = e.run("spread_steps", controller="pid_position", draw=outcome)

    finite = {name: pair[1] for name, pair in again.metrics.items() if name in outcome.metrics}
    # Slow metrics are computed for a run alone.
    assert {name: outcome.metrics[name] for name in finite} == finite
    assert again.failures == outcome.failures and again.passed == outcome.passed
    assert again.baseline is None
    assert again.plant["K_S"] == outcome.parameters["K_S"]
    assert f"run {outcome.run} of a campaign (" in str(again)
    assert f"sensor noise {outcome.seed}" in str(again)
    assert again.to_dict()["draw"] == {"run": outcome.run, "seed": outcome.seed, "parameters": outcome.parameters}
    assert again.to_dict()["seed"] == outcome.seed


def test_the_file_of_a_campaign_names_its_runs(campaign):
    """The worst one without a number; any run with its number."""
    file, found = campaign

    assert read_draw(str(file)) == found.worst
    assert read_draw(f"{file}:7") == found.outcomes[7]
    assert str(found.worst) in str(found)
    with pytest.raises(e.InputError, match="has no run 12; expected one of 0 to 11"):
        read_draw(f"{file}:12")


def test_the_worst_run_failed_if_any_did():
    """A metric that did not happen is worst; otherwise the smallest margin."""
    made = [
        Outcome(0, True, 0.01, 1, {}, {}),
        Outcome(1, False, -0.2, 1, {}, {}, ("a",)),
        Outcome(2, False, -0.3, 1, {}, {}, ("b",)),
        Outcome(3, False, float("nan"), 1, {}, {}, ("expected trip did not happen",)),
    ]

    assert worst(made).run == 2
    assert worst(made[:1]).run == 0
    assert worst([*made, Outcome(4, False, float("-inf"), 1, {}, {}, ("c",))]).run == 4


@pytest.mark.parametrize("text", ["", "1,2\n", '{"other": 1}\n', '{"campaign": "k"}\n{"run": 1}\n'])
def test_another_file_is_one_sentence(tmp_path, text):
    path = tmp_path / "runs.jsonl"
    path.write_text(text)

    with pytest.raises(e.InputError, match=r"is not the (\.jsonl of a montecarlo campaign|result of a run)"):
        read_draw(str(path))
    with pytest.raises(e.InputError, match="can't be read"):
        read_draw(str(tmp_path / "none.jsonl"))


def test_a_draw_of_another_plant_is_one_sentence():
    with pytest.raises(e.InputError, match="the replayed run is of another scenario or plant"):
        e.run("steps_spring", draw=Outcome(0, True, 0.0, 1, {"no_such": 1.0}, {}))
