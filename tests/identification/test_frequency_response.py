"""Frequency responses of known systems: exact lines, calibrated errors, what noise and what friction make."""

import control
import numpy as np
import pytest
from scipy.linalg import toeplitz

import ehsa_ctrl as e
from ehsa_ctrl.identification.comparison import fit_percent
from ehsa_ctrl.identification.frequency_signals import model_response
from ehsa_ctrl.identification.spectra import find_period, periodic_response, spectral_response

T_S = 0.004


@pytest.fixture(scope="module")
def linear():
    return e.load_plant("ehsa", model="linear")


def log_of(plant, current):
    """A log without noise."""
    run = e.simulate(plant, current)
    channels = {"current": current, "speed": run["omega"], "p1": run["P_1"], "p2": run["P_2"], "position": run["x"]}
    return e.Log(run.time, channels)


@pytest.mark.parametrize("output", ["speed", "pressure_difference", "position"])
def test_lines_of_a_multisine_are_the_transfer_function(linear, output):
    """Without noise each line of the periodic method equals the sampled transfer function; nothing is nonlinear."""
    logs = [log_of(linear, e.excitation("multisine", duration=20.0, seed=seed)[1]) for seed in (0, 1)]
    found = e.frequency_response(linear, logs)
    lines = found[output]

    assert found.method == "periodic" and found.period == pytest.approx(4.0) and found.averages == 8
    assert np.allclose(lines.frequency, np.arange(0.25, 20.0, 0.5))
    np.testing.assert_allclose(lines.response, found.models["linear"][output], rtol=2e-5)
    assert np.max(lines.sd / np.abs(lines.response)) < 2e-5
    assert lines.even < 1e-6
    assert found.distance("linear", output) < 2e-5


def test_the_models_response_is_that_of_python_control(linear):
    """The sampled model at a frequency, current held."""
    import control

    model = e.three_state(linear)
    frequency = np.array([0.5, 3.0, 40.0])
    sampled = control.c2d(model, T_S, "zoh")(np.exp(2j * np.pi * frequency * T_S))

    assert np.allclose(model_response(model, linear, "speed", frequency, T_S), sampled[0, 0])
    assert np.allclose(model_response(model, linear, "pressure_difference", frequency, T_S), sampled[1, 0])
    both = e.linearise(linear)
    assert np.allclose(model_response(both, linear, "pressure_difference", frequency, T_S), sampled[1, 0])


def test_h1_and_h2_of_white_noise(linear):
    """H1 is unbiased for noise at the output and H2 for noise at the input; each is biased by the other one."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(3)
    b, a, n = [0.1, 0.05], [1.0, -0.85], 400_000
    u = rng.normal(size=n)
    y = lfilter(b, a, u)
    truth = lambda f: np.polyval(b, z := np.exp(2j * np.pi * f * T_S)) / np.polyval(a, z)  # noqa: E731

    def bias(inputs, outputs, estimator):
        lines = spectral_response([inputs], [outputs], T_S, 2000, estimator)
        return float(np.mean(np.abs(lines.response / truth(lines.frequency)))) - 1.0, lines

    at_output, lines = bias(u, y + 0.3 * rng.normal(size=n), "H1")
    at_input, _ = bias(u + 0.3 * rng.normal(size=n), y, "H2")
    assert abs(at_output) < 0.02 and abs(at_input) < 0.02
    assert bias(u + 0.3 * rng.normal(size=n), y, "H1")[0] == pytest.approx(1 / 1.09 - 1.0, abs=0.02)
    # Coherence of signal and noise with known spectra.
    size = np.abs(truth(lines.frequency)) ** 2
    assert np.mean(np.abs(lines.coherence - size / (size + 0.09))) < 0.03
    # The stated error is the scatter: two standard deviations of a complex number hold 1 - exp(-4), 98 %.
    inside = np.abs(lines.response - truth(lines.frequency)) < 2.0 * lines.noise_sd
    assert 0.95 < inside.mean() <= 1.0


def test_noise_of_a_periodic_record_is_calibrated():
    """The stated standard deviation by noise is the scatter over many records."""
    rng = np.random.default_rng(0)
    time = T_S * np.arange(8 * 500)
    u = np.sum([np.sin(2 * np.pi * 0.5 * k * time + k) for k in (1, 3, 5)], axis=0)
    records = [periodic_response([u], [2.0 * u + 0.5 * rng.normal(size=u.size)], T_S, 500, 500) for _ in range(200)]
    scatter = np.std([lines.response for lines in records], axis=0)
    stated = np.sqrt(np.mean([lines.noise_sd**2 for lines in records], axis=0))

    assert np.allclose(stated, scatter, rtol=0.15)


def test_a_cubic_nonlinearity_is_told_from_noise():
    """y = u + c u^3: realisations scatter; odd lines without excitation show it, even ones don't; 1 + 3 c E u^2."""
    rng = np.random.default_rng(1)
    time = T_S * np.arange(5 * 1000)
    lines = np.setdiff1d(np.arange(1, 60, 2), [7, 21, 35])
    inputs = [
        np.sum([np.sin(2 * np.pi * 0.25 * k * time + rng.uniform(0, 7)) for k in lines], axis=0) for _ in range(6)
    ]
    outputs = [u + 0.01 * u**3 + 0.01 * rng.normal(size=u.size) for u in inputs]
    found = periodic_response(inputs, outputs, T_S, 1000, 0)

    assert np.median(found.nonlinear_sd) > 10 * np.median(found.noise_sd)
    assert found.odd > 10 * found.even
    assert np.mean(found.response.real) == pytest.approx(1.0 + 3 * 0.01 * 0.5 * lines.size, rel=0.02)
    linear = periodic_response(inputs, inputs, T_S, 1000, 0)
    assert np.allclose(linear.response, 1.0) and np.max(linear.nonlinear_sd) < 1e-9


def test_friction_shows_as_nonlinearity():
    """A multisine on the plant with friction: nonlinearity beyond noise, and a gain far from the sliding model's."""
    plant = e.load_plant("ehsa")
    logs = [
        e.record(plant, *e.excitation("multisine", amplitude=3.0, duration=16.0, seed=seed), seed=seed, centre=True)[0]
        for seed in range(3)
    ]
    found = e.frequency_response(plant, logs)
    speed = found["speed"]

    assert np.nanmedian(speed.nonlinear_sd) > 10 * np.median(speed.noise_sd)
    assert found.distance("nonlinear", "speed") > 0.2
    assert "by nonlinearity" in str(found)
    frame = found.to_pandas()
    assert set(frame["output"]) == {"speed", "pressure_difference", "position"}
    assert found.to_frd("speed")(2j * np.pi * speed.frequency[3]) == pytest.approx(speed.response[3])


@pytest.mark.parametrize(("name", "period"), [("multisine", 1000), ("steps", 250), ("sine", 125), ("noise", None)])
def test_periods_are_found(name, period):
    """In the current with measurement noise."""
    current = e.excitation(name, duration=12.0)[1]

    assert find_period(current + 0.005 * np.random.default_rng(0).normal(size=current.size)) == period


def test_a_subspace_model_has_the_plants_poles(linear):
    """Without noise: order 3 by the singular values, poles of the plant without position, fit near 100 %."""
    time, current = e.excitation("white", amplitude=1.0, duration=32.0)
    run = e.simulate(linear, current)
    found = e.identify_subspace(current, {"speed": run["omega"], "dP": run["dP"]}, T_S)
    poles = np.sort_complex(np.log(found.system.poles().astype(complex)) / T_S)

    assert found.order == 3 and time.size == current.size
    np.testing.assert_allclose(poles, np.sort_complex(e.three_state(linear, position=False).poles()), rtol=2e-3)
    assert min(found.fit_percent.values()) > 99.0


def test_a_subspace_model_has_the_feedthrough_of_the_data():
    """y = x + 0.5 u with noise, at a sample time far from 1 s."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(4000)
    system = control.ss([[0.9]], [[1.0]], [[0.3]], [[0.5]], T_S)
    y = control.forced_response(system, T_S * np.arange(u.size), u).outputs + 0.01 * rng.standard_normal(u.size)
    found = e.identify_subspace(u, {"y": y}, T_S, order=1)

    assert found.system.D[0, 0] == pytest.approx(0.5, abs=0.01)
    assert found.system.poles()[0].real == pytest.approx(0.9, abs=0.01)
    assert found.fit_percent["y"] > 97.0


def test_under_friction_a_subspace_model_is_as_good_as_a_linear_one_can_be():
    """Least squares over 200 past samples of the drive, the best linear model of that memory: 68 % of the speed."""
    current = 3.0 * np.random.default_rng(1).uniform(-1.0, 1.0, 8000)
    speed = e.simulate(e.load_plant("ehsa"), current, sample_time=T_S)["omega"][: current.size]
    found = e.identify_subspace(current, {"speed": speed}, T_S)
    past = toeplitz(current - current.mean(), np.zeros(200))
    measured = speed - speed.mean()
    best = fit_percent(measured, past @ np.linalg.lstsq(past, measured, rcond=None)[0])

    assert best > 60.0
    assert best - 5.0 < found.fit_percent["speed"] < best + 0.5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "periodic"}, "current has no period"),
        ({"estimator": "H3"}, "estimator = 'H3'; expected H1 or H2"),
        ({"segment": 0.02}, "segments of 0.02 s; expected 16 samples"),
        ({"period": 30.0}, "expected at least two whole periods"),
        ({"subspace": True}, "the input excites .* % of the band"),
        ({"method": "welch"}, "frequency_response: method is 'welch'"),
    ],
)
def test_wrong_requests_are_one_sentence(linear, options, words):
    log = log_of(linear, e.excitation("noise", duration=12.0)[1])

    with pytest.raises(e.InputError, match=words) as caught:
        e.frequency_response(linear, [log], **options)

    assert "\n" not in str(caught.value)
