"""Parsing of Python text, one thread at a time, and the arguments of functions."""

import ast
import inspect
import textwrap
from collections.abc import Callable
from functools import cache
from threading import Lock

#: CPython 3.11 counts the depth of its syntax trees for all threads together, and raises SystemError where two of them
#: parse at once (python/cpython issue 106905).
_ONE_AT_A_TIME = Lock()


def parse_expression(text: str) -> ast.expr:
    """The tree of an expression. Raises SyntaxError and others as `ast.parse` does."""
    with _ONE_AT_A_TIME:
        return ast.parse(text, mode="eval").body


def parse_statement(text: str) -> ast.stmt:
    """The tree of the first statement of a text, which may be indented."""
    text = textwrap.dedent(text)
    with _ONE_AT_A_TIME:
        return ast.parse(text).body[0]


@cache
def argument_names(function: Callable[..., object]) -> tuple[str, ...]:
    """Names of the arguments of a function in their order; `inspect.signature` takes 80 us each time."""
    return tuple(inspect.signature(function).parameters)
