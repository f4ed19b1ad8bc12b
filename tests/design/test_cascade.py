"""Position over speed: the designed margins, the law, its limits."""

import control
import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.controller_interface import INPUTS
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.kinds.cascade import Cascade
from ehsa_ctrl.design.load import build_controller

T_S = 0.004
KIND = CONTROLLER_KINDS["cascade"]


@pytest.fixture
def model(linear):
    return ehsa_ctrl.three_state(linear)


def controller(model, speed=(130, 65), position=(30, 60), **more):
    outer = {"crossover": f"{position[0]} rad/s", "phase_margin": f"{position[1]} deg", "speed_limit": "450 rad/s"}
    content = {
        "schema": 1, "kind": "cascade", "title": "under test", "current_limit": "6 A",
        "speed": {"crossover": f"{speed[0]} rad/s", "phase_margin": f"{speed[1]} deg"}, "position": outer | more,
    }  # fmt: skip
    return build_controller("mine", KIND, KIND.file.model_validate(content), model)


def test_both_loops_have_what_was_asked_for(model):
    """By python-control's own sampling and feedback, one loop inside the other."""
    law = controller(model, integral_ratio=0.1).law
    z = control.tf("z")
    z.dt = T_S
    omega = control.sample_system(model[model.output_labels.index("omega"), 0], T_S, "zoh")
    x = control.sample_system(model[model.output_labels.index("x"), 0], T_S, "zoh")
    inner = law.k_w + law.k_iw * T_S / (z - 1)
    outer = law.k_x + law.k_ix * T_S / (z - 1)

    at = np.exp(130j * T_S)
    assert complex(inner(at) * omega(at)) == pytest.approx(-np.exp(1j * np.radians(65)), rel=1e-9)
    at = np.exp(30j * T_S)
    position = outer(at) / law.n * inner(at) * x(at) / (1 + inner(at) * omega(at))
    assert abs(position) == pytest.approx(1.0, rel=1e-9)
    assert np.degrees(np.pi + np.angle(position)) >= 60


def test_the_way_per_radian_is_that_of_pump_and_piston(linear, model):
    """n = D / A, but for the oil's leakage and compression at the crossover."""
    assert controller(model).law.n == pytest.approx(linear["D"] / linear["A"], rel=0.02)


def test_the_shipped_cascade_is_robust(model):
    loop = analyse_loop(model, ehsa_ctrl.load_controller("cascade_position", model))

    assert loop.stable
    assert loop.Ms < 1.5
    assert loop.disk_margin > 0.8


def law_of(**changes):
    numbers = {
        "k_x": 27.0, "k_ix": 40.0, "k_w": 0.04, "k_iw": 1.2, "n": 3.9e-4, "f": 1.0,
        "speed_limit": 1e9, "current_limit": 1e9, "sample_time": T_S,
    }  # fmt: skip
    return Cascade(**{**numbers, **changes})


def run(law, reference, velocity, speed, position, hold=0.0):
    memory, numbers = law.initial_memory(), law.settings()
    currents, memories = [], []
    for row in zip(reference, velocity, speed, position, strict=True):
        r, v, omega, y = row
        planned, read = np.array([r, v, 0.0]), np.array([omega, 0.0, 0.0, y, 0.0])
        currents.append(law.function(planned, read, memory, numbers, 0.0, hold))
        memories.append(memory.copy())
    return np.array(currents), np.array(memories)


def test_the_linear_law_is_the_law_without_limits():
    rng = np.random.default_rng(2)
    signals = rng.normal(0, [[1e-3], [0.05], [50.0], [1e-3]], (4, 150))
    law = law_of()

    currents, _ = run(law, *signals)

    inputs = np.zeros((len(INPUTS), 150))
    for name, values in zip(("reference_position", "reference_velocity", "speed", "position"), signals, strict=True):
        inputs[INPUTS.index(name)] = values
    expected = control.forced_response(law.linear(), inputs=inputs).outputs[0]
    assert np.allclose(currents, expected, rtol=1e-9, atol=1e-9)


def test_the_speed_asked_for_keeps_its_limit_and_the_outer_integral_waits():
    law = law_of(speed_limit=100.0)
    zeros = np.zeros(50)

    _, memories = run(law, np.full(50, 0.05), zeros, zeros, zeros)

    assert np.all(memories[:, 2] == 100.0)
    assert np.all(memories[:, 1] == 0.0)


def test_no_integral_runs_away_while_the_current_is_limited():
    law = law_of(current_limit=1.0)
    zeros = np.zeros(3000)

    currents, memories = run(law, np.full(3000, 0.02), zeros, zeros, zeros)

    assert np.all(currents == 1.0)
    assert np.all(memories[:, 1] == 0.0)
    # In balance of back-calculation, k_iw gap = back (wanted - limit): the integral is the limit itself.
    assert memories[-1, 0] == pytest.approx(1.0, rel=1e-6)


def test_both_integrals_stand_still_while_they_are_held():
    zeros = np.zeros(20)

    _, memories = run(law_of(), np.full(20, 1e-3), zeros, zeros, zeros, hold=1.0)

    assert np.all(memories[:, :2] == 0.0)


def test_no_kick_at_the_start_wherever_the_rod_is():
    zeros = np.zeros(20)

    currents, _ = run(law_of(), np.full(20, 0.07), zeros, zeros, np.full(20, 0.07))

    assert np.all(currents == 0.0)


def test_velocity_feedforward_takes_the_lag_away(linear, model):
    """A ramp of 50 mm/s on the linear plant: without it the rod is v / k_x behind, with it nearly on it."""
    time = T_S * np.arange(400)
    ramp = np.stack([0.05 * time, np.full(400, 0.05), np.zeros(400)], axis=1)

    errors = {}
    for share in (0.0, 1.0):
        chosen = controller(model, velocity_feedforward=share)
        errors[share] = ehsa_ctrl.run_closed_loop(linear, chosen, ramp).error[-1]
        k_x = chosen.law.k_x

    assert errors[0.0] == pytest.approx(0.05 / k_x, rel=0.03)
    assert abs(errors[1.0]) < 0.03 * errors[0.0]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"speed": (160, 85)}, "infeasible in the speed loop, which has 74.8 deg"),
        ({"speed": (60, 45), "position": (50, 70)}, "has a phase margin of .* less than the specified 70 deg"),
        ({"speed": (30, 60), "position": (30, 60)}, "expected 0 < position < speed"),
        ({"speed": (900, 60)}, "the Nyquist frequency"),
    ],
)
def test_what_the_loops_can_not_have_is_one_sentence(model, content, sentence):
    with pytest.raises(ValueError, match=sentence):
        controller(model, **content)


def test_a_model_without_the_shaft_is_refused(model):
    only = model[model.output_labels.index("x"), :]

    with pytest.raises(InputError, match=r"has no shaft: expected .position. velocity_limit in m/s"):
        controller(only)
