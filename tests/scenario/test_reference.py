"""References: speed and acceleration are the derivatives of the position, ends are where they should be."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.scenario.definition import ScenarioFile
from ehsa_ctrl.scenario.reference import Reference

FORMS = TypeAdapter(Reference)
TIME = np.arange(0, 6, 1e-4)

MOVING = {
    "moves": {"times": ["0.5 s", "3 s"], "positions": ["20 mm", "-5 mm"], "durations": ["1 s", "2 s"]},
    "sine": {"amplitude": "10 mm", "frequency": "0.5 Hz", "start": "0.3 s"},
    "ramp": {"position": "-8 mm", "velocity": "4 mm/s", "start": "1 s"},
    "trapezoid": {
        "times": ["0.2 s", "2.5 s"], "positions": ["50 mm", "45 mm"], "velocity": "60 mm/s", "acceleration": "0.5 m/s2",
    },
}  # fmt: skip


def reference(kind, content):
    return FORMS.validate_python({"kind": kind, **content})


@pytest.mark.parametrize("kind", MOVING)
def test_speed_and_acceleration_are_derivatives(kind):
    """By finite differences, except at jumps."""
    signal = reference(kind, MOVING[kind]).signal(TIME)
    for column in (1, 2):
        slope = np.gradient(signal[:, column - 1], TIME)
        off = np.abs(slope - signal[:, column]) > 1e-3 * max(np.abs(signal[:, column]).max(), 1e-3)

        # A jump of the acceleration, or of a ramp's speed, spoils the two samples beside it.
        assert np.count_nonzero(off) <= 20


@pytest.mark.parametrize("kind", ["moves", "ramp", "trapezoid"])
def test_a_hold_is_a_hold(kind):
    """During a hold the target is constant."""
    form = reference(kind, MOVING[kind])
    signal = form.signal(TIME)
    positions = {"moves": [20e-3, -5e-3], "ramp": [-8e-3], "trapezoid": [50e-3, 45e-3]}[kind]

    assert len(form.holds()) == len(positions)
    for (start, end), position in zip(form.holds(), positions, strict=True):
        held = signal[(start + 1e-6 < TIME) & (end > TIME)]

        np.testing.assert_allclose(held[:, 0], position, atol=1e-12)
        np.testing.assert_allclose(held[:, 1], 0, atol=1e-9)


def test_a_trapezoid_takes_d_over_v_plus_v_over_a():
    """Long move: 50 mm at 60 mm/s and 0.5 m/s2; short one: 2 sqrt(d / a), and never faster than allowed."""
    form = reference("trapezoid", MOVING["trapezoid"])
    (first, _), (second, _) = form.holds()

    assert first == pytest.approx(0.2 + 0.05 / 0.06 + 0.06 / 0.5)
    assert second == pytest.approx(2.5 + 2 * np.sqrt(5e-3 / 0.5))
    assert np.max(np.abs(form.signal(TIME)[:, 1])) == pytest.approx(0.06)


def write(tmp_path, text):
    (tmp_path / "way.csv").write_text(text)
    content = {"kind": "file", "file": "way.csv", "start": "1 s"}
    return FORMS.validate_python(content, context={"folder": tmp_path})


def test_a_file_is_followed_from_row_to_row(tmp_path):
    """Linear interpolation, the slope as speed, the last position held; the path is relative to the scenario."""
    form = write(tmp_path, "t,position\n0,0\n1,0.01\n3,0.03\n3.5,0.03\n")
    signal = form.signal(np.array([0.5, 1.5, 2.5, 5.0]))

    np.testing.assert_allclose(signal[:, 0], [0, 0.005, 0.015, 0.03])
    np.testing.assert_allclose(signal[:, 1], [0, 0.01, 0.01, 0])
    assert form.holds() == [(4.5, np.inf)]


def test_a_file_may_bring_its_own_speed(tmp_path):
    """Columns velocity and acceleration are taken as they are."""
    form = write(tmp_path, "t,position,velocity,acceleration\n0,0,0,1\n2,0.01,0.5,1\n")

    np.testing.assert_allclose(form.signal(np.array([2.0]))[0], [0.005, 0.25, 1])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,x\n0,0\n1,1\n", "has no column 'position'"),
        ("t,position\n0,0\n1,oops\n", "column .position., row 3"),
        ("t,position\n0,0\n0,1\n", "t must have at least two rows, increase"),
        ("t,position\n0,0\n", "at least two rows"),
    ],
)
def test_a_wrong_file_is_a_sentence(tmp_path, text, says):
    """File, column and row."""
    with pytest.raises(ValidationError, match=says):
        write(tmp_path, text)


SCENARIO = {
    "schema": 1, "title": "t", "why": "w", "plant": "ehsa", "controller": "pid_position", "duration": "4 s",
    "reference": {"kind": "steps", "times": ["0.2 s", "2 s"], "positions": ["1 mm", "2 mm"]},
}  # fmt: skip


def test_a_force_cuts_a_hold():
    """A change of force splits a hold; edges outside a hold or the run do not."""
    force = [{"force": "1 kN", "start": "1 s", "duration": "0.5 s"}, {"force": "1 kN", "start": "3 s"}]
    definition = validate(SCENARIO | {"disturbance": force}, ScenarioFile, "x")

    assert definition.holds() == [(0.2, 1.0), (1.0, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, np.inf)]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"reference": {"kind": "ramp", "position": "1 mm", "velocity": "0 mm/s"}}, "velocity must be greater than 0"),
        (
            {"reference": MOVING["trapezoid"] | {"kind": "trapezoid", "times": ["0.2 s", "0.3 s"]}},
            "the move at 0.3 s starts before",
        ),
        ({"reference": {"kind": "file", "file": "nowhere.csv"}}, "nowhere.csv: no such file"),
        ({"fault": [{"kind": "stuck", "channel": "pos", "start": "1 s"}]}, "channel"),
        ({"fault": [{"kind": "broken", "start": "1 s"}]}, "stuck"),
        (
            {"fault": [{"kind": "lost", "channel": "p1", "start": "9 s"}]},
            "duration = 4 s, but an event of the scenario is at 9 s",
        ),
        ({"fault": [{"kind": "current_limit", "current": "-1 A", "start": "1 s"}]}, "current must be at least 0"),
        ({"supervision": {"position": "0 mm"}}, "must be greater than 0"),
        ({"supervision": {"pressure_min": "3 bar", "pressure_max": "2 bar"}}, "less than pressure_max"),
        ({"spread": {"K_T": [1, 2, 3]}}, "expected a standard deviation"),
        ({"baseline": {"time": "-1 ms"}}, "at least 0"),
        (
            {"reference": MOVING["trapezoid"] | {"kind": "trapezoid"}, "limits": {"Overshoot": {"max": "5 %"}}},
            r"my.toml: \[limits\] Overshoot: is not defined here because the target of .* 'trapezoid' does not jump",
        ),
        (
            {"reference": {"kind": "sine", "amplitude": "1 mm", "frequency": "1 Hz"}, "limits": {"Slips": {"max": 3}}},
            r"\[limits\] Slips: is not defined here because the target of .* 'sine' is never held",
        ),
    ],
)
def test_a_mistake_is_a_sentence_with_its_key(change, says):
    """One line, with the file's name."""
    with pytest.raises(InputError, match=says) as caught:
        validate(SCENARIO | change, ScenarioFile, "my.toml")

    assert str(caught.value).startswith("my.toml: ") and "\n" not in str(caught.value)


def test_a_file_that_is_repeated_begins_anew(tmp_path):
    """Each period is the first one, and the errors of the first and last full period are metrics."""
    (tmp_path / "there_and_back.csv").write_text("t,position\n0,0\n0.5,0.01\n1,0\n")
    given = {"kind": "file", "file": "there_and_back.csv", "period": "1.2 s", "start": "0.1 s"}
    reference = TypeAdapter(Reference).validate_python(given, context={"folder": tmp_path})
    time = 0.004 * np.arange(1000)
    signal = reference.signal(time)

    assert np.all(signal[time < 0.1] == 0.0)
    assert np.allclose(signal[25:325], signal[325:625], atol=1e-11)
    assert np.max(signal[:, 0]) == pytest.approx(0.01, abs=1e-4)
    assert reference.holds() == []


@pytest.mark.parametrize(
    ("rows", "period", "sentence"),
    [("0,0\n1,0\n", "0.5 s", "ends before the file, whose last t is 1 s"),
     ("0,0\n1,0.01\n", "2 s", "must end where it begins; .* goes from 0 m to 0.01 m")],
)  # fmt: skip
def test_a_period_that_does_not_fit_is_one_sentence(tmp_path, rows, period, sentence):
    (tmp_path / "one.csv").write_text(f"t,position\n{rows}")
    with pytest.raises(ValueError, match=sentence):
        TypeAdapter(Reference).validate_python(
            {"kind": "file", "file": "one.csv", "period": period}, context={"folder": tmp_path}
        )
