"""First stage of the multi-start search: each start fitted over short windows, which tolerate wrong parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..plant.plant import Plant
from .fit_result import Diverged, Fit, Progress
from .gauss_newton import fit
from .parameters import FreeParameter, bounds_of
from .shooting import ShootingWindow
from .uncertainty import SLIP_DEVIATIONS, within_noise

# Engineering judgement.

#: Length of the windows of the first stage [s]: long enough for a few slips, too short to diverge.
SHORT = 0.4
#: Relative standard deviation of the priors that hold the parameters near their start in that stage.
LOOSE = 0.3
#: Largest number of random starts of the first stage, their relative spread, and number of starts in a row without an
#: improvement after which the stage ends.
WINDOW_DRAWS, WINDOW_SPREAD, PATIENCE = 10, 0.15, 3
#: Residuals of short windows above this multiple of the noise's variance are model errors, which no parameters remove.
#: The channels are then weighted by their residuals instead of their noise, and the logged input is taken as exact.
MISFIT = 3.0


class WindowOptimum(NamedTuple):
    """Result of the window stage: cost per residual, name of the start, parameter values."""

    cost: float
    name: str
    values: np.ndarray


@dataclass(frozen=True)
class WindowStage:
    """Fits of a plant over short windows."""

    plant: Plant
    parameters: tuple[FreeParameter, ...]
    windows: Sequence[ShootingWindow]
    watch: Callable[[Progress], None] | None

    def run(self, candidates: Mapping[str, np.ndarray], random: np.random.Generator) -> list[WindowOptimum] | Diverged:
        """Fit each candidate over short windows; the best first.

        Short windows have local minima too, but fits are cheap, and the cost shows them: until one is as small as
        noise, further starts are drawn between the candidates.
        """
        optima: list[WindowOptimum] = []
        best: Fit | None = None
        diverged: Diverged | None = None
        named, first = list(candidates.items()), np.array(list(candidates.values()))
        without_gain, fine = 0, False
        for number in range(len(named) + WINDOW_DRAWS):
            if number < len(named):
                name, values = named[number]
            else:
                share = random.random(first.shape[1])
                away = np.exp(WINDOW_SPREAD * random.standard_normal(first.shape[1]))
                name = f"window draw {number - len(named) + 1}"
                values = away * (share * first[0] + (1.0 - share) * first[-1])
            found = self._fit(name, values, self.windows)
            if isinstance(found, Diverged):
                diverged = found
                continue
            lowest = best.reduced_cost if best is not None else np.inf
            without_gain = 0 if found.reduced_cost < 0.995 * lowest else without_gain + 1
            optima.append(WindowOptimum(found.reduced_cost, name, found.values))
            best = found if found.reduced_cost < lowest else best
            fine = fine or within_noise(found, 1.0)
            if number + 1 >= len(named) and (fine or without_gain >= PATIENCE):
                break
        if best is None:
            assert diverged is not None
            return diverged
        optima.sort(key=lambda optimum: optimum.cost)
        if best.reduced_cost <= MISFIT:
            optima[:0] = self._without_missed_slips(best)
        return optima

    def _without_missed_slips(self, best: Fit) -> list[WindowOptimum]:
        """Fit the best start again without windows that miss a slip, because these bias the parameters."""
        excess = [size for size, _ in best.worst_blocks]
        windows = [w for w, size in zip(self.windows, excess, strict=True) if size < 2.0 * SLIP_DEVIATIONS]
        if len(windows) == len(self.windows) or 2 * len(windows) < len(self.windows):
            return []
        name = "without misses"
        found = self._fit(name, best.values, windows)
        return [] if isinstance(found, Diverged) else [WindowOptimum(found.reduced_cost, name, found.values)]

    def _fit(self, name: str, values: np.ndarray, windows: Sequence[ShootingWindow]) -> Fit | Diverged:
        """Fit over short windows with a loose prior around the start values."""
        held = [
            replace(parameter, value=float(value), prior_sd=parameter.prior_sd or LOOSE * abs(value) or None)
            for parameter, value in zip(self.parameters, np.clip(values, *bounds_of(self.parameters)), strict=True)
        ]
        return fit(
            self.plant, windows, held, stage=f"{name}, windows of {SHORT:g} s", steps=15, enough=1e-2,
            drive_errors=False, watch=self.watch,
        )  # fmt: skip
