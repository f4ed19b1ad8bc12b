"""A controller as C99 source: a translator from the small subset of Python in which laws are written.

The subset: arguments and results annotated as float, int, bool, np.ndarray (vectors) or None; variables; entries and
slices of vectors; + - * / and % of floats; comparisons, and, or, not, `a if c else b`; min, max, abs, int, float and
functions of math; if, while, for over range, continue, break, return; unpacking of tuples; calls of such functions,
without recursion. Anything else is an InputError with file, line and function.

The C code does the same operations in the same order, in doubles or floats. In doubles, without contraction and
fast-math, +, -, *, / and sqrt give Python's bits; exp, sin and the like those of libm, which Python calls too. Where
Python raises (for division by zero or the root of a negative number), C continues with inf or nan.

In fixed point (`fixed`) the settings are known: the code has constants for them and a scale for each number.
"""

from .code_check import CodeCheck, SignalCheck, check_code
from .deployment import FILES, Deployment, TestVector, export_controller, replay
from .fixed import FIXED, FixedWord
from .number import FLOATING, NumberType
from .program import Program

#: Numbers of the C by the name that a user gives.
NUMBERS: dict[str, NumberType | FixedWord] = {**FLOATING, **FIXED}

__all__ = [
    "FILES", "FIXED", "FLOATING", "NUMBERS", "CodeCheck", "Deployment", "FixedWord", "NumberType", "Program",
    "SignalCheck", "TestVector", "check_code", "export_controller", "replay",
]  # fmt: skip
