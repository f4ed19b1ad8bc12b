"""Units at the edges."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.unit import base_units, factor, parse


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
        ("three mm", "m", "is no quantity"),
        ("3 furlongz", "m", "is not known"),
        ("2 Hz", "rad/s", "1 Hz is 2 pi rad/s"),
        ("2 rad/s", "Hz", "1 Hz is 2 pi rad/s"),
        ("3000 1/min", "rad/s", "does not say of what angle"),
        ("3.7 cm3", "m3/rad", "as in 'rpm' and 'cm3/rev'"),
    ],
)
def test_wrong_text_is_a_sentence(text, expected, says):
    """What can't be read says why."""
    with pytest.raises(InputError, match=says):
        parse(text, expected)


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
    with pytest.raises(InputError, match="'bar' is no SI unit; one of it is 100000"):
        base_units("bar")
