"""The engine's algorithm in C, compiled on demand with several common sets of flags."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from engine_cases import DT, START, Array, Case

SOURCE = Path(__file__).with_name("c_engine.c")
#: Which is fastest depends on compiler and processor; the engine is compared with the fastest on each case.
FLAGS = {
    "-O2": ("-O2", "-march=native"),
    "-O3": ("-O3", "-march=native"),
    "-O3 -ffast-math": ("-O3", "-march=native", "-ffast-math"),
    "-O2 -fno-math-errno -fno-trapping-math": ("-O2", "-march=native", "-fno-math-errno", "-fno-trapping-math"),
}

#: Order of `Parameters` in c_engine.c.
PARAMETERS = (
    "J_M", "K_T", "D", "K_L", "V_10", "V_20", "beta", "A", "M", "P_0", "x_0", "K_S", "F_pre", "k_3", "F_0", "m_L",
    "A_FM", "B_FM", "C_FM", "tau_FM", "A_FR", "B_FR", "C_FR", "tau_FR",
)  # fmt: skip

#: What `read_counts` returns when compiled with -DCOUNT.
COUNTS = ("rates", "steps", "rejected", "shortened", "locating", "events")


@cache
def library(*flags: str) -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "c_engine.so"
        subprocess.run(["cc", *flags, "-shared", "-fPIC", str(SOURCE), "-o", str(file), "-lm"], check=True)
        lib = ctypes.CDLL(str(file))
    pointer, number = ctypes.c_void_p, ctypes.c_double
    lib.run.argtypes = [*[pointer] * 5, ctypes.c_int, ctypes.c_int, number, number, *[pointer] * 4]
    lib.run.restype = ctypes.c_int
    return lib


def c_run(case: Case, tol: float, flags: str) -> Callable[[], Array]:
    """A function that runs the case; buffers are allocated once, so that the timing excludes ctypes."""
    run = library(*FLAGS[flags]).run
    n = case.current.size
    p = np.array([case.values.get(name, 0.0) for name in PARAMETERS])
    current, force = np.ascontiguousarray(case.current), np.zeros(n)
    y, mode = np.empty(5), np.empty(2)
    states, modes, cell, extremes = np.empty((n, 5)), np.empty((n, 2), np.int8), np.empty(n), np.empty((2, 5))
    head = [array.ctypes.data for array in (p, y, mode, current, force)]
    tail = [array.ctypes.data for array in (states, modes, cell, extremes)]
    arguments = (*head, n, int(case.first_order), DT, tol, *tail)
    alive = (p, y, mode, current, force, states, modes, cell, extremes)

    def call(alive: tuple[np.ndarray, ...] = alive) -> Array:
        y[:], mode[:] = START, 0.0
        if run(*arguments):
            raise RuntimeError("the C engine did not finish")
        return states

    return call


def counts(case: Case, tol: float) -> dict[str, int]:
    """Work of one run, counted by a separate library so that counting does not slow the timed one."""
    lib = library("-O2", "-march=native", "-DCOUNT")
    tally = (ctypes.c_longlong * len(COUNTS))()
    lib.read_counts(tally)
    n = case.current.size
    p = np.array([case.values.get(name, 0.0) for name in PARAMETERS])
    y, mode, force = START.copy(), np.zeros(2), np.zeros(n)
    out: list[np.ndarray] = [np.empty((n, 5)), np.empty((n, 2), np.int8), np.empty(n), np.empty((2, 5))]
    current = np.ascontiguousarray(case.current)
    head = [array.ctypes.data for array in (p, y, mode, current, force)]
    lib.run(*head, n, int(case.first_order), DT, tol, *[array.ctypes.data for array in out])
    lib.read_counts(tally)
    return dict(zip(COUNTS, tally, strict=True))
