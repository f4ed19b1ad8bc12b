"""What a value of the subset can be, and its C."""

from __future__ import annotations

#: Truth value, whole number, number, vector of numbers.
BOOL, INT, DOUBLE, ARRAY = "bool", "int", "double", "array"
#: Annotations of arguments and results -> kind; None: nothing is returned.
ANNOTATIONS: dict[str, str | None] = {"float": DOUBLE, "int": INT, "bool": BOOL, "np.ndarray": ARRAY, "None": None}


def join(a: str, b: str) -> str | None:
    """The kind of a variable that is once this and once that; None if there is none."""
    if a == b:
        return a
    return DOUBLE if {a, b} == {INT, DOUBLE} else None


KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""
TAKEN = """
    abs acos asin atan atan2 bool ceil copysign cos cosh ehsa_reset ehsa_step ehsa_solver exp fabs false floor fmod
    hypot isfinite isinf isnan larger larger_int log log10 main memcpy memmove pow remainder_of round sin
    settings_of_all sinh smaller smaller_int solve_qp sqrt tan tanh true trunc INFINITY NAN NULL
"""
#: Words that C, its headers or our frame claim; a name of Python's gets an underscore behind.
CLAIMED = frozenset(KEYWORDS.split() + TAKEN.split())


def c_name(name: str) -> str:
    """A name of Python's as C takes it; what begins with an underscore is the compiler's own there."""
    return f"{name.lstrip('_')}_" if name in CLAIMED or name.startswith("_") else name


def literal(value: float) -> str:
    """A number as C reads it back to the last bit."""
    if isinstance(value, int):
        return str(value)
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))
