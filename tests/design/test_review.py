"""The design review: result and verdict of each check."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from made_loops import Made, integral, integrator, proportional

from ehsa_ctrl import InputError, four_state, load_controller, three_state
from ehsa_ctrl.design.analysis.robustness import robust_margins
from ehsa_ctrl.design.analysis.sampled import hidden_modes
from ehsa_ctrl.design.review import Known, review
from ehsa_ctrl.plant.motion_current import motion_current

FRICTION = Known(static=1.076, coulomb=0.941, slip=43e-6)


@pytest.fixture
def system(linear):
    return three_state(linear)


def test_a_sound_design_passes(system):
    """The shipped PID: no fault; friction still has something to say."""
    found = review(system, load_controller("pid_position", system), known=FRICTION)

    assert found.passed
    assert found["closed loop stable"].verdict == found["Ms"].verdict == found["disk margin"].verdict == "good"
    assert found["reaches its target"].result == "no steady-state error in the linear model"


def test_an_unstable_loop_is_a_fault(system):
    """With a fix, and without tests that make no sense then."""
    found = review(system, proportional(-100.0))

    assert not found.passed
    assert found.warnings[0].test == "closed loop stable" and found.warnings[0].fix
    assert "Ms" not in [finding.test for finding in found.findings]


def test_modes_out_of_reach_are_named(linear, system):
    """(6) has P_1 + P_2, which no current changes; (7) has nothing of the kind. An unstable one is a fault."""
    controller = proportional(100.0)
    unstable = control.ss(
        [[0.0, 0.0], [0.0, 0.5]], [[1.0], [0.0]], [[1.0, 1.0]], 0, inputs=["current"], outputs=["x"], states=["x", "w"]
    )

    assert review(system, controller)["model controllable"].verdict == "good"
    six = review(four_state(linear), controller)["model controllable"]
    assert six.verdict == "warning" and "0 rad/s" in six.result
    assert review(unstable, controller)["model controllable"].verdict == "fault"


def test_hidden_modes_are_those_of_the_matrices():
    """Of diag(-1, -2, -3) an input into the first and third leaves -2."""
    assert hidden_modes(np.diag([-1.0, -2.0, -3.0]), np.array([[1.0], [0.0], [1.0]])) == [-2]
    assert hidden_modes(np.diag([-1.0, -2.0]), np.array([[1.0], [1.0]])) == []


def test_the_stick_band_of_a_gain_is_breakaway_over_gain(system):
    """1.076 A over 400 A/m is 2690 um, for good; a warning, as nothing corrects it."""
    found = review(system, proportional(400.0), known=FRICTION)["stick band"]

    assert "errors up to 2690 um persist" in found.result and "43 um" in found.result
    assert found.verdict == "warning"


def test_an_integral_breaks_away_when_it_has_built_up(system):
    """k_p e + k_i e t passes breakaway at t = (1.076 / 1e-4 - 400) / 4000 s, as reported for 100 um."""
    k_p, k_i = 400.0, 4000.0
    found = review(system, integral(k_p, k_i), known=FRICTION)

    assert f"100 um for {(1.076 / 1e-4 - k_p) / k_i:.3g} s" in found["stick band"].result


@pytest.mark.parametrize(
    ("known", "rest", "verdict"),
    [(FRICTION, None, "warning"), (FRICTION, object(), "good"), (Known(static=1.0, coulomb=1.0), None, "good")],
)
def test_an_integral_hunts_where_static_friction_is_larger(system, known, rest, verdict):
    """Not where the integral is held at rest, nor without a step from static to Coulomb friction."""
    found = review(system, integral(400.0, 2000.0, rest=rest), known=known)

    assert found["limit cycle of the integral"].verdict == verdict


@pytest.mark.parametrize(("limit", "verdict"), [(6.0, "good"), (1.5, "warning"), (1.0, "fault")])
def test_breakaway_must_be_within_the_limit(system, limit, verdict):
    """1.076 A are needed before anything moves."""
    found = review(system, proportional(100.0, current_limit=limit), known=FRICTION)

    assert found["breakaway"].verdict == verdict


def test_a_spring_needs_its_own_current(linear, plant):
    """At 50 mm against 50 kN/m: the load current of motion_current, on top of breakaway."""
    stiff = linear.set(K_S=50e3)
    needed = motion_current(plant.set(K_S=50e3))["stiffness"] * 0.05
    found = review(three_state(stiff), proportional(100.0), known=replace(FRICTION, reach=0.05))

    assert f"+ {needed:.3g} A for the spring" in found["breakaway"].result


def test_the_creep_is_leakage_over_area(linear, system):
    """v = K_L F / A^2."""
    found = review(system, proportional(100.0))

    assert f"{1e9 * linear['K_L'] / linear['A'] ** 2:.3g} um/s per kN" in found["creep by leakage"].result


def test_droop_is_a_warning_without_integral_action(system):
    """A proportional gain has a static compliance, a PI has none."""
    assert review(system, proportional(100.0))["droop under load"].verdict == "warning"
    assert review(system, integral(100.0, 100.0))["droop under load"].verdict == "good"


def test_a_controller_that_does_not_reach_its_target_is_seen(system):
    """With a reference gain 10 % too small the rod stops 10 % short."""
    law = proportional(100.0).law
    short = Made(control.ss(law.A, law.B, law.C, law.D * np.array([0.9] + [1.0] * 7), law.dt))
    found = review(system, short)["reaches its target"]

    assert found.verdict == "warning" and "10 % steady-state error" in found.result


@pytest.mark.parametrize(("horizon", "verdict"), [(5, "warning"), (400, "good")])
def test_a_horizon_must_see_the_rise(system, horizon, verdict):
    """An integrator-like loop of crossover w rises in some 2.2 / w; five samples are 20 ms."""
    controller = proportional(100.0)
    controller.law.horizon = horizon
    found = review(system, controller)["horizon"]

    assert found.verdict == verdict and f"{horizon} samples are" in found.result


@pytest.mark.parametrize(("time", "verdict"), [(1e-3, "good"), (3e-3, "warning"), (5e-3, "fault")])
def test_a_solver_must_be_in_time(system, time, verdict):
    """Of 4 ms a sample."""
    assert review(system, proportional(100.0), known=Known(solver_time=time))["solver time"].verdict == verdict


def test_the_worst_plant_is_in_the_review():
    """With its name, against the same limits as the nominal loop."""
    controller = proportional(0.5 / 0.004)
    robust = robust_margins({"weak": integrator(), "three times": integrator(3.0)}, controller)
    found = review(integrator(), controller, robust=robust)

    assert found["disk margin"].verdict == "good"
    assert found["worst disk margin"].verdict == "warning" and "three times" in found["worst disk margin"].result
    assert found["worst Ms"].verdict == "warning"


def test_margins_of_another_controller_are_refused():
    """The worst case would be somebody else's."""
    robust = robust_margins({"nominal": integrator()}, proportional(50.0, name="theirs"))

    with pytest.raises(InputError, match="margins of theirs, the review is of made"):
        review(integrator(), proportional(50.0), robust=robust)


def test_what_is_not_known_is_not_judged(system):
    """Without friction, noise and solver there are no such tests."""
    tests = {finding.test for finding in review(system, proportional(100.0)).findings}

    assert not tests & {"breakaway", "stick band", "noise in the current", "solver time", "worst disk margin"}


def test_a_review_can_be_read(system):
    """As text, table and dictionary; an unknown test is refused with the known ones."""
    found = review(system, proportional(100.0), known=FRICTION)
    table = found.to_pandas()

    assert set(table.columns) == {"result", "verdict", "fix"}
    assert table.loc["stick band", "verdict"] == "warning"
    assert "! stick band" in str(found) and "->" in str(found)
    assert found.to_dict()["passed"] is True and "<pre>" in found._repr_html_()
    with pytest.raises(InputError, match="made no test 'noise'"):
        found["noise"]


@pytest.mark.parametrize("name", ["lqr_position", "mpc_position"])
def test_state_scaling_is_that_of_the_laws_own_model(system, name):
    """Laws with a model of their own have states of like size; the SI model differs by more than a million."""
    found = review(system, load_controller(name, system))["state scaling"]

    assert found.verdict == "good" and "own model" in found.result
    assert float(found.result.split("differ by a factor of ")[1].split()[0]) < 100


def test_a_lag_counts(system):
    """Two samples of lag leave less of everything."""
    prompt, late = (review(system, load_controller("pid_position", system), lag=lag).loop for lag in (0, 2))

    assert late.disk_margin < prompt.disk_margin and math.isfinite(late.disk_margin)


@pytest.mark.parametrize("name", ["force_press", "impedance_push"])
def test_a_law_in_contact_is_reviewed_there(system, name):
    """Its position has no target of its own; the margins over the stiffness are those of the design."""
    controller = load_controller(name, system)
    found = review(system, controller, known=FRICTION)
    tests = [finding.test for finding in found.findings]

    assert not found.warnings and not {"reaches its target", "droop under load", "stick band"} & {*tests}
    assert f"in contact with {1e-3 * controller.law.stiffness:g} kN/m" in found["environment"].result
    assert f"Ms {controller.law.margins.worst['Ms'].value:.3g} or less" in found["margins in contact"].result
