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
from .deployment import Deployment, replay
from .number import NumberType
from .operations import worst_operations


@dataclass(frozen=True, repr=False)
class CodeCheck(Result):
    """Figures of exported code.

    Attributes
    ----------
    number: type of its numbers. operations: of the costliest sample of the test vector, by kind. stack: bytes of the
    deepest chain of calls without libm; None if unknown. errors: run -> largest difference of its currents from
    those of Python in doubles [A]. samples: run -> number of samples.
    """

    number: str
    operations: dict[str, int]
    stack: int | None
    errors: dict[str, float]
    samples: dict[str, int]

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as in check.json."""
        return as_dict(self, largest_error=max(self.errors.values()))

    def __str__(self) -> str:
        kinds = ", ".join(f"{count} {kind}" for kind, count in self.operations.items() if kind != "flops")
        stack = "unknown to this compiler" if self.stack is None else f"{self.stack} bytes, without libm's own"
        worst = max(self.errors, key=lambda name: self.errors[name])
        return "\n".join(
            [
                f"{self.number}: {self.operations['flops']} flops in the costliest sample ({kinds})",
                f"  worst-case stack {stack}",
                f"  largest difference from Python in doubles {self.errors[worst]:.3g} A, in {worst}:",
                *(
                    f"    {name:<24} {self.samples[name]:>7} samples {self.errors[name]:>10.3g} A"
                    for name in self.errors
                ),
            ]
        )


def check_code(
    deployment: Deployment,
    controller: SampledController,
    number: NumberType,
    runs: Iterable[tuple[str, np.ndarray, np.ndarray]],
) -> CodeCheck:
    """Compile an exported controller without a solver and replay its test vector and other runs.

    runs: name, reference (N, 3 or 4) and readings (N, 5).

    Raises InputError without a C compiler.
    """
    vector = deployment.vector
    errors, samples = {}, {}
    with TemporaryDirectory() as folder:
        for name in ("controller.c", "controller.h"):
            (Path(folder) / name).write_text(deployment.files[name], encoding="utf-8")
        code = CompiledCode(Path(folder), number, controller.initial_memory().size)
        for name, reference, measured in [("test vector", vector.reference, vector.measured), *runs]:
            difference = code.currents(reference, measured) - replay(controller, reference, measured)
            # A current that is not a number is the largest error there is.
            errors[name] = float(np.max(np.where(np.isfinite(difference), np.abs(difference), np.inf)))
            samples[name] = len(reference)
        stack = code.worst_stack
    return CodeCheck(
        number.word, worst_operations(controller, vector.reference, vector.measured), stack, errors, samples
    )
