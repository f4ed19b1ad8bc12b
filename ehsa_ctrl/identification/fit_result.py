"""The result of a fit: the estimate, its information matrix, and how it compares with the noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..plant.plant import Plant
from .parameters import FreeParameter
from .residuals import WindowRun

#: Length of a piece in which a single missed slip stands out of the noise [s].
SLIP_TIME = 0.1


@dataclass(frozen=True)
class Iterate:
    """Parameters (k,), initial states and input errors of each window, and the simulated windows."""

    values: np.ndarray
    starts: tuple[np.ndarray, ...]
    errors: tuple[np.ndarray, ...]
    runs: tuple[WindowRun, ...]


@dataclass(frozen=True)
class Progress:
    """Passed to a watcher after each step: stage, number of steps, cost per residual, parameter values."""

    stage: str
    step: int
    cost: float
    names: tuple[str, ...]
    values: np.ndarray


@dataclass(frozen=True)
class Diverged:
    """The outcome of a fit whose simulation diverges at the start values already."""

    plant: str
    names: tuple[str, ...]
    values: np.ndarray

    def __str__(self) -> str:
        values = ", ".join(f"{name} = {value:g}" for name, value in zip(self.names, self.values, strict=True))
        return (
            f"{self.plant} can't be simulated along the log with {values}: the run leaves the range where the "
            "equations hold; start nearer or use shorter windows"
        )


@dataclass(frozen=True)
class Fit:
    """An estimate over some windows.

    values (k,). cost: sum of squares of whitened residuals and priors. objective: the cost that was minimised, equal
    to `cost` unless input errors were unknowns. weighted: by other weights than the sensors' noise. residuals: their
    number. information (k, k): inverse of the covariance due to noise. scores (blocks, k): gradient of each half
    second, which shows whether residuals are correlated. stopped: why the iteration ended.
    """

    parameters: tuple[FreeParameter, ...]
    plant: Plant
    iterate: Iterate
    cost: float
    objective: float
    weighted: bool
    residuals: int
    information: np.ndarray
    scores: np.ndarray
    steps: int
    stopped: str

    @property
    def values(self) -> np.ndarray:
        return self.iterate.values

    @cached_property
    def worst_blocks(self) -> tuple[tuple[float, int], ...]:
        """Of each run the worst tenth of a second: excess in standard deviations of its sum, and its middle sample.

        One missed slip disappears in the cost of thousands of samples; in its own block it stands out.
        """
        found = []
        for run in self.iterate.runs:
            squares = np.sum((run.residual / run.measured.sd) ** 2, axis=1)
            if run.measured.input_sd > 0.0:
                squares = squares + (run.errors / run.measured.input_sd) ** 2
            length = min(max(int(round(SLIP_TIME / run.window.log.sample_time)), 1), squares.size)
            sums = np.convolve(squares, np.ones(length), mode="valid")
            expected = length * run.residual.shape[1]
            at = int(np.argmax(sums))
            found.append((float((sums[at] - expected) / np.sqrt(2.0 * expected)), at + length // 2))
        return tuple(found)

    @property
    def worst_block(self) -> tuple[float, int, int]:
        """The worst of all runs: excess in standard deviations, number of the run, sample."""
        number = int(np.argmax([size for size, _ in self.worst_blocks]))
        size, at = self.worst_blocks[number]
        return size, number, at

    @property
    def reduced_cost(self) -> float:
        """Cost per degree of freedom: one when model and noise are right."""
        return self.cost / self._degrees_of_freedom

    @property
    def noise_ratio(self) -> float:
        """The larger of both costs per degree of freedom.

        They agree at a minimum where first order holds. A run that misses slips or diverges may look white to its own
        filter, which takes the unstable direction for input noise; the input errors that this would need are far beyond
        that noise, and show in the minimised cost.
        """
        return max(self.cost, self.objective) / self._degrees_of_freedom

    @property
    def _degrees_of_freedom(self) -> int:
        states = sum(len(run.window.free) for run in self.iterate.runs)
        return max(self.residuals - self.values.size - states, 1)
