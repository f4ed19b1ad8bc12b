"""The result of an identification: the plant, the accuracy of its parameters, and its fit on other logs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.errors import InputError, choices
from ..core.plotting import draw
from ..core.result import Result, as_dict, as_table
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .balances import BalanceEstimate
from .checks import LogFinding
from .comparison import Comparison
from .fit_result import Fit
from .identification_text import identification_text
from .initial_state import sensor_sd
from .residual_tests import Correlation
from .uncertainty import Estimate, ParameterCovariance, within_noise

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FreeRuns:
    """Free runs of some logs with the identified plant (after) and with the plant before the identification."""

    after: tuple[Comparison, ...]
    before: tuple[Comparison, ...]

    @property
    def fit_percent(self) -> dict[str, float]:
        """Fit of each channel, all logs taken together."""
        return _pooled_fit(self.after)

    @property
    def fit_percent_before(self) -> dict[str, float]:
        return _pooled_fit(self.before)


def _pooled_fit(comparisons: tuple[Comparison, ...]) -> dict[str, float]:
    """100 (1 - ||y - yhat|| / ||y - mean(y)||) with the norms over all logs, each with its own mean."""
    found = {}
    for channel in dict.fromkeys(channel for run in comparisons for channel in run.fit_percent):
        runs = [run for run in comparisons if channel in run.fit_percent]
        error = sum(float(np.sum((run.log[channel] - run.simulated[channel]) ** 2)) for run in runs)
        spread = sum(float(np.sum((run.log[channel] - np.mean(run.log[channel])) ** 2)) for run in runs)
        found[channel] = 100.0 * (1.0 - math.sqrt(error / spread)) if spread > 0.0 else math.nan
    return found


@dataclass(frozen=True, repr=False)
class Identification(Result):
    """A plant identified from logs.

    Attributes
    ----------
    plant: with the identified values; `write_plant` makes a TOML of it. nominal: the plant before.
    method: "simulation" or "balances", which gave `estimates`.
    estimates: value, sd, interval and verdict of each parameter, and the parameters that it is correlated with.
    other_estimates: the same by the other method, if there is one; no_simulation: why the simulation gave none.
    uncertainty: covariance and correlation.
    fit: the minimum of the simulation error; None if only the balances were used.
    balances: the estimate from balances, if the system has any.
    starts: name of each start and the cost that it reached. starts_agree, disagreement: see
        `multi_start.SearchResult`.
    train, validation: free runs of the logs used, and of those held out.
    residual_tests: correlation of the residuals, which a better model could explain.
    findings: results of `check_log`.
    window: length of the windows of the cost [s]; None for whole logs in free run. fell_back: short windows were
        fitted, because no start fitted the whole logs in free run.
    interrupted: the search was stopped by Ctrl-C; this is its best result so far.
    """

    plant: Plant
    nominal: Plant
    method: Literal["simulation", "balances"]
    estimates: tuple[Estimate, ...]
    other_estimates: tuple[Estimate, ...]
    no_simulation: str
    uncertainty: ParameterCovariance
    fit: Fit | None = field(repr=False)
    balances: BalanceEstimate | None
    starts: tuple[tuple[str, float], ...]
    starts_agree: bool
    disagreement: tuple[float, float] | None
    train: FreeRuns = field(repr=False)
    validation: FreeRuns = field(repr=False)
    residual_tests: tuple[Correlation, ...] = field(repr=False)
    findings: tuple[LogFinding, ...]
    window: float | None
    interrupted: bool
    seconds: float
    fell_back: bool = False
    provenance: dict[str, str] = field(default_factory=versions)

    def __getitem__(self, name: str) -> Estimate:
        """The row of a parameter. Raises InputError for one that was not estimated."""
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise InputError(f"{name} was not estimated; {choices(name, [e.name for e in self.estimates])}")

    @property
    def explained(self) -> bool:
        """Whether the noise of sensors and input explains the size of the residuals."""
        return self.fit is not None and within_noise(self.fit)

    @property
    def noise_ratio(self) -> float:
        """Mean square of the residuals over the variance due to noise; 1 for pure noise.

        The residuals are whitened, which includes the noise of the logged input, unless they are weighted by
        themselves.
        """
        if self.fit is None:
            return math.nan
        if not self.fit.weighted:
            return self.fit.noise_ratio
        squares, count = 0.0, 0
        for run in self.fit.iterate.runs:
            noise = [sensor_sd(self.plant, run.window.log, channel) for channel in run.measured.channels]
            squares += float(np.sum((run.residual / np.array(noise)) ** 2))
            count += run.residual.size
        return squares / count

    @property
    def noise_sd(self) -> dict[str, float]:
        """Input and channels -> standard deviation by which the cost weights them, SI units."""
        if self.fit is None:
            return {}
        measured, system = self.fit.iterate.runs[0].measured, self.plant.structure.system
        channels = dict(zip(measured.channels, measured.sd.tolist(), strict=True))
        return {system.drives[system.inputs[0]]: measured.input_sd, **channels}

    @property
    def search_warnings(self) -> tuple[str, ...]:
        """Reasons why the minimum may be a local one, in sentences."""
        if self.method != "simulation":
            return ()
        found = []
        if self.fell_back:
            found.append(
                f"no start fits the logs in free run, so windows of {self.window:.3g} s were fitted: where the rod "
                "hardly moves, noise decides when it slips; use a log with more motion (see ehsa-ctrl excite)"
            )
        if not self.starts_agree:
            count = len(self.starts)
            starts = "the only start leaves more than noise"
            if count != 1:
                starts = f"no two of {count} starts reached the same minimum"
            found.append(
                f"{starts}: a lower one may exist, so no parameter counts as well determined; try more starts "
                "(--starts)"
            )
        if self.disagreement is not None:
            low, high = self.disagreement
            found.append(
                f"starts agree in the parameters but not in the cost ({low:.5g} and {high:.5g} times the noise's "
                "variance): slips of the rod separate local minima, and a lower one may exist; try more starts "
                "(--starts)"
            )
        return tuple(found)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the standard deviations and verdicts, in sentences; empty for a sound result."""
        if self.method != "simulation" or self.fit is None:
            return ()
        failed = [test for test in self.residual_tests if not test.passed]
        if not self.explained:
            left = (
                f"residuals have {self.noise_ratio:.3g} times the noise's variance: the model is incomplete, and "
                "parameter errors may be larger than the standard deviations"
            )
            return (*self.search_warnings, left)
        if failed:
            tests = ", ".join(f"{test.channel} with {test.against}" for test in failed[:3])
            tests += f" and {len(failed) - 3} more" if len(failed) > 3 else ""
            left = (
                f"residuals are as small as noise but correlated ({tests}): parameter errors may be larger than the "
                "standard deviations"
            )
            return (*self.search_warnings, left)
        return self.search_warnings

    @property
    def differing(self) -> tuple[str, ...]:
        """Parameters whose estimates by both methods differ by more than two standard deviations of the difference."""
        other = {estimate.name: estimate for estimate in self.other_estimates}
        return tuple(
            e.name
            for e in self.estimates
            if e.name in other
            and math.isfinite(e.sd)
            and abs(e.value - other[e.name].value) > 2.0 * math.hypot(e.sd, other[e.name].sd)
        )

    def _meaning(self, name: str) -> str:
        """Meaning of a parameter of the plant, or of a sensor (SETTING.CHANNEL), in words."""
        word, dot, channel = name.partition(".")
        if dot:
            return f"{word} of the sensor of {channel}"
        meanings = {kind.name: kind.meaning for kind in self.plant.structure.equations.parameters}
        return meanings.get(name, "")

    def to_dict(self) -> dict[str, Any]:
        """The content of identification.json."""
        fit, balances = self.fit, self.balances
        return as_dict(
            self, "warnings search_warnings method findings interrupted seconds provenance",
            parameters={
                e.name: as_dict(
                    e, "value sd unit identifiable verdict at_bound start prior_sd", interval_95=e.interval,
                    trades_with=e.trades, meaning=self._meaning(e.name),
                )
                for e in self.estimates
            },
            beside={
                "method": "balances" if self.method == "simulation" else "simulation",
                "parameters": {e.name: as_dict(e, "value sd unit") for e in self.other_estimates},
                "differing": self.differing,
                "without": self.no_simulation,
            },
            balances=balances and as_dict(
                balances, "method balances undetermined",
                relative_error={closure.name: closure.relative_error for closure in balances.balances},
            ),
            fit_percent={
                "train": self.train.fit_percent,
                "validate": self.validation.fit_percent,
                "before": {"train": self.train.fit_percent_before, "validate": self.validation.fit_percent_before},
                "kind": "free run, driven by the logged drive",
                "start": [run.start.words for run in (*self.train.after, *self.validation.after)],
            },
            runs=[
                as_dict(run, "fit_percent stopped", log=run.log.name, use=use, start=run.start.words)
                for use, reach in (("train", self.train), ("validate", self.validation))
                for run in reach.after
            ],
            correlation=as_dict(
                self.uncertainty, "names covariance", matrix=self.uncertainty.correlation
            ) | {"from": self.uncertainty.source},
            cost=fit and as_dict(
                self, "noise_ratio explained window noise_sd", reduced=fit.reduced_cost, residuals=fit.residuals,
                steps=fit.steps, weights="residuals" if fit.weighted else "noise",
                stopped="interrupted" if self.interrupted else fit.stopped, settled=self.starts_agree,
                starts=[{"name": name, "cost": cost} for name, cost in self.starts],
                sensor_noise_sd={
                    channel: sensor_sd(self.plant, self.train.after[0].log, channel)
                    for channel in self.noise_sd
                    if channel in self.train.fit_percent
                },
            ),
            residual_tests=[as_dict(t, "channel against passed largest band outside") for t in self.residual_tests],
            logs={
                "train": [run.log.path for run in self.train.after],
                "validate": [run.log.path for run in self.validation.after],
            },
        )  # fmt: skip

    def to_pandas(self) -> pandas.DataFrame:
        """One row per parameter."""
        return as_table(
            self.estimates,
            "unit start value sd lower upper verdict trades_with",
            lower=lambda e: e.interval[0],
            upper=lambda e: e.interval[1],
            trades_with=lambda e: ", ".join(e.trades),
        )

    def plot(self) -> Figure:
        """Measured signals and free runs before and after, on the validation logs, else on those used."""
        return draw(self)

    def __str__(self) -> str:
        return identification_text(self)
