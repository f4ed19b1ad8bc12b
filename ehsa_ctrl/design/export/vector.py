"""A test vector: what a controller got in a run, and the current that its Python gives for it."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np

from ...core.controller_interface import INPUTS, MEASURED, REFERENCE
from ...core.errors import InputError
from ..controller import SampledController


@dataclass(frozen=True)
class Vector:
    """A test vector.

    Attributes
    ----------
    reference (N, 3), measured (N, 5): as in core.controller_interface; a reading that is not a number was lost.
    current: (N,) of the Python controller [A].
    exact: (N,) what an exact solver gives from the same memory [A]; None for a law without a solver.
    unsolved: (N,) whether the law's own solver left the sample to the fallback.
    """

    reference: np.ndarray
    measured: np.ndarray
    current: np.ndarray
    exact: np.ndarray | None = None
    unsolved: np.ndarray | None = None

    @property
    def distance(self) -> float | None:
        """Largest distance from the exact solution where there is one of its own [A]."""
        if self.exact is None or self.unsolved is None:
            return None
        return float(np.max(np.abs(self.current - self.exact)[~self.unsolved], initial=0.0))

    @property
    def left(self) -> int:
        """How many samples were left to the fallback."""
        return 0 if self.unsolved is None else int(np.count_nonzero(self.unsolved))

    @property
    def columns(self) -> list[str]:
        return [*INPUTS, "current", *([] if self.exact is None else ["exact"])]

    def to_csv(self) -> str:
        """Text with a header row; every number is read back to the last bit."""
        last = [self.current] if self.exact is None else [self.current, self.exact]
        table = np.column_stack([self.reference, self.measured, *last])
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(self.columns)
        rows.writerows(table.tolist())
        return text.getvalue()


def checked(reference: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both as arrays. Raises InputError for shapes that don't fit."""
    reference, measured = np.array(reference, dtype=float), np.array(measured, dtype=float)
    n = len(reference)
    if n < 1 or reference.shape != (n, len(REFERENCE)) or measured.shape != (n, len(MEASURED)):
        raise InputError(
            f"a test vector of shapes {reference.shape} and {measured.shape}; expected (N, {len(REFERENCE)}) and "
            f"(N, {len(MEASURED)})"
        )
    return reference, measured


def replay(controller: SampledController, reference: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Currents (N,) of the plain Python controller for what it is given, from its first sample on."""
    memory = controller.initial_memory()
    return np.array([controller.step(r, y, memory) for r, y in zip(reference, measured, strict=True)])
