"""Numbers and units as a reader sees them."""

import math

import pytest

from ehsa_ctrl.report.text import NOTHING, number, quantity, uncertain, unit


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (45678.0, "45680"),
        (0.123449, "0.1234"),
        (1.5, "1.5"),
        (-0.0, "0"),
        (0, "0"),
        (99999.9, "100000"),
        (1.4e9, "1.4e9"),
        (-4.13e-13, "-4.13e-13"),
        (0.00012345, "0.0001234"),
        (math.nan, NOTHING),
        (math.inf, "∞"),
        (-math.inf, "-∞"),
    ],
)
def test_four_significant_digits(value, text):
    """Numbers of ordinary size have no exponent, none has more than four digits, none is missing."""
    assert number(value) == text


@pytest.mark.parametrize(
    ("plain", "typeset"),
    [
        ("m3/(Pa s)", "m³/(Pa s)"),
        ("um", "µm"),
        ("1", ""),
        ("mm s2", "mm s²"),
        ("1/A", "1/A"),
        ("rpm", "rpm"),
        ("%", "%"),
    ],
)
def test_units_are_typeset(plain, typeset):
    """Exponents are raised, micro is a Greek letter, no unit is nothing."""
    assert unit(plain) == typeset


def test_a_quantity_without_unit_is_a_bare_number():
    """No blank follows a number that has no unit."""
    assert quantity(2.0, "1") == "2"
    assert quantity(0.0121, "m") == "0.0121 m"


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (853.03, 1.1, "853.0 ± 1.1"),
        (-3.1745, 0.1, "-3.17 ± 0.10"),
        (4.0958e-13, 6.9e-15, "(4.096 ± 0.069)e-13"),
        (0.0020576, 1.8e-6, "(2.0576 ± 0.0018)e-3"),
        (11942.0, 340.0, "(1.194 ± 0.034)e4"),
        (0.0, 1e-5, "(0.0 ± 1.0)e-5"),
        (2.0, 31.0, "2 ± 31"),
        (1.5, math.inf, "1.5"),
        (1.5, 0.0, "1.5"),
        (math.nan, 1.0, NOTHING),
    ],
)
def test_a_value_is_written_to_the_second_digit_of_its_deviation(value, sd, text):
    """No digit that means nothing, none left out that does; very small and large ones with a common exponent."""
    assert uncertain(value, sd) == text
