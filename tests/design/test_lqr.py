"""LQR and LQI with their observer: optimal, free of standing errors, with margins."""

from dataclasses import replace

import control
import numpy as np
import pytest
from linear_loop import LQI, LQR, TEXTS, load, parabola, run, still

from ehsa_ctrl import InputError, load_controller, run_closed_loop
from ehsa_ctrl.core.catalogue import controllers
from ehsa_ctrl.design.analysis.closed_loop import closed_loop, linear_law
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.analysis.sampled import sampled_plant
from ehsa_ctrl.design.load import read_controller
from ehsa_ctrl.design.state_space.kalman import Observer, design_kalman
from ehsa_ctrl.design.state_space.model import design_model
from ehsa_ctrl.design.state_space.regulator import Cost, design_regulator, solve_target, weight_matrix
from ehsa_ctrl.design.state_space.state_feedback import StateFeedback

T = 0.004


@pytest.fixture
def lqr(system, tmp_path):
    return load(LQR, system, tmp_path)


@pytest.fixture
def lqi(system, tmp_path):
    return load(LQI, system, tmp_path)


def free(law):
    """Without its limit of the current."""
    return replace(law, current_limit=1e9)


def cost_of(model, **more):
    return Cost(weight_matrix(model, {"position": 5e-4, "speed": 50.0}), 1.0, **more)


def test_the_gain_is_python_controls(model):
    """Without rate and integral K is `dlqr` of the model."""
    cost = cost_of(model)
    K, P, poles = control.dlqr(model.A, model.B[:, None], cost.Q, cost.R)
    regulator = design_regulator(model, cost)

    np.testing.assert_allclose(regulator.K, K[0], rtol=1e-8)
    np.testing.assert_allclose(regulator.P[:4, :4], P, rtol=1e-8, atol=1e-8 * np.max(P))
    assert regulator.before == pytest.approx(0.0, abs=1e-12) and regulator.integral == 0.0
    np.testing.assert_allclose(np.sort(np.abs(regulator.poles)), np.sort(np.abs(np.r_[poles, 0.0])), atol=1e-9)


@pytest.mark.parametrize("more", [{}, {"R_rate": 25.0}, {"Q_integral": 1e8}, {"R_rate": 4.0, "Q_integral": 1e6}])
def test_the_gain_solves_the_riccati_equation(model, more):
    """P = Q + A'P A - K'(R + B'P B) K with the gain that this P gives, for every form of the cost."""
    r = design_regulator(model, cost_of(model, **more))
    S, M = r.R + r.B @ r.P @ r.B, r.B @ r.P @ r.A + r.N_cross
    residual = r.Q + r.A.T @ r.P @ r.A - np.outer(M, M) / S - r.P

    assert np.max(np.abs(residual)) < 1e-8 * np.max(np.abs(r.P))
    gains = np.r_[r.K, r.before, [r.integral] * ("Q_integral" in more)]
    np.testing.assert_allclose(gains, M / S, rtol=1e-8, atol=1e-10)
    assert np.max(np.abs(r.poles)) < 1.0


def test_no_other_gain_is_cheaper(model):
    """From random states each of 40 gains nearby costs more than the regulator, with the weight on the rate as well."""
    r = design_regulator(model, cost_of(model, R_rate=4.0))
    rng = np.random.default_rng(0)
    best = np.r_[r.K, r.before]

    def total(gain):
        closed = r.A - np.outer(r.B, gain)
        stage = r.Q + r.R * np.outer(gain, gain) - np.outer(r.N_cross, gain) - np.outer(gain, r.N_cross)
        return np.trace(control.dlyap(closed.T, stage))

    assert total(best) == pytest.approx(np.trace(r.P), rel=1e-7)
    for _ in range(40):
        assert total(best * (1 + 0.05 * rng.standard_normal(5))) > total(best)


def test_scaled_and_unscaled_states_give_one_law(system):
    """States of like size are for the solver's good alone: gains in SI units are those of the model in SI units."""
    laws = []
    for scaled in (True, False):
        model = design_model(system, T, scaled=scaled)
        parts = solve_target(model), design_kalman(model, Observer()), design_regulator(model, cost_of(model))
        laws.append(StateFeedback(model, *parts, 6.0))

    np.testing.assert_allclose(laws[0].K, laws[1].K, rtol=1e-6)
    for name in ("K_z", "K_r", "F_z"):
        np.testing.assert_allclose(laws[0].matrices[name], laws[1].matrices[name], rtol=1e-5, err_msg=name)


@pytest.mark.parametrize("name", ["lqr", "lqi"])
def test_the_poles_separate(system, name, tmp_path):
    """The closed loop's poles are the regulator's and the observer's, no others."""
    controller = load(TEXTS[name], system, tmp_path)
    closed = closed_loop(sampled_plant(system, T), linear_law(controller))
    poles = np.r_[controller.law.regulator.poles, controller.law.kalman.poles]

    for pole in closed.poles():
        # The current before is no state here without its weight; every other one must be found.
        assert np.min(np.abs(poles - pole)) < 1e-5
    assert closed.nstates >= 8


@pytest.mark.parametrize("name", ["lqr", "lqi"])
def test_linear_is_what_the_text_does(system, name, tmp_path):
    """`linear()` run as a discrete system gives the currents of the law's text, on readings that are pure noise."""
    law = free(load(TEXTS[name], system, tmp_path).law)
    linear, rng = law.linear(), np.random.default_rng(5)
    memory, state = law.initial_memory(), np.zeros(law.linear().nstates)
    scale = np.array([1e-3, 1e-2, 1e-1, 1.0, 1e5, 1e5, 1e-3, 1.0])
    law.function(np.zeros(3), np.zeros(5), memory, law.settings(), 0.0, 0.0)
    for _ in range(300):
        row = scale * rng.standard_normal(8)
        u = law.function(row[:3], row[3:], memory, law.settings(), 0.0, 0.0)

        assert u == pytest.approx((linear.C @ state + linear.D @ row)[0], rel=1e-7, abs=1e-9)
        state = linear.A @ state + linear.B @ row


@pytest.mark.parametrize("name", ["lqr", "lqi"])
@pytest.mark.parametrize("disturbance", [{"load": 2000.0}, {"friction": -1.2}, {"load": -800.0, "friction": 0.5}])
def test_no_error_stands(system, model, name, disturbance, tmp_path):
    """A constant force or a constant current at the motor leaves no steady-state error."""
    law = free(load(TEXTS[name], system, tmp_path).law)
    position, _, _ = run(law, still(1500, 0.004), plant=model, **disturbance)

    assert abs(position[-1] - 0.004) < 1e-9


def test_the_estimate_is_the_disturbance(lqr):
    """Friction as a current and the load as a force are found, each in its place and unit."""
    _, _, memory = run(free(lqr.law), still(1500), load=1500.0, friction=-0.7)

    assert memory[-1, lqr.law.traces["estimate_load"]] == pytest.approx(1500.0, rel=1e-6)
    assert memory[-1, lqr.law.traces["estimate_friction"]] == pytest.approx(-0.7, rel=1e-6)
    assert memory[-1, lqr.law.traces["estimate_leak"]] == pytest.approx(0.0, abs=1e-6)


def test_without_either_the_error_stands(model):
    """A state feedback without estimated disturbances and integral has the static stiffness of K under a load."""
    bare = model.without_disturbance
    law = StateFeedback(
        bare, solve_target(bare), design_kalman(bare, Observer()), design_regulator(bare, cost_of(bare)), 1e9
    )
    position, _, _ = run(law, still(1500), load=1000.0, plant=model)

    assert -position[-1] > 1e-5


@pytest.mark.parametrize("name", ["lqr", "lqi"])
def test_a_planned_motion_is_followed_without_lag(system, name, tmp_path):
    """From rest along a parabola: speed and acceleration feed forward, the error is rounding, LQI's a transient."""
    law = free(load(TEXTS[name], system, tmp_path).law)
    reference = parabola(200, T, 0.3)
    position, _, _ = run(law, reference)

    # At rest the plant is not yet where an accelerating one is; what that costs has decayed by then.
    assert np.max(np.abs(position - reference[:, 0])[100:]) < 1e-6


@pytest.mark.parametrize("name", ["lqr", "lqi"])
def test_the_start_has_no_kick(system, name, tmp_path):
    """Where it rests, at any position and pressure, the first current is none. Nor is the second, but for a filter that
    has no place for a load and takes the pressure for the beginning of a motion."""
    law = load(TEXTS[name], system, tmp_path).law
    memory = law.initial_memory()
    measured = np.array([0.0, 27e5, 14e5, 0.031, 0.0])
    first = law.function(np.array([0.031, 0, 0]), measured, memory, law.settings(), 0.0, 0.0)
    second = law.function(np.array([0.031, 0, 0]), measured, memory, law.settings(), 0.0, 0.0)

    assert abs(first) < 1e-9
    assert abs(second) < (1e-6 if name == "lqr" else 0.2)


def test_hold_keeps_what_it_has_learnt(model, lqr, lqi):
    """While hold is set, disturbance estimates and integral are constant; afterwards they compensate the load."""
    hold = np.where(np.arange(400) < 200, 1.0, 0.0)
    for law, names in ((lqr.law, ("friction", "load", "leak")), (lqi.law, ())):
        position, _, memory = run(free(law), still(400), load=800.0, hold=hold, plant=model)
        places = [law.traces[f"estimate_{name}"] for name in names] or [1]

        assert np.all(np.ptp(memory[:200, places], axis=0) == 0.0)
        assert np.ptp(memory[200:, places], axis=0).max() > 1e-6
        assert abs(position[199]) > 1e-5 > abs(position[-1])


def test_extra_current_is_not_taken_for_motion(lqr):
    """Friction that feed-forward pays for to the point leaves estimates and position as if there were none."""
    extra = np.where(np.arange(500) >= 100, 0.9, 0.0)
    model = lqr.law.model
    law = free(lqr.law)
    memory, x = law.initial_memory(), np.zeros(4)
    for k in range(500):
        speed, dP, position = model.C @ x
        measured = np.array([speed, dP / 2, -dP / 2, position, 0.0])
        u = law.function(np.array([0.002, 0, 0]), measured, memory, law.settings(), extra[k], 0.0)
        x = model.A @ x + model.B * (u - extra[k])
    assert abs(memory[law.traces["estimate_friction"]]) < 1e-6
    assert position == pytest.approx(0.002, abs=1e-8)


@pytest.mark.parametrize("name", ["lqr", "lqi"])
def test_saturation_does_not_wind_up(system, name, tmp_path):
    """A step that saturates for long overshoots no more than the step that does not, relative to its size."""
    law = load(TEXTS[name], system, tmp_path).law
    tight, wide = replace(law, current_limit=1.5), free(law)
    over = []
    for each in (tight, wide):
        position, *_ = run(each, still(1500, 0.05))
        over.append(max(position) / 0.05 - 1)

        assert abs(position[-1] - 0.05) < 1e-6
    assert over[0] < over[1] + 0.02


@pytest.mark.parametrize("lost", [0, 1, 2, 3])
def test_a_lost_reading_does_not_poison(lqr, lost):
    """Readings that are no numbers for 30 samples: every current is a number, and the position is held again after."""

    def spoil(k, measured):
        if 300 <= k < 330:
            measured[lost] = np.nan if k % 2 else np.inf

    position, current, memory = run(lqr.law, still(1200, 0.003), load=500.0, spoil=spoil)

    assert np.isfinite(current).all() and np.isfinite(memory).all()
    assert abs(position[-1] - 0.003) < 1e-6


def test_the_catalogues_loops_have_their_margins(system):
    """Broken at the current, with the observer, every state feedback of the catalogue: Ms at most 1.6 and a disk margin
    of at least 0.6; so has what these tests take."""
    names = [name for name in controllers if read_controller(controllers.find(name))[0].name in ("lqr", "mpc")]

    assert len(names) >= 3
    for name in names:
        loop = analyse_loop(system, load_controller(name, system))

        assert loop.stable and loop.Ms <= 1.6 and loop.disk_margin >= 0.6, name


def test_a_stuck_rod_does_not_mislead_the_observer(plant, lqr):
    """Held by friction against a target just out of reach, the estimated speed stays near the true one, which is 0."""
    bare = replace(lqr, rest=None, trajectory=None, feedforward=None)
    loop = run_closed_loop(plant, bare, still(500, 3e-5))
    resting = loop.trajectory["omega"] == 0.0

    assert np.count_nonzero(resting) > 100
    assert np.max(np.abs(loop.traces["estimate_omega"][resting])) < 2.0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('position = "0.5 mm"', "position = [1, 2]", r"\[weights\] position"),
        ('position = "0.5 mm"', 'position = "0 mm"', r"greater than 0"),
        ('offset_free = "disturbance"', 'offset_free = "integral"', "give both or neither"),
        ('sample_time = "4 ms"', 'sample_time = "20 ms"', "at most 0.00958 s"),
        ('load = "200 N"', 'load = "-200 N"', r"\[observer\] load = -200.0; expected a value greater than 0"),
        ("[weights]", '[feedforward]\ninertia = "1 A s2/m"\n[weights]', "friction only"),
    ],
)
def test_wrong_files_are_sentences(tmp_path, system, old, new, says):
    """The error names the file, the given and the expected value."""
    assert old in LQR

    with pytest.raises(InputError, match=says) as caught:
        load(LQR.replace(old, new), system, tmp_path)
    assert "mine.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("cost", "says"),
    [
        (Cost(np.eye(3), 1.0), r"shape \(3, 3\); expected \(4, 4\)"),
        (Cost(np.diag([1.0, 1, 1, -1]), 1.0), "positive semidefinite"),
        (Cost(np.eye(4) + np.eye(4, k=1), 1.0), "symmetric"),
        (Cost(np.eye(4), 0.0), "expected R > 0"),
        (Cost(np.zeros((4, 4)), 1.0), r"give \[weights\] position"),
    ],
)
def test_wrong_weights_are_sentences(model, cost, says):
    """Weights of the wrong shape or sign, or without effect on a mode that must be stabilised."""
    with pytest.raises(InputError, match=says):
        design_regulator(model, cost)
