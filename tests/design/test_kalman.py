"""The design model and the filter on it."""

import control
import numpy as np
import pytest

from ehsa_ctrl import InputError, three_state
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.design.analysis.sampled import sampled_plant
from ehsa_ctrl.design.state_space.kalman import Observer, design_kalman
from ehsa_ctrl.design.state_space.model import design_model
from ehsa_ctrl.design.state_space.regulator import solve_target

T = 0.004


def test_the_model_is_the_sampled_plant(model, system):
    """Scaled back, the model is the exactly sampled plant, from the current and from the force."""
    plant = sampled_plant(system, T)
    to_si = np.diag(model.scale)

    z = np.exp(1j * np.array([0.01, 0.3, 2.0]))
    for point in z:
        own = model.C @ np.linalg.solve(point * np.eye(4) - model.A, np.column_stack([model.B, model.E[:, 1] / 1e3]))
        seen = model.pick @ plant(point)
        np.testing.assert_allclose(own, seen, rtol=1e-8)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(to_si @ model.A)), np.sort_complex(np.linalg.eigvals(model.A @ to_si))
    )


def test_leak_is_speed_that_the_pump_loses(model):
    """With the shaft held, a lost speed of 1 rad/s moves the oil as one rad/s of shaft speed backwards would."""
    pump = model.states.index("dP")
    omega = model.states.index("omega")
    small = design_model_small()

    assert small.E[pump, 2] == pytest.approx(-small.A[pump, omega] / small.scale[omega], rel=1e-3)


def design_model_small():
    """Sampled so fast that every column is its own first order."""
    from ehsa_ctrl import load_plant

    return design_model(three_state(load_plant("ehsa", model="linear")), 1e-6)


def test_scaled_and_unscaled_filters_are_one(system):
    """In states of like size and in SI units the same gain comes out."""
    a, b = (design_kalman(design_model(system, T, scaled=scaled), Observer()) for scaled in (True, False))
    sizes = np.r_[design_model(system, T).scale, np.ones(3)]

    np.testing.assert_allclose(a.gain * sizes[:, None], b.gain, rtol=1e-5)


def test_the_filter_is_the_limit_of_the_recursion(model):
    """The stationary gain is what the time-varying filter ends with, from another start, without any Riccati solver."""
    kalman = design_kalman(model, Observer())
    P = np.eye(7)
    for _ in range(6000):
        S = kalman.C @ P @ kalman.C.T + kalman.R
        gain = np.linalg.solve(S, kalman.C @ P).T
        P = kalman.A @ (P - gain @ kalman.C @ P) @ kalman.A.T + kalman.Q
        P = 0.5 * (P + P.T)

    np.testing.assert_allclose(kalman.gain, gain, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(kalman.covariance, P, rtol=1e-6, atol=1e-15)


def test_the_filter_agrees_with_python_control(model):
    """The predictor's gain A times the filter's is python-control's `dlqe`, given rad/s, bar and mm to measure in: with
    variances in Pa2 beside m2 its Riccati solver stops."""
    kalman = design_kalman(model, Observer(friction="1 A"))
    unit = np.diag([1.0, 1e-5, 1e3])
    L, _, poles = control.dlqe(kalman.A, np.eye(7), unit @ kalman.C, kalman.Q, unit @ kalman.R @ unit)

    np.testing.assert_allclose(kalman.A @ kalman.gain, L @ unit, rtol=1e-6, atol=1e-9 * np.max(np.abs(L)))
    np.testing.assert_allclose(np.sort(np.abs(kalman.poles)), np.sort(np.abs(poles)), rtol=1e-6)


def test_the_covariance_is_what_the_errors_have(model):
    """Driven by noise of the assumed covariance, the estimation error has the computed covariance."""
    kalman = design_kalman(model, Observer(friction="1 A", load="300 N"))
    rng = np.random.default_rng(1)
    samples, burn = 60000, 2000
    process = rng.multivariate_normal(np.zeros(7), kalman.Q, samples, method="eigh")
    noise = rng.standard_normal((samples, 3)) * np.sqrt(np.diag(kalman.R))
    keep = (np.eye(7) - kalman.gain @ kalman.C) @ np.eye(7)
    error, errors = np.zeros(7), np.empty((samples, 7))
    for k in range(samples):
        errors[k] = error
        error = kalman.A @ (keep @ error - kalman.gain @ noise[k]) + process[k]

    np.testing.assert_allclose(np.var(errors[burn:], axis=0), np.diag(kalman.covariance), rtol=0.25)


def test_the_first_estimate_shows_the_measurement_and_stays(model):
    """A filter that starts under a load reproduces the measurement, and its prediction without current is constant."""
    kalman = design_kalman(model, Observer())
    y = np.array([0.4, 13e5, 0.02])
    z = kalman.start(still=(0,)) @ y

    np.testing.assert_allclose(kalman.C @ z, [0.0, 13e5, 0.02], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(kalman.A @ z, z, rtol=1e-9, atol=1e-12)


def test_the_target_moves_along_the_reference(model):
    """x = Pi w, u = Gamma w run along the model: with friction, load and leakage the position is the reference."""
    to = solve_target(model)
    w = np.array([0.01, 0.05, -0.8, 0.7, 1.2, -2.0])
    for _ in range(50):
        x, u = to.Pi @ w, to.Gamma @ w
        later = to.S @ w

        assert model.row("position") @ x == pytest.approx(w[0], abs=1e-12)
        np.testing.assert_allclose(model.A @ x + model.B * u + model.E @ w[3:], to.Pi @ later, atol=1e-9)
        w = later


def test_what_a_load_needs_is_the_balance_of_the_plant(model, linear):
    """To hold against 1 kN the pump needs dP = F / A and the current K_T I = D dP, but for the leakage's own."""
    to = solve_target(model)
    p = linear.values
    dP = 1e3 / p["A"]
    leak = p["K_L"] * dP / p["D"]

    assert (to.Pi * model.scale[:, None])[model.states.index("dP"), 4] == pytest.approx(dP, rel=1e-9)
    assert to.Gamma[4] == pytest.approx((p["D"] * dP + p["B_FM"] * leak) / p["K_T"], rel=1e-9)


@pytest.mark.parametrize(
    ("sample_time", "says"), [(0.02, "at most 0.00958 s"), (0.0, "does not fit"), (np.inf, "does not fit")]
)
def test_a_sample_time_that_does_not_fit_is_a_sentence(system, sample_time, says):
    """A sample time that would show the hydraulic mode as a slower one says which would do."""
    with pytest.raises(InputError, match=says):
        design_model(system, sample_time)


def test_a_mode_out_of_reach_is_a_sentence():
    """A position that the current does not move, or that nothing measures."""
    names = {"inputs": ["current"], "states": ["omega", "x"]}
    unreached = control.ss([[-1.0, 0], [0, 0]], [[1.0], [0]], np.eye(2), 0, outputs=["omega", "x"], **names)
    unseen = control.ss([[-1.0, 0], [1, 0]], [[1.0], [0]], [[1.0, 0], [1.0, 0]], 0, outputs=["omega", "x"], **names)

    with pytest.raises(InputError, match="the current does not reach it"):
        design_model(unreached, T)
    with pytest.raises(InputError, match="no measurement shows it"):
        design_model(unseen, T)


def test_a_position_that_cannot_be_held_is_a_sentence():
    """A plant whose position answers the current's change alone."""
    washout = control.ss([[-3.0]], [[1.0]], [[-3.0]], 0, states=["q"], inputs=["current"], outputs=["x"])
    held = design_model(
        control.ss(
            [[-3.0, 1], [0, -5]], [[0.0], [1]], [[1.0, 0]], 0, states=["x", "v"], inputs=["current"], outputs=["x"]
        ),
        T,
    )

    assert np.isfinite(solve_target(held).Gamma).all()
    assert design_model(washout, T).disturbances == ("friction",)
    zero = control.ss(
        [[-3.0, 0], [0, -5.0]], [[1.0], [1.0]], [[-3.0, 5.0]], 0, states=["a", "b"], inputs=["current"], outputs=["x"]
    )
    with pytest.raises(InputError, match="zero at z = 1"):
        solve_target(design_model(zero, T))


def test_a_noise_of_zero_is_a_sentence():
    """A sensor without noise would leave the filter without a Riccati equation."""
    with pytest.raises(InputError, match="greater than 0"):
        validate({"position": "0 m"}, Observer, "mine.toml")
