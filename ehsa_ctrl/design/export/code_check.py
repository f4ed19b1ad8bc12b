"""What exported code costs and how far its currents are from those of Python, as this machine's compiler makes it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...core.result import Result, as_dict
from ..controller import SampledController
from .compiled_code import CompiledCode
from .deployment import Deployment, embedded_controller, replay
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


@dataclass(frozen=True, repr=False)
class CodeCheck(Result):
    """Figures of exported code.

    Attributes
    ----------
    number: type of its numbers. operations: of the costliest sample of the test vector, by kind. stack: bytes of the
    deepest chain of calls without libm; None if unknown. runs: name -> replayed run, the test vector first.
    """

    number: str
    operations: dict[str, int]
    stack: int | None
    runs: dict[str, CheckedRun]

    @property
    def worst(self) -> str:
        """Name of the run with the largest error."""
        return max(self.runs, key=lambda name: self.runs[name].error)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as in check.json."""
        return as_dict(self, largest_error=self.runs[self.worst].error)

    def __str__(self) -> str:
        kinds = ", ".join(f"{count} {kind}" for kind, count in self.operations.items() if kind != "flops")
        stack = "unknown to this compiler" if self.stack is None else f"{self.stack} bytes, without libm's own"
        lines = [
            f"{self.number}: {self.operations['flops']} flops in the costliest sample of the test vector ({kinds})",
            f"  worst-case stack {stack}",
            f"  largest difference from Python in doubles {self.runs[self.worst].error:.3g} A, in {self.worst}:",
        ]
        for name, run in self.runs.items():
            solver = "" if run.iterations is None else f" {run.iterations:>6} iterations, {run.unsolved} unsolved"
            lines.append(f"    {name:<24} {run.samples:>7} samples {run.error:>10.3g} A{solver}")
        return "\n".join(lines)


def check_code(
    deployment: Deployment,
    controller: SampledController,
    number: NumberType,
    runs: Iterable[tuple[str, np.ndarray, np.ndarray]],
) -> CodeCheck:
    """Compile an exported controller, and replay its test vector and other runs.

    runs: name, reference (N, 3 or 4) and readings (N, 5).

    Raises InputError without a C compiler.
    """
    vector, embedded = deployment.vector, embedded_controller(controller)
    solves = vector.iterations is not None
    watched = [embedded.traces[name] for name in ("solver_iterations", "solver_reason")] if solves else []
    checked = {}
    with TemporaryDirectory() as folder:
        for name in ("controller.c", "controller.h"):
            (Path(folder) / name).write_text(deployment.files[name], encoding="utf-8")
        code = CompiledCode(Path(folder), number, embedded.initial_memory().size)
        for name, reference, measured in [("test vector", vector.reference, vector.measured), *runs]:
            currents, traced = code.run(reference, measured, watched)
            difference = currents - replay(controller, reference, measured)
            # A current that is not a number is the largest error there is.
            error = float(np.max(np.where(np.isfinite(difference), np.abs(difference), np.inf)))
            solver = (int(traced[:, 0].max()), int(np.count_nonzero(traced[:, 1]))) if solves else ()
            checked[name] = CheckedRun(len(reference), error, *solver)
        stack = code.worst_stack
    only = None if vector.iterations is None else int(np.argmax(vector.iterations))
    operations = worst_operations(embedded, vector.reference, vector.measured, only)
    return CodeCheck(number.word, operations, stack, checked)
