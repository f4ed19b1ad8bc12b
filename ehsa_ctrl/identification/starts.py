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
from .window import Window, cut, sensor_sd

#: Length of the windows in which a start finds its way [s]: some events of sticking, not many.
SHORT = 0.4
#: While it does, a parameter is held this loosely at where the start puts it, relative.
LOOSE = 0.3
#: At most so many starts are drawn for the windows, this far apart (relative), until PATIENCE in a row come no lower.
NEAR_DRAWS, NEAR_SPREAD, PATIENCE = 10, 0.15, 3
#: Two starts that end within so much cost of each other, in squared standard deviations, have found the same minimum.
SAME = 10.0
#: Ends within so many standard deviations of the best in every parameter say the same; so many ends it takes to say so.
CLOSE, LEAST_ENDS = 3.0, 3
#: Residuals within so many standard deviations of the noise's size could be noise.
GOOD = 3.0
#: If no two starts agree, so many more begin this many standard deviations around the best end.
AROUND, NEARBY = 4, 12.0
#: At most so many pieces are mended, each from NEAR samples before to NEAR after its middle.
MENDINGS, NEAR = 4, 20
#: Residuals of short windows beyond so many times the noise's variance are the model's own: no parameters make it fit.
#: Each channel is then weighed by the residual that it has, not by its noise, and drives are taken as logged.
MISFIT = 3.0
#: Beyond so many times the noise's variance the logs as they are could not be followed; short windows may be.
LOST = 1.5
#: From so many of the windows' best ends the fit to windows is made then.
FALLS = 3
#: Two such starts have come to the same minimum if their residuals differ in size by less than this, relative.
ALIKE = 0.01
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
        self.ends: list[Fit] = []
        self.settled = self.lost = False
        self.misfit, self.best_size = False, np.inf
        self.tried: list[tuple[str, float]] = []

    def keep(self, found: Fit) -> None:
        """Remember the best so far, also in the middle of a stage."""
        if self.best is None or found.lowered <= self.best.lowered:
            self.best = found

    def run(self, first: Mapping[str, float], starts: int) -> None:
        """Lead at most so many starts to their ends.

        Raises InputError if the plant can't be simulated along the log from any of them.
        """
        plain = np.array([parameter.value for parameter in self.parameters])
        balanced = np.array([first.get(parameter.name, parameter.value) for parameter in self.parameters])
        near = self._near({"balances": balanced, "plant": plain} if first else {"plant": plain})
        # A start whose windows don't fit is a bad start as long as another one's do; else the model is wrong.
        fitting = [each for each in near if each[0] <= MISFIT]
        self.misfit = not fitting
        if self.misfit:
            failed: InputError | None = None
            for _, name, values in near:
                if len(self.tried) == min(starts, 2):
                    break
                try:
                    self._weigh_by_residuals(name, values)
                except InputError as error:
                    failed = error
            if self.best is None and failed is not None:
                raise failed
            sizes = sorted(size for _, size in self.tried)
            self.settled = len(sizes) == 1 or sizes[1] < (1.0 + ALIKE) * sizes[0]
            return
        failure = InputError("no start was tried")
        for number in range(starts):
            # The two best of the windows; more of them would mostly be led to the same end.
            if number < min(len(fitting), 2):
                _, name, values = fitting[number]
            else:
                name, values = f"draw {number - min(len(fitting), 2) + 1}", self._draw(fitting[0][2])
            try:
                self._lead(name, values)
            except InputError as error:
                failure = error
                continue
            if self.best is None:
                continue
            self.lost = number + 1 >= min(len(fitting), 2) and self.best.noise_ratio > MISFIT
            if self.lost:
                break
            if not consistent(self.best):
                continue
            if self._agreeing() > 1:
                break
        if self.best is None:
            raise failure
        self.settled |= self._agreeing() > 1
        if not self.settled and not self.lost and consistent(self.best):
            self._look_around()
        if not self.lost:
            self._polish()
        if self.best.noise_ratio > LOST:
            self._fall_back([values for _, _, values in fitting[:FALLS]])

    def _near(self, candidates: Mapping[str, np.ndarray]) -> list[tuple[float, str, np.ndarray]]:
        """Cost per residual over short windows, name and values of each candidate led through them, the best first.

        Windows have wrong minima too, but a fit to them is cheap and its cost tells: while none is as small as noise,
        values between the candidates are drawn, until some in a row come no lower.
        """
        near: list[tuple[float, str, np.ndarray]] = []
        best: Fit | None = None
        failure: InputError | None = None
        first = np.array(list(candidates.values()))
        since, fine = 0, False
        for number in range(len(first) + NEAR_DRAWS):
            if number < len(first):
                name, values = list(candidates.items())[number]
            else:
                share = self.draws.random(first.shape[1])
                away = np.exp(NEAR_SPREAD * self.draws.standard_normal(first.shape[1]))
                name, values = (
                    f"window draw {number - len(first) + 1}",
                    away * (share * first[0] + (1.0 - share) * first[-1]),
                )
            try:
                found = self._through_windows(name, values)
            except InputError as error:
                failure = error
                continue
            lowest = min((cost for cost, _, _ in near), default=np.inf)
            since = 0 if found.reduced_cost < 0.995 * lowest else since + 1
            near.append((found.reduced_cost, name, found.values))
            best = found if found.reduced_cost < lowest else best
            fine = fine or consistent(found, 1.0)
            if number + 1 >= len(first) and (fine or since >= PATIENCE):
                break
        if failure is not None and not near:
            raise failure
        near.sort(key=lambda each: each[0])
        if best is not None and best.reduced_cost <= MISFIT:
            near[:0] = self._without_misses(best)
        return near

    def _without_misses(self, best: Fit) -> list[tuple[float, str, np.ndarray]]:
        """The same start over the windows that fit: one in which a slip is missed pulls parameters where it likes."""
        kept = [p for p, (size, _) in zip(self.short, best.worst_blocks, strict=True) if size < 2.0 * SPOTTED]
        if len(kept) == len(self.short) or 2 * len(kept) < len(self.short):
            return []
        found = self._through_windows("without misses", best.values, kept)
        return [(found.reduced_cost, "without misses", found.values)]

    def _through_windows(self, name: str, values: np.ndarray, windows: Sequence[Window] = ()) -> Fit:
        """Values led through short windows, each held loosely where it was put."""
        held = [
            replace(parameter, value=float(value), prior_sd=parameter.prior_sd or LOOSE * abs(value) or None)
            for parameter, value in zip(self.parameters, np.clip(values, *self._bounds()), strict=True)
        ]
        return fit(
            self.plant, windows or self.short, held, stage=f"{name}, windows of {SHORT:g} s", steps=15, enough=1e-2,
            drive_errors=False, watch=self.watch,
        )  # fmt: skip

    def _look_around(self) -> None:
        """Starts near the best end, where none from afar came to it: do they lead back to it, or lower?"""
        for number in range(AROUND):
            assert self.best is not None
            try:
                self._lead(f"near {number + 1}", self._draw(self.best.values, wide=NEARBY))
            except InputError:
                continue
            if self._agreeing() > 1:
                self.settled = True
                return

    def _fall_back(self, candidates: Sequence[np.ndarray]) -> None:
        """Short windows instead of the logs as they are, which no start could follow: kept if they fit better."""
        assert self.best is not None
        whole, ends = self.best, []
        for number, values in enumerate(candidates):
            stage = f"windows of {SHORT:g} s, {number + 1}"
            found = fit(
                self.plant, self.short, self.parameters, start=values, stage=stage, enough=1e-4, watch=self.watch
            )
            self.tried.append((stage, found.noise_ratio))
            ends.append(found)
        best = min(ends, key=lambda end: end.lowered)
        if best.noise_ratio >= whole.noise_ratio:
            return
        self.best, self.long, self.ends = best, self.short, ends
        self.settled = self._agreeing() > 1

    def _agreeing(self) -> int:
        """How many ends have come to the same minimum as the lowest one.

        Where the rod sticks and slips, a minimum breaks up into many that a slip more or less tells apart. Then it is
        enough, after LEAST_ENDS starts, that every end that fits as well as noise allows means the same parameters;
        ends that fit worse than that are no rivals.
        """
        low = self._as_low()
        fine = self._acceptable()
        if low == 1 and len(self.ends) >= LEAST_ENDS and fine and all(self._near_best(end) for end in fine):
            return len(self.ends)
        return low

    def _acceptable(self) -> list[Fit]:
        """Ends whose residuals could be noise."""
        return [end for end in self.ends if consistent(end, GOOD)]

    def _as_low(self) -> int:
        """How many ends have the cost of the lowest one."""
        lowest = min(end.lowered for end in self.ends)
        return sum(end.lowered < lowest + SAME for end in self.ends)

    def _near_best(self, end: Fit) -> bool:
        """Whether an end lies within CLOSE standard deviations of the best."""
        assert self.best is not None
        sd = uncertainty(self.best).sd
        known = np.isfinite(sd) & (sd > 0.0)
        return bool(np.all(np.abs(end.values - self.best.values)[known] <= CLOSE * sd[known]))

    @property
    def spread(self) -> np.ndarray:
        """Mean square (k, k) of how far other ends are from the best, where no two have the same cost.

        Ends that fit far worse than the best, against the noise, are none that the search could have believed.
        """
        assert self.best is not None
        k = self.best.values.size
        level = LOST * max(self.best.noise_ratio, 1.0)
        rivals = self._acceptable() if self.settled else [end for end in self.ends if end.noise_ratio < level]
        away = [end.values - self.best.values for end in rivals]
        away = [step for step in away if np.any(step)]
        if not away or self._as_low() > 1:
            return np.zeros((k, k))
        return np.mean([np.outer(step, step) for step in away], axis=0)

    def _lead(self, name: str, values: np.ndarray) -> None:
        """One start over the logs as they are, to its end."""
        found = fit(
            self.plant, self.long, self.parameters, start=values, stage=name, steps=25, enough=1e-4,
            watch=self.watch, keep=self.keep,
        )  # fmt: skip
        self.tried.append((name, found.noise_ratio))
        self.ends.append(found)
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

    def _draw(self, near: np.ndarray, wide: float = 30.0) -> np.ndarray:
        """Values around the best so far, `wide` standard deviations; around `near` while there is none."""
        if self.best is None or self.best.noise_ratio > MISFIT:
            values, spread = near, np.full(near.size, LOOSE / 3.0)
        else:
            values, sd = self.best.values, uncertainty(self.best).sd
            size = np.maximum(np.abs(values), 1e-300)
            spread = np.clip(wide * np.where(np.isfinite(sd), sd, size) / size, 1e-3 * wide, LOOSE)
        return np.clip(values * np.exp(spread * self.draws.standard_normal(values.size)), *self._bounds())


def _residual_rms(found: Fit) -> dict[str, float]:
    """RMS of each channel's residual, in its own unit, but not less than its noise."""
    rms = {}
    for c, channel in enumerate(found.point.runs[0].measurement.channels):
        residual = np.concatenate([run.residual[:, c] for run in found.point.runs])
        noise = sensor_sd(found.plant, found.point.runs[0].window.log, channel)
        rms[channel] = max(float(np.sqrt(np.mean(residual**2))), noise)
    return rms
