"""Controllers in fixed point: straight C of integers, with a scale for every number."""

from .code import FixedCode, write_fixed
from .scale import Q15, Q31, FixedWord

#: By the name that a user gives.
FIXED = {"q31": Q31, "q15": Q15}

__all__ = ["FIXED", "Q15", "Q31", "FixedCode", "FixedWord", "write_fixed"]
