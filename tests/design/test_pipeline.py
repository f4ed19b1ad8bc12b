"""The stages of a controller: one text for plain and compiled, neutral stages change nothing."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import load_controller, three_state
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.stages.compiled import compiled_pipeline, pointer_text
from ehsa_ctrl.design.stages.feedforward import MEMORY as FEED_MEMORY
from ehsa_ctrl.design.stages.feedforward import SETTINGS as FEED
from ehsa_ctrl.design.stages.feedforward import Feedforward, feedforward, feedforward_settings
from ehsa_ctrl.design.stages.pipeline import M_LAW, M_REST, S_LAW, pipeline
from ehsa_ctrl.design.stages.rest import MEMORY as REST_MEMORY
from ehsa_ctrl.design.stages.rest import Dither, Knocker, Rest, rest, rest_settings
from ehsa_ctrl.design.stages.trajectory import TrajectoryLimits

T = 0.004


@pytest.fixture
def pid(linear):
    return load_controller("pid_position", three_state(linear))


@pytest.fixture
def full(pid):
    """Every stage on."""
    return replace(
        pid,
        trajectory=TrajectoryLimits(speed="0.15 m/s", acceleration="3 m/s2"),
        feedforward=Feedforward(inertia="0.7 A s2/m", viscous="5 A s/m", coulomb="0.9 A", static="1 A"),
        rest=Rest(band="40 um", knocker=Knocker(first="0.2 A", growth="0.1 A", largest="2 A")),
        dither=Dither(amplitude="0.1 A", frequency="60 Hz"),
    )


def test_plain_and_compiled_are_equal_to_the_bit(full):
    """Each stage's text, run in Python and compiled, over noisy readings, losses and jumps."""
    rng = np.random.default_rng(3)
    plain, compiled = full.initial_memory(), full.initial_memory()
    for k in range(400):
        reference = np.array([0.01 * (k > 100), 0.0, 0.0])
        measured = rng.standard_normal(5) * 1e-5 + [0, 2e6, 2e6, 0.01 * (k > 200), 0]
        measured[3] = np.nan if 300 < k < 305 else measured[3]

        assert full.step(reference, measured, plain) == full.compiled(reference, measured, compiled, full.settings())
    np.testing.assert_array_equal(plain, compiled)


def test_neutral_stages_change_nothing(pid):
    """Without any stage the pipeline returns the law's current, to the bit."""
    rng = np.random.default_rng(4)
    memory, alone = pid.initial_memory(), pid.law.initial_memory()
    for _ in range(200):
        reference, measured = 0.01 * rng.standard_normal(3), 0.01 * rng.standard_normal(5)
        wanted = pid.law.function(reference, measured, alone, pid.law.settings(), 0.0, 0.0)

        assert pid.step(reference, measured, memory) == wanted


def test_every_stage_has_its_own_place(full):
    """The vectors have the sizes of the stages, with the law's part at the end."""
    assert full.settings().size == S_LAW + full.law.settings().size
    assert full.initial_memory().size == M_LAW + full.law.initial_memory().size
    assert M_LAW - M_REST == REST_MEMORY
    assert feedforward_settings(None, T).size == FEED


def test_lost_readings_end_in_zero_current(full):
    """A position that stays lost stops the loop; the current is zero from then on, even for a large error."""
    memory = full.initial_memory()
    currents = []
    for k in range(60):
        measured = np.array([0.0, 2e6, 2e6, np.nan if k > 20 else 0.0, 0.0])
        currents.append(full.step(np.array([0.02, 0.0, 0.0]), measured, memory))

    assert np.isfinite(currents).all()
    assert currents[25] != 0.0
    assert not np.any(currents[31:])


def test_feedforward_is_the_law_it_says():
    """Against the formula, and odd in the motion where nothing but preload breaks the symmetry."""
    numbers = Feedforward(
        inertia="0.7 A s2/m",
        viscous="5 A s/m",
        stiffness="16 A/m",
        coulomb="0.9 A",
        static="1.1 A",
        stribeck="0.01 m/s",
    )
    settings, memory = feedforward_settings(numbers, T), np.zeros(FEED_MEMORY)
    x, v, a = 0.02, 0.03, -1.0
    expected = 0.7 * a + 5 * v + 16 * x + 0.9 + 0.2 * np.exp(-3)

    assert feedforward(np.array([x, v, a]), np.zeros(5), memory, settings) == pytest.approx(expected, rel=1e-14)
    assert feedforward(-np.array([x, v, a]), np.zeros(5), memory, settings) == pytest.approx(-expected, rel=1e-14)
    assert feedforward(np.array([x, 0.0, 0.0]), np.zeros(5), memory, settings) == pytest.approx(16 * x)


def test_the_measured_force_is_carried():
    """From its first reading on, then with the filter's time constant."""
    numbers = Feedforward(load="0.3 A/kN", force_time="20 ms")
    settings, memory = feedforward_settings(numbers, T), np.zeros(FEED_MEMORY)
    readings = [np.array([0.0, 0.0, 0.0, 0.0, force]) for force in [1000.0] + [2000.0] * 5]
    currents = [feedforward(np.zeros(3), each, memory, settings) for each in readings]

    np.testing.assert_allclose(currents, 0.3 * (2 - np.exp(-T / 0.02 * np.arange(6))), rtol=1e-12)


def rests(error, speed, samples, stage):
    """Hold flag and extra current for a standing error and a shaft speed after the end of a motion."""
    memory, settings = np.zeros(REST_MEMORY), rest_settings(stage, None, T)
    rows = []
    for _ in range(samples):
        rest(np.array([error, 0.0, 0.0]), np.array([speed, 2e6, 2e6, 0.0, 0.0]), memory, settings)
        rows.append(memory[:2].copy())
    return np.array(rows).T


def test_the_integral_stands_still_within_the_band_only():
    """Held inside the band once the patience is over; not outside, and not while the shaft turns."""
    stage = Rest(band="40 um", patience="60 ms")

    assert rests(30e-6, 0.0, 100, stage)[0].tolist() == [0.0] * 15 + [1.0] * 85
    assert not rests(60e-6, 0.0, 100, stage)[0].any()
    assert not rests(30e-6, 2.0, 100, stage)[0].any()


def test_the_knocker_pulses_towards_the_target_ever_higher():
    """One sample in five, 0.2 A up by 0.1 A to 0.5 A, signed as the error."""
    knocker = Knocker(first="0.2 A", growth="0.1 A", largest="0.5 A", width="4 ms", period="20 ms")
    hold, extra = rests(-60e-6, 0.0, 60, Rest(band="40 um", patience="40 ms", knocker=knocker))
    pulses = extra[10:]

    assert np.all(hold[10:] == 1.0)
    np.testing.assert_allclose(pulses[::5], [-0.2, -0.3, -0.4, *[-0.5] * 7])
    assert not pulses.reshape(-1, 5)[:, 1:].any()


def test_dither_is_a_sine():
    """Amplitude and frequency as asked for."""
    memory, settings = np.zeros(REST_MEMORY), rest_settings(None, Dither(amplitude="0.1 A", frequency="50 Hz"), T)
    extra = []
    for _ in range(40):
        rest(np.zeros(3), np.zeros(5), memory, settings)
        extra.append(memory[1])

    np.testing.assert_allclose(extra, 0.1 * np.sin(2 * np.pi * 50 * T * np.arange(40)), atol=1e-12)


def test_the_pipeline_takes_any_callable_as_law(pid):
    """A law with a solver inside runs plain through the same text."""
    memory = pid.initial_memory()
    current = pipeline(np.zeros(3), np.ones(5), memory, pid.settings(), lambda *arguments: 0.25 + arguments[4])

    assert current == 0.25


def shifting_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """Means of the last readings, by all that a law may do with a slice."""
    first, second, third = memory[1:4]
    memory[1:4] = memory[:3]
    memory[0] = measured[3]
    memory[3], memory[0] = memory[0], memory[3]
    tail = memory[2:]
    return first + 2.0 * second + 4.0 * third + 8.0 * tail[1] + extra


def test_slices_are_the_same_with_pointers():
    """An overlapping copy, several targets and slices of slices: compiled as plain, to the bit."""
    step = compiled_pipeline(shifting_law, ())
    settings = np.zeros(S_LAW)
    settings[:7] = [10.0, np.inf, np.inf, -np.inf, np.inf, np.inf, 0.0]
    plain, compiled = np.zeros(M_LAW + 4), np.zeros(M_LAW + 4)
    for k in range(8):
        measured = np.array([0.0, 1.0, 2.0, 0.1 * k * k, 0.0])
        found = step(np.zeros(3), measured, compiled, settings)

        assert found == pipeline(np.zeros(3), measured, plain, settings, shifting_law)
    assert found != 0.0
    np.testing.assert_array_equal(plain, compiled)


def test_an_index_from_the_end_is_refused():
    """A pointer has no end."""

    def law(memory):
        return memory[-1]

    with pytest.raises(InputError, match=r"law: `memory\[-1\]`; expected an index that counts from the front"):
        pointer_text(law)
