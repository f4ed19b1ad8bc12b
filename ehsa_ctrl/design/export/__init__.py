"""A controller as C99 source: a translator from the small subset of Python in which laws are written.

The subset: arguments and results annotated as float, int, bool, np.ndarray (vectors) or None; variables; vectors'
entries and slices; + - * / and % of floats; comparisons, and, or, not, `a if c else b`; min, max, abs, int, float and
functions of math; if, while, for over range, continue, break, return; tuples unpacked; calls of functions of the same
kind that don't call themselves. Anything else is an InputError with file, line and function.

The C does the same operations in the same order. Compiled without contraction and fast-math, in doubles, +, -, *, /
and sqrt give Python's bits; exp, sin and the others those of the machine's libm, which Python calls too. Where Python
would raise (a division by zero, a root of a negative number) C goes on with inf or nan.
"""

from .deployment import FILES, Deployment, TestVector, export_controller, replay
from .program import Program

__all__ = ["FILES", "Deployment", "Program", "TestVector", "export_controller", "replay"]
