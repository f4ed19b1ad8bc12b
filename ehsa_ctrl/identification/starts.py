"""The search for the minimum of a fit's cost: several starts, windows first, pieces that are mended."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.errors import InputError
from ..core.log import Log
from ..plant.plant import Plant
from .estimator import Fit, Point, Progress, fit
from .free import FreeParameter
from .uncertainty import SPOTTED, consistent, uncertainty
from .window import cut, sensor_sd

#: Length of the windows in which a start finds its way [s]: some events of sticking, not many.
SHORT = 0.4
#: While it does, a parameter is held this loosely at where the start puts it, relative.
LOOSE = 0.3
#: Two starts that end within so much cost of each other, in squared standard deviations, have found the same minimum.
SAME = 10.0
#: After so many starts a best one is believed whose cost is within GOOD standard deviations of what noise makes it.
ENOUGH, GOOD = 3, 2.5
#: At most so many pieces are mended, each from NEAR samples before to NEAR after its middle.
MENDINGS, NEAR = 4, 20
#: Residuals of short windows beyond so many times the noise's variance are the model's own: no parameters make it fit.
#: Each channel is then weighed by the residual that it has, not by its noise, and drives are taken as logged.
MISFIT = 3.0
#: How often these weights are made anew.
REWEIGHTED = 4


class Search:
    """Starts one after the other until two of them have come to the same best minimum.

    One that fits as well as noise allows is not enough: where the rod sticks and slips, minima that miss a slip here
    and there leave residuals that are hardly larger, with parameters that are ten deviations off.
    """

    def __init__(
        self,
        plant: Plant,
        logs: Sequence[Log],
        parameters: tuple[FreeParameter, ...],
        window: float | None,
        seed: int,
        watch: Callable[[Progress], None] | None,
    ) -> None:
        self.plant, self.parameters, self.watch = plant, parameters, watch
        self.short = [piece for log in logs for piece in cut(plant, log, SHORT)]
        self.long = [piece for log in logs for piece in cut(plant, log, window)]
        self.draws = np.random.default_rng(seed)
        self.best: Fit | None = None
        self.ends: list[float] = []
        self.settled = False
        self.misfit, self.best_size = False, np.inf
        self.tried: list[tuple[str, float]] = []

    def keep(self, found: Fit) -> None:
        """Remember the best so far, also in the middle of a stage."""
        if self.best is None or found.lowered <= self.best.lowered:
            self.best = found

    def run(self, first: Mapping[str, float], starts: int) -> None:
        plain = np.array([parameter.value for parameter in self.parameters])
        balanced = np.array([first.get(parameter.name, parameter.value) for parameter in self.parameters])
        candidates = [("balances", balanced)] if first else []
        candidates.append(("plant", plain))
        failures: list[InputError] = []
        for number in range(starts):
            if number < len(candidates):
                name, values = candidates[number]
            elif self.best is not None:
                name, values = f"draw {number - len(candidates) + 1}", self._draw(self.best)
            else:
                break
            try:
                self._one(name, values, through_windows=number < len(candidates))
            except InputError as error:
                failures.append(error)
                continue
            near = [cost for cost in self.ends if cost < min(self.ends) + SAME]
            good = number + 1 >= ENOUGH and self.best is not None and consistent(self.best, GOOD)
            if len(near) > 1 or good or (self.misfit and number + 1 >= len(candidates)):
                self.settled = True
                break
        if self.best is None:
            raise failures[0]
        self._polish()

    def _one(self, name: str, values: np.ndarray, *, through_windows: bool) -> None:
        """One start, through short windows unless it is near already, to the end."""
        if through_windows:
            held = [
                replace(parameter, value=float(value), prior_sd=parameter.prior_sd or LOOSE * abs(value) or None)
                for parameter, value in zip(self.parameters, np.clip(values, *self._bounds()), strict=True)
            ]
            near = fit(
                self.plant, self.short, held, stage=f"{name}, windows of {SHORT:g} s", steps=15, enough=1e-2,
                drive_errors=False, watch=self.watch,
            )  # fmt: skip
            values = near.values
            self.misfit = near.reduced_cost > MISFIT
        if self.misfit:
            self._weigh_by_residuals(name, values)
            return
        found = fit(
            self.plant, self.long, self.parameters, start=values, stage=name, steps=25, enough=1e-4,
            watch=self.watch, keep=self.keep,
        )  # fmt: skip
        self.tried.append((name, found.reduced_cost))
        self.ends.append(found.lowered)
        self.keep(found)

    def _weigh_by_residuals(self, name: str, values: np.ndarray) -> None:
        """Minimise the product of the channels' residuals: weights are the residuals of the round before.

        That is the maximum of the likelihood with a variance of its own for each channel, whatever it comes from.
        """
        weights: dict[str, float] | None = None
        for number in range(REWEIGHTED):
            if weights is None:
                weights = self._spreads()
            found = fit(
                self.plant, self.long, self.parameters, start=values, stage=f"{name}, weights {number + 1}", steps=12,
                enough=1e-3, drive_errors=False, weights=weights, watch=self.watch,
            )  # fmt: skip
            values, weights = found.values, _residual_rms(found)
            size = float(np.exp(np.mean(np.log(list(weights.values())))))
            if self.best is None or size < self.best_size:
                self.best, self.best_size = found, size
        self.tried.append((name, self.best_size))

    def _spreads(self) -> dict[str, float]:
        """Standard deviation of each channel itself, the weights to begin with."""
        channels = [c for c in self.plant.structure.system.outputs if c in self.long[0].log.channels]
        return {c: max(float(np.std(self.long[0].log[c])), 1e-300) for c in channels}

    def _polish(self) -> None:
        """Go on from the best to the very minimum."""
        best = self.best
        assert best is not None
        if self.misfit:
            return
        self._go_on(best.point, "best")
        self._mend()

    def _go_on(self, begin: Point, stage: str) -> None:
        """From a point to the minimum that it leads to; kept if it is lower."""
        self.keep(
            fit(self.plant, self.long, self.parameters, begin=begin, stage=stage, watch=self.watch, keep=self.keep)
        )

    def _mend(self) -> None:
        """Where one short piece fits plainly worse than noise, look for the slip that the simulation misses there.

        A rod that is held says nothing of what would break it away, so that no derivative leads there. Other errors of
        the drive just before may: none, or all a little higher or lower.
        """
        for attempt in range(MENDINGS):
            best = self.best
            assert best is not None
            size, run, at = best.worst_block
            if size < SPOTTED or best.point.runs[run].measurement.input_sd == 0.0:
                return
            sd = best.point.runs[run].measurement.input_sd
            before = best.lowered
            for push in (0.0, 1.5, -1.5, 3.0, -3.0):
                errors = [each.copy() for each in best.point.errors]
                errors[run][max(at - NEAR, 0) : at + NEAR] = push * sd
                self._go_on(replace(best.point, errors=tuple(errors), runs=()), f"mending {attempt + 1}")
                if self.best is not None and self.best.lowered < before - SAME:
                    break
            else:
                return

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([p.lower for p in self.parameters]), np.array([p.upper for p in self.parameters])

    def _draw(self, best: Fit) -> np.ndarray:
        """Values around the best so far, wide where the log says little."""
        sd = uncertainty(best).sd
        size = np.maximum(np.abs(best.values), 1e-300)
        spread = np.clip(30.0 * np.where(np.isfinite(sd), sd, size) / size, 0.03, LOOSE)
        drawn = best.values * np.exp(spread * self.draws.standard_normal(size.size))
        return np.clip(drawn, *self._bounds())


def _residual_rms(found: Fit) -> dict[str, float]:
    """RMS of each channel's residual, in its own unit, but not less than its noise."""
    rms = {}
    for c, channel in enumerate(found.point.runs[0].measurement.channels):
        residual = np.concatenate([run.residual[:, c] for run in found.point.runs])
        noise = sensor_sd(found.plant, found.point.runs[0].window.log, channel)
        rms[channel] = max(float(np.sqrt(np.mean(residual**2))), noise)
    return rms
