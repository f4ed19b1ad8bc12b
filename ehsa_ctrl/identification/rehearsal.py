"""An experiment rehearsed on the virtual bench: do estimates scatter as much as the covariance promises?

The covariance takes the run for linear in parameters and noise. Where the rod is almost, but not quite, set free or
held again, a change within the noise adds or removes an event, and estimates scatter more than any derivative tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ..core.errors import EhsaError
from ..simulation.bench import record
from .estimator import fit
from .forecast import Forecast, forecast_run
from .free import FreeParameter
from .window import cut

#: A rehearsal fails if errors as large come from the promised covariance more rarely than this.
RARE = 0.01
#: After so many logs a rehearsal that fails plainly is ended: an estimate along such a run takes long.
FIRST = 2


@dataclass(frozen=True)
class Rehearsal:
    """ratio: rms of the estimates' errors over what is promised, all directions together; logs: how many were made."""

    ratio: float
    logs: int
    passed: bool

    def __str__(self) -> str:
        words = (
            "as the linear theory has them"
            if self.passed
            else "more than promised by it: the run hangs on events that noise can change"
        )
        return f"{self.logs} rehearsals: errors {self.ratio:.2f} times the expected sd, {words}"


def rehearse(
    promised: Forecast,
    parameters: Sequence[FreeParameter],
    current: np.ndarray,
    *,
    centre: bool = False,
    logs: int = 6,
    seed: int = 0,
    jobs: int = 1,
) -> Rehearsal:
    """Record the bench `logs` times with the believed plant, estimate from each, compare with the forecast.

    Parameters that the forecast calls undetermined are left at what is believed. Estimates start at the truth.
    """
    plant, time = promised.run.plant, promised.run.time
    shown = [p for p in parameters if p.name not in promised.undetermined]
    if not shown or logs < 1:
        return Rehearsal(np.inf, 0, False)
    expected = promised if len(shown) == len(parameters) else forecast_run(promised.run, shown)
    root = np.linalg.cholesky(expected.fit.information)
    truth = expected.fit.values

    def error(number: int) -> np.ndarray:
        """The errors (k,) of one estimate, in the promised standard deviations of independent directions."""
        log, _ = record(plant, time, current, seed=1000 * (seed + 1) + number, centre=centre)
        try:
            found = fit(plant, cut(plant, log, None), shown, steps=15)
        except EhsaError:
            return np.full(len(shown), np.inf)
        return np.asarray(root.T @ (found.values - truth))

    errors = np.zeros((0, len(shown)))
    with ThreadPoolExecutor(jobs) as pool:
        for numbers in (range(min(FIRST, logs)), range(FIRST, logs)):
            errors = np.vstack([errors, *pool.map(error, numbers)])
            squares = float(np.sum(errors**2))
            passed = squares <= float(stats.chi2.isf(RARE, errors.size))
            if not passed:
                break
    return Rehearsal(float(np.sqrt(squares / errors.size)), len(errors), passed)
