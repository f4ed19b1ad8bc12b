"""Impedance controller: the response to a push in closed form, margins in contact, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.kinds._impedance_law import Impedance
from ehsa_ctrl.scenario.impedance_metrics import impedance_metrics

NAME = "impedance_push"
FORCE = 2e3


@pytest.fixture(scope="module")
def plant():
    return e.load_plant("ehsa", model="linear")


@pytest.fixture(scope="module")
def model(plant):
    return e.three_state(plant)


def yielding(time, z):
    """Deviation [m] after a force step: an underdamped mass-damper-spring in closed form."""
    w, damping = np.sqrt(z.stiffness / z.mass), z.damping / (2.0 * np.sqrt(z.stiffness * z.mass))
    w_d = w * np.sqrt(1.0 - damping**2)
    ring = np.cos(w_d * time) + damping * w / w_d * np.sin(w_d * time)
    return -FORCE / z.stiffness * (1.0 - np.exp(-damping * w * time) * ring)


@pytest.fixture(scope="module")
def pushed(plant, model):
    """The linear plant, which has no dry friction to feed forward, under a step of 2 kN, with an underdamped target."""
    target = {"mass": 1000.0, "damping": 10e3, "stiffness": 50e3}
    controller = e.load_controller(NAME, model, impedance=target, feedforward={"coulomb": 0.0, "static": 0.0})
    samples = 500
    loop = e.run_closed_loop(plant, controller, np.zeros(samples), force=np.full(samples, FORCE))
    return controller.law.impedance, loop


def test_the_rod_moves_as_the_closed_form_says(pushed):
    """Within 3 % of the static deviation at every instant, the inner loop's lag included."""
    target, loop = pushed
    error = loop["x"] - yielding(loop.trajectory.time, target)
    static = FORCE / target.stiffness

    assert np.max(np.abs(error)) < 0.03 * static
    assert abs(error[-1]) < 0.002 * static
    assert np.min(loop["x"]) < -1.03 * static


def test_the_deviation_is_sampled_exactly(pushed):
    """The law's own mass-damper-spring equals the closed form; the trace is that for the next sample."""
    target, loop = pushed

    exact = yielding(loop.trajectory.time, target)

    np.testing.assert_allclose(loop["deviation"][:-1], exact[1:], rtol=0, atol=1e-12)


def test_the_metric_is_the_distance_from_that_motion(pushed):
    """A run that follows exactly has 0; one that is 10 % too soft has 10 %; no force gives none."""
    target, loop = pushed
    run = loop.trajectory
    exact = yielding(run.time, target)
    column = run.plant.structure.equations.index("x")

    def moved(x):
        states = run.states.copy()
        states[:, column] = x
        return replace(loop, trajectory=replace(run, states=states))

    assert impedance_metrics(moved(exact), target)["ImpedanceError"] < 1e-3
    assert impedance_metrics(moved(1.1 * exact), target)["ImpedanceError"] == pytest.approx(0.1, abs=1e-3)
    silent = replace(loop, trajectory=replace(run, cell_force=0.0 * run.cell_force))
    assert impedance_metrics(silent, target) == {} and impedance_metrics(loop, None) == {}


def test_compiled_and_plain_law_are_equal(model):
    """To the bit, with and without a planned motion."""
    controller = e.load_controller(NAME, model)
    random = np.random.default_rng(5)
    reference = np.column_stack([0.01 * random.random((200, 2)), np.zeros(200)])
    reference[100:, 1] = 0.0
    measured = random.random((200, 5)) * [100.0, 4e6, 4e6, 0.01, 4e3]
    plain, compiled = controller.initial_memory(), controller.initial_memory()

    for r, y in zip(reference, measured, strict=True):
        assert controller.step(r, y, plain) == controller.compiled(r, y, compiled, controller.settings())
    np.testing.assert_array_equal(plain, compiled)


def test_margins_hold_from_soft_to_stiff(model):
    """10 kN/m to 10 MN/m: Ms of at most 1.5 for the shipped target; a light one has less."""
    shipped = e.load_controller(NAME, model).law.margins
    light = e.load_controller(NAME, model, impedance={"mass": 400.0, "damping": 8e3}).law.margins

    assert next(iter(shipped.loops)) == "10 kN/m" and [*shipped.loops][-1] == "10000 kN/m"
    assert shipped.Ms < 1.5 < light.Ms


def test_a_target_without_spring_stays_where_it_is_pushed():
    """d' tends to -F / B."""
    transition, entry = Impedance(100.0, 1e3, 0.0).sampled(0.01)
    d = np.zeros(2)
    for _ in range(1000):
        d = transition @ d - entry * 50.0

    assert d[1] == pytest.approx(-0.05, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"impedance": {"mass": 10.0}}, r"\[impedance\] moves at 4000 rad/s .* faster than the position loop"),
        ({"impedance": {"mass": 0.0}}, r"\[impedance\] mass = 0"),
        ({"rest": {"band": 1e-4}}, "rest: unknown key"),
        ({"position": {"crossover": 900.0}}, r"\[position\] crossover = 900 rad/s: expected more than 0"),
        ({"impedance": {"mass": 40.0, "damping": 10.0, "stiffness": 10.0}}, "the impedance loop is unstable against"),
    ],
)
def test_an_impossible_design_is_said(model, change, message):
    """In one sentence, with what to do."""
    with pytest.raises(InputError, match=message):
        e.load_controller(NAME, model, **change)
