"""Parameters: values in SI units, with their provenance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf, isfinite

from .errors import InputError
from .unit import unit_suffix

#: A value that differs from the file's by more than this factor is probably in another unit. Engineering judgement:
#: mm, kN and g are off by 1e3.
FAR = 1e3
#: Smallest magnitude besides 0, as in `core.definition`.
LEAST = 1e-30
#: Largest magnitude of a finite bound, as in `core.definition`.
MOST = 1e30

SOURCES = ("datasheet", "identified", "literature", "assumed", "derived")


@dataclass(frozen=True)
class Parameter:
    """A parameter's value in SI units, with its provenance.

    Attributes
    ----------
    name: the paper's symbol.
    value: in `unit`.
    unit: SI.
    source: one of SOURCES, or "given" for a value that a user set for one run.
    sd: standard deviation in `unit`, None if unknown.
    spread: standard deviation between units of the same make in `unit`, None if unknown; a diagnosis takes it for the
        prior deviation of a single unit.
    lower, upper: range of plausible values, not physical limits.
    note: reference or reason.
    written: value and unit as in the file.
    stated: the parameter in the plant's file, if another value was set since.
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
    spread: float | None = None
    stated: Parameter | None = field(default=None, compare=False, repr=False)

    @property
    def text(self) -> str:
        """Value and unit as in the plant's file, or in SI units."""
        return self.written or f"{self.value:g}{unit_suffix(self.unit)}"

    @property
    def file_unit(self) -> str:
        """The unit used in the plant's file."""
        return self.written.partition(" ")[2] or self.unit

    def given(self, value: float) -> Parameter:
        """The parameter with a value set for one run. The standard deviation, that of the old value, is dropped."""
        return replace(
            self,
            value=value,
            source="given",
            sd=None,
            written=f"{value:g}{unit_suffix(self.unit)}",
            stated=self.stated or self,
        )

    @property
    def far(self) -> str:
        """A message if the value that was set differs from the file's by more than a factor of FAR; else empty.

        Values of zero are ignored: they switch something on or off.
        """
        if self.stated is None or not self.value or not self.stated.value:
            return ""
        ratio = abs(self.value / self.stated.value)
        if 1.0 / FAR <= ratio <= FAR or not isfinite(ratio) or ratio == 0.0:
            return ""
        own = self.stated.text.partition(" ")[2]
        times = f"{ratio:.3g} times" if ratio > 1.0 else f"1/{1.0 / ratio:.3g} of"
        hint = (
            f"; a number without a unit is in {self.unit}; if {own} is meant, write {self.name}='{self.value:g} {own}'"
        )
        told = f"{self.name} = {self.value:g}{unit_suffix(self.unit)} is {times} the file's {self.stated.text}"
        return told + (hint if own and own != self.unit else "")


def check_range(where: str, value: float, unit: str, lower: float, upper: float, *, lower_open: bool = False) -> None:
    """Raise InputError unless value is finite and lower <= value <= upper (lower < value if lower_open).

    An infinite bound allows infinity: a valve that never opens has an infinite cracking pressure.
    """
    infinite = value in (lower, upper) and not lower_open
    if 0.0 < abs(value) < LEAST:
        raise InputError(f"{where} = {value:g} {unit}: is too small; expected 0, or at least {LEAST:g}")
    if (isfinite(value) or infinite) and lower <= value <= upper and not (lower_open and value == lower):
        return
    # A bound of MOST stands for none; the message names it only if the value exceeds it.
    left = f"greater than {lower:g}" if lower_open else f"at least {lower:g}"
    expected = left if lower > -MOST or value < lower != -inf else ""
    if upper < MOST or value > upper != inf:
        expected += f"{' and ' if expected else ''}at most {upper:g}"
    raise InputError(
        f"{where} = {value:g} {unit}: must be {expected or 'a finite number'}" + (f" {unit}" if expected else "")
    )
