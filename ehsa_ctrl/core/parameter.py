"""A number that knows where it comes from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite

from .errors import InputError

SOURCES = ("datasheet", "identified", "literature", "assumed", "derived")


@dataclass(frozen=True)
class Parameter:
    """A parameter's value in SI units with its provenance.

    Attributes
    ----------
    name: the paper's letter.
    value: in `unit`.
    unit: SI.
    source: one of SOURCES, or "given" for a value that a user set for one run.
    sd: one standard deviation, None where unknown.
    lower, upper: the range in which the value is believed, not a physical limit.
    note: reference or reason.
    written: the value as it stands in the file, with the unit used there.
    """

    name: str
    value: float
    unit: str
    source: str
    sd: float | None = None
    lower: float = -inf
    upper: float = inf
    note: str = ""
    written: str = ""

    def given(self, value: float) -> Parameter:
        """The same parameter with a value set for one run; what was known of the old value's error goes with it."""
        return replace(self, value=value, source="given", sd=None, written=f"{value:g} {self.unit}")


def check_range(where: str, value: float, unit: str, lower: float, upper: float, *, lower_open: bool = False) -> None:
    """Raise InputError unless lower <= value <= upper (lower < value if lower_open) and value is a finite number.

    An infinite bound lets the same infinity pass: it is how "never" is written (a valve that does not open).
    """
    infinite = value in (lower, upper) and not lower_open
    if (isfinite(value) or infinite) and lower <= value <= upper and not (lower_open and value == lower):
        return
    left = f"greater than {lower:g}" if lower_open else f"at least {lower:g}"
    expected = left if lower != -inf else ""
    if upper != inf:
        expected += f"{' and ' if expected else ''}at most {upper:g}"
    raise InputError(
        f"{where} = {value:g} {unit}: must be {expected or 'a finite number'}" + (f" {unit}" if expected else "")
    )
