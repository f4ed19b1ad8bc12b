"""Automatic tuning: bounds hold, and nothing better is to be had within them."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.operating_point import operating_point
from ehsa_ctrl.design.kinds.pid import Gains
from ehsa_ctrl.design.tuning.constraints import BANDS, POINTS, PidLoop, SampledPlant, Tuning, band_peaks, position_plant
from ehsa_ctrl.design.tuning.tune import tune

T_S = 0.004


@pytest.fixture(scope="module")
def model():
    return ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))


@pytest.fixture(scope="module")
def integrator():
    """Position as the integral of the current, nothing else."""
    import control

    return control.ss([[0.0]], [[1.0]], [[1.0]], 0, states=["x"], inputs=["current"], outputs=["x"])


def sensitivities(system, gains, points=20000):
    """|S|, |T|, |K S|, |S - T| and omega on a grid of its own, by python-control's sampling and transfer functions."""
    import control

    plant = control.sample_system(system[system.output_labels.index("x"), 0], T_S, "zoh")
    z = control.tf("z")
    z.dt = T_S
    law = gains.k_p + gains.k_i * T_S / (z - 1) + gains.k_d * (z - 1) / ((gains.T_f + T_S) * z - gains.T_f)
    omega = np.pi / T_S * np.geomspace(1e-5, 1.0, points)[:-1]
    on = np.exp(1j * omega * T_S)
    C, G = np.asarray(law(on)), np.asarray(plant(on))
    S = 1 / (1 + C * G)
    return np.abs(S), np.abs(1 - S), np.abs(C * S), np.abs(2 * S - 1), omega


# The loop that is tuned


def test_an_integrator_under_p_has_the_poles_and_the_integral_of_the_closed_form():
    """y[k] = 1 - (1 - a)^k with a = k_p T_s: pole at 1 - a, integral of the error T_s / a."""
    plant = SampledPlant(np.array([[1.0]]), np.array([T_S]), np.array([1.0]), T_S)
    loop = PidLoop(plant, Gains(100.0))

    assert loop.radius() == pytest.approx(1 - 100.0 * T_S)
    assert np.allclose(loop.error(50, "reference"), (1 - 100.0 * T_S) ** np.arange(50))
    assert T_S * np.sum(loop.error(400, "reference")) == pytest.approx(1 / 100.0)


def test_the_integrated_error_of_a_load_step_is_one_over_k_i(model):
    """Whatever the plant: the integral has to grow by the current that the load takes."""
    for lag in (0, 2):
        loop = PidLoop(position_plant(model, T_S, lag=lag), Gains(300.0, 1500.0, 20.0, 0.004))

        assert T_S * np.sum(loop.error(4096, "load")) == pytest.approx(-1 / 1500.0, rel=1e-9)


def test_the_step_is_that_of_the_simulated_loop(linear, model):
    """The law in the house against the linear plant, 1 um so that no limit is met."""
    from ehsa_ctrl.design.controller import SampledController
    from ehsa_ctrl.design.kinds.pid import Pid

    gains = Gains(300.0, 1500.0, 20.0, 0.004)
    reference = np.zeros((300, 3))
    reference[1:, 0] = 1e-6
    law = Pid(gains, 0.7, 0.2, 1e3, np.inf, False, T_S)

    run = ehsa_ctrl.run_closed_loop(linear, SampledController("mine", "pid", T_S, 1e3, law), reference, tolerance=1e-9)

    error = PidLoop(position_plant(model, T_S), gains, 0.7, 0.2).error(299, "reference")
    assert np.allclose(1e6 * run.error[1:], error, atol=2e-4)


def test_peaks_are_found_between_the_points():
    """A narrow bump whose top lies between two points of the grid."""
    x = np.linspace(0.0, 1.0, POINTS)
    top = 0.5 * (x[200] + x[201])

    peaks = band_peaks(1.0 - (x - top) ** 2 * 1e3)

    assert peaks.shape == (BANDS,)
    assert np.max(peaks) == pytest.approx(1.0, abs=1e-9)


# Optimum


@pytest.mark.parametrize("Ms", [1.25, 1.6])
def test_p_on_an_integrator_is_the_closed_form(integrator, Ms):
    """|S| = |(z - 1) / (z - 1 + a)| is largest at z = -1: 2 / (2 - a), so that a = 2 - 2 / Ms is the most."""
    asked = Tuning(terms="P", minimise="IAE", response="reference", Ms=Ms, Mt=None, disk_margin=None, noise_gain=None)

    found = tune(integrator, asked, sample_time=T_S)

    assert found.gains.k_p * T_S == pytest.approx(2 - 2 / Ms, rel=1e-3)
    assert found.active == ("Ms",)


@pytest.mark.slow
def test_pi_with_least_integrated_error_is_the_best_of_a_net(model):
    """Brute force over 300 x 300 gains: none within the bounds has more k_i than the optimum, and some come near."""
    asked = Tuning(terms="PI", minimise="IE", Ms=1.5, Mt=1.6, disk_margin=None, noise_gain=None)

    best = tune(model, asked, sample_time=T_S).gains

    k_p, k_i = (value * np.linspace(0.5, 1.6, 300) for value in (best.k_p, best.k_i))
    plant = position_plant(model, T_S)
    z = np.exp(1j * np.pi * np.geomspace(1e-4, 1.0, 250))
    G = plant.response(z)
    C = k_p[:, None, None] + k_i[:, None] * T_S / (z - 1.0)
    S = 1 / (1 + C * G)
    kept = (np.abs(S).max(axis=2) <= 1.5) & (np.abs(1 - S).max(axis=2) <= 1.6)
    stable = [
        (k, j)
        for k, j in np.argwhere(kept)
        if k_i[j] > 0.98 * best.k_i and PidLoop(plant, Gains(k_p[k], k_i[j])).radius() < 1
    ]
    reached = max(k_i[j] for _, j in stable)
    assert reached <= best.k_i * 1.004
    assert reached >= best.k_i * 0.99


@pytest.mark.slow
def test_no_random_gains_within_the_bounds_are_better(model):
    """ITAE of a load step: 1500 gains drawn around the optimum, none better than it by more than rounding."""
    asked = Tuning(Ms=1.5, Mt=1.4, disk_margin=0.7, noise_gain="8000 A/m")
    found = tune(model, asked, sample_time=T_S)
    plant, rng, better, kept = position_plant(model, T_S), np.random.default_rng(5), [], 0
    omega = np.pi * np.geomspace(1e-4, 1.0, 300)
    z = np.exp(1j * omega)
    G, g = plant.response(z), found.gains

    for _ in range(1500):
        factors = np.exp(rng.normal(0, 0.1, 4))
        gains = Gains(g.k_p * factors[0], g.k_i * factors[1], g.k_d * factors[2], g.T_f * factors[3])
        C = gains.response(z, T_S)
        S = 1 / (1 + C * G)
        noise = np.sqrt(np.trapezoid(np.abs(C * S) ** 2, omega) / np.pi)
        if (
            np.abs(S).max() <= 1.5
            and np.abs(1 - S).max() <= 1.4
            and noise <= 8000
            and np.abs(2 * S - 1).max() <= 2 / 0.7
        ):
            kept += 1
            error = np.abs(PidLoop(plant, gains).error(1024, "load"))
            better.append(T_S * np.sum(T_S * np.arange(error.size) * error) / found.objective)

    assert kept > 50
    assert min(better) > 0.998


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked",
    [
        {},
        {"minimise": "IE", "Ms": 1.4, "Mt": 1.3, "noise_gain": "5000 A/m"},
        {"terms": "PD", "response": "reference", "Ms": 1.6, "noise_gain": None},
        {"minimise": "IAE", "lag": 1, "crossover": "25 rad/s"},
    ],
)
def test_bounds_hold_on_an_independent_grid(model, asked):
    bounds = Tuning(**asked)

    found = tune(model, bounds, sample_time=T_S, b=0.7)

    system = model
    S, T, KS, SmT, omega = sensitivities(system, found.gains) if bounds.lag == 0 else lagged(model, found.gains)
    assert np.max(S) <= bounds.Ms * (1 + 1e-5)
    assert np.max(T) <= bounds.Mt * (1 + 1e-5)
    assert 2 / np.max(SmT) >= bounds.disk_margin * (1 - 1e-5)
    if bounds.noise_gain is not None:
        assert np.sqrt(np.trapezoid(KS**2, omega * T_S) / np.pi) <= bounds.noise_gain * (1 + 1e-4)
    if bounds.crossover is not None:
        assert T[omega >= bounds.crossover][0] / S[omega >= bounds.crossover][0] >= 1 - 1e-3
    assert found.loops[0].stable
    assert found.active


def lagged(model, gains, points=20000):
    """As `sensitivities`, one sample late."""
    omega = np.pi / T_S * np.geomspace(1e-5, 1.0, points)[:-1]
    z = np.exp(1j * omega * T_S)
    G = position_plant(model, T_S).response(z) / z
    C = gains.response(z, T_S)
    S = 1 / (1 + C * G)
    return np.abs(S), np.abs(1 - S), np.abs(C * S), np.abs(2 * S - 1), omega


@pytest.mark.slow
def test_bounds_hold_on_every_model_given(model):
    """Tuned for hard and soft oil together, the gains are lower than for hard oil alone."""
    soft = operating_point(model, bulk_modulus=0.4)
    asked = Tuning(Ms=1.5, Mt=None, disk_margin=None)

    alone, both = tune(model, asked, sample_time=T_S), tune([model, soft], asked, sample_time=T_S)

    assert np.max(sensitivities(soft, alone.gains)[0]) > 1.7
    for system in (model, soft):
        assert np.max(sensitivities(system, both.gains)[0]) <= 1.5 * (1 + 1e-5)
    assert both.gains.k_i < alone.gains.k_i


# Mistakes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"Ms": 1.2, "crossover": "200 rad/s"}, "no PID controller satisfies Ms at most 1.2.*the nearest one has"),
        ({"crossover": "800 rad/s"}, "Nyquist frequency 785.4 rad/s"),
        (
            {"terms": "P", "response": "reference", "crossover": "20 rad/s"},
            "no P controller satisfies .*the nearest one has Ms",
        ),
    ],
)
def test_what_nothing_reaches_is_one_sentence(model, asked, sentence):
    with pytest.raises(InputError, match=sentence) as raised:
        tune(model, Tuning(**asked), sample_time=T_S)

    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"Ms": 0.9}, "greater than 1"),
        ({"terms": "PD"}, "leaves a steady-state error"),
        ({"minimise": "IE", "response": "reference"}, "integrated error of a load step"),
        ({"Ms": None, "disk_margin": None}, "gains grow without bound"),
        ({"noise_gain": "0 A/m"}, "greater than 0"),
    ],
)
def test_a_tuning_that_makes_no_sense_is_refused(asked, sentence):
    with pytest.raises(ValueError, match=sentence):
        Tuning(**asked)
