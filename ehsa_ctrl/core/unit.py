"""Units of the user: a text such as "3.7 cm3/rev" becomes a number in SI units.

pint supplies the units and the arithmetic. The grammar is this module's: names, small exponents, products, quotients
and brackets, as in a data sheet (m3, kg m2, Nm/A); pint's parser would evaluate any expression. Hz is not accepted for
rad/s, although both are 1/s to pint.
"""

from __future__ import annotations

import math
import re
from contextlib import suppress
from functools import cache, lru_cache
from typing import Any

import numpy as np

from .errors import InputError, shown

#: SI units in which data sheets often omit the angle, and pint's names of angles.
PER_ANGLE, ANGLES = ("rad/s", "m3/rad"), ("radian", "turn", "degree", "rev", "arc")
#: Products written as one word; to pint Nm is a count of textile yarn.
JOINED = {"Nm": "N m", "Nmm": "N mm", "Nms": "N m s", "Ns": "N s", "As": "A s", "Vs": "V s", "Ws": "W s", "Pas": "Pa s"}
#: Dimensionless units; others of pint, such as pi, are refused.
NUMBERS = ("percent", "permille", "ppm", "fraction", "count")
#: Longest text of a unit, and largest exponent.
LONGEST, LARGEST = 60, 9

_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_EXPONENT = r"-?\d(?:\.\d{1,3})?"
#: An exponent follows a letter at once, or a sign: in "m 3" the 3 would be a number.
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
    """Name -> exponent in the text of a unit. Raises ValueError for a text that is no unit."""
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
    """Factors up to the end or a closing bracket, from left to right, and the remaining tokens."""
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
        # Degrees Celsius and decibels have an offset, so they are no factor.
        if (0.0 * found).to_base_units().magnitude != 0.0:
            raise ValueError("no factor")
        return found
    except (pint.errors.PintError, ValueError, OverflowError) as error:
        raise InputError(
            f"unit {shown(unit)} is not known; write it as in 'kg m2', 'N s/m', 'bar', 'cm3/rev'"
        ) from error


@cache
def factor(unit: str, expected: str) -> float:
    """`expected` (an SI unit) in one `unit`.

    Raises InputError for an unknown unit, for one of another dimension, for Hz instead of rad/s, and for a speed or a
    displacement without angle, unless it is SI: 1/min usually means revolutions.
    """
    got, wanted = _quantity(unit), _quantity(expected)
    if not got.is_compatible_with(wanted) or ("Hz" in unit) != ("Hz" in expected):
        hint = "; 1 Hz is 2 pi rad/s" if "Hz" in unit or "Hz" in expected else ""
        raise InputError(f"unit {shown(unit)} does not fit: expected one that converts to {expected!r}{hint}")
    found = float(got.to(wanted).magnitude)
    if found != 1.0 and expected in PER_ANGLE and not names_angle(unit):
        raise InputError(
            f"unit {shown(unit)} does not say of what angle, where {expected!r} is meant; write rev, as in 'rpm' and "
            "'cm3/rev', or rad"
        )
    return found


def names_angle(unit: str) -> bool:
    """Whether a unit contains an angle: rpm and rad/s do, 1/min does not. Raises InputError for an unknown unit."""
    return any(word in str(_quantity(unit).units) for word in ANGLES)


#: SI base units by pint's names; radians are added because pint treats them as a number.
_BASES = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd"}


@cache
def base_units(unit: str) -> dict[str, float]:
    """Exponents of the SI base units that an SI unit is made of, rad among them: "N m/rad" is kg 1, m 2, s -2, rad -1.

    Raises InputError for an unknown unit and for one that is not SI, as bar.
    """
    quantity = _quantity(unit)
    based = quantity.to_base_units()
    if abs(float(based.magnitude) - 1.0) > 1e-12:
        raise InputError(f"unit {shown(unit)} is no SI unit; one of it is {based:~}")
    found = {_BASES[name]: float(power) for name, power in based.unit_items() if name in _BASES}
    radians = dict(quantity.unit_items()).get("radian", 0)
    return found | ({"rad": float(radians)} if radians else {})


def parse(text: str, expected: str) -> float:
    """Turn "20 mm" into 0.02 for expected "m". A bare number is taken only where nothing has a unit ("1").

    Raises InputError, in one sentence, for text without number, without unit, with a unit that does not fit, or with a
    number too large for a computer.
    """
    match = re.match(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", text.strip())
    if match is None:
        raise InputError(f"{shown(text)} is no quantity; write a number and a unit, such as '3 {expected}'")
    unit = text.strip()[match.end() :].strip()
    if not unit and expected not in ("1", "fraction"):
        raise InputError(f"{shown(text)} has no unit; write it as in '{shown(match[0])[1:-1]} {expected}'")
    value = float(match[0]) * factor(unit or "1", expected)
    if not math.isfinite(value):
        raise InputError(f"{shown(text)} is too large; expected a finite number")
    return value


def read_value(given: str | float, unit: str) -> float:
    """A number in SI units, or a text with its unit or without. Raises InputError for anything else."""
    if isinstance(given, str):
        try:
            return float(given)
        except ValueError:
            return parse(given, unit)
    if isinstance(given, int | float | np.number) and not isinstance(given, bool | np.complexfloating):
        with suppress(OverflowError):
            return float(given)
    raise InputError(f"is {shown(given)}; expected a number in {unit}, or a text with its unit, as '3 {unit}'")
