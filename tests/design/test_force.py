"""Force controller: the linear loop as designed, the switch without a bump, and what it refuses."""

from dataclasses import replace

import control
import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.controller_interface import INPUTS
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.closed_loop import discrete_response, linear_law
from ehsa_ctrl.design.analysis.contact import in_contact
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.analysis.sampled import sampled_plant

NAME = "force_press"


@pytest.fixture(scope="module")
def plant():
    return e.load_plant("ehsa", model="linear")


@pytest.fixture(scope="module")
def model(plant):
    return e.three_state(plant)


@pytest.fixture(scope="module")
def shipped(model):
    return e.load_controller(NAME, model)


def force_only(model, **keys):
    """The shipped controller without the approach and without limits that a small signal reaches."""
    content = e.core.files.read_toml(e.controllers[NAME])
    del content["position"], content["feedforward"]
    force = {**content["force"], "rate": "1e9 N/s", "deadband": "0 N"}
    return e.load_controller({**content, "force": force, **keys}, model, label="pressing")


def test_contact_is_the_model_with_that_spring(plant, model):
    """F_D = K x closes the loop of (7) as load.stiffness does; the output is the spring's force."""
    closed, known = in_contact(model, 2e6), e.three_state(plant.set(K_S=2e6))

    np.testing.assert_allclose(closed.A, known.A, rtol=1e-12)
    np.testing.assert_allclose(closed.C[-1], 2e6 * known.C[known.output_labels.index("x")], rtol=1e-12)


def test_the_static_force_per_current_is_that_of_the_balances(plant, shipped):
    """At rest K_T I = D dP + B_FM omega, D omega = 2 K_L dP / 2 ... and F = A dP; by python-control on (7)."""
    known = 1e6 * control.dcgain(e.three_state(plant.set(K_S=1e6)))[3, 0]
    p = plant.values
    by_hand = p["K_T"] * p["A"] / (p["D"] + p["B_FM"] * p["K_L"] / p["D"])

    assert pytest.approx(float(known), rel=1e-9) == shipped.law.G_0
    assert pytest.approx(by_hand, rel=1e-6) == shipped.law.G_0


@pytest.mark.parametrize("measurement", ["load_cell", "pressures"])
def test_crossover_and_margin_are_as_specified(model, measurement):
    """The loop broken at the current has |L| = 1 and 60 deg at 80 rad/s against 10 MN/m."""
    content = e.core.files.read_toml(e.controllers[NAME])
    controller = e.load_controller(NAME, model, force={"measurement": measurement})
    loop = analyse_loop(model, controller)

    assert content["force"]["crossover"] == "80 rad/s"
    assert loop.crossover == pytest.approx(80.0, rel=1e-3)
    assert loop.phase_margin == pytest.approx(60.0, abs=0.05)


def test_margins_hold_from_soft_to_stiff(shipped):
    """10 kN/m to 10 MN/m: Ms below 1.3 and 50 deg or more; they are printed."""
    loops = shipped.law.margins.loops

    assert next(iter(loops)) == "10 kN/m" and [*loops][-1] == "10000 kN/m"
    assert shipped.law.margins.stable and shipped.law.margins.Ms < 1.3
    assert "from 10 kN/m to 10000 kN/m: phase margin 60 deg or more, Ms 1.15 or less" in str(shipped)


def predicted_step(model, controller, stiffness, samples):
    """Force (samples,) after a unit step of the target, by the sampled plant and the law's difference equations."""
    T_s, law = controller.sample_time, controller.law
    plant = sampled_plant(in_contact(model, stiffness), T_s)
    x, integral, found = np.zeros(plant.nstates), 0.0, []
    for _ in range(samples):
        y = plant.C @ x
        error = 1.0 - y[4]
        current = 1.0 / law.G_0 + law.force.k * error + integral - law.force.k_w * y[0]
        integral += T_s * law.force.k_i * error
        found.append(y[4])
        x = plant.A @ x + plant.B[:, 0] * current
    return np.array(found)


@pytest.mark.parametrize("stiffness", [1e5, 1e6, 1e7])
def test_the_simulated_loop_is_the_predicted_one(plant, model, stiffness):
    """Without friction the step of the simulated plant is that of the linear loop, overshoot included."""
    controller = force_only(model)
    reference = np.column_stack([np.zeros((250, 3)), np.full(250, 100.0)])
    loop = e.run_closed_loop(plant.set(K_S=stiffness), controller, reference, tolerance=1e-9)
    force, predicted = loop.trajectory.cell_force, 100.0 * predicted_step(model, controller, stiffness, 250)

    np.testing.assert_allclose(force, predicted, atol=0.05)
    assert np.max(force) == pytest.approx(np.max(predicted), abs=0.05)


def test_the_linear_law_is_that_of_the_force_loop(model, shipped):
    """From the load cell -(k_f + k_fi T / (z - 1)), from the speed -k_fw, nothing else."""
    law, gains, T_s = linear_law(shipped), shipped.law.force, shipped.sample_time
    w = np.array([5.0, 50.0])
    z = np.exp(1j * w * T_s)
    response = discrete_response(law, w)[:, 0]

    np.testing.assert_allclose(response[:, INPUTS.index("force")], -(gains.k + gains.k_i * T_s / (z - 1)))
    np.testing.assert_allclose(response[:, INPUTS.index("speed")], -gains.k_w)
    others = [k for k, name in enumerate(INPUTS) if name not in ("force", "speed")]
    assert not np.any(response[:, others])


def pressing(controller, forces, currents_of=None):
    """Currents of one sample each: the rod moves at 20 mm/s while the load cell reads `forces`."""
    memory, found, modes = controller.initial_memory(), [], []
    for k, force in enumerate(forces):
        reference = np.array([0.02 * 0.004 * k, 0.02, 0.0, 3000.0 if k < 60 else 0.0])
        measured = np.array([50.0, 2e6, 2e6, 0.02 * 0.004 * k - 1e-4, force])
        found.append(controller.step(reference, measured, memory))
        modes.append(memory[-8])
    return np.array(found), np.array(modes)


def test_the_switch_is_without_a_bump(shipped):
    """At contact and at the release the current of the sample equals that of the last one."""
    forces = np.where(np.arange(100) < 30, 0.0, 400.0)
    current, mode = pressing(shipped, forces)
    switches = np.flatnonzero(np.diff(mode)) + 1

    assert switches.tolist() == [30, 60]
    assert np.abs(current).max() > 0.1
    np.testing.assert_allclose(current[switches], current[switches - 1], rtol=0, atol=1e-12)


def test_the_avoided_step_decays_and_the_rod_is_braked(shipped):
    """At e^(-crossover T) a sample, 80 rad/s; the damping of the arriving rod then acts in full."""
    memory = shipped.initial_memory()
    reference, free, touched = (
        np.array([0.021, 0.02, 0.0, 3e3]),
        *(np.array([50.0, 2e6, 2e6, 0.02, force]) for force in (0.0, 400.0)),
    )
    for measured in (free, free, touched):
        shipped.step(reference, measured, memory)
    first = memory[-3]
    for _ in range(5):
        shipped.step(reference, touched, memory)

    assert abs(first) > 0.3
    assert memory[-3] / first == pytest.approx(np.exp(-80.0 * 5 * 0.004), rel=1e-9)


def test_friction_is_built_up_against_a_lasting_error(model):
    """At a constant target the current grows by I_C in friction_time, beside the integral; a new motion drops it."""
    content = e.core.files.read_toml(e.controllers[NAME])
    del content["position"]
    controller = e.load_controller(content, model, force={"rate": 1e9, "friction_time": 0.3}, label="pressing")
    memory, T_s, gains = controller.initial_memory(), controller.sample_time, controller.law.force
    measured = np.array([0.0, 2e6, 2e6, 0.0, 1800.0])
    currents = [controller.step(np.array([0.0, 0.0, 0.0, 2e3]), measured, memory) for _ in range(60)]
    rate = (currents[50] - currents[20]) / (30 * T_s)
    again = controller.step(np.array([0.0, 0.0, 0.0, 2.1e3]), measured, memory)

    assert rate == pytest.approx(gains.k_i * 200.0 + 0.941 / 0.3, rel=1e-9)
    assert again == pytest.approx(currents[0] + T_s * gains.k_i * 200.0 + 100.0 * (1 / controller.law.G_0 + gains.k))


def test_below_contact_the_position_is_controlled(shipped):
    """A load cell that stays below 300 N never switches."""
    assert not pressing(shipped, np.full(60, 299.0))[1].any()


@pytest.mark.parametrize("measurement", ["load_cell", "pressures"])
def test_compiled_and_plain_law_are_equal(model, measurement):
    """To the bit, through approach, contact, a changed target and the release."""
    controller = e.load_controller(NAME, model, force={"measurement": measurement})
    random = np.random.default_rng(3)
    n = 400
    reference = np.column_stack([0.01 * random.random((n, 3)), np.repeat([0.0, 3e3, 1e3, 0.0], n // 4)])
    measured = random.random((n, 5)) * [100.0, 4e6, 4e6, 0.01, 4e3]
    plain, compiled = controller.initial_memory(), controller.initial_memory()
    settings = controller.settings()

    for r, y in zip(reference, measured, strict=True):
        assert controller.step(r, y, plain) == controller.compiled(r, y, compiled, settings)
    np.testing.assert_array_equal(plain, compiled)


def test_friction_is_fed_forward_while_the_target_moves(model):
    """By the Coulomb current of [feedforward], in the direction of the change."""
    content = e.core.files.read_toml(e.controllers[NAME])
    del content["position"]
    base = e.load_controller(content, model)
    none = replace(base, law=replace(base.law, friction=0.0))
    reference, measured = np.array([0.0, 0.0, 0.0, 2e3]), np.zeros(5)
    with_it, without = (c.step(reference, measured, c.initial_memory()) for c in (base, none))

    assert with_it - without == pytest.approx(0.941)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": {"limit": 20e3}}, r"\[force\] limit = 2e\+04 N is beyond the 1.571e\+04 N that 6 A gives"),
        ({"force": {"crossover": 900.0}}, r"\[force\] crossover = 900 rad/s: expected more than 0"),
        ({"force": {"phase_margin": 2.0}}, "lower the margin"),
        ({"position": {"contact": 6e3}}, r"contact = 6000 N must be less than \[force\] limit = 5000 N"),
        ({"environment": {"softest": 1e8}}, "must be less than stiffest"),
        ({"rest": {"band": 1e-4}}, "rest: unknown key"),
        ({"environment": {"stiffest": 1e12, "stiffness": 1e5}}, "the force loop is unstable against"),
    ],
)
def test_an_impossible_design_is_said(model, change, message):
    """In one sentence, with what is possible."""
    with pytest.raises(InputError, match=message):
        e.load_controller(NAME, model, **change)


def test_a_force_that_the_pressures_do_not_allow_is_refused():
    """Beyond 2 A P_0 one chamber would be empty; the scenario's force must be within the controller's limit."""
    scenario = {
        "plant": "ehsa", "duration": 1.0, "load": {"stiffness": 1e6},
        "reference": {
            "kind": "steps", "times": [0.0], "positions": [0.0], "force": {"times": [0.1], "forces": [5500.0]},
        },
    }  # fmt: skip
    content = e.core.files.read_toml(e.controllers[NAME])
    with pytest.raises(
        InputError, match=r"exceeds the rating of the plant ehsa, 6107 N \(2 A \(P_0 - pressure_min\)\)"
    ):
        e.run(scenario, controller={**content, "force": {**content["force"], "limit": 7e3}})
    with pytest.raises(InputError, match="5500 N is beyond the limit of force_press, 5000 N"):
        e.run(scenario, controller=NAME)


def test_what_holds_while_extending_holds_while_retracting(model):
    """Signals of a press, mirrored: rod, shaft and force turned round, the chambers exchanged, the current negated."""
    rng = np.random.default_rng(7)
    time = np.arange(600) * 0.004
    depth = np.clip(0.02 * time - 0.01, 0.0, None)
    measured = np.column_stack([5 + 0 * time, 2e6 + 1e6 * depth, 2e6 - 1e6 * depth, 0.02 * time, 2e5 * depth])
    measured += rng.normal(size=measured.shape) * [1.0, 1e4, 1e4, 1e-5, 5.0]
    reference = np.column_stack([0.025 * time, 0 * time + 0.025, 0 * time, np.where(time > 2.0, 0.0, 3e3)])
    for name in (NAME, "impedance_push"):
        controller = e.load_controller(name, model)
        currents = [
            [controller.step(sign * r, np.array(y), memory) for r, y in zip(reference, rows, strict=True)]
            for sign, rows, memory in (
                (1.0, measured, controller.initial_memory()),
                (-1.0, measured[:, [0, 2, 1, 3, 4]] * [-1, 1, 1, -1, -1], controller.initial_memory()),
            )
        ]

        assert np.ptp(currents[0]) > 1.0
        np.testing.assert_allclose(currents[1], -np.array(currents[0]), atol=1e-9)
