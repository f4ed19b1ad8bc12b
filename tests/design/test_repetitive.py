"""Repetitive control: the filter, convergence in closed form, the law against an independent recursion."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.closed_loop import INPUTS, OUTPUTS, close_loop, discrete_response
from ehsa_ctrl.design.analysis.learning import binomial_taps, design_learning
from ehsa_ctrl.design.review import review

T_S = 0.004
BASE = {
    "kind": "cascade",
    "speed": {"crossover": "130 rad/s", "phase_margin": "65 deg"},
    "position": {"crossover": "30 rad/s", "phase_margin": "60 deg", "speed_limit": "450 rad/s"},
}
UNSTABLE = {"kind": "adrc", "adrc": {"bandwidth": "60 rad/s", "observer_ratio": 12.0, "measurement": "position"}}


@pytest.fixture
def model(linear):
    return ehsa_ctrl.three_state(linear)


def controller(model, base=BASE, current_limit="6 A", **cycle):
    content = {
        "kind": "repetitive", "current_limit": current_limit, "sample_time": "4 ms", "base": base,
        "cycle": {"period": "0.4 s", "cutoff": "10 Hz"} | cycle,
    }  # fmt: skip
    return ehsa_ctrl.load_controller(content, model)


@pytest.mark.parametrize("cutoff", [2.0, 10.0, 60.0])
def test_the_filter_has_no_phase_and_its_cutoff(cutoff):
    taps = binomial_taps(cutoff, T_S)
    q = taps.size // 2

    def gain(frequency):
        return np.sum(taps * np.exp(-2j * np.pi * frequency * T_S * np.arange(-q, q + 1)))

    assert gain(0.0) == pytest.approx(1.0)
    assert np.imag(gain(0.7 * cutoff)) == pytest.approx(0.0, abs=1e-12)
    assert 0.3 < gain(cutoff).real <= np.sqrt(0.5) < gain(0.8 * cutoff).real + 0.1


def test_the_error_that_is_left_is_that_of_theory(linear, model):
    """A sine of the period on the linear plant: (1 - Q) / (1 - Q (1 - gamma z^m T)) of the base loop's error."""
    chosen = controller(model, gain=0.7, current_limit="1000 A")
    learning, N, cycles = chosen.law.learning, 100, 60
    time, w = np.arange(N * cycles) * T_S, 2 * np.pi / 0.4
    sine = 1e-3 * np.column_stack([np.sin(w * time), np.zeros((time.size, 2))])
    loop = ehsa_ctrl.run_closed_loop(linear, chosen, sine)
    last, first = (loop.error[k * N : (k + 1) * N] for k in (cycles - 1, 1))

    _, _, closed = close_loop(model, chosen)
    T = discrete_response(closed[OUTPUTS.index("position"), INPUTS.index("r_position")], w)[0, 0, 0]
    Q = np.cos(0.5 * w * T_S) ** (learning.taps.size - 1)
    left = (1 - Q) / (1 - Q * (1 - learning.gain * np.exp(1j * learning.lead * w * T_S) * T)) * (1 - T)
    assert np.max(np.abs(last)) == pytest.approx(1e-3 * abs(left), rel=0.01)
    assert np.max(np.abs(last)) < 0.3 * np.max(np.abs(first))


def test_the_law_is_the_recursion_over_whole_cycles(model):
    """w of a cycle from w and e of the one before, by convolution of whole signals."""
    chosen = controller(model, deadband="20 um", limit="1 mm")
    law, N = chosen.law, 100
    q, m = law.learning.taps.size // 2, law.learning.lead
    rng = np.random.default_rng(1)
    r, y = rng.normal(0, 1e-4, (2, 6 * N))
    memory, numbers = law.initial_memory(), law.settings()
    place = law.traces["corrected_position"]
    found = []
    for k in range(6 * N):
        row, read = np.array([r[k], 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, y[k], 0.0])
        law.function(row, read, memory, numbers, 0.0, 0.0)
        found.append(memory[place] - r[k])

    e = np.where(np.abs(r - y) <= 20e-6, 0.0, r - y)
    # v begins m samples before the run: the first errors belong to the end of the cycle before.
    before = N + q + m
    w, v = np.zeros(6 * N), np.zeros(6 * N + before)
    for k in range(6 * N):
        w[k] = np.clip(v[before + k - N - q : before + k - N + q + 1] @ law.learning.taps, -1e-3, 1e-3)
        v[before + k - m] = (w[k - m] if k >= m else 0.0) + law.learning.gain * e[k]
    assert np.allclose(found, w, atol=1e-15)
    assert np.max(np.abs(w)) > 1e-5


@pytest.mark.parametrize(
    "base",
    [
        {"kind": "pid", "design": {"crossover": "35 rad/s", "phase_margin": "60 deg"}},
        {"kind": "lqr", "weights": {"position": "0.5 mm"}},
        {"kind": "adrc", "adrc": {"bandwidth": "30 rad/s"}},
        {"kind": "sliding_mode", "sliding_mode": {"bandwidth": "30 rad/s", "disturbance": "0.6 A"}},
        BASE,
    ],
    ids=lambda base: base["kind"],
)
def test_the_first_cycle_is_that_of_the_base(model, base):
    """To the bit, for every kind of base."""
    both = (
        controller(model, base),
        ehsa_ctrl.load_controller(base | {"current_limit": "6 A", "sample_time": "4 ms"}, model),
    )
    rng = np.random.default_rng(3)
    rows = rng.normal(0, [1e-3, 0.05, 1.0, 0.0, 20.0, 1e5, 1e5, 1e-3, 10.0], (60, 9))
    found = []
    for chosen in both:
        memory, numbers = chosen.law.initial_memory(), chosen.law.settings()
        found.append([chosen.law.function(row[:4], row[4:], memory, numbers, 0.0, 0.0) for row in rows])

    assert found[0] == found[1]


def test_plain_and_compiled_law_are_the_same(plant, model):
    time = T_S * np.arange(300)
    reference = np.column_stack([2e-3 * np.sin(2 * np.pi / 0.4 * time), np.zeros((300, 2))])

    plain, fast = (
        ehsa_ctrl.run_closed_loop(plant, controller(model), reference, compiled=way) for way in (False, True)
    )

    assert np.allclose(plain.asked, fast.asked, rtol=1e-9, atol=1e-12)
    assert np.ptp(fast.traces["corrected_position"] - reference[:, 0]) > 1e-4


def test_the_review_states_the_contraction(model):
    chosen = ehsa_ctrl.load_controller("repetitive_press", model)

    assert review(model, chosen)["learning converges"].verdict == "good"
    assert chosen.law.learning.contraction < 0.95


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"period": "0.401 s"}, r"period = 0.401 s is 100.25 samples of 0.004 s; expected a whole number"),
        ({"cutoff": "130 Hz"}, "cutoff must be below half the sample rate 125 Hz"),
        ({"cutoff": "100 Hz", "lead": 0}, "learning does not converge .* grows by .* per cycle at .*; lower it to "),
        ({"cutoff": "1 Hz", "period": "0.1 s"}, "period of 25 samples is too short for a filter"),
        ({"gain": 2.5}, "gain = 2.5; expected a value less than 2"),
        ({"base": {"kind": "mpc"}}, r"\[base\] kind = 'mpc'; .*known: .*cascade"),
        ({"base": BASE | {"title": "mine"}}, r"\[base\] title: belongs to the controller itself"),
        ({"base": {"kind": "adrc", "adrc": {"width": 1}}}, r"\[base\]: \[adrc\] width: unknown key"),
        ({"base": UNSTABLE}, r"\[base\] the loop is unstable on this model"),
    ],
)
def test_a_wrong_definition_is_one_sentence(model, given, sentence):
    base = given.pop("base", BASE) if "base" in given else BASE
    with pytest.raises(InputError, match=sentence) as raised:
        controller(model, base, **given)

    assert "\n" not in str(raised.value)


def test_the_best_lead_is_no_worse_than_another(model):
    chosen = ehsa_ctrl.load_controller("cascade_position", model)
    best = design_learning(model, chosen, gain=0.7, cutoff=6.0)
    others = [design_learning(model, chosen, gain=0.7, cutoff=3.0, lead=m).contraction for m in (0, 4, 8)]

    assert best.converges
    assert design_learning(model, chosen, gain=0.7, cutoff=3.0).contraction <= min(others)
