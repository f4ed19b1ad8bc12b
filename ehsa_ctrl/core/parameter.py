"""A number that knows where it comes from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf, isfinite

from .errors import InputError

#: A value this many times the file's own, or that part of it, is probably meant in another unit.
FAR = 1e3
#: What is smaller, and is not 0, is a mistake that squares could not be computed of.
LEAST = 1e-30

SOURCES = ("datasheet", "identified", "literature", "assumed", "derived")


@dataclass(frozen=True)
class Parameter:
    """A parameter's value in SI units with its provenance.

    Attributes
    ----------
    name: the paper's symbol.
    value: in `unit`.
    unit: SI.
    source: one of SOURCES, or "given" for a value that a user set for one run.
    sd: one standard deviation, None where unknown.
    lower, upper: the range in which the value is believed, not a physical limit.
    note: reference or reason.
    written: the value as it stands in the file, with the unit used there.
    stated: the parameter as the plant's file has it, where another value was set since.
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
    stated: Parameter | None = field(default=None, compare=False, repr=False)

    def given(self, value: float) -> Parameter:
        """The same parameter with a value set for one run; what was known of the old value's error goes with it."""
        return replace(
            self, value=value, source="given", sd=None, written=f"{value:g} {self.unit}", stated=self.stated or self
        )

    @property
    def far(self) -> str:
        """A sentence where a value that was set is more than FAR times the file's, or less than a FAR-th; else empty.

        Zero is how a thing is switched off and on, and says nothing of a unit.
        """
        if self.stated is None or not self.value or not self.stated.value:
            return ""
        ratio = abs(self.value / self.stated.value)
        if 1.0 / FAR <= ratio <= FAR or not isfinite(ratio) or ratio == 0.0:
            return ""
        number, _, own = (self.stated.written or f"{self.stated.value:g} {self.unit}").partition(" ")
        times = f"{ratio:.3g} times" if ratio > 1.0 else f"1/{1.0 / ratio:.3g} of"
        hint = f"; a number without a unit is in {self.unit}, write {self.name}='{self.value:g} {own}' if that is meant"
        return f"{self.name} = {self.value:g} {self.unit} is {times} the file's {number} {own}" + (
            hint if own and own != self.unit else ""
        )


def check_range(where: str, value: float, unit: str, lower: float, upper: float, *, lower_open: bool = False) -> None:
    """Raise InputError unless lower <= value <= upper (lower < value if lower_open) and value is a finite number.

    An infinite bound lets the same infinity pass: it is how "never" is written (a valve that does not open).
    """
    infinite = value in (lower, upper) and not lower_open
    if 0.0 < abs(value) < LEAST:
        raise InputError(f"{where} = {value:g} {unit}: is too small to compute with; expected 0 or {LEAST:g} and more")
    if (isfinite(value) or infinite) and lower <= value <= upper and not (lower_open and value == lower):
        return
    left = f"greater than {lower:g}" if lower_open else f"at least {lower:g}"
    expected = left if lower != -inf else ""
    if upper != inf:
        expected += f"{' and ' if expected else ''}at most {upper:g}"
    raise InputError(
        f"{where} = {value:g} {unit}: must be {expected or 'a finite number'}" + (f" {unit}" if expected else "")
    )
