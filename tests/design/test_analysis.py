"""Loops: closed forms, python-control, and margins that are really where stability ends."""

import control
import numpy as np
import pytest
from made_loops import Made, grows, integral, integrator, proportional, ripples

from ehsa_ctrl import InputError, four_state, load_controller, three_state
from ehsa_ctrl.core.controller_interface import MEASURED
from ehsa_ctrl.design.analysis.closed_loop import closed_loop, discrete_response, linear_law
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.analysis.margins import disk_range
from ehsa_ctrl.design.analysis.sampled import sampled_plant

H = 0.004


@pytest.fixture
def system(linear):
    return three_state(linear)


def loop_gain(system, controller):
    """L(z) put together by python-control alone."""
    plant = control.sample_system(system[system.output_labels.index("x"), 0], controller.sample_time, method="zoh")
    return -control.ss(controller.linear())[0, 6] * plant


@pytest.mark.parametrize("kh", [0.1, 0.8, 1.5])
def test_an_integrator_under_a_gain_has_its_closed_form_margins(kh):
    """L = k h / (z - 1): every margin by hand; for k h above 1 the complementary peak is at half the sampling."""
    loop = analyse_loop(integrator(), proportional(kh / H))
    crossover = 2 / H * np.arcsin(kh / 2)

    assert loop.stable
    assert loop.crossover == pytest.approx(crossover, rel=1e-9)
    assert loop.phase_margin == pytest.approx(90 - np.degrees(crossover * H / 2), rel=1e-9)
    assert loop.gain_margin == pytest.approx(2 / kh, rel=1e-9)
    assert loop.gain_frequency == pytest.approx(np.pi / H)
    assert loop.gain_reduction == 0.0
    assert loop.Ms == pytest.approx(2 / (2 - kh), rel=1e-9)
    assert loop.Mt == pytest.approx(max(1.0, kh / (2 - kh)), rel=1e-4)
    assert loop.disk_margin == pytest.approx(2 * (2 - kh) / (2 + kh), rel=1e-9)
    assert loop.noise_gain["position"] == pytest.approx(kh / H * np.sqrt(2 / (2 - kh)), rel=1e-9)
    assert loop.Mks == pytest.approx(kh / H * 2 / (2 - kh), rel=1e-9)


@pytest.mark.parametrize("samples", [1, 2, 5])
def test_the_delay_margin_is_exact_where_it_is_known(samples):
    """With d samples of delay an integrator is at the brink for k h = 2 sin(pi / (4 d + 2))."""
    loop = analyse_loop(integrator(), proportional(2 * np.sin(np.pi / (4 * samples + 2)) / H))

    assert loop.delay_margin == pytest.approx(samples * H, rel=1e-4)


@pytest.mark.parametrize("name", ["pid_position", "lqr_position"])
def test_a_delay_beyond_the_margin_makes_the_sampled_loop_grow(system, name):
    """Simulated in small steps of time, 3 % below the delay margin the loop calms down, 3 % above it grows."""
    controller = load_controller(name, system)
    margin = analyse_loop(system, controller).delay_margin
    law = control.ss(controller.linear())

    assert not grows(ripples(system, law, 0.97 * margin, 4.0 if name.startswith("pid") else 2.0))
    assert grows(ripples(system, law, 1.03 * margin, 4.0 if name.startswith("pid") else 2.0))


def test_a_gain_beyond_the_margin_makes_the_sampled_loop_grow(system):
    """The same for the gain margin, here at half the sampling's frequency for some laws."""
    controller = load_controller("pid_position", system)
    margin = analyse_loop(system, controller).gain_margin
    law = control.ss(controller.linear())

    for factor, beyond in ((0.98, False), (1.02, True)):
        scaled = control.ss(law.A, law.B, factor * margin * law.C, factor * margin * law.D, law.dt)
        assert grows(ripples(system, scaled, 0.0, 2.0, parts=1)) == beyond


def perturbed_poles(system, controller, factor):
    """Poles of the closed loop with a complex factor on the current."""
    plant, law = sampled_plant(system, controller.sample_time), linear_law(controller)
    push, readings = factor * plant.B[:, :1], law.B[:, 3:]
    a = np.block([[plant.A + push @ law.D[:, 3:] @ plant.C, push @ law.C], [readings @ plant.C, law.A]])
    return np.linalg.eigvals(a)


@pytest.mark.parametrize("name", ["pid_position", "lqr_position"])
def test_the_disk_margin_is_where_the_first_complex_factor_ends_stability(system, name):
    """The factor on the disk's edge puts a pole on the unit circle at the disk's frequency; none inside does."""
    controller = load_controller(name, system)
    loop = analyse_loop(system, controller)
    gain = complex(np.interp(loop.disk_frequency, loop.omega, loop.response))
    factor = -1 / gain
    alpha = abs(2 * (factor - 1) / (factor + 1))
    poles = perturbed_poles(system, controller, factor)
    rng = np.random.default_rng(1)
    inside = 0.999 * loop.disk_margin * np.exp(2j * np.pi * rng.random(200))

    assert alpha == pytest.approx(loop.disk_margin, rel=1e-3)
    assert np.min(np.abs(poles - np.exp(1j * loop.disk_frequency * H))) < 1e-3
    for d in inside:
        assert np.max(np.abs(perturbed_poles(system, controller, (2 + d) / (2 - d)))) < 1


@pytest.mark.slow
def test_margins_agree_with_python_control(system):
    """Gain, phase, Ms and disk margin of a PID loop against stability_margins and disk_margins on a dense grid."""
    controller = load_controller("pid_position", system)
    loop = analyse_loop(system, controller)
    gain = loop_gain(system, controller)
    omega = np.linspace(1, 0.9999 * np.pi / H, 4000)
    data = control.frd(discrete_response(gain, omega)[:, 0, 0], omega, smooth=True)
    gain_margin, phase_margin, _, _, crossover, _ = control.stability_margins(data)

    assert loop.phase_margin == pytest.approx(phase_margin, rel=1e-5)
    assert loop.crossover == pytest.approx(crossover, rel=1e-5)
    assert loop.gain_margin == pytest.approx(gain_margin, rel=1e-5)
    assert loop.disk_margin == pytest.approx(control.disk_margins(gain, omega)[0], rel=1e-4)
    assert 1 / loop.Ms == pytest.approx(control.disk_margins(gain, omega, skew=1.0)[0], rel=1e-4)
    assert 1 / loop.Mt == pytest.approx(control.disk_margins(gain, omega, skew=-1.0)[0], rel=1e-4)


def test_what_a_disk_margin_guarantees_agrees_with_python_control(system):
    """Factors and phase of disk_range are the ones that disk_margins gives for the same alpha, in dB and degrees."""
    gain = loop_gain(system, load_controller("pid_position", system))
    alpha, decibel, degrees = control.disk_margins(gain, np.linspace(1, 700, 2000))
    low, high, phase = disk_range(alpha)

    assert 20 * np.log10(high) == pytest.approx(decibel) and low * high == pytest.approx(1)
    assert phase == pytest.approx(degrees)


def test_a_peak_narrower_than_the_grid_is_found():
    """A resonance with 0.001 % damping, between the grid's points: no value of a grid fine as its width is larger."""
    w, zeta = 123.456, 1e-5
    a = np.array([[0.0, 1.0], [-(w**2), -2 * zeta * w]])
    system = control.ss(a, [[0.0, 0.0], [1.0, 1.0]], [[1.0, 0.0]], 0, inputs=["current", "F_D"], outputs=["x"])
    controller = proportional(0.5)
    loop = analyse_loop(system, controller, points=100)
    omega = w + np.linspace(-0.1, 0.1, 40001)
    gain = discrete_response(loop_gain(system, controller), omega)[:, 0, 0]
    peak = np.max(np.abs(1 / (1 + gain)))

    assert loop.stable and peak > 3
    assert loop.Ms == pytest.approx(peak, rel=1e-4)


def test_the_sampled_plant_is_python_controls(system):
    """Response of every channel to the current as by sample_system; p1 and p2 are half of dP, up and down."""
    omega = np.geomspace(0.5, 700, 30)
    plant = sampled_plant(system, H)
    by_control = discrete_response(control.sample_system(system, H, method="zoh"), omega)[..., 0]
    found = dict(zip(MEASURED, discrete_response(plant, omega)[..., 0].T, strict=True))
    rows = {name: by_control[:, system.output_labels.index(name)] for name in ("omega", "dP", "x")}

    np.testing.assert_allclose(found["speed"], rows["omega"], rtol=1e-8)
    np.testing.assert_allclose(found["p1"], rows["dP"] / 2, rtol=1e-8)
    np.testing.assert_allclose(found["p2"], -rows["dP"] / 2, rtol=1e-8)
    np.testing.assert_allclose(found["position"], rows["x"], rtol=1e-8)
    assert not np.any(found["force"])


@pytest.mark.parametrize("samples", [1, 3])
def test_a_whole_sample_of_delay_is_a_power_of_z(system, samples):
    """Delayed by d samples the plant's answer is that without delay, times z^-d."""
    omega = np.geomspace(0.5, 700, 30)
    late = discrete_response(sampled_plant(system, H, delay=samples * H), omega)[..., 0]
    prompt = discrete_response(sampled_plant(system, H), omega)[..., 0]

    np.testing.assert_allclose(late, prompt * np.exp(-1j * omega * H * samples)[:, None], rtol=1e-7)


@pytest.mark.parametrize("delay", [0.3 * H, 2.7 * H])
def test_a_fraction_of_a_sample_is_exact(system, delay):
    """A held pulse that comes late is, at the samples, what python-control's continuous step says."""
    plant = sampled_plant(system, H, delay=delay)
    state, found = np.zeros(plant.nstates), []
    for k in range(60):
        found.append(plant.C[3] @ state)
        state = plant.A @ state + plant.B[:, 0] * (k == 0)
    time = np.arange(60) * H
    fine = np.union1d(np.arange(6000) * H / 100, [])
    step = control.step_response(system[system.output_labels.index("x"), 0], fine).outputs
    after = np.interp(time - delay, fine, step, left=0.0) - np.interp(time - delay - H, fine, step, left=0.0)

    np.testing.assert_allclose(found, after, atol=2e-5 * np.max(np.abs(after)))


def test_the_mode_that_nothing_reaches_changes_nothing(linear, system):
    """(6) with its constant P_1 + P_2 has the margins of (7), and its loop is stable."""
    controller = load_controller("pid_position", system)
    three, four = analyse_loop(system, controller), analyse_loop(four_state(linear), controller)

    assert four.stable
    for name in ("Ms", "disk_margin", "phase_margin", "delay_margin", "compliance"):
        assert getattr(four, name) == pytest.approx(getattr(three, name), rel=1e-5)


def test_rounding_in_a_linearised_model_changes_nothing(system):
    """1e-10 instead of 0 where the pressure would depend on the position: x is no constant because of that."""
    controller = load_controller("pid_position", system)
    names = list(system.state_labels)
    a = system.A.copy()
    a[names.index("dP"), names.index("x")] = -7.5e-10
    rounded = control.ss(
        a, system.B, system.C, 0, states=names, inputs=system.input_labels, outputs=system.output_labels
    )
    found = analyse_loop(rounded, controller)

    assert found.stable
    assert found.disk_margin == pytest.approx(analyse_loop(system, controller).disk_margin, rel=1e-9)


def test_a_lag_is_a_delay_of_whole_samples(system):
    """lag = 2 and delay = 2 samples are the same loop, and take as much of the delay margin."""
    controller = load_controller("pid_position", system)
    prompt, late = analyse_loop(system, controller), analyse_loop(system, controller, lag=2)

    assert late.Ms == pytest.approx(analyse_loop(system, controller, delay=2 * H).Ms)
    assert late.delay_margin == pytest.approx(prompt.delay_margin - 2 * H, rel=1e-4)


def test_the_droop_of_a_gain_is_the_one_by_hand(linear, system):
    """At rest under a force: oil leaks, the shaft turns to make up for it, and the current holds both."""
    p, k = linear, 200.0
    loop = analyse_loop(system, proportional(k))
    turning = p["K_L"] / (p["A"] * p["D"])
    current = (p["B_FM"] * turning + p["D"] / p["A"]) / p["K_T"]

    assert loop.static_compliance == pytest.approx(-current / k, rel=1e-6)
    assert loop.compliance >= abs(loop.static_compliance) * 0.999


def test_rounding_is_no_static_compliance(system):
    """With integral action the static compliance is zero, whatever the rounding."""
    loop = analyse_loop(system, load_controller("lqr_position", system))

    assert loop.static_compliance == 0.0 < loop.compliance
    assert "static 0 um/kN" in str(loop)


def test_an_integrator_that_is_switched_off_is_no_pole(system):
    """A PI with k_i = 0 has a state at z = 1 that nothing reaches: the loop is that of the gain alone."""
    with_state, without = analyse_loop(system, integral(200.0, 0.0)), analyse_loop(system, proportional(200.0))

    assert with_state.stable
    assert with_state.Ms == pytest.approx(without.Ms, rel=1e-9)


def test_an_unstable_loop_has_no_margins(system):
    """It is called so, and its disk margin is zero."""
    loop = analyse_loop(system, proportional(-200.0))

    assert not loop.stable and loop.disk_margin == 0.0
    assert np.isnan([loop.phase_margin, loop.gain_margin, loop.delay_margin, loop.noise_gain["position"]]).all()
    radius = np.max(np.abs(loop.poles))
    assert radius > 1.0 and f"NOT STABLE: spectral radius {radius:.4g}" in str(loop)


@pytest.mark.slow
def test_noise_of_all_sensors_adds_by_squares(system):
    """The current's noise is that of a long simulated record."""
    controller = load_controller("lqr_position", system)
    sd = {"speed": 0.5, "p1": 15e3, "p2": 15e3, "position": 2e-5}
    loop = analyse_loop(system, controller, noise=sd)
    closed = closed_loop(sampled_plant(system, H), linear_law(controller))
    rng = np.random.default_rng(0)
    inputs = np.zeros((closed.ninputs, 60_000))
    for channel, size in sd.items():
        inputs[closed.input_labels.index(f"n_{channel}")] = size * rng.standard_normal(60_000)
    current = control.forced_response(closed, inputs=inputs).outputs[closed.output_labels.index("current")]

    assert loop.current_noise == pytest.approx(np.std(current[1000:]), rel=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: (s, object.__new__(type("Bare", (), {"name": "bare"}))), "bare has no linear law"),
        (lambda s: (s, Made(control.ss([], [], [], [[1.0]], H))), "1 inputs and 1 outputs; expected 8"),
        (lambda s: (s, Made(proportional(1.0).law, 0.002)), "expected its sample time, 0.002 s"),
        (lambda s: (control.sample_system(s, H), proportional(1.0)), "discrete time; expected the continuous"),
        (lambda s: (s[0, 0], proportional(1.0)), "no output x"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_sentence(system, change, words):
    """The error names the given and the expected value."""
    model, controller = change(system)
    if not hasattr(controller, "sample_time"):
        controller.sample_time = H

    with pytest.raises(InputError, match=words):
        analyse_loop(model, controller)


def test_names_of_the_states_play_no_part(linear):
    """A model whose states lost their names, as python-control's slices do, has the same margins."""
    model = three_state(linear)
    unnamed = model[[model.output_labels.index("x"), model.output_labels.index("omega")], :]
    named, lost = (analyse_loop(each, load_controller("cascade_position", model)) for each in (model, unnamed))

    assert not set(unnamed.state_labels) & set(model.state_labels)
    for figure in ("Ms", "Mt", "disk_margin", "delay_margin", "crossover"):
        assert lost.figure(figure) == pytest.approx(named.figure(figure), rel=1e-6)
