"""Monte Carlo: reproducible draws, resumption after an interrupt, coverage of the interval."""

import json
from dataclasses import replace

import joblib
import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.scenario.montecarlo import MonteCarlo, monte_carlo, open_campaign
from ehsa_ctrl.scenario.outcome import Outcome
from ehsa_ctrl.scenario.prepare import prepare
from ehsa_ctrl.scenario.sensitivity import influences
from ehsa_ctrl.scenario.uncertainty import ParameterUncertainty, UncertainParameter, uncertainty_of

ADD = '\n[limits]\nMaxError = { max = "2 mm" }\n\n[spread]\nK_T = ["1.0 N m/A", "1.4 N m/A"]\nA_FR = "10 %"\n'


@pytest.fixture
def scenario(project):
    return project(add=ADD)


def outcome(run, passed, margin=0.0, **parameters):
    return Outcome(run, passed, margin, 0, parameters, {})


def test_the_result_does_not_depend_on_who_runs_it(scenario):
    """One core, two threads: the same outcomes in the same order; another seed gives others."""
    alone = monte_carlo(scenario, runs=24, seed=3)

    assert alone.outcomes == monte_carlo(scenario, runs=24, seed=3, jobs=2).outcomes
    assert alone.outcomes != monte_carlo(scenario, runs=24, seed=4).outcomes


@pytest.mark.slow
def test_processes_give_the_same(scenario):
    """Processes, which a controller in plain Python needs, give the outcomes of threads."""
    with joblib.parallel_config(backend="loky"):
        processes = monte_carlo(scenario, runs=24, jobs=2)

    assert processes.outcomes == monte_carlo(scenario, runs=24).outcomes


def test_a_run_of_a_campaign_is_a_run_of_the_scenario(scenario):
    """Draw, plant and noise of run 7, done by hand, give its metrics."""
    found = monte_carlo(scenario, runs=8).outcomes[7]
    case = prepare(scenario)
    metrics = case.metrics(case.simulate(case.nonlinear.set(**found.parameters), found.seed))

    assert found.metrics["MaxError"] == metrics["MaxError"]
    assert found.passed == (metrics["MaxError"] <= 2e-3)
    assert found.margin == pytest.approx(1 - metrics["MaxError"] / 2e-3)


def test_a_controller_can_be_handed_over(scenario):
    """A loaded controller gives the same as its name."""
    ready = prepare(scenario).controller

    assert monte_carlo(scenario, runs=3, controller=ready).outcomes == monte_carlo(scenario, runs=3).outcomes


def test_settings_hold_in_every_run(scenario):
    """The same draws on a plant with a stiffer spring: other errors, and another campaign than without."""
    softer, stiffer = (monte_carlo(scenario, runs=4, settings=set) for set in (None, {"load.stiffness": "80 kN/m"}))
    (run, *_), (other, *_) = softer.outcomes, stiffer.outcomes

    assert stiffer.plant["K_S"] == 80e3 and run.parameters == other.parameters
    assert run.metrics["MaxError"] != other.metrics["MaxError"]


def test_more_runs_begin_with_the_same(scenario):
    """Run k has the same draw for any number of runs."""
    assert monte_carlo(scenario, runs=12).outcomes[:5] == monte_carlo(scenario, runs=5).outcomes


def test_an_interrupted_campaign_goes_on(scenario, tmp_path):
    """After an interrupt with a truncated line only the missing runs are made; the result is the same."""
    file = tmp_path / "runs.jsonl"
    seen = []

    def stop(done, total):
        seen.append(done)
        if done >= 10:
            raise KeyboardInterrupt

    part = monte_carlo(scenario, runs=30, file=file, watch=stop)
    assert part.interrupted and len(part.outcomes) == 10
    file.write_text(file.read_text() + '{"run": 11, "pass')

    counted = []
    whole = monte_carlo(scenario, runs=30, file=file, watch=lambda done, total: counted.append(done))

    assert counted == [20, 30] and not whole.interrupted
    assert whole.outcomes == monte_carlo(scenario, runs=30).outcomes


def test_a_file_of_another_campaign_is_refused(scenario, project, tmp_path):
    """Results of another seed or limit are refused."""
    file = tmp_path / "runs.jsonl"
    monte_carlo(scenario, runs=2, file=file)
    with pytest.raises(InputError, match="another campaign"):
        monte_carlo(scenario, runs=2, seed=1, file=file)
    with pytest.raises(InputError, match="another campaign"):
        monte_carlo(project("other", add=ADD.replace("2 mm", "3 mm")), runs=2, file=file)

    (tmp_path / "no.jsonl").write_text("1\n")
    with pytest.raises(InputError, match="is not a file of a Monte Carlo campaign"):
        monte_carlo(scenario, runs=2, file=tmp_path / "no.jsonl")


def test_an_outcome_survives_its_file(tmp_path):
    """Also a margin of minus infinity, and a failure's sentence with a line break's worth of quotes."""
    file = tmp_path / "runs.jsonl"
    outcomes = (
        Outcome(0, True, 0.5, 7, {"K_T": 1.1}, {"IAE": 0.25}),
        Outcome(1, False, float("-inf"), 8, {"K_T": 1.3}, {}, ('it said "no"',)),
    )
    open_campaign(file, "x").append(outcome.to_line() for outcome in outcomes)

    assert open_campaign(file, "x").results == list(outcomes)


def test_the_interval_holds_the_probability_as_often_as_it_says():
    """Exact binomial interval at 90 %: over all possible counts it covers at least 90 %, for any probability."""
    from scipy.stats import binom

    n = 40
    intervals = []
    for k in range(n + 1):
        outcomes = tuple(outcome(i, i < k, K_T=1.0) for i in range(n))
        intervals.append(MonteCarlo("s", "c", ParameterUncertainty(()), outcomes, 0).interval(0.9))
    for p in (0.02, 0.3, 0.71, 0.97):
        covered = sum(binom.pmf(k, n, p) for k, (low, high) in enumerate(intervals) if low <= p <= high)

        assert covered >= 0.9


def test_the_parameter_that_decides_is_found():
    """Runs fail where K_T is high, whatever J_M is."""
    rng = np.random.default_rng(0)
    draws = rng.uniform(size=(200, 2))
    outcomes = [outcome(k, bool(a < 0.8), K_T=a, J_M=b) for k, (a, b) in enumerate(draws)]
    first, second = influences(outcomes, ("J_M", "K_T"))

    assert (first.name, first.measure, first.decisive) == ("K_T", "ks", True)
    assert first.value == 1.0 and "runs fail if it is high" in str(first)
    assert not second.decisive


def test_where_all_pass_the_margin_tells():
    """Without failures the rank correlation with the margin counts; infinite margins rank last."""
    rng = np.random.default_rng(1)
    outcomes = [outcome(k, True, margin=-(a**3), A_FR=a, J_M=b) for k, (a, b) in enumerate(rng.uniform(size=(60, 2)))]
    first, _ = influences(outcomes, ("J_M", "A_FR"))

    assert (first.name, first.measure) == ("A_FR", "rank") and first.value == pytest.approx(-1.0)
    assert "decreases with it" in str(first)


def test_chance_is_shared_among_all_that_were_looked_at():
    """Of 40 parameters without influence hardly one is called decisive."""
    rng = np.random.default_rng(2)
    names = [f"p{k}" for k in range(40)]
    called = 0
    for _ in range(8):
        outcomes = [outcome(k, bool(k % 3), **dict(zip(names, rng.normal(size=40), strict=True))) for k in range(90)]
        called += any(influence.decisive for influence in influences(outcomes, names))

    assert called <= 1


def test_draws_have_the_spread_that_was_asked_for(plant):
    """Normal with 10 %, cut at three deviations; uniform between bounds; so are the ranges of the file."""
    uncertainty = uncertainty_of(plant, {"A_FR": "10 %", "load.stiffness": ("0 N/m", "100 kN/m"), "beta": "0"})
    rng = np.random.default_rng(0)
    draws = [uncertainty.draw(rng) for _ in range(4000)]
    friction = np.array([draw["A_FR"] for draw in draws])
    spring = np.array([draw["K_S"] for draw in draws])

    assert {*uncertainty.names} == {"K_T", "tau_FM", "tau_FR", "A_FR", "K_S"}
    assert friction.mean() == pytest.approx(854, rel=0.01) and friction.std() == pytest.approx(85.4, rel=0.04)
    assert np.max(np.abs(friction - 854)) <= 3 * 85.4
    assert spring.min() >= 0 and spring.max() <= 1e5 and spring.mean() == pytest.approx(5e4, rel=0.03)


def test_draws_have_the_covariance_of_the_identification(plant, tmp_path):
    """Correlated estimates are drawn jointly."""
    file = tmp_path / "identification.json"
    sd = np.array([1e-5, 0.02])
    covariance = np.array([[1.0, 0.9], [0.9, 1.0]]) * np.outer(sd, sd)
    file.write_text(json.dumps({"correlation": {"names": ["J_M", "A_FM"], "covariance": covariance.tolist()}}))
    uncertainty = uncertainty_of(plant, {"M": "5 %"}, file)
    rng = np.random.default_rng(0)
    table = np.array(
        [[draw[name] for name in ("J_M", "A_FM", "M")] for draw in (uncertainty.draw(rng) for _ in range(3000))]
    )
    found = np.corrcoef(table.T)

    assert found[0, 1] == pytest.approx(0.9, abs=0.02)
    assert abs(found[0, 2]) < 0.06
    assert np.std(table[:, 1]) == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize(
    ("spread", "says"),
    [
        ({"K_X": "10 %"}, "K_X: the nonlinear model of ehsa has no such parameter"),
        ({"K_T": "5 bar"}, r"\[spread\] K_T: unit 'bar' does not fit"),
        ({"K_T": ("2 N m/A", "1 N m/A")}, "expected an increasing range within"),
        ({"K_T": "-1 N m/A"}, "must be at least 0"),
        ({"K_T": "x %"}, "is not a percentage"),
    ],
)
def test_a_wrong_spread_is_a_sentence(plant, spread, says):
    """It names the key."""
    with pytest.raises(InputError, match=says):
        uncertainty_of(plant, spread)


def test_bounds_without_room_are_said():
    """A range far from the value."""
    nowhere = ParameterUncertainty((UncertainParameter("K_T", 1.0, 5.0, 6.0, sd=0.1),))
    with pytest.raises(InputError, match="draws lies within the bounds of K_T"):
        nowhere.draw(np.random.default_rng(0))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"runs": 0}, "runs = 0"),
        ({"jobs": 0}, "jobs = 0"),
        ({"identification": "nowhere.json"}, "nowhere.json: no such file"),
    ],
)
def test_what_can_not_be_run_is_said(scenario, arguments, says):
    """One sentence."""
    with pytest.raises(InputError, match=says):
        monte_carlo(scenario, **{"runs": 2, **arguments})


def test_a_scenario_without_limits_has_nothing_to_pass(project):
    """Without a limit every run would pass."""
    with pytest.raises(InputError, match="has no limits, so every run would pass"):
        monte_carlo(project(add=""), runs=2)


def test_result_prints_and_draws(scenario):
    """Text with the interval, table with one row per run, figure."""
    found = monte_carlo(scenario, runs=10)

    assert "of 10 runs pass, probability" in str(found)
    assert len(found.to_pandas()) == 10 and {"K_T", "passed", "MaxError"} <= {*found.to_pandas()}
    assert found.plot().axes
    assert "the influence of the parameters shows from 5 runs on" in str(replace(found, outcomes=found.outcomes[:3]))
    assert ehsa_ctrl.monte_carlo.__wrapped__ is monte_carlo
