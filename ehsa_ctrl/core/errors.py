"""Exceptions and parts of their messages.

EhsaError
├── InputError         wrong file, key, value or argument: exit status 2, one sentence
│   └── CompileError   a physics function, also a user's own, has a construct that the engine can't translate
└── SimulationError    a run stopped early: the message gives the time and the reason
"""

from __future__ import annotations

import difflib
import os
import reprlib
from collections.abc import Iterable
from numbers import Real


class EhsaError(Exception):
    """Base of every error that ehsa_ctrl raises on purpose; its text is a sentence for the user."""


class InputError(EhsaError, ValueError):
    """Wrong input. The text tells what was found, what was expected and what to do."""


class CompileError(InputError):
    """A physics function is not straight-line scalar code, so it can't be compiled and differentiated."""


class SimulationError(EhsaError, RuntimeError):
    """A simulation stopped early; the text gives the time and the reason."""


#: Most names listed in a message. Engineering judgement: enough for all parameters of a plant.
MOST = 100


def choices(name: object, known: Iterable[str]) -> str:
    """Hint for an unknown name: the closest known name, then all of them."""
    known = sorted(known)
    near = difflib.get_close_matches(str(name)[:100], known, n=1, cutoff=0.5)
    listed = ", ".join(known[:MOST]) + (f" and {len(known) - MOST} more" if len(known) > MOST else "") or "none"
    return (f"did you mean {near[0]!r}? " if near else "") + f"known: {listed}"


def shown(value: object) -> str:
    """A value for a message: numbers and strings as Python writes them, shortened if long; other objects by type."""
    if isinstance(value, int) and abs(value) >= 10**40:
        # Python refuses to format integers with thousands of digits.
        return f"a whole number of {value.bit_length()} bits"
    if value is None or isinstance(value, bool | Real | str):
        return _SHORT.repr(value)
    if isinstance(value, os.PathLike):
        return str(value)
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"an array of shape {value.shape}" + (f" of {value.dtype}" if value.dtype.kind not in "fiu" else "")
    word = type(value).__name__
    return f"{'an' if word[0] in 'AEIOaeio' else 'a'} {word}"


def reason(error: Exception) -> str:
    """A library's message on one line, shortened if it is long."""
    return " ".join(str(error).split())[:160] or type(error).__name__


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 50
