"""Adaptive friction feedforward: the true factors, their bounds, frozen at rest, the same in every form."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.files import read_toml
from ehsa_ctrl.design.stages.adaptation import MEMORY, Adaptation, adapt, adaptation_settings, renew_factors
from ehsa_ctrl.design.stages.pipeline import M_CURRENT

NAME = "pid_adaptive"
T = 0.004
VISCOUS, COULOMB, LIMIT = 6.0, 0.9, 6.0


@pytest.fixture(scope="module")
def model():
    return e.three_state(e.load_plant("ehsa", model="linear"))


@pytest.fixture(scope="module")
def adaptive(model):
    return e.load_controller(NAME, model)


def settings(**keys):
    return adaptation_settings(Adaptation(**keys), COULOMB, (0.0, VISCOUS, 0.0), T, LIMIT)


def moved(memory, numbers, speed, factors):
    """One sample after a motion at `speed` whose friction is the model's times `factors`."""
    viscous, dry = VISCOUS * speed, COULOMB * np.sign(speed)
    memory[:4] = factors[0] * viscous + factors[1] * dry + 0.2, 0.2, viscous, dry
    memory[9] = speed
    adapt(memory, numbers)


def test_the_factors_converge_to_the_true_ones():
    """Speeds of 0 to 0.2 m/s tell viscous from dry friction; a part of the current that is known drops out."""
    memory, numbers = np.zeros(MEMORY), settings()
    for k in range(40000):
        moved(memory, numbers, 0.2 * np.sin(0.01 * k), (0.6, 1.5))

    np.testing.assert_allclose(1.0 + memory[7:9], [0.6, 1.5], rtol=0.01)


def test_at_one_speed_the_sum_converges_at_the_stated_time():
    """Then only the total friction is told; its error falls as exp(-t / time) once the filter has settled."""
    memory, numbers = np.zeros(MEMORY), settings(time="2 s", filter_time="0 s")
    left = []
    for _ in range(501):
        moved(memory, numbers, 0.1, (1.5, 1.5))
        friction = (1.0 + memory[7]) * VISCOUS * 0.1 + (1.0 + memory[8]) * COULOMB
        left.append(1.5 * (VISCOUS * 0.1 + COULOMB) - friction)

    assert left[-1] / left[0] == pytest.approx(np.exp(-500 * T / 2.0), rel=0.02)


def test_the_factors_stay_within_their_bounds():
    """Projection, for friction far beyond them; then they return."""
    memory, numbers = np.zeros(MEMORY), settings(least=0.5, most=2.0)
    for factors in ((3.5, 3.5), (-3.5, -3.5)):
        for k in range(5000):
            moved(memory, numbers, 0.2 * np.sin(0.01 * k), factors)
            assert 0.5 <= 1.0 + memory[7] <= 2.0 and 0.5 <= 1.0 + memory[8] <= 2.0
        assert 1.0 + memory[8] == (2.0 if factors[0] > 0.0 else 0.5)


def test_frozen_at_rest_and_at_the_limit():
    """Neither a current that winds up at rest nor a limited one changes a factor; the filter starts anew."""
    memory, numbers = np.zeros(MEMORY), settings()
    for _ in range(200):
        moved(memory, numbers, 0.1, (1.2, 1.2))
    before = memory[7:9].copy()
    for _ in range(200):
        memory[:4], memory[9] = (2.0, 0.0, 0.0, 0.0), 0.0
        adapt(memory, numbers)
    np.testing.assert_array_equal(memory[7:9], before)
    assert not memory[4:7].any()
    for _ in range(200):
        memory[:4], memory[9] = (LIMIT, 0.0, 0.6, 0.9), 1.0
        adapt(memory, numbers)
    np.testing.assert_array_equal(memory[7:9], before)


def after_a_motion(estimates, error):
    """Memory after a motion at 0.1 m/s with these estimates less 1 and this mean position error [m]."""
    memory, numbers = np.zeros(MEMORY), settings()
    for _ in range(100):
        memory[10] = error
        moved(memory, numbers, 0.1, (1.0, 1.0))
    memory[7:9] = estimates
    return memory


@pytest.mark.parametrize(
    ("estimates", "error", "used"),
    [
        ((0.2, 0.3), 1e-4, (0.2, 0.3)),
        ((-0.2, -0.3), -1e-4, (-0.2, -0.3)),
        ((-0.2, -0.3), 1e-4, (0.0, 0.0)),
        ((0.2, -0.3), -1e-4, (0.0, -0.3)),
        ((0.2, 0.3), 0.0, (0.0, 0.0)),
    ],
)
def test_an_estimate_is_used_if_the_position_agrees(estimates, error, used):
    """Larger friction only for a rod that lagged, smaller only for one that led; both directions of motion alike."""
    for sign in (1.0, -1.0):
        memory = after_a_motion(estimates, error)
        memory[9] = sign * 0.1
        renew_factors(memory, -sign * 0.1, 0.0)

        np.testing.assert_array_equal(memory[13:15], used)
        np.testing.assert_array_equal(memory[7:9], used)
        assert not memory[11:13].any()


def test_factors_in_use_change_at_starts_and_reversals_only():
    """Within a motion and at rest they stay; at the next start they are renewed."""
    memory = after_a_motion((0.2, 0.3), 1e-4)
    for velocity in (0.1, 0.05, 0.0, 0.0):
        renew_factors(memory, velocity, 0.0)
        assert not memory[13:15].any()
    renew_factors(memory, 0.01, 0.0)

    np.testing.assert_array_equal(memory[13:15], (0.2, 0.3))


def test_compiled_and_plain_are_equal_to_the_bit(adaptive):
    """Over noisy readings and planned motions in both directions; the last current is the one returned."""
    rng = np.random.default_rng(3)
    plain, compiled = adaptive.initial_memory(), adaptive.initial_memory()
    numbers = adaptive.settings()
    for k in range(600):
        reference = np.array([0.02 * (k // 150 % 2), 0.0, 0.0])
        measured = rng.standard_normal(5) * [1.0, 1e4, 1e4, 1e-4, 50.0] + [0, 2e6, 2e6, 0.01, 500.0]
        current = adaptive.step(reference, measured, plain)

        assert current == adaptive.compiled(reference, measured, compiled, numbers) == plain[M_CURRENT]
    np.testing.assert_array_equal(plain, compiled)
    assert plain[adaptive.traces["friction_factor"]] != 0.0


def test_without_adaptation_the_current_is_that_of_fixed_numbers(adaptive, model):
    """To the bit, over a run in closed loop."""
    fixed = e.load_controller("pid_friction", model)
    neutral = replace(adaptive, feedforward=adaptive.feedforward.model_copy(update={"adaptation": None}))
    plant = e.load_plant("ehsa")
    reference = np.repeat([0.0, 0.02, 0.0], 200)
    runs = [e.run_closed_loop(plant, each, reference) for each in (fixed, neutral)]

    np.testing.assert_array_equal(runs[0].asked, runs[1].asked)


@pytest.mark.parametrize("scale", [0.6, 1.4])
def test_wrong_numbers_are_found_in_a_sine(scale):
    """Fixed numbers that are 40 % off more than double the error; the factors make up for them within 10 %."""
    content = read_toml(e.controllers[NAME])
    fed = content["feedforward"]
    for key in ("viscous", "coulomb", "static"):
        number, unit = fed[key].split(" ", 1)
        fed[key] = f"{scale * float(number):.6g} {unit}"
    without = {**content, "feedforward": {key: value for key, value in fed.items() if key != "adaptation"}}
    fixed, adapted = (e.run("slow_sine", controller=each) for each in (without, content))

    assert adapted.metrics["RMSError"][1] < 0.5 * fixed.metrics["RMSError"][1]
    assert scale * (1.0 + adapted.nonlinear["friction_factor"][-1]) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize(("name", "viscous"), [("adrc_friction", "5.87 A s/m"), ("lqr_friction", "5.87 A s/m")])
def test_a_law_that_friction_too_large_helps_keeps_it(name, viscous):
    """With numbers 40 % too large these laws err less in a sine than with the right ones: no return to those."""
    content = read_toml(e.controllers[name])
    fed = dict(content["feedforward"])
    for key in ("coulomb", "static"):
        number, unit = fed[key].split(" ", 1)
        fed[key] = f"{1.4 * float(number):.6g} {unit}"
    motion = {"inertia": "0.721 A s2/m", "viscous": viscous, "load": "0.321 A/kN"}
    right, fixed, adapted = (
        e.run("slow_sine", controller={**content, "feedforward": each}).metrics["RMSError"][1]
        for each in (content["feedforward"], fed, {**fed, "adaptation": motion})
    )

    assert fixed < 0.9 * right
    assert adapted < 1.05 * fixed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": 0.2}, "must be at least 10 times filter_time"),
        ({"least": 1.2}, "least = 1.2"),
        ({"most": 0.9}, "most = 0.9"),
        ({"gain": 2.0}, "gain: unknown key"),
    ],
)
def test_impossible_numbers_are_said(model, change, message):
    """With the key and what is expected."""
    with pytest.raises(InputError, match=message):
        e.load_controller(NAME, model, feedforward={"adaptation": change})


def test_adaptation_needs_friction_to_start_from(model):
    with pytest.raises(InputError, match="adaptation needs a coulomb current to start from"):
        e.load_controller(NAME, model, feedforward={"coulomb": 0.0, "static": 0.0})
