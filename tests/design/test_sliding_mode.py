"""Sliding mode: poles within the boundary layer, reaching it on an uncertain plant, the law."""

import control
import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.controller_interface import INPUTS
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.kinds.sliding_mode import SlidingMode
from ehsa_ctrl.design.review import Known, review

T_S, B_0, N = 0.004, 1.3, 4e-4


@pytest.fixture
def model(linear):
    return ehsa_ctrl.three_state(linear)


def controller(model, **more):
    surface = {"bandwidth": "30 rad/s", "disturbance": "0.6 A"} | more
    content = {"kind": "sliding_mode", "current_limit": "6 A", "sample_time": "4 ms", "sliding_mode": surface}
    return ehsa_ctrl.load_controller(content, model)


def law_of(**changes):
    numbers = {
        "b_0": B_0, "c": 8.0, "n": N, "bandwidth": 30.0, "layer": 60.0, "disturbance": 0.6, "reaching": 0.3,
        "gain_margin": 1.2, "current_limit": 1e9, "sample_time": T_S,
    }  # fmt: skip
    return SlidingMode(**{**numbers, **changes})


def test_within_the_layer_the_poles_are_those_of_surface_and_layer():
    """-lambda twice and -lambda_phi, of the continuous loop that a sample time of 1 us stands for."""
    step = 1e-6
    law = law_of(sample_time=step).linear()
    plant = control.ss([[-8.0, 0.0], [1.0, 0.0]], [[B_0], [0.0]], np.eye(2), np.zeros((2, 1)))
    sampled = control.sample_system(plant, step, "zoh")
    # The law's readings from v and x.
    from_states = np.zeros((len(INPUTS), 2))
    from_states[INPUTS.index("speed"), 0], from_states[INPUTS.index("position"), 1] = 1.0 / N, 1.0
    b, d = law.B @ from_states, law.D @ from_states
    a = np.block([[sampled.A + sampled.B @ d, sampled.B @ law.C], [b, law.A]])
    # States of the law that only record something are at zero, or do not change.
    used = np.abs(a).sum(axis=0) - np.abs(np.diag(a)) > 0.0
    poles = np.linalg.eigvals(a[np.ix_(used, used)]).astype(complex)
    slow = sorted((np.log(z) / step for z in poles if abs(z) > 0.5 and z != 1.0), key=abs)

    assert np.poly(slow) == pytest.approx(np.poly([-30.0, -30.0, -60.0]), rel=1e-3)


@pytest.mark.parametrize("gain", [1 / 1.2, 1.2])
@pytest.mark.parametrize("disturbance", [-0.6, 0.6])
def test_it_reaches_the_layer_in_time_whatever_the_uncertainty_does(gain, disturbance):
    """|s| falls by at least b_0 eta per second, on every plant that beta and F admit."""
    law = law_of(sample_time=1e-4)
    memory, numbers, x, v = law.initial_memory(), law.settings(), 0.05, 0.0
    sizes = []
    for _ in range(20_000):
        u = law.function(np.zeros(3), np.array([v / N, 0.0, 0.0, x, 0.0]), memory, numbers, 0.0, 0.0)
        sizes.append(abs(memory[1]))
        if abs(memory[2]) < law.k:
            break
        a = gain * B_0 * (u + disturbance) - 8.0 * v
        x, v = x + 1e-4 * v + 0.5e-8 * a, v + 1e-4 * a
    # 2 % for the sampling.
    assert np.max(np.diff(sizes)) < -0.98 * 1e-4 * B_0 * 0.3 / 1.2
    assert len(sizes) < 20_000


def test_the_linear_law_is_the_law_within_the_layer():
    signals = np.random.default_rng(2).normal(0, [1e-5, 1e-3, 0.1, 1.0, 1e-5], (150, 5))
    law = law_of(disturbance=50.0)
    memory, numbers = law.initial_memory(), law.settings()
    found = [law.function(s[:3], np.array([s[3], 0, 0, s[4], 0]), memory, numbers, 0.0, 0.0) for s in signals]
    inputs = np.zeros((len(INPUTS), 150))
    for column, name in enumerate((*INPUTS[:3], "speed", "position")):
        inputs[INPUTS.index(name)] = signals[:, column]

    expected = control.forced_response(law.linear(), inputs=inputs).outputs[0]
    assert np.allclose(found, expected, rtol=1e-8, atol=1e-9)


def test_outside_the_layer_nothing_winds_up_and_at_rest_nothing_moves():
    law = law_of(current_limit=1.0)
    memory, numbers, away = law.initial_memory(), law.settings(), np.array([0.02, 0.0, 0.0])
    for _ in range(1000):
        assert law.function(away, np.zeros(5), memory, numbers, 0.0, 0.0) == 1.0
    assert memory[0] == 0.0
    near = np.array([1e-4, 0.0, 0.0])
    law = law_of()
    memory, numbers = law.initial_memory(), law.settings()
    held = [law.function(near, np.zeros(5), memory, numbers, 0.0, 1.0) for _ in range(20)]
    assert np.ptp(held) == 0.0 and memory[0] == 0.0 and held[0] > 0.0


def test_the_review_names_layer_and_disturbance(model):
    """More friction than F bears is a warning, until it is fed forward."""
    known = Known(static=1.08)
    bare = review(model, controller(model), known=known)
    shipped = ehsa_ctrl.load_controller("sliding_friction", model)

    assert bare["disturbance"].verdict == "warning" and "to 1.1 A or more" in bare["disturbance"].fix
    assert review(model, shipped, known=known)["disturbance"].verdict == "good"
    assert "k = 0.96 A" in bare["boundary layer"].result


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"bandwidth": "300 rad/s", "layer_ratio": 4.0}, "expected less than 785.4 rad/s, the Nyquist frequency"),
        ({"bandwidth": "90 rad/s", "layer_ratio": 5.0}, "the loop is unstable .* lower .sliding_mode. bandwidth"),
        ({"disturbance": "5 A"}, r"k = beta \(F \+ eta\) = 8 A is beyond current_limit = 6 A"),
        ({"disturbance": "0 A"}, "disturbance = .*greater than 0"),
        ({"gain_margin": 0.8}, "gain_margin = 0.8; expected a value greater than or equal to 1"),
    ],
)
def test_a_wrong_specification_is_one_sentence(model, given, sentence):
    with pytest.raises(InputError, match=sentence):
        controller(model, **given)


def test_a_model_without_the_shaft_gets_the_rods_speed_from_its_position(model):
    law = controller(model[model.output_labels.index("x"), :]).law

    assert law.reads == ("position",) and law.n == 1.0 and law.T_f == pytest.approx(1.0 / (10.0 * 30.0))
