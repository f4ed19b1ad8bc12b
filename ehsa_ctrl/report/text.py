"""Numbers and units as text: four significant digits, units with superscript exponents."""

from __future__ import annotations

import math
import re

from ..core.unit import factor

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Shown instead of nan, such as the settling time of a step that never settles.
NOTHING = "–"


def number(value: float) -> str:
    """A number with four significant digits; nan becomes a dash, infinity its symbol.

    Numbers from 1e-4 to 1e6 have no exponent: 45678 becomes "45680", 4.13e-13 becomes "4.13e-13".
    """
    if math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    rounded = float(f"{value:.4g}")
    if rounded == 0:
        return "0"
    if 1e-4 <= abs(rounded) < 1e6:
        return f"{rounded:.10g}"
    mantissa, exponent = f"{rounded:.3e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


def uncertain(value: float, sd: float) -> str:
    """A value rounded to the second digit of its standard deviation: "853.0 ± 1.1", "(4.096 ± 0.069)e-13".

    Only the value if the standard deviation is infinite, nan or not positive.
    """
    if not (math.isfinite(value) and math.isfinite(sd) and sd > 0.0):
        return number(value)
    power = math.floor(math.log10(max(abs(value), sd)))
    power = power if power < -2 or power >= 6 or sd >= 99.5 else 0
    scale = 10.0**power
    decimals = max(1 - math.floor(math.log10(sd / scale)), 0)
    both = f"{value / scale:.{decimals}f} ± {sd / scale:.{decimals}f}"
    return f"({both})e{power}" if power else both


def unit(text: str) -> str:
    """A unit as it is typeset: "m3/(Pa s)" becomes "m³/(Pa s)", "um" becomes "µm" and "1" an empty text."""
    if text == "1":
        return ""
    micro = re.sub(r"\bu(?=[a-zA-Z])", "µ", text)
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda match: match[0].translate(SUPERSCRIPTS), micro)


def quantity(value: float, unit_text: str) -> str:
    """A number with its unit: quantity(0.0121, "m") is "0.0121 m"."""
    return f"{number(value)} {unit(unit_text)}".rstrip()


def value_text(value: float | None, scale: float = 1.0, digits: int = 4) -> str:
    """A number from JSON divided by `scale`; None, which stands for nan and infinity in JSON, becomes a dash."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return number(float(f"{value / scale:.{digits}g}"))


def percent(share: float | None, digits: int = 3) -> str:
    """A ratio in percent: percent(0.123) is "12.3 %"; a dash for None or nan."""
    text = value_text(share, 0.01, digits)
    return text if text == NOTHING else f"{text} %"


def quantity_in(value: float, unit_shown: str, unit_si: str) -> str:
    """An SI value in another unit: quantity_in(1.2e9, "GPa", "Pa") is "1.2 GPa"."""
    return quantity(value / factor(unit_shown, unit_si), unit_shown)


def as_sentence(words: str) -> str:
    """Text with an initial capital and a final full stop; the rest is unchanged.

    A parameter that it begins with keeps its symbol ("kappa = 3 lies ...").
    """
    first = words[:1] if re.match(r"\w+ = ", words) else words[:1].upper()
    return f"{first}{words[1:].rstrip('.')}."
