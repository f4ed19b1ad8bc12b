"""What exported code costs and how far its currents are from those of Python, as this machine's compiler makes it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isinf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...core.result import Result, as_dict
from ..controller import SampledController
from .compiled_code import CompiledCode
from .deployment import Deployment, embedded_controller
from .fixed import FixedWord
from .number import NumberType
from .operations import worst_operations


@dataclass(frozen=True)
class CheckedRun:
    """A run replayed by exported code.

    Attributes
    ----------
    samples: of the run. error: largest difference of the currents from those of Python in doubles [A]. iterations:
    most of the solver in a sample; None without a solver. unsolved: number of samples without a solution.
    """

    samples: int
    error: float
    iterations: int | None = None
    unsolved: int = 0


@dataclass(frozen=True)
class SignalCheck:
    """A signal over all runs, SI: the current, and what the controller records of its memory.

    Attributes
    ----------
    largest: magnitude of the Python controller's. error: largest difference from it.
    step: value of the last bit, and headroom: bits from the largest magnitude to the end of the scale (infinite for a
    signal that stayed 0), in fixed point; None for other numbers.
    """

    largest: float
    error: float
    step: float | None = None
    headroom: float | None = None


@dataclass(frozen=True, repr=False)
class CodeCheck(Result):
    """Figures of exported code.

    Attributes
    ----------
    number: type of its numbers in C. operations: of the costliest sample of the test vector, or in fixed point of the
    longest way through the code, by kind. stack: bytes of the deepest chain of calls without libm; None if unknown.
    runs: name -> replayed run, the test vector first. signals: name -> what became of it.
    tolerance: largest error of the current with which the code is usable [unit]. unit: of the drive, SI.
    """

    number: str
    operations: dict[str, int]
    stack: int | None
    runs: dict[str, CheckedRun]
    signals: dict[str, SignalCheck]
    tolerance: float
    unit: str = "A"

    @property
    def worst(self) -> str:
        """Name of the run with the largest error."""
        return max(self.runs, key=lambda name: self.runs[name].error)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as in check.json."""
        return as_dict(self, largest_error=self.runs[self.worst].error, usable=self.usable)

    @property
    def usable(self) -> bool:
        """Whether the current is near that of Python in all runs."""
        return self.runs[self.worst].error <= self.tolerance

    def __str__(self) -> str:
        kinds = ", ".join(f"{count} {kind}" for kind, count in self.operations.items() if kind != "flops")
        stack = "unknown to this compiler" if self.stack is None else f"{self.stack} bytes, without libm's own"
        fixed = self.signals["current"].step is not None
        what = "operations on the longest way" if fixed else "flops in the costliest sample of the test vector"
        unit, error = self.unit, self.runs[self.worst].error
        lines = [
            f"{self.number}: {self.operations['flops']} {what} ({kinds})",
            f"  worst-case stack {stack}",
            f"  largest difference from Python in doubles {error:.3g} {unit}, in {self.worst}:",
        ]
        for name, run in self.runs.items():
            solver = "" if run.iterations is None else f" {run.iterations:>6} iterations, {run.unsolved} unsolved"
            lines.append(f"    {name:<24} {run.samples:>7} samples {run.error:>10.3g} {unit}{solver}")
        lines.append("  signals over all runs, SI:    largest      error" + "   last bit   headroom" * fixed)
        for name, signal in self.signals.items():
            scale = ""
            if signal.step is not None and signal.headroom is not None:
                room = "never moved" if isinf(signal.headroom) else f"{signal.headroom:.1f} bits"
                scale = f" {signal.step:>10.3g} {room:>10}"
            lines.append(f"    {name:<24} {signal.largest:>10.3g} {signal.error:>10.3g}{scale}")
        if not self.usable:
            limit = f"accepted are {self.tolerance:.3g} {unit}"
            lines.append(f"  not usable: a difference of {error:.3g} {unit} in {self.worst}; {limit}")
        return "\n".join(lines)


def check_code(
    deployment: Deployment,
    controller: SampledController,
    number: NumberType | FixedWord,
    runs: Iterable[tuple[str, np.ndarray, np.ndarray]],
) -> CodeCheck:
    """Compile an exported controller, and replay its test vector and other runs.

    runs: name, reference (N, 3 or 4) and readings (N, 5).

    Raises InputError without a C compiler.
    """
    vector, embedded = deployment.vector, embedded_controller(controller)
    solves = vector.iterations is not None
    traces = embedded.traces
    checked, largest, errors = {}, np.zeros(len(traces) + 1), np.zeros(len(traces) + 1)
    with TemporaryDirectory() as folder:
        for name in ("controller.c", "controller.h"):
            (Path(folder) / name).write_text(deployment.files[name], encoding="utf-8")
        code = CompiledCode(Path(folder), number, embedded.initial_memory().size, deployment.fixed)
        for name, reference, measured in [("test vector", vector.reference, vector.measured), *runs]:
            currents, traced = code.run(reference, measured, list(traces.values()))
            expected = replay_signals(controller, reference, measured, [controller.traces[each] for each in traces])
            difference = np.column_stack([currents, traced]) - expected
            # A number that is none is the largest error there is.
            error = np.max(np.where(np.isfinite(difference), np.abs(difference), np.inf), axis=0)
            largest, errors = np.maximum(largest, np.max(np.abs(expected), axis=0)), np.maximum(errors, error)
            solver: tuple[int, ...] = ()
            if solves:
                recorded = dict(zip(traces, traced.T, strict=True))
                solver = int(recorded["solver_iterations"].max()), int(np.count_nonzero(recorded["solver_reason"]))
            checked[name] = CheckedRun(len(reference), float(error[0]), *solver)
        stack = code.worst_stack
    only = None if vector.iterations is None else int(np.argmax(vector.iterations))
    scales: list[tuple[float, float]] | list[tuple[()]] = [()] * (len(traces) + 1)
    if deployment.fixed is not None:
        operations, word = deployment.fixed.operations(), deployment.fixed.word
        kept = [deployment.fixed.current, *(deployment.fixed.memory[place] for place in traces.values())]
        scales = [(signal.step, signal.headroom(word.bits)) for signal in kept]
    else:
        operations = worst_operations(embedded, vector.reference, vector.measured, only)
    figures = zip(("current", *traces), largest.tolist(), errors.tolist(), scales, strict=True)
    signals = {name: SignalCheck(most, error, *scale) for name, most, error, scale in figures}
    return CodeCheck(number.word, operations, stack, checked, signals, deployment.tolerance, deployment.unit)


def replay_signals(
    controller: SampledController, reference: np.ndarray, measured: np.ndarray, places: list[int]
) -> np.ndarray:
    """Currents and entries of the memory after each sample (N, 1 + places) of the controller in Python."""
    memory = controller.initial_memory()
    found = np.empty((len(reference), 1 + len(places)))
    for k, (r, y) in enumerate(zip(reference, measured, strict=True)):
        found[k, 0] = controller.step(r, y, memory)
        found[k, 1:] = memory[places]
    return found
