"""Whatever is wrong with a definition, a result, a log or an argument: one sentence, soon, and never a traceback.

The cases are drawn with a fixed seed, so that a run can be repeated; what a case finds is mended where its class is.
"""

from __future__ import annotations

import copy
import math
import random
import shutil
import signal
import tomllib
import warnings
from contextlib import contextmanager

import pytest
import tomlkit

import ehsa_ctrl as e
from ehsa_ctrl.core import catalogue

SHIPPED = [path for kind in catalogue.KINDS for path in catalogue.shipped(kind).values()]
#: What stands where a value was.
VALUES = [
    True, False, 0, -1, 1, 2**63 - 1, -(2**63), 0.0, -0.0, 1e300, -1e300, 1e-300, 5e-324, math.inf, -math.inf, math.nan,
    "", " ", "x", "0", "1", "1e999", "nan", "inf", "0 m", "-1 m", "1e300 m", "1e-300 m", "3 furlong", "3 m**9**9**9",
    "3 (", "3 m/0", "3 pi", "__import__('os')", "1e300 A", "1e-300 A", "0 A", "-5 A", "1e30 rad/s", "1e-30 rad/s",
    "0 deg", "180 deg", "-60 deg", "1e300 s", "1e-300 s", "0 s", "0 Hz", "-1 Hz", "1e300 Hz", "1e300 N", "1e308 Pa",
    "1e-308 Pa", "0 %", "1e300 %", "\n", "ü", "..", "../..", "/", "/dev/null", "/etc", "a" * 300, "a\0b", "ehsa",
    "emps", "linear", "none", "K_T", [], [1], ["pid"], ["1 m", "2 m"], [[]], [True], [1e300, -1e300], ["0 s"] * 500, {},
    {"x": 1}, {"value": 1}, {"value": 1.0, "unit": "m", "source": "assumed"}, {"max": "1 mm"}, [{}], [{"kind": "lost"}],
]  # fmt: skip


class TooLong(BaseException):
    """Not an Exception, so that nothing takes it for a mistake of the user's."""


@contextmanager
def within(seconds):
    """Raise TooLong in what takes longer."""

    def stop(*_):
        raise TooLong(f"took more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def places(content, at=()):
    """Paths of all values in nested tables and arrays, tables themselves included."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield (*at, key)
        yield from places(value, (*at, key))


def mutated(content, draw):
    """The content with one value replaced, dropped, scaled or put in twice, or a key added."""
    content = copy.deepcopy(content)
    *above, key = draw.choice(list(places(content)))
    table = content
    for step in above:
        table = table[step]
    match draw.choice(["replace"] * 4 + ["size"] * 3 + ["drop", "add", "repeat", "scale", "unit"]):
        case "drop":
            del table[key]
        case "add":
            if isinstance(table, dict):
                table[draw.choice(["x", "", "value", "kind", "ünit", "a.b", "K_T", "max"])] = draw.choice(VALUES)
        case "repeat":
            table[key] = [table[key], table[key]]
        case "scale" if isinstance(table[key], int | float):
            table[key] = table[key] * draw.choice([1e30, -1, 1e-30, 1e6, 1e-6])
        case "size" if isinstance(table[key], str):
            unit = table[key].partition(" ")[2]
            table[key] = f"{draw.choice(['1e300', '1e-300', '1e30', '1e-30', '1e9', '1e-9', '0', '-1'])} {unit}"
        case "unit" if isinstance(table[key], str):
            number = table[key].partition(" ")[0]
            table[key] = f"{number} {draw.choice(['', 'm', 's', 'A', 'Pa', 'rpm', '%', 'Nm', '1/0', '(', 'm^999'])}"
        case _:
            table[key] = draw.choice(VALUES)
    return content


def cut(raw, draw):
    """The bytes of a file cut, or with others in between."""
    at = draw.randrange(len(raw))
    odd = [b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"[" * 3000, b"\n[[", b"= ", b'"', b"\r", b"9" * 5000, b"#", b"{" * 500]
    return raw[:at] + draw.choice([b"", *(part + raw[at:] for part in odd)])


def said(error):
    """The sentence of an error; it is one, and no longer than a person reads."""
    text = str(error)
    assert text and "\n" not in text.strip() and len(text) < 1500, text
    assert "Traceback" not in text and "pydantic" not in text
    return text


def answered(call, *arguments, seconds=10.0, **kwargs):
    """What a call gives, or its sentence; anything else is raised, a numpy warning too."""
    with within(seconds), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return call(*arguments, **kwargs)
        except e.EhsaError as error:
            return said(error)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Copies of the shipped files, as a user's project has them."""
    root = tmp_path_factory.mktemp("project")
    for kind in catalogue.KINDS:
        shutil.copytree(catalogue.shipped_folder(kind), root / kind)
    return root


def mutant(path, folder, seed):
    """A shipped definition with something wrong, beside the others in the project's folder."""
    draw = random.Random(f"{path.name} {seed}")
    raw = path.read_bytes()
    if draw.random() < 0.15:
        raw = cut(raw, draw)
    else:
        content = mutated(tomllib.loads(raw.decode()), draw)
        raw = tomlkit.dumps(content).encode("utf-8", "surrogateescape")
    file = folder / path.parent.name / "mutant.toml"
    file.write_bytes(raw)
    return file
