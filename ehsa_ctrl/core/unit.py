"""Units at the edges: text such as "3.7 cm3/rev" becomes a plain SI number inside.

pint does the arithmetic. Two things are ours: exponents may be written as in a data sheet (m3, kg m2), and Hz never
passes for rad/s, which pint would allow because both are 1/s to it.
"""

from __future__ import annotations

import re
from functools import cache, lru_cache
from typing import Any

from .errors import InputError

#: SI units whose angle data sheets leave out at times, and what names an angle in pint's words.
PER_ANGLE, ANGLES = ("rad/s", "m3/rad"), ("radian", "turn", "degree", "rev", "arc")


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(autoconvert_offset_to_baseunit=False)
    registry.define("rev = turn")
    registry.define("fraction = 1")
    return registry


@cache
def _quantity(unit: str) -> Any:
    """One of this unit, as pint sees it."""
    import pint

    text = re.sub(r"(?<=[A-Za-z])(\d)", r"**\1", unit)
    try:
        return _registry().Quantity(1.0, text)
    except (pint.errors.PintError, AttributeError, TypeError, SyntaxError, ValueError) as error:
        raise InputError(f"unit {unit!r} is not known; write it as in 'kg m2', 'N s/m', 'bar', 'cm3/rev'") from error


@cache
def factor(unit: str, expected: str) -> float:
    """How many `expected` (an SI unit) are one `unit`.

    Raises InputError for an unknown unit, for one of another dimension, for Hz where rad/s is meant, and for a speed or
    a displacement without an angle, unless it is SI: 1/min may be revolutions, and mostly is.
    """
    got, wanted = _quantity(unit), _quantity(expected)
    if not got.is_compatible_with(wanted) or ("Hz" in unit) != ("Hz" in expected):
        hint = "; 1 Hz is 2 pi rad/s" if "Hz" in unit or "Hz" in expected else ""
        raise InputError(f"unit {unit!r} does not fit: expected one that converts to {expected!r}{hint}")
    found = float(got.to(wanted).magnitude)
    if found != 1.0 and expected in PER_ANGLE and not names_angle(unit):
        raise InputError(
            f"unit {unit!r} does not say of what angle, where {expected!r} is meant; write rev, as in 'rpm' and "
            "'cm3/rev', or rad"
        )
    return found


def names_angle(unit: str) -> bool:
    """Whether a unit says of what angle it is: rpm and rad/s do, 1/min does not. Raises InputError if it is unknown."""
    return any(word in str(_quantity(unit).units) for word in ANGLES)


#: SI base units by pint's names, and radians, which pint takes for a mere number.
_BASES = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd"}


@cache
def base_units(unit: str) -> dict[str, float]:
    """Exponents of the SI base units that an SI unit is made of, rad among them: "N m/rad" is kg 1, m 2, s -2, rad -1.

    Raises InputError for an unknown unit and for one that is not SI, as bar.
    """
    quantity = _quantity(unit)
    based = quantity.to_base_units()
    if abs(float(based.magnitude) - 1.0) > 1e-12:
        raise InputError(f"unit {unit!r} is no SI unit; one of it is {based:~}")
    found = {_BASES[name]: float(power) for name, power in based.unit_items() if name in _BASES}
    radians = dict(quantity.unit_items()).get("radian", 0)
    return found | ({"rad": float(radians)} if radians else {})


def parse(text: str, expected: str) -> float:
    """Turn "20 mm" into 0.02 for expected "m". A bare number is taken only where nothing has a unit ("1").

    Raises InputError, in one sentence, for text without number, without unit or with a unit that does not fit.
    """
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    if match is None:
        raise InputError(f"{text!r} is no quantity; write a number and a unit, such as '3 {expected}'")
    number, unit = float(match[1]), match[2]
    if not unit and expected not in ("1", "fraction"):
        raise InputError(f"{text!r} has no unit; write it as in '{match[1]} {expected}'")
    return number * factor(unit or "1", expected)
