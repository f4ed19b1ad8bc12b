"""Units in the user's texts."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.unit import base_units, factor, parse, parse_angular_frequency


@pytest.mark.parametrize(
    ("text", "expected", "value"),
    [
        ("20 mm", "m", 0.02),
        ("3.7 cm3/rev", "m3/rad", 3.7e-6 / (2 * np.pi)),
        ("4500 rpm", "rad/s", 4500 * 2 * np.pi / 60),
        ("210 bar", "Pa", 210e5),
        ("-1.5e3 mA", "A", -1.5),
        ("50 N/mm", "N/m", 50e3),
        ("12 %", "1", 0.12),
        ("0.3", "1", 0.3),
        ("60 deg", "rad", np.pi / 3),
        ("60°", "rad", np.pi / 3),
        ("1.1 Nm/A", "N m/A", 1.1),
        ("2 kNm", "N m", 2000.0),
        ("0.01 Nms/rad", "N m s/rad", 0.01),
        ("30 lpm", "m3/s", 0.5e-3),
        ("4 l/min/bar", "m3/(s Pa)", 4e-3 / 60 / 1e5),
        ("9.81 m·s⁻²", "m/s2", 9.81),
        ("3 m ** (-1)", "1/m", 3.0),
    ],
)
def test_text_becomes_si(text, expected, value):
    """A number with its unit is read in SI."""
    assert parse(text, expected) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "expected", "says"),
    [
        ("3 kg", "m", "does not fit"),
        ("3", "m", "has no unit"),
        ("three mm", "m", "is not a quantity"),
        ("3 furlongz", "m", "is not known"),
        ("2 Hz", "rad/s", "1 Hz is 2 pi rad/s"),
        ("2 rad/s", "Hz", "1 Hz is 2 pi rad/s"),
        ("3000 1/min", "rad/s", "has no angle"),
        ("3.7 cm3", "m3/rad", "as in 'rpm' and 'cm3/rev'"),
    ],
)
def test_wrong_text_is_a_sentence(text, expected, says):
    """Errors give the reason."""
    with pytest.raises(InputError, match=says):
        parse(text, expected)


def test_frequency_is_read_in_hertz_too():
    """1 Hz is 2 pi rad/s for a crossover or bandwidth; another unit is refused in rad/s."""
    assert parse_angular_frequency("6 Hz") == pytest.approx(2 * np.pi * 6, rel=1e-12)
    assert parse_angular_frequency("0.006 kHz") == pytest.approx(2 * np.pi * 6, rel=1e-12)
    assert parse_angular_frequency("38 rad/s") == 38.0
    with pytest.raises(InputError, match="converts to 'rad/s'"):
        parse_angular_frequency("6 mm")


@given(
    st.sampled_from([("bar", "Pa"), ("mm", "m"), ("rpm", "rad/s"), ("kN", "N"), ("cm2", "m2")]), st.floats(-1e6, 1e6)
)
def test_there_and_back(pair, number):
    """Converting to SI and dividing by the factor gives the number back."""
    unit, si = pair

    assert parse(f"{number!r} {unit}", si) / factor(unit, si) == pytest.approx(number, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("N m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("m3/(Pa s)", {"m": 4, "kg": -1, "s": 1}),
        ("N m s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("m3/(s Pa^0.5)", {"m": 3.5, "kg": -0.5}),
        ("1", {}),
    ],
)
def test_an_si_unit_is_made_of_base_units(unit, exponents):
    """By hand: Pa = kg/(m s2), N = kg m/s2; radians are kept."""
    assert base_units(unit) == pytest.approx(exponents)


def test_a_unit_beside_si_has_no_base_units():
    with pytest.raises(InputError, match="'bar' is not an SI unit; 1 bar is 100000"):
        base_units("bar")


@pytest.mark.parametrize(
    "unit",
    [
        "unbalanced bracket (", "(m", "m)", "m/0", "m/", "/m", "m//s", "m**9**9**9", "m^99", "((m9)^9)^9", "m!", "pi m",
        "__import__('os')", "m.s", "m 3", "10 bar", "m" * 100_000, "(" * 5000 + "m" + ")" * 5000, "m\0", "\udcff", "mu",
        "dB", "degC", "sqrt(Pa)", "lambda: 1", "1e9", "m^1e9", "__class__", "²", "_",
    ],
)  # fmt: skip
def test_what_is_no_unit_is_refused_at_once(unit):
    """No text is evaluated: only names, small exponents, products, quotients and brackets are allowed."""
    with pytest.raises(InputError, match=r"is not known|does not fit") as caught:
        factor(unit, "m")

    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("text", ["1e999 m", "9" * 5000 + " m", "1e308 km", " " * 100_000 + "m", "inf m", "nan m"])
def test_a_number_beyond_any_meaning_is_refused(text):
    """Also if the conversion overflows."""
    with pytest.raises(InputError, match=r"is too large; expected a finite number|is not a quantity"):
        parse(text, "m")


@given(st.text("mNsPa/*^()-.0123 ²°%\u0660_'\"", max_size=70))
@settings(max_examples=300, derandomize=True)
def test_any_text_is_a_unit_or_a_sentence(text):
    """Any text."""
    with suppress(InputError):
        assert np.isfinite(factor(text, "m"))
