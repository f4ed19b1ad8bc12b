"""The number types of exported code."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class NumberType:
    """A floating-point type of C.

    Attributes
    ----------
    word: in C. suffix: of its literals. function_suffix: of functions of math. size: bytes.
    """

    word: str
    suffix: str
    function_suffix: str
    size: int

    def literal(self, value: float) -> str:
        """A C literal with every bit of the number in this type; an int stays an int."""
        if isinstance(value, int):
            return str(value)
        with np.errstate(over="ignore"):
            rounded = np.float32(value) if self.size == 4 else np.float64(value)
        if math.isnan(rounded):
            return "NAN"
        if math.isinf(rounded):
            return "INFINITY" if rounded > 0 else "-INFINITY"
        return f"{rounded}{self.suffix}"

    def of(self, word: str) -> str:
        """The word in C for a type of the translator: this type for its double."""
        return self.word if word == "double" else word

    def function(self, name: str) -> str:
        """A function of math for this type: sqrt, or sqrtf for floats."""
        return f"{name}{self.function_suffix}"


DOUBLES = NumberType("double", "", "", 8)
FLOATS = NumberType("float", "F", "f", 4)
#: By the name that a user gives.
FLOATING = {"double": DOUBLES, "float": FLOATS}
