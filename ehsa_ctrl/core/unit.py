"""Convert quantities such as "3.7 cm3/rev" to SI units.

pint supplies the units and the arithmetic. The grammar is defined here: names, small exponents, products, quotients
and brackets, as in a data sheet (m3, kg m2, Nm/A). pint's own parser would evaluate any expression. Hz is not accepted
for rad/s, although pint treats both as 1/s.
"""

from __future__ import annotations

import math
import re
from contextlib import suppress
from functools import cache, lru_cache
from typing import Any

import numpy as np

from .errors import InputError, shown

#: SI units from which data sheets often omit the angle, and pint's names of angles.
PER_ANGLE, ANGLES = ("rad/s", "m3/rad"), ("radian", "turn", "degree", "rev", "arc")
#: Products written as one word. pint would read Nm as the metric number of a yarn.
JOINED = {"Nm": "N m", "Nmm": "N mm", "Nms": "N m s", "Ns": "N s", "As": "A s", "Vs": "V s", "Ws": "W s", "Pas": "Pa s"}
#: Accepted dimensionless units; others that pint knows, such as pi, are rejected.
NUMBERS = ("percent", "permille", "ppm", "fraction", "count")
#: Longest text of a unit, and largest exponent. Engineering judgement: no unit of this field comes near them.
LONGEST, LARGEST = 60, 9

_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_EXPONENT = r"-?\d(?:\.\d{1,3})?"
#: An exponent follows a letter directly, or ^ or **; the 3 in "m 3" is rejected as a number.
_TOKEN = re.compile(
    rf"(?:(?P<name>°?[^\W\d]+|[%‰°])|(?P<one>1)(?![\d.])|(?P<sign>\*(?!\*)|[/()·⋅])"
    rf"|(?:(?<=[^\W\d])|(?:\^|\*\*)\s*)(?:(?P<power>{_EXPONENT})(?![\d.])|\((?P<braced>{_EXPONENT})\)))\s*"
)


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(autoconvert_offset_to_baseunit=False, on_redefinition="ignore")
    registry.define("rev = turn")
    registry.define("fraction = 1")
    registry.define("lpm = liter / minute")
    registry.define("@alias degree = °")
    for word, product in JOINED.items():
        registry.define(f"{word}_joined = {product.replace(' ', ' * ')} = {word}")
    return registry


def _factors(unit: str) -> dict[str, float]:
    """Parse a unit: name -> exponent. Raises ValueError for a text that is not a unit."""
    text = unit.strip().translate(_RAISED)
    if len(text) > LONGEST:
        raise ValueError("too long")
    tokens: list[tuple[str, str]] = []
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ValueError(text[at])
        kind = str(match.lastgroup)
        tokens.append(("power" if kind == "braced" else kind, match[kind]))
        at = match.end()
    found, rest = _product(tokens)
    if rest or any(abs(power) > LARGEST for power in found.values()):
        raise ValueError(text)
    return found


def _product(tokens: list[tuple[str, str]]) -> tuple[dict[str, float], list[tuple[str, str]]]:
    """Parse a product up to its end or a closing bracket; returns name -> exponent, and the remaining tokens."""
    found: dict[str, float] = {}
    sign = 1.0
    while True:
        (kind, word), *tokens = tokens or [("end", "")]
        if (kind, word) == ("sign", "("):
            part, tokens = _product(tokens)
            if not tokens or tokens.pop(0) != ("sign", ")"):
                raise ValueError("unbalanced bracket")
        elif kind in ("name", "one"):
            part = {word: 1.0} if kind == "name" else {}
        else:
            raise ValueError(word)
        if tokens and tokens[0][0] == "power":
            power = float(tokens.pop(0)[1])
            part = {name: power * one for name, one in part.items()}
        for name, one in part.items():
            found[name] = found.get(name, 0.0) + sign * one
        if not tokens or tokens[0] == ("sign", ")"):
            return found, tokens
        sign = -1.0 if tokens[0] == ("sign", "/") else 1.0
        if tokens[0][0] == "sign" and tokens[0][1] != "(":
            tokens = tokens[1:]


@cache
def _quantity(unit: str) -> Any:
    """One of this unit as a pint quantity."""
    import pint

    registry = _registry()
    try:
        found = registry.Quantity(1.0, "")
        for name, power in (_factors(unit) if unit else {}).items():
            known = registry.get_name(name)
            if known not in NUMBERS and registry.Quantity(1.0, known).to_root_units().unitless:
                raise ValueError(f"{name} is a number")
            found = found * registry.Quantity(1.0, known) ** power
        # Degrees Celsius and decibels do not convert by a factor alone.
        if (0.0 * found).to_base_units().magnitude != 0.0:
            raise ValueError("no factor")
        return found
    except (pint.errors.PintError, ValueError, OverflowError) as error:
        raise InputError(
            f"unit {shown(unit)} is not known; write it as in 'kg m2', 'N s/m', 'bar', 'cm3/rev'"
        ) from error


def unit_suffix(unit: str) -> str:
    """A unit as it follows a number in text; empty for a number without one ("1")."""
    return "" if unit in ("", "1") else f" {unit}"


@cache
def factor(unit: str, expected: str) -> float:
    """Size of one `unit` in the SI unit `expected`.

    Raises InputError for an unknown unit, another dimension, Hz instead of rad/s, and for a speed or displacement
    without an angle, unless it is SI: 1/min usually means revolutions.
    """
    got, wanted = _quantity(unit), _quantity(expected)
    if not got.is_compatible_with(wanted) or ("Hz" in unit) != ("Hz" in expected):
        hint = "; 1 Hz is 2 pi rad/s" if "Hz" in unit or "Hz" in expected else ""
        raise InputError(f"unit {shown(unit)} does not fit: expected one that converts to {expected!r}{hint}")
    found = float(got.to(wanted).magnitude)
    if found != 1.0 and expected in PER_ANGLE and not names_angle(unit):
        raise InputError(
            f"unit {shown(unit)} has no angle, but {expected!r} is expected; write rev, as in 'rpm' and 'cm3/rev', "
            "or rad"
        )
    return found


def names_angle(unit: str) -> bool:
    """Whether a unit contains an angle: rpm and rad/s do, 1/min does not. Raises InputError for an unknown unit."""
    return any(word in str(_quantity(unit).units) for word in ANGLES)


#: SI base units by pint's names; radians are added because pint treats them as a number.
_BASES = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd"}


@cache
def base_units(unit: str) -> dict[str, float]:
    """Exponents of the SI base units, including rad, of an SI unit: "N m/rad" is kg 1, m 2, s -2, rad -1.

    Raises InputError for an unknown unit, and for one that is not SI, such as bar.
    """
    quantity = _quantity(unit)
    based = quantity.to_base_units()
    if abs(float(based.magnitude) - 1.0) > 1e-12:
        raise InputError(f"unit {shown(unit)} is not an SI unit; 1 {unit} is {based:~}")
    found = {_BASES[name]: float(power) for name, power in based.unit_items() if name in _BASES}
    radians = dict(quantity.unit_items()).get("radian", 0)
    return found | ({"rad": float(radians)} if radians else {})


def parse(text: str, expected: str) -> float:
    """Turn "20 mm" into 0.02 for expected "m". A bare number is accepted only for a dimensionless quantity ("1").

    Raises InputError for a text without a number or a unit, a unit of another dimension, or an infinite number.
    """
    match = re.match(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", text.strip())
    if match is None:
        raise InputError(f"{shown(text)} is not a quantity; write a number and a unit, such as '3 {expected}'")
    unit = text.strip()[match.end() :].strip()
    if not unit and expected not in ("1", "fraction"):
        raise InputError(f"{shown(text)} has no unit; write it as in '{shown(match[0])[1:-1]} {expected}'")
    value = float(match[0]) * factor(unit or "1", expected)
    if not math.isfinite(value):
        raise InputError(f"{shown(text)} is too large; expected a finite number")
    return value


def parse_angular_frequency(text: str) -> float:
    """Turn "6 Hz" or "38 rad/s" into rad/s. A frequency in Hz is one of a sine, so that 1 Hz is 2 pi rad/s; a speed of
    rotation is read by `parse`, which refuses Hz.

    Raises InputError as `parse` does.
    """
    with suppress(InputError):
        return 2.0 * math.pi * parse(text, "Hz")
    return parse(text, "rad/s")


def read_value(given: str | float, unit: str) -> float:
    """Read a number in SI units, or a text with or without a unit. Raises InputError for anything else."""
    if isinstance(given, str):
        try:
            return float(given)
        except ValueError:
            return parse(given, unit)
    if isinstance(given, int | float | np.number) and not isinstance(given, bool | np.complexfloating):
        with suppress(OverflowError):
            return float(given)
    raise InputError(f"is {shown(given)}; expected a number in {unit}, or a text with a unit, as '3 {unit}'")
