"""Controllers from dictionaries, linear systems and Python code."""

import control
import numpy as np
import pytest

import ehsa_ctrl as e

T_S = 0.004


@pytest.fixture(scope="module")
def linear():
    return e.load_plant("ehsa", model="linear")


def loop_of(plant, controller, samples=400):
    return e.run_closed_loop(plant, controller, np.full(samples, 0.002), tolerance=1e-10)


def test_a_transfer_function_controls_as_python_control_says(linear):
    """On the linear plant, below the current limit, the loop is that of control.feedback."""
    lead = control.tf([20.0, 500.0], [0.004, 1.0])
    run = loop_of(linear, e.load_controller(lead, current_limit=100.0))

    plant = control.c2d(control.ss(e.three_state(linear))["x", "current"], T_S)
    law = control.c2d(control.ss(lead), T_S, "tustin")
    y = control.forced_response(control.feedback(plant * law), np.arange(400) * T_S, np.full(400, 0.002)).outputs

    assert np.max(np.abs(run["asked"])) < 100.0
    assert np.max(np.abs(run["x"] - y)) < 1e-9


def test_a_function_controls_as_the_same_transfer_function(linear):
    """A static gain, a function, an object with a step and a discrete state space give the same run to the bit."""

    class Gain:
        def __init__(self):
            self.samples = 0

        def step(self, t, y, r):
            assert t == self.samples * T_S
            self.samples += 1
            return 800.0 * r.position - 800.0 * y.position

    gain = control.ss([], [], [], [[800.0, -800.0]], T_S, inputs=["reference_position", "position"], outputs=["u"])
    own = Gain()
    laws = [gain, lambda t, y, r: 800.0 * r.position - 800.0 * y.position, own]
    runs = [loop_of(linear, e.load_controller(law, current_limit=6.0)) for law in laws]

    assert np.array_equal(runs[0]["x"], runs[1]["x"])
    assert np.array_equal(runs[0]["x"], runs[2]["x"])
    assert own.samples == 0, "each run has its own copy"


def test_state_of_an_object_begins_anew_in_each_run(linear):
    """Two runs with one controller are the same although the object counts."""

    class Integrator:
        total = 0.0

        def step(self, t, y, r):
            self.total += T_S * (r[0] - y[3])
            return 500.0 * (r[0] - y[3]) + 100.0 * self.total

    controller = e.load_controller(Integrator(), current_limit=6.0)

    assert np.array_equal(loop_of(linear, controller)["x"], loop_of(linear, controller)["x"])


def test_compiled_and_plain_law_agree(linear):
    """To the last bit, in saturation too."""
    pi = control.tf([900.0, 9000.0], [1.0, 0.0])
    controller = e.load_controller(pi, current_limit=0.5)
    runs = [e.run_closed_loop(linear, controller, np.full(300, 0.01), compiled=compiled) for compiled in (True, False)]

    assert np.array_equal(runs[0]["asked"], runs[1]["asked"])
    assert np.max(np.abs(runs[0]["asked"])) == 0.5


def test_an_integrator_does_not_wind_up(linear):
    """A step that saturates a PI for long: the overshoot stays near that of a small step; without L it grows."""
    pi = control.tf([12.0, 300.0, 900.0], [0.004, 1.0, 0.0])
    controller = e.load_controller(pi, current_limit=0.8)
    small, large = (
        e.run_closed_loop(linear, controller, np.full(1500, size))["x"].max() / size - 1.0 for size in (1e-4, 0.02)
    )
    law = controller.law
    from dataclasses import replace

    bare = replace(controller, law=replace(law, anti_windup=np.zeros_like(law.anti_windup)))
    wound = e.run_closed_loop(linear, bare, np.full(1500, 0.02))["x"].max() / 0.02 - 1.0

    assert large < small + 0.05
    assert wound > large + 0.1


@pytest.mark.parametrize("method", ["tustin", "zoh", "foh", "euler", "backward"])
def test_methods_of_discretisation(method):
    """Low frequencies are kept by all of them, and the text names the method."""
    lead = control.tf([20.0, 500.0], [0.02, 1.0])
    controller = e.load_controller(lead, current_limit=6.0, method=method)
    found = controller.linear()(np.exp(1j * 0.5 * T_S))[0]

    assert abs(found[0] - lead(0.5j)) < 0.01 * abs(lead(0.5j))
    assert found[0] == -found[6]
    assert method in str(controller)


def test_margins_are_those_of_python_control(linear):
    """Crossover and margins of the sampled loop with a lead compensator agree with control.margin."""
    model, lead = e.three_state(linear), control.tf([20.0, 500.0], [0.004, 1.0])
    loop = e.analyse_loop(model, e.load_controller(lead, current_limit=6.0))
    plant = control.c2d(control.ss(model)["x", "current"], T_S)
    open_loop = plant * control.c2d(control.ss(lead), T_S, "tustin")
    gain, phase, _, crossover = control.margin(control.frd(open_loop, np.geomspace(1.0, 780.0, 20000)))

    assert loop.stable
    assert e.analyse_loop(model, lead).phase_margin == loop.phase_margin
    assert loop.gain_margin == pytest.approx(gain, rel=2e-3)
    assert loop.phase_margin == pytest.approx(phase, rel=2e-3)
    assert loop.crossover == pytest.approx(crossover, rel=2e-3)


@pytest.mark.parametrize(
    ("law", "options", "words"),
    [
        (control.tf([1.0, 0.0, 0.0], [1.0, 2.0]), {}, "improper: its numerator has degree 2, its denominator 1"),
        (
            control.tf([[[1.0], [2.0]]], [[[1.0], [1.0, 1.0]]]),
            {},
            "a transfer function with 2 inputs and 1 outputs; expected one of each",
        ),
        (control.tf([1.0], [1.0, 0.5], 0.001), {}, r"has dt = 0.001; expected the sample time of the loop, 0.004 s"),
        (control.tf([1.0], [1.0, 0.5], True), {}, r"has dt = True"),
        (
            control.ss([[0.0]], [[1.0]], [[1.0], [2.0]], 0),
            {},
            "1 input and 2 outputs; expected one output, the current",
        ),
        (control.ss([[-1.0]], [[1.0, 1.0]], [[1.0]], 0), {}, "2 inputs and 1 output; .* inputs named from error"),
        (control.ss([[np.nan]], [[1.0]], [[1.0]], 0, remove_useless_states=False), {}, "not finite"),
        (control.tf([1.0], [1.0, 1.0]), {"method": "tusting"}, "method = 'tusting'; did you mean 'tustin'"),
        (control.ss(np.diag([-1.0, 1.0]), [[1.0], [0.0]], [[1.0, 0.0]], 0), {}, "a mode that does not decay"),
        (lambda t, y: 0.0, {}, r"can't be called with three arguments; expected \(t, y, r\)"),
        (object, {}, "controller object is a class; give an object of it"),
    ],
)
def test_wrong_input_is_one_sentence(law, options, words):
    """What was found and what was expected."""
    with pytest.raises(e.InputError, match=words) as caught:
        e.load_controller(law, current_limit=6.0, **options)

    assert "\n" not in str(caught.value)


def test_a_law_without_limit_is_one_sentence():
    with pytest.raises(e.InputError, match="controller TransferFunction: current_limit: is missing"):
        e.load_controller(control.tf([1.0], [1.0, 1.0]))


@pytest.mark.parametrize("value", [None, "2", [1.0, 2.0]])
def test_a_step_that_returns_no_number(linear, value):
    """The sentence names the controller, what it returned and when."""

    def broken(t, y, r):
        return value if t > 0.02 else 0.0

    if value == "2":
        value = "two"
    with pytest.raises(e.InputError, match=r"controller broken returned .* at t = 0.024 s; expected the current"):
        loop_of(linear, e.load_controller(broken, current_limit=6.0))


def test_a_step_that_returns_nan(linear):
    """The run stops with the time."""
    with pytest.raises(e.SimulationError, match=r"at 0\.1"):
        loop_of(linear, e.load_controller(lambda t, y, r: np.nan if t > 0.1 else 0.0, current_limit=6.0))


def test_a_dictionary_is_the_file(linear):
    """Keys and keyword arguments give the controller of the TOML; numbers are SI."""
    model = e.three_state(linear)
    shipped = e.load_controller("pid_position", model)
    keys = {
        "kind": "pid",
        "current_limit": 6,
        "design": {"crossover": 35.0, "phase_margin": "60 deg", "integral_ratio": 0.1, "filter_ratio": 8.0},
    }
    same = e.load_controller(keys, model)
    changed = e.load_controller("pid_position", model, design={"crossover": 30.0}, label="slow")

    assert np.array_equal(shipped.settings(), same.settings())
    assert changed.name == "slow"
    assert changed.law.gains.k_p < shipped.law.gains.k_p
    with pytest.raises(e.InputError, match=r"controller own: \[design\] crossing: unknown key; did you mean"):
        e.load_controller({**keys, "design": {"crossing": 3.0}}, model)
    with pytest.raises(e.InputError, match="is designed on a linear model; give one"):
        e.load_controller("pid_position")


def test_a_linearised_plant_is_reduced_and_said(linear):
    """The mode of P_1 + P_2 is left out: exactly, for the linear set, the design on (7)."""
    here = e.load_controller("lqr_position", e.linearise(linear))
    there = e.load_controller("lqr_position", e.three_state(linear))

    assert np.allclose(here.settings(), there.settings(), rtol=1e-6, atol=1e-8)
    assert "the mode of P_1 + P_2 is left out" in str(here)
    assert "level" not in here.note.split("reach it")[1]
    nonlinear = e.load_controller("lqr_position", e.linearise(e.load_plant("ehsa")))
    assert "P_1 + P_2" in str(nonlinear)


def test_direct_feedthrough_of_a_plant_is_one_sentence(linear):
    """Designs assume a strictly proper plant."""
    model = e.three_state(linear)
    d = np.zeros_like(model.D)
    d[list(model.output_labels).index("x"), 0] = 1.0
    wrong = control.ss(
        model.A, model.B, model.C, d, states=model.state_labels, inputs=model.input_labels, outputs=model.output_labels
    )
    with pytest.raises(e.InputError, match="direct feedthrough"):
        e.load_controller("lqr_position", wrong)
