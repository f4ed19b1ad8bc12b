"""Functions of integers that fixed-point code calls, as C for a word."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from .scale import FixedWord

#: Function -> those that it calls.
CALLS = {
    "saturated": (), "raised": (), "rounded": (), "magnitude": (), "smaller": (), "larger": (), "remainder_of": (),
    "quotient": (), "root": (), "polynomial": (), "power_of_two": ("polynomial",), "sine": ("polynomial",),
}  # fmt: skip
#: Bits of a word -> degrees of the polynomials for 2^x and for sin, whose errors are below the last bit.
DEGREES = {32: (8, 5), 16: (4, 3)}

TEXTS = {
    "saturated": """\
/* A number as a stored word; the smallest of its type means a lost reading. */
static {word} saturated({wide} x)
{{
    if (x > {most}) {{
        return {most};
    }}
    return ({word})(x < -{most} ? -{most} : x);
}}""",
    "raised": """\
/* x 2^shift as a stored word. */
static {word} raised({wide} x, int shift)
{{
    const {wide} most = {literal}({most}) >> shift;
    if (x > most) {{
        return {most};
    }}
    if (x < -most) {{
        return -{most};
    }}
    return ({word})(x * ({literal}(1) << shift));
}}""",
    "rounded": """\
/* x 2^-shift, to the nearest. A right shift keeps the sign on every target that is known (see the check above). */
static {wide} rounded({wide} x, int shift)
{{
    return ((x >> (shift - 1)) + 1) >> 1;
}}""",
    "magnitude": "static {wide} magnitude({wide} x)\n{{\n    return x < 0 ? -x : x;\n}}",
    "smaller": "static {wide} smaller({wide} a, {wide} b)\n{{\n    return b < a ? b : a;\n}}",
    "larger": "static {wide} larger({wide} a, {wide} b)\n{{\n    return b > a ? b : a;\n}}",
    "remainder_of": """\
/* a - b floor(a / b). */
static {wide} remainder_of({wide} a, {wide} b)
{{
    const {wide} rest = a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}}""",
    "quotient": """\
/* a / b, with {shift} more binary places than those of a less those of b. */
static {wide} quotient({word} a, {word} b)
{{
    const {wide} raised_a = ({wide})a * ({literal}(1) << {shift});
    if (b == 0) {{
        return a < 0 ? -({literal}(1) << {room}) : ({literal}(1) << {room});
    }}
    return raised_a / b;
}}""",
    "root": """\
/* Square root, rounded down; 0 of a negative number. */
static {wide} root({wide} x)
{{
    {wide} rest = x, found = 0;
    for ({wide} bit = {literal}(1) << {room}; bit > 0; bit >>= 2) {{
        if (rest >= found + bit) {{
            rest -= found + bit;
            found = (found >> 1) + bit;
        }} else {{
            found >>= 1;
        }}
    }}
    return x > 0 ? found : 0;
}}""",
    "polynomial": """\
/* c[0] + c[1] x + ..., all with {places} binary places. */
static {wide} polynomial(const {word} c[], int degree, {wide} x)
{{
    {wide} sum = c[degree];
    for (int i = degree - 1; i >= 0; i--) {{
        sum = c[i] + ((sum * x) >> {places});
    }}
    return sum;
}}""",
    "power_of_two": """\
/* 2^x of x <= 0 with `fraction` binary places, at most {places}; {places} binary places. */
static {word} power_of_two({wide} x, int fraction)
{{
    static const {word} c[] = {{ {powers} }};
    const {wide} whole = x >> fraction;
    const {wide} rest = (x - whole * ({literal}(1) << fraction)) * ({literal}(1) << ({places} - fraction));
    if (whole < -{places}) {{
        return 0;
    }}
    return ({word})(polynomial(c, {powers_degree}, rest) >> -whole);
}}""",
    "sine": """\
/* sin(2 pi x), x and the result with {places} binary places. */
static {word} sine({wide} x)
{{
    static const {word} c[] = {{ {sines} }};
    const {wide} quarter = {literal}(1) << ({places} - 2);
    /* From -1/4 to 3/4 of a turn; the second half mirrored: sin(pi - a) = sin(a). */
    {wide} turn = ((x + quarter) & (4 * quarter - 1)) - quarter;
    if (turn > quarter) {{
        turn = 2 * quarter - turn;
    }}
    const {wide} z = 4 * turn;
    return ({word})((z * polynomial(c, {sines_degree}, (z * z) >> {places})) >> {places});
}}""",
}


def _coefficients(function: Callable[[np.ndarray], np.ndarray], degree: int, places: int) -> tuple[int, str]:
    """Degree and coefficients, as text, of a polynomial through a function at the Chebyshev points of 0 to 1."""
    fitted = Chebyshev.interpolate(function, degree, domain=[0.0, 1.0]).convert(kind=Polynomial)
    return degree, ", ".join(str(round(math.ldexp(value, places))) for value in fitted.coef)


def _half_sine(square: np.ndarray) -> np.ndarray:
    """sin(pi z / 2) / z as a function of z^2."""
    z = np.sqrt(np.maximum(square, 1e-12))
    return np.asarray(np.sin(0.5 * np.pi * z) / z)


def used_functions(code: str, word: FixedWord) -> str:
    """C of the functions that some code calls, each after those that it calls itself."""
    direct = [name for name in CALLS if re.search(rf"\b{name}\(", code)]
    needed = [name for name in CALLS if name in direct or any(name in CALLS[user] for user in direct)]
    places = word.bits - 2
    powers, sines = DEGREES[word.bits]
    powers_degree, power_texts = _coefficients(np.exp2, powers, places)
    sines_degree, sine_texts = _coefficients(_half_sine, sines, places)
    values = {
        "word": word.word, "wide": word.wide, "literal": word.literal, "most": word.largest, "shift": word.bits - 1,
        "room": word.room, "places": places, "powers": power_texts, "powers_degree": powers_degree,
        "sines": sine_texts, "sines_degree": sines_degree,
    }  # fmt: skip
    return "\n\n".join(TEXTS[name].format(**values) for name in needed)
