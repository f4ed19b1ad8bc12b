"""Sensitivity to assumed parameters at the ends of their ranges."""

import math

import pytest

from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.scenario.definition import Scenario, ScenarioFile
from ehsa_ctrl.scenario.prepare import prepare
from ehsa_ctrl.scenario.run import run
from ehsa_ctrl.scenario.sensitivity import assumption_sensitivity

STEP = {
    "schema": 1,
    "title": "A small step",
    "why": "Tests need a run that takes little time.",
    "plant": "ehsa",
    "controller": "pid_position",
    "duration": "0.6 s",
    "reference": {"kind": "steps", "times": ["0.1 s"], "positions": ["5 mm"]},
    "sensors": {"noise": False},
}


def scenario(**more):
    return Scenario("step", validate(STEP | more, ScenarioFile, "step"))


@pytest.fixture(scope="module")
def result():
    return run(scenario(), assumed=True)


def test_every_assumed_parameter_with_a_range_is_tried(result):
    """Exactly the assumed parameters, at both ends of the file's range."""
    expected = {
        p.name: (p.lower, p.upper)
        for p in result.plant.parameters.values()
        if p.source == "assumed" and math.isfinite(p.lower) and math.isfinite(p.upper)
    }

    assert {s.parameter.name: (s.low.value, s.high.value) for s in result.sensitivities} == expected
    assert "K_T" in expected


def test_an_end_is_the_same_loop_on_a_plant_set_so(result):
    """The controller is not redesigned: the run has the nominal controller on the changed plant."""
    case = prepare(scenario())
    swing = next(s for s in result.sensitivities if s.parameter.name == "K_T")
    loop = case.simulate(case.nonlinear.set(K_T=swing.high.value))

    assert swing.high.metrics["RMSError"] == case.metrics(loop)["RMSError"]
    assert swing.high.metrics["RMSError"] != result.metrics["RMSError"][1]


def test_what_a_setting_gave_is_not_assumed():
    """A value set for the run counts as certain: it has no range."""
    case = prepare(scenario(settings={"K_T": "1.1 N m/A"}))

    assert "K_T" not in {swing.parameter.name for swing in assumption_sensitivity(case, nominal_passed=True)}


def test_a_limit_between_both_ends_flips_the_verdict(result):
    """A limit that holds at the nominal value and not at an end flips; a wide one does not."""
    swing = next(s for s in result.sensitivities if s.parameter.name == "K_T")
    nominal = result.metrics["RMSError"][1]
    worst = max(end.metrics["RMSError"] for end in swing.ends)
    assert worst > nominal
    tight = run(scenario(limits={"RMSError": {"max": f"{0.5 * (nominal + worst)} m"}}), assumed=True)
    wide = run(scenario(limits={"RMSError": {"max": f"{2.0 * worst} m"}}), assumed=True)

    assert tight.passed and wide.passed
    assert next(s for s in tight.sensitivities if s.parameter.name == "K_T").flips
    assert not any(s.flips for s in wide.sensitivities)


def test_by_default_nothing_more_is_run():
    """Off by default in Python; None depends on the controller."""
    assert run(scenario()).sensitivities is None
    assert run(scenario(), assumed=None).sensitivities


def test_a_run_that_can_not_be_made_is_a_failure_and_no_crash(monkeypatch):
    """An end where the plant does not run counts as not kept, with the reason."""
    from ehsa_ctrl.core.errors import SimulationError
    from ehsa_ctrl.scenario.prepare import PreparedScenario

    case = prepare(scenario())
    whole = PreparedScenario.simulate

    def stops(self, plant, seed=None):
        if plant["K_T"] > 1.5:
            raise SimulationError("left the range of its equations")
        return whole(self, plant, seed)

    monkeypatch.setattr(PreparedScenario, "simulate", stops)
    swing = next(s for s in assumption_sensitivity(case, nominal_passed=True) if s.parameter.name == "K_T")

    assert swing.low.passed and swing.high.failures == ("left the range of its equations",)
    assert swing.flips and swing.high.metrics == {}
