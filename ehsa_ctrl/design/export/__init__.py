"""A controller as C99 source: a translator from the small subset of Python in which laws are written.

The subset: arguments and results annotated as float, int, bool, np.ndarray (vectors) or None; variables; entries and
slices of vectors; + - * / and % of floats; comparisons, and, or, not, `a if c else b`; min, max, abs, int, float and
functions of math; if, while, for over range, continue, break, return; unpacking of tuples; calls of such functions,
without recursion. Anything else is an InputError with file, line and function.

The C code does the same operations in the same order, in doubles or floats. In doubles, without contraction and
fast-math, +, -, *, / and sqrt give Python's bits; exp, sin and the like those of libm, which Python calls too. Where
Python raises (for division by zero or the root of a negative number), C continues with inf or nan.
"""

from .code_check import CodeCheck, check_code
from .deployment import FILES, Deployment, TestVector, export_controller, replay
from .number import NUMBERS, NumberType
from .program import Program

__all__ = [
    "FILES", "NUMBERS", "CodeCheck", "Deployment", "NumberType", "Program", "TestVector", "check_code",
    "export_controller", "replay",
]  # fmt: skip
