"""Statistics of many identifications of a known plant: success, coverage, held-out fit, time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

Result = dict[str, Any]

#: An estimate is near if it is within this share of the truth or within this number of standard deviations.
NEAR, DEVIATIONS = 0.03, 2.0


@dataclass(frozen=True)
class Share:
    """A share of `count` cases with its 95 % interval over logs, as errors within one log are correlated."""

    value: float
    lower: float
    upper: float
    count: int

    def __str__(self) -> str:
        return f"{100 * self.value:.2f} % ({100 * self.lower:.2f} to {100 * self.upper:.2f}), {self.count} cases"


def share(hits: Sequence[Sequence[bool]]) -> Share:
    """Pooled share of hits (one sequence per log), with the ratio estimator's interval over logs, within [0, 1].

    Source: W. G. Cochran, "Sampling Techniques", 3rd ed., section 9.7. If all logs agree, that interval has zero width,
    and the Clopper-Pearson interval with one draw per log replaces it.
    """
    sizes = np.array([len(log) for log in hits], dtype=float)
    sums = np.array([sum(log) for log in hits], dtype=float)
    logs, total = np.count_nonzero(sizes), sizes.sum()
    if total == 0:
        return Share(float("nan"), float("nan"), float("nan"), 0)
    value = float(sums.sum() / total)
    if logs < 2 or value in (0.0, 1.0):
        bounds = stats.binomtest(round(value * logs), int(logs)).proportion_ci()
        return Share(value, float(bounds.low), float(bounds.high), int(total))
    se = np.sqrt(np.sum((sums - value * sizes) ** 2) * logs / (logs - 1)) / total
    reach = stats.t.ppf(0.975, logs - 1) * se
    return Share(value, max(value - reach, 0.0), min(value + reach, 1.0), int(total))


@dataclass(frozen=True)
class Parameter:
    """One parameter over all logs: shares near the truth and covered; sd, rms error and mean error in percent of it.

    z: rms of error over sd, one if the sd are right.
    """

    name: str
    identifiable: float
    near: Share
    covered: Share
    sd: float
    rms: float
    bias: float
    z: float


@dataclass(frozen=True)
class Summary:
    """Statistics of one kind of log.

    near: share of the identifiable parameters. covered: share of all parameters with a finite sd. held_out: (log,
    channel) -> percentage points of fit below that of the true parameters (worst, median). failures: messages of failed
    identifications, whose parameters all count as missed. unsettled: number of logs on which no two starts agree;
    covered_settled: share over the other logs.
    """

    runs: int
    failures: tuple[str, ...]
    near: Share
    covered: Share
    covered_settled: Share
    parameters: tuple[Parameter, ...]
    held_out: dict[tuple[str, str], tuple[float, float]]
    explained: int
    unsettled: int
    sd_from_residuals: int
    one_start: int
    reduced_cost: tuple[float, float, float]
    wall: tuple[float, float]
    cpu: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """For a JSON file."""
        plain = {
            name: value for name, value in vars(self).items() if not isinstance(value, Share) and name != "parameters"
        }
        plain["held_out"] = {" ".join(key): value for key, value in self.held_out.items()}
        rows = {p.name: {**vars(p), "near": vars(p.near), "covered": vars(p.covered)} for p in self.parameters}
        return {
            **plain,
            "near": vars(self.near),
            "covered": vars(self.covered),
            "covered_settled": vars(self.covered_settled),
            "parameters": rows,
        }


def is_near(row: Result) -> bool:
    return bool(abs(row["value"] - row["truth"]) <= max(NEAR * abs(row["truth"]), DEVIATIONS * row["sd"]))


def is_covered(row: Result) -> bool:
    return bool(row["interval"][0] <= row["truth"] <= row["interval"][1])


def summary(results: Sequence[Result]) -> Summary:
    """Statistics of several identifications. Raises ValueError if none succeeded."""
    good = [result for result in results if "failure" not in result]
    failures = tuple(result["failure"] for result in results if "failure" in result)
    if not good:
        raise ValueError(f"no identification succeeded: {failures[0] if failures else 'there are none'}")
    names = list(good[0]["parameters"])
    tables = [result["parameters"] for result in good]
    missed = [[False] * len(names)] * len(failures)
    near = [[is_near(row) for row in table.values() if row["identifiable"]] for table in tables]
    covered = [[is_covered(row) for row in table.values() if np.isfinite(row["sd"])] for table in tables]
    costs = [result["reduced_cost"] for result in good]
    keys = [(kind, channel) for kind, fits in good[0]["held_out"].items() for channel in fits]
    lost = {(kind, channel): [_lost(*result["held_out"][kind][channel]) for result in good] for kind, channel in keys}
    wall, cpu = ([result[clock] for result in good] for clock in ("wall", "cpu"))
    return Summary(
        runs=len(results),
        failures=failures,
        near=share(near + missed),
        covered=share(covered),
        covered_settled=share([hits for hits, result in zip(covered, good, strict=True) if result["settled"]]),
        parameters=tuple(_parameter(name, tables) for name in names),
        held_out={key: (max(values), float(np.median(values))) for key, values in lost.items()},
        explained=sum(result["explained"] for result in good),
        unsettled=sum(not result["settled"] for result in good),
        sd_from_residuals=sum(result["sd_from"] == "residuals" for result in good),
        one_start=sum(len(result["tried"]) == 1 for result in good),
        reduced_cost=(min(costs), float(np.median(costs)), max(costs)),
        wall=(float(np.median(wall)), max(wall)),
        cpu=(float(np.median(cpu)), max(cpu)),
    )


def _lost(best: float, mine: float) -> float:
    """Percentage points of fit below that of the true parameters; 100 for a run that stopped early."""
    return best - mine if np.isfinite(mine) else 100.0


def _parameter(name: str, tables: Sequence[Result]) -> Parameter:
    rows = [table[name] for table in tables]
    truth = np.array([row["truth"] for row in rows])
    error = np.array([row["value"] for row in rows]) / truth - 1.0
    sd = np.array([row["sd"] for row in rows]) / np.abs(truth)
    fine = np.isfinite(sd) & (sd > 0.0)
    return Parameter(
        name=name,
        identifiable=float(np.mean([row["identifiable"] for row in rows])),
        near=share([[is_near(row)] for row in rows if row["identifiable"]]),
        covered=share([[is_covered(row)] for row in rows if np.isfinite(row["sd"])]),
        sd=100.0 * float(np.median(sd)),
        rms=100.0 * float(np.sqrt(np.mean(error**2))),
        bias=100.0 * float(np.mean(error)),
        z=float(np.sqrt(np.mean((error[fine] / sd[fine]) ** 2))) if fine.any() else float("nan"),
    )
