"""Numbers and units as a reader sees them: four significant digits, units with raised exponents."""

from __future__ import annotations

import math
import re

from ..core.unit import factor

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Shown for a number that does not exist: a step that never settled, a hunting that did not happen.
NOTHING = "–"


def number(value: float) -> str:
    """A number with four significant digits; nan as a dash, infinity as its sign.

    Between 1e-4 and 1e6 all digits are written out, beyond that with an exponent: 45678 becomes 45680, 4.13e-13 stays.
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
    """A value to the second digit of its standard deviation: "853.0 ± 1.1", "(4.096 ± 0.069)e-13".

    The value alone where the standard deviation is infinite, zero or none.
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
    """A unit as it is typeset: "m3/(Pa s)" becomes "m³/(Pa s)", "um" becomes "µm", and "1" nothing."""
    if text == "1":
        return ""
    micro = re.sub(r"\bu(?=[a-zA-Z])", "µ", text)
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda match: match[0].translate(RAISED), micro)


def quantity(value: float, of: str) -> str:
    """A number with its unit: quantity(0.0121, "m") is "0.0121 m"."""
    return f"{number(value)} {unit(of)}".rstrip()


def value_text(value: float | None, scale: float = 1.0, digits: int = 4) -> str:
    """A number of a result's JSON, in units of `scale`; None (nan or infinity in JSON) is a dash."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return number(float(f"{value / scale:.{digits}g}"))


def percent(share: float | None, digits: int = 3) -> str:
    """A share in percent; a dash for None or nan."""
    text = value_text(share, 0.01, digits)
    return text if text == NOTHING else f"{text} %"


def quantity_in(value: float, unit_shown: str, unit_si: str) -> str:
    """An SI value in another unit: quantity_in(1.2e9, "GPa", "Pa") is "1.2 GPa"."""
    return quantity(value / factor(unit_shown, unit_si), unit_shown)


def as_sentence(words: str) -> str:
    """Words with a capital letter and a full stop; symbols within stay as they are."""
    return f"{words[:1].upper()}{words[1:].rstrip('.')}."
