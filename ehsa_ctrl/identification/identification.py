"""What an identification gives: the plant, how sure its numbers are, and how well it does on logs it has not seen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.plotting import draw
from ..core.text import TextResult
from ..plant.file import both
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .balances import BalanceEstimate
from .checks import Finding
from .estimator import Fit
from .replay import Replay, fit_cell, fit_words
from .uncertainty import Estimate, Uncertainty, consistent
from .whiteness import Correlation
from .window import sensor_sd

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Reach:
    """Free runs of some logs with the identified plant, and with the plant as it was believed before."""

    after: tuple[Replay, ...]
    before: tuple[Replay, ...]

    @property
    def fit_percent(self) -> dict[str, float]:
        """Fit of each channel, all logs taken together."""
        return _pooled(self.after)

    @property
    def fit_percent_before(self) -> dict[str, float]:
        return _pooled(self.before)


def _pooled(replays: tuple[Replay, ...]) -> dict[str, float]:
    """100 (1 - ||y - yhat|| / ||y - mean(y)||) with the norms over all logs, each with its own mean."""
    channels = list(dict.fromkeys(channel for run in replays for channel in run.fit_percent))
    found = {}
    for channel in channels:
        runs = [run for run in replays if channel in run.fit_percent]
        measured = [run.log[channel] for run in runs]
        missed = sum(float(np.sum((y - run.simulated[channel]) ** 2)) for y, run in zip(measured, runs, strict=True))
        spread = sum(float(np.sum((y - np.mean(y)) ** 2)) for y in measured)
        found[channel] = 100.0 * (1.0 - math.sqrt(missed / spread)) if spread > 0.0 else math.nan
    return found


@dataclass(frozen=True)
class Identification(TextResult):
    """A plant identified from logs.

    Attributes
    ----------
    plant: with the identified values; `write_plant` makes a TOML of it. believed: the plant before.
    method: "simulation" or "balances", by which `estimates` were found.
    estimates: one row a parameter: value, sd, interval, verdict, with what it trades places.
    beside: the same by the other method, where there is one; without: why there is none.
    uncertainty: covariance and correlation.
    fit: the minimum of the cost, with what it was computed from; None if only the balances were used.
    balances: what the balances say. tried: starts and the cost that each came to. settled: two
        of them came to the same minimum, or one fits as well as noise allows.
    train, validation: free runs of the logs used, and of those not used.
    residual_tests: is anything left that a better model could explain.
    findings: what `check_log` had to say.
    window: length of the windows of the cost in s; None for whole logs in free run. fell_back: these windows were not
        asked for, no start could follow the logs as they are.
    interrupted: the search was ended by hand; this is the best that it had.
    """

    plant: Plant
    nominal: Plant
    method: Literal["simulation", "balances"]
    estimates: tuple[Estimate, ...]
    beside: tuple[Estimate, ...]
    without: str
    uncertainty: Uncertainty
    fit: Fit | None = field(repr=False)
    balances: BalanceEstimate | None
    tried: tuple[tuple[str, float], ...]
    settled: bool
    train: Reach = field(repr=False)
    validation: Reach = field(repr=False)
    residual_tests: tuple[Correlation, ...] = field(repr=False)
    findings: tuple[Finding, ...]
    window: float | None
    interrupted: bool
    seconds: float
    fell_back: bool = False
    provenance: dict[str, str] = field(default_factory=versions)

    def __getitem__(self, name: str) -> Estimate:
        """The row of a parameter. Raises InputError for one that was not estimated."""
        from ..core.errors import InputError, choices

        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise InputError(f"{name} was not estimated; {choices(name, [e.name for e in self.estimates])}")

    @cached_property
    def explained(self) -> bool:
        """True if the residuals are no larger than the sensors' noise makes them."""
        return self.fit is not None and consistent(self.fit)

    @property
    def noise_ratio(self) -> float:
        """Mean square of the residuals over the variance that the sensors' noise gives them; 1 is all noise.

        Whitened, so that the noise of the logged drive is in it; not so where the residuals had to be the weights.
        """
        if self.fit is None:
            return math.nan
        if not self.fit.weighted:
            return self.fit.noise_ratio
        squares, count = 0.0, 0
        for run in self.fit.point.runs:
            noise = [sensor_sd(self.plant, run.window.log, channel) for channel in run.measurement.channels]
            squares += float(np.sum((run.residual / np.array(noise)) ** 2))
            count += run.residual.size
        return squares / count

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the minimum may be the wrong one, in sentences."""
        if self.method != "simulation":
            return ()
        found = []
        if self.fell_back:
            found.append(
                f"no start could follow the logs in free run, so that windows of {self.window:.3g} s were fitted: "
                "where the rod hardly moves, noise decides when it slips; use a log that moves more (see excite)"
            )
        if not self.settled:
            count = len(self.tried)
            found.append(
                (
                    "the only start does not fit as well as noise allows"
                    if count == 1
                    else f"no two of {count} starts came to the same minimum"
                )
                + ": a lower one may exist, so that nothing is called well determined; try more with --starts"
            )
        return tuple(found)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What stands against the standard deviations and verdicts, in sentences; empty for a sound result."""
        if self.method != "simulation" or self.fit is None:
            return ()
        failed = [test for test in self.residual_tests if not test.passed]
        told = ", ".join(f"{test.channel} with {test.against}" for test in failed[:3])
        told += f" and {len(failed) - 3} more" if len(failed) > 3 else ""
        if not self.explained:
            left = (
                f"residuals have {self.noise_ratio:.3g} times the noise's variance: the model misses something, and "
                "true errors may be larger than the standard deviations"
            )
            return (*self.doubts, left)
        if failed:
            return (
                *self.doubts,
                f"residuals are as small as noise but not as random ({told}): true errors may be larger than the "
                "standard deviations",
            )
        return self.doubts

    @property
    def differing(self) -> tuple[str, ...]:
        """Parameters on which the two methods differ by more than two standard deviations of both together."""
        other = {estimate.name: estimate for estimate in self.beside}
        return tuple(
            e.name
            for e in self.estimates
            if e.name in other
            and math.isfinite(e.sd)
            and abs(e.value - other[e.name].value) > 2.0 * math.hypot(e.sd, other[e.name].sd)
        )

    def to_dict(self) -> dict[str, Any]:
        """As it stands in identification.json."""
        return {
            "warnings": list(self.warnings),
            "parameters": {
                e.name: {
                    "value": e.value,
                    "sd": e.sd,
                    "unit": e.unit,
                    "identifiable": e.identifiable,
                    "verdict": e.verdict,
                    "interval_95": list(e.interval),
                    "trades_with": list(e.trades),
                    "at_bound": e.at_bound,
                    "start": e.start,
                    "prior_sd": e.prior_sd,
                }
                for e in self.estimates
            },
            "method": self.method,
            "beside": {
                "method": "balances" if self.method == "simulation" else "simulation",
                "parameters": {e.name: {"value": e.value, "sd": e.sd, "unit": e.unit} for e in self.beside},
                "differing": list(self.differing),
                "without": self.without,
            },
            "balances": None
            if self.balances is None
            else {
                "method": self.balances.method,
                "relative_error": {fit.name: fit.relative_error for fit in self.balances.balances},
                "undetermined": self.balances.undetermined,
            },
            "fit_percent": {
                "train": self.train.fit_percent,
                "validate": self.validation.fit_percent,
                "before": {
                    "train": self.train.fit_percent_before,
                    "validate": self.validation.fit_percent_before,
                },
                "kind": "free run, driven by the logged drive",
                "start": [run.start.words for run in (*self.train.after, *self.validation.after)],
            },
            "correlation": {
                "names": list(self.uncertainty.names),
                "matrix": self.uncertainty.correlation,
                "covariance": self.uncertainty.covariance,
                "from": self.uncertainty.source,
            },
            "cost": None
            if self.fit is None
            else {
                "reduced": self.fit.reduced_cost,
                "noise_ratio": self.noise_ratio,
                "weights": "residuals" if self.fit.weighted else "noise",
                "explained": self.explained,
                "residuals": self.fit.residuals,
                "steps": self.fit.steps,
                "stopped": "interrupted" if self.interrupted else self.fit.stopped,
                "window": self.window,
                "starts": [{"name": name, "cost": cost} for name, cost in self.tried],
                "settled": self.settled,
                "noise_sd": self.noise_sd,
            },
            "residual_tests": [
                {
                    "channel": test.channel,
                    "against": test.against,
                    "passed": test.passed,
                    "largest": test.largest,
                    "band": test.band,
                }
                for test in self.residual_tests
            ],
            "logs": {
                "train": [run.log.path for run in self.train.after],
                "validate": [run.log.path for run in self.validation.after],
            },
            "findings": [finding.to_dict() for finding in self.findings],
            "interrupted": self.interrupted,
            "seconds": self.seconds,
            "provenance": self.provenance,
        }

    @property
    def noise_sd(self) -> dict[str, float]:
        """Standard deviation by which each channel was weighted, and that of the drive."""
        if self.fit is None:
            return {}
        measurement = self.fit.point.runs[0].measurement
        system = self.plant.structure.system
        found = dict(zip(measurement.channels, measurement.sd.tolist(), strict=True))
        return {system.drives[system.inputs[0]]: measurement.input_sd, **found}

    def to_pandas(self) -> pandas.DataFrame:
        """One row a parameter."""
        import pandas

        rows = [
            {
                "name": e.name,
                "unit": e.unit,
                "start": e.start,
                "value": e.value,
                "sd": e.sd,
                "lower": e.interval[0],
                "upper": e.interval[1],
                "verdict": e.verdict,
                "trades_with": ", ".join(e.trades),
            }
            for e in self.estimates
        ]
        return pandas.DataFrame(rows).set_index("name")

    def plot(self) -> Figure:
        """Measured, before and after, on the validation logs if there are any, else on those used."""
        return draw(self)

    def _lines(self) -> Iterator[str]:
        used = ", ".join(run.log.name for run in self.train.after)
        how = "free run" if self.window is None else f"windows of {self.window:.3g} s"
        if self.method == "balances" and self.balances is not None:
            how = f"balances, {self.balances.method}"
        yield f"{self.plant.name} ({self.plant.model}) identified from {used}, {how}; computed in {self.seconds:.1f} s"
        if self.interrupted:
            yield "  interrupted: this is the best so far, not the minimum"
        width = max(12, *(len(both(e.name)) for e in self.estimates))
        yield f"  {'':<{width}} {'value':>11} {'sd':>9} {'':>8} {'start':>11} {'unit':<10}"
        for e in self.estimates:
            relative = f"{100 * e.relative_sd:.2g} %" if e.relative_sd < 10 else "-"
            words: str = "" if e.identifiable else e.verdict
            if e.at_bound:
                words += f", at its {e.at_bound} bound"
            if e.trades and not e.identifiable:
                words += f", trades with {', '.join(map(both, e.trades))}"
            sd = f"{e.sd:.2g}" if math.isfinite(e.sd) else "-"
            numbers = f"  {both(e.name):<{width}} {e.value:>11.5g} {sd:>9} {relative:>8} {e.start:>11.5g}"
            yield f"{numbers} {e.unit:<10} {words}".rstrip()
        if self.method == "balances" and self.balances is not None:
            for balance in self.balances.balances:
                yield f"  {balance.name} balance: relative error {100 * balance.relative_error:.2f} %"
            yield from self._beside()
        elif self.fit is not None:
            yield (
                f"  residuals {self.noise_ratio:.3g} times the noise's variance"
                + ("" if self.explained else ": more than noise is left, standard deviations are from the residuals")
                + (", and so are the channels' weights" if self.fit.weighted else "")
            )
        yield from (f"  warning: {sentence}" for sentence in self.warnings)
        yield "  fit in free run, %   " + "".join(f"{channel:>11}" for channel in self.train.fit_percent)
        for name, reach in (("used", self.train), ("held out", self.validation)):
            if reach.after:
                for word, fits in (("before", reach.fit_percent_before), ("after", reach.fit_percent)):
                    yield f"    {name + ', ' + word:<19}" + "".join(f"{fit_cell(value):>11}" for value in fits.values())
        where, reach = ("held out", self.validation) if self.validation.after else ("on the logs used", self.train)
        if words := fit_words(reach.fit_percent):
            yield f"  fit {where}: {words}"
        failed = [test for test in self.residual_tests if not test.passed]
        if failed:
            told = ", ".join(f"{test.channel} with {test.against} ({test.largest:.2g})" for test in failed[:4])
            more = f" and {len(failed) - 4} more" if len(failed) > 4 else ""
            yield f"  left in the residuals, largest correlation: {told}{more}"

    def _beside(self) -> Iterator[str]:
        """The other method's estimate, and why it may differ."""
        if self.without:
            yield f"  no estimate by simulation: {self.without}"
        if not self.beside:
            return
        how = "free run" if self.window is None else f"windows of {self.window:.3g} s"
        yield f"  by simulation ({how}):"
        for e in self.beside:
            sd = f"{e.sd:.2g}" if math.isfinite(e.sd) else "-"
            words = "" if e.identifiable else e.verdict
            yield f"    {both(e.name):<10} {e.value:>11.5g} {sd:>9} {e.unit:<10} {words}".rstrip()
        differ = ", ".join(map(both, self.differing))
        yield (
            (f"  {differ} differ: " if differ else "  no parameter differs by more than two deviations: ")
            + "balances weigh the error of a force at every instant, the simulation what it adds up to; what the model "
            "lacks goes into other parameters in the one than in the other"
        )

    def __str__(self) -> str:
        return "\n".join(self._lines())

    __repr__ = __str__
