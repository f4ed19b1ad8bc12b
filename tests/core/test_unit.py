"""Units at the edges."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.unit import factor, parse


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
