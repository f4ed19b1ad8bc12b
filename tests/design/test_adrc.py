"""ADRC: poles in closed form, the law, its behaviour at rest."""

import control
import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.controller_interface import INPUTS
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.closed_loop import close_loop
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.analysis.rigid_body import rigid_body
from ehsa_ctrl.design.kinds.adrc import Adrc, observer_gains

T_S, B_0, N = 0.004, 1.3, 4e-4


@pytest.fixture
def model(linear):
    return ehsa_ctrl.three_state(linear)


def inertia(b_0=B_0, c=0.0):
    """dv/dt = b_0 u - c v, omega = v / N."""
    return control.ss(
        [[-c, 0.0], [1.0, 0.0]], [[b_0], [0.0]], [[0.0, 1.0], [1.0 / N, 0.0]], np.zeros((2, 1)),
        inputs=["current"], outputs=["x", "omega"], states=["v", "x"], name="inertia",
    )  # fmt: skip


def controller(model, bandwidth=30, ratio=4.0, measurement="speed", **more):
    loop = {"bandwidth": f"{bandwidth} rad/s", "observer_ratio": ratio, "measurement": measurement} | more
    return ehsa_ctrl.load_controller(
        {"kind": "adrc", "current_limit": "6 A", "sample_time": "4 ms", "adrc": loop}, model
    )


@pytest.mark.parametrize("c", [0.0, 8.0])
def test_the_rigid_body_is_the_models(c):
    """Gain, decay and travel of a plant that is one."""
    found = rigid_body(inertia(c=c), 30.0)

    assert (found.b_0, found.c, found.n) == pytest.approx((B_0, c, N), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("measures_speed", [True, False])
def test_all_poles_of_the_observer_are_where_the_bandwidth_says(measures_speed):
    l_x, l_v, l_f = observer_gains(120.0, T_S, measures_speed=measures_speed)
    a = np.array([[1.0, T_S, T_S**2 / 2], [0.0, 1.0, T_S], [0.0, 0.0, 1.0]])
    gain, c = np.array([l_x, l_v, l_f]), np.array([1.0, 0.0, 0.0])
    if measures_speed:
        a, gain, c = a[1:, 1:], gain[1:], np.array([1.0, 0.0])
    beta = np.exp(-120.0 * T_S)

    # The characteristic polynomial, because a multiple eigenvalue is known to its root of rounding only.
    assert np.poly(a - np.outer(gain, c) @ a) == pytest.approx(np.poly([beta] * len(a)), abs=1e-12)


@pytest.mark.parametrize("measurement", ["speed", "position"])
def test_poles_of_loop_and_observer_separate_on_the_plant_that_it_assumes(measurement):
    """The sampled double integrator: those of state feedback, and those of the observer."""
    chosen = controller(inertia(), measurement=measurement)
    _, _, closed = close_loop(inertia(), chosen)
    feedback = np.array([[1.0, T_S], [0.0, 1.0]]) - np.outer([T_S**2 / 2, T_S], [30.0**2, 60.0])
    beta = np.exp(-120.0 * T_S)
    expected = np.poly([*np.linalg.eigvals(feedback), *[beta] * (2 if measurement == "speed" else 3)])
    found = np.poly(closed.A)
    # The law's memory may have more states than the loop; they are at zero.
    assert found[: expected.size] == pytest.approx(expected, abs=1e-9)
    assert found[expected.size :] == pytest.approx(0.0, abs=1e-9)


def test_with_the_position_no_load_leaves_an_error_and_with_the_speed_only_leakage_does(linear, model):
    """The observer of the speed does not see the oil that leaks past a shaft at rest: 2 / w_c times its speed."""
    position = analyse_loop(model, controller(model, 15, 2.0, "position"))
    chosen = ehsa_ctrl.load_controller("adrc_position", model)
    speed = analyse_loop(model, chosen)

    assert position.stable and position.static_compliance == 0.0
    assert speed.stable and speed.disk_margin > 0.9
    leak = linear["K_L"] / linear["A"] ** 2
    assert abs(speed.static_compliance) == pytest.approx(2.0 / chosen.law.w_c * leak, rel=0.02)


def law_of(**changes):
    return Adrc(**{"b_0": B_0, "w_c": 30.0, "w_o": 120.0, "n": N, "current_limit": 1e9, "sample_time": T_S, **changes})


def run(law, signals, hold=None):
    """Currents for rows of r, v_r, a_r, omega, y."""
    memory, numbers = law.initial_memory(), law.settings()
    hold = np.zeros(len(signals)) if hold is None else hold
    rows = zip(signals, hold, strict=True)
    return np.array(
        [law.function(s[:3], np.array([s[3], 0.0, 0.0, s[4], 0.0]), memory, numbers, 0.0, h) for s, h in rows]
    )


@pytest.mark.parametrize("n", [N, 0.0])
def test_the_linear_law_is_the_law_without_limits(n):
    signals = np.random.default_rng(2).normal(0, [1e-3, 0.05, 1.0, 50.0, 1e-3], (150, 5))
    signals[0] = 0.0
    law = law_of(n=n)
    inputs = np.zeros((len(INPUTS), 150))
    for column, name in enumerate((*INPUTS[:3], "speed", "position")):
        inputs[INPUTS.index(name)] = signals[:, column]

    expected = control.forced_response(law.linear(), inputs=inputs).outputs[0]
    assert np.allclose(run(law, signals), expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("n", [N, 0.0])
def test_no_kick_at_the_start_and_no_drift_while_friction_holds_the_rod(n):
    """A rod at its target gets no current; one that rests beside it a constant one."""
    there, beside = np.zeros((40, 5)), np.zeros((40, 5))
    there[:, [0, 4]] = 0.07
    beside[:, 0] = 1e-4
    held = np.r_[np.zeros(10), np.ones(30)]

    assert np.all(run(law_of(n=n), there) == 0.0)
    assert np.ptp(run(law_of(n=n), beside, held)[10:]) == 0.0


def test_a_limited_current_does_not_wind_the_observer_up():
    """The observer gets the limited current: on its own plant it sees no disturbance."""
    law = law_of(current_limit=0.5)
    memory, x, v = law.initial_memory(), 0.0, 0.0
    for _ in range(100):
        u = law.function(np.array([0.5, 0, 0.0]), np.array([v / N, 0, 0, x, 0.0]), memory, law.settings(), 0.0, 0.0)
        x, v = x + T_S * v + T_S**2 / 2 * B_0 * u, v + T_S * B_0 * u

    assert u == 0.5
    assert memory[3] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"bandwidth": 300}, "is 1200 rad/s; expected less than 785.4 rad/s, the Nyquist frequency"),
        ({"ratio": 0.5}, "observer_ratio = 0.5; expected a value greater than 1"),
        ({"bandwidth": 60, "ratio": 12.0, "measurement": "position"}, "the loop is unstable .* lower .adrc. bandwidth"),
        ({"b_0": "-1 m/(s2 A)"}, "b_0 = .*greater than 0"),
        ({"b_0": "2 kg"}, "b_0: "),
    ],
)
def test_a_wrong_specification_is_one_sentence(model, given, sentence):
    with pytest.raises(InputError, match=sentence):
        controller(model, **given)


def test_a_model_without_the_shaft_needs_the_other_measurement(model):
    row = model.output_labels.index("x")
    only = control.ss(
        model.A, model.B, model.C[[row]], model.D[[row]],
        states=list(model.state_labels), inputs=list(model.input_labels), outputs=["x"],
    )  # fmt: skip

    with pytest.raises(InputError, match=r"no output omega; take \[adrc\] measurement = 'position'"):
        controller(only)
    assert controller(only, 15, 2.0, "position").law.n == 0.0
