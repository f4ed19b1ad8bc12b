"""Exported code as this machine's compiler makes it: its currents over given runs, and its worst-case stack."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import InputError
from .fixed import FixedCode, FixedWord
from .number import NumberType

#: As in the exported Makefile, without the warnings.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
#: Types of numbers for ctypes and for numpy.
TYPES: dict[str, tuple[Any, Any]] = {
    "double": (ctypes.c_double, np.float64),
    "float": (ctypes.c_float, np.float32),
    "int32_t": (ctypes.c_int32, np.int32),
    "int16_t": (ctypes.c_int16, np.int16),
}


class CompiledCode:
    """The exported code of a controller, compiled as a library.

    Raises InputError without a C compiler, and if it refuses the code.
    """

    def __init__(
        self, folder: Path, number: NumberType | FixedWord, memory: int, fixed: FixedCode | None = None
    ) -> None:
        """folder: has controller.c and controller.h, and gets the results. number, memory: type and length of its
        memory. fixed: scales of fixed-point code."""
        self._compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang") or ""
        if not self._compiler:
            raise InputError("--check needs a C compiler (cc, gcc or clang), and there is none on the PATH")
        self._folder, self._size = folder, memory
        self._fixed = fixed
        self._type = TYPES[number.word]

    def _run(self, *words: str) -> None:
        call = [self._compiler, *FLAGS, *words]
        done = subprocess.run(call, cwd=self._folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise InputError(f"{self._compiler} refuses the exported code: {done.stderr.strip()[:500]}")

    @cached_property
    def _library(self) -> ctypes.CDLL:
        self._run("-shared", "-fPIC", "controller.c", "-lm", "-o", "controller.so")
        library = ctypes.CDLL(str(self._folder / "controller.so"))
        library.ehsa_step.restype = self._type[0]
        return library

    def run(
        self, reference: np.ndarray, measured: np.ndarray, watched: Sequence[int] = ()
    ) -> tuple[np.ndarray, np.ndarray]:
        """Currents (N,) [A] for reference (N, 3 or 4) and readings (N, 5) from the initial memory, and the entries
        `watched` (k,) of the memory after each sample (N, k), SI."""
        word, kind = self._type
        fixed = self._fixed
        if fixed is not None:
            reference, measured = fixed.encode(reference, measured)
        memory = (word * self._size)()
        self._library.ehsa_reset(memory)
        rows = [np.ascontiguousarray(table, dtype=kind) for table in (reference, measured)]
        pointers = [[row.ctypes.data_as(ctypes.POINTER(word)) for row in table] for table in rows]
        currents, traced = np.empty(len(reference)), np.empty((len(reference), len(watched)))
        entries, places = np.ctypeslib.as_array(memory), list(watched)
        for k, (r, y) in enumerate(zip(*pointers, strict=True)):
            currents[k] = self._library.ehsa_step(r, y, memory)
            traced[k] = entries[places]
        if fixed is not None:
            currents *= fixed.current.step
            traced *= [fixed.memory[place].step for place in places]
        return currents, traced

    @cached_property
    def worst_stack(self) -> int | None:
        """Bytes of stack of the deepest chain of calls from ehsa_step, without those inside libm; None if the compiler
        does not tell (gcc from version 10 on does)."""
        try:
            self._run("-fstack-usage", "-fcallgraph-info=su", "-c", "controller.c", "-o", "controller.o")
            graph = (self._folder / "controller.ci").read_text(encoding="utf-8")
        except (InputError, OSError):
            return None
        return deepest_stack(graph, "ehsa_step")


def deepest_stack(graph: str, entry: str) -> int:
    """Bytes of the deepest chain of calls in gcc's call graph with stack usage (-fcallgraph-info=su).

    Raises InputError for a function whose stack is not bounded, and for recursion.
    """
    nodes = re.findall(r'node: \{ title: "([^"]*)" label: "([^"]*)"', graph)
    sizes = {title: re.search(r"(\d+) bytes \((\w+)", label) for title, label in nodes}
    calls: dict[str, set[str]] = {}
    for source, target in re.findall(r'edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)"', graph):
        calls.setdefault(source, set()).add(target)

    def depth(name: str, above: tuple[str, ...]) -> int:
        if name in above:
            raise InputError(f"{name} calls itself; its stack has no bound")
        size = sizes.get(name)
        if size is not None and size[2] != "static":
            raise InputError(f"{name} has a stack of variable size")
        below = [depth(called, (*above, name)) for called in calls.get(name, ())]
        return (int(size[1]) if size is not None else 0) + max(below, default=0)

    return depth(entry, ())
