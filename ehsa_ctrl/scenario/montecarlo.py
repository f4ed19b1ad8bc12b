"""Monte Carlo: the probability that a scenario passes on an uncertain plant, and the parameters that decide it.

Results are appended to a file as they finish, one JSON line per run, so that an interruption loses nothing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.checkpoint import Checkpoint, open_checkpoint
from ..core.errors import InputError, SimulationError
from ..core.parallel import Prefer, in_rounds, worker_count
from ..core.plotting import draw
from ..core.result import Result, as_dict
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .definition import Scenario
from .outcome import Outcome
from .prepare import PreparedScenario, prepare
from .replay import worst
from .result import LimitCheck
from .sensitivity import MIN_RUNS, Influence, influences
from .uncertainty import ParameterUncertainty, uncertainty_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

#: Runs per task: a compromise between the transfer to a worker and visible progress (engineering judgement).
CHUNK = 10
#: Upper bound of the noise seeds.
LARGEST_SEED = 2**31


@dataclass(frozen=True, repr=False)
class MonteCarlo(Result):
    """A scenario on many random plants.

    Attributes
    ----------
    scenario, controller: names.
    uncertainty: distributions of the drawn parameters. outcomes: in the order of the runs.
    seed: of the draws. interrupted: whether there are fewer runs than requested.
    plant: nominal plant. files: input files of scenario, controller and plants.
    limits: metric -> lower and upper bound of the scenario, SI units; None for a side without one.
    """

    scenario: str
    controller: str
    uncertainty: ParameterUncertainty
    outcomes: tuple[Outcome, ...]
    seed: int
    interrupted: bool = False
    plant: Plant | None = None
    files: tuple[Path, ...] = ()
    limits: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)

    @property
    def passes(self) -> int:
        return sum(outcome.passed for outcome in self.outcomes)

    @property
    def probability(self) -> float:
        """Share of the runs that passed."""
        return self.passes / len(self.outcomes)

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Exact binomial confidence interval of the probability (C. J. Clopper, E. S. Pearson, Biometrika 26, 1934)."""
        from scipy.stats import binomtest

        found = binomtest(self.passes, len(self.outcomes)).proportion_ci(confidence, method="exact")
        return float(found.low), float(found.high)

    @property
    def worst(self) -> Outcome:
        """The run farthest beyond its limits, or closest to one if all passed; `run(scenario, draw=...)` replays it."""
        return worst(self.outcomes)

    @property
    def margins(self) -> dict[str, np.ndarray]:
        """Limited metric -> margin of each run (N,), relative to the limit as `LimitCheck.margin`; the metric with the
        smallest 5 % quantile comes first.

        Negative where the limit is violated, -inf where the metric has no value.
        """
        found = {
            name: np.array([LimitCheck(name, o.metrics.get(name, np.nan), *bounds).margin for o in self.outcomes])
            for name, bounds in self.limits.items()
        }
        return dict(sorted(found.items(), key=lambda item: float(np.quantile(item[1], 0.05, method="lower"))))

    @property
    def influences(self) -> tuple[Influence, ...]:
        """Influence of each parameter on passing, the strongest first."""
        return influences(self.outcomes, self.uncertainty.names)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per run: passed, margin, the drawn parameters and the metrics, SI units."""
        import pandas

        rows = [
            {"run": o.run, "passed": o.passed, "margin": o.margin, "seed": o.seed, **o.parameters, **o.metrics}
            for o in self.outcomes
        ]
        return pandas.DataFrame(rows).set_index("run")

    def to_dict(self, confidence: float = 0.95) -> dict[str, Any]:
        """Plain values for montecarlo.json, SI units."""
        return as_dict(
            self, "scenario controller passes probability seed interrupted influences",
            runs=len(self.outcomes), confidence=confidence, interval=self.interval(confidence), failures=self.reasons,
            uncertain=[str(parameter) for parameter in self.uncertainty.parameters], provenance=versions(),
            worst=as_dict(self.worst, "run seed passed margin parameters failures"),
            margins=[self._margin(name, values) for name, values in self.margins.items()],
        )  # fmt: skip

    def _margin(self, name: str, values: np.ndarray) -> dict[str, Any]:
        """Quantiles of a metric's margin and its worst run, plain values."""
        (lower, upper), k = self.limits[name], int(np.argmin(values))
        low, median = (float(np.quantile(values, q, method="lower")) for q in (0.05, 0.5))
        return {
            "metric": name, "lower": lower, "upper": upper, "smallest": float(values[k]), "low": low, "median": median,
            "run": self.outcomes[k].run, "violated": int(np.sum(values < 0.0)),
        }  # fmt: skip

    @property
    def reasons(self) -> dict[str, int]:
        """Violated limit -> number of runs, the most frequent first."""
        counts: dict[str, int] = {}
        for outcome in self.outcomes:
            # The first word is the metric's name, the first three of a trip are "trip: NAME ...".
            words = [" ".join(reason.split()[: 3 if reason.startswith("trip") else 1]) for reason in outcome.failures]
            for word in dict.fromkeys(words):
                counts[word] = counts.get(word, 0) + 1
        return dict(sorted(counts.items(), key=lambda item: -item[1]))

    def plot(self) -> Figure:
        """Figure: margin to each decisive limit over the most influential parameters, passing and failing runs."""
        return draw(self)

    def __str__(self) -> str:
        low, high = self.interval()
        lines = [
            f"{self.scenario} with {self.controller}: {self.passes} of {len(self.outcomes)} runs pass, probability "
            f"{self.probability:.3g} (95 %: {low:.3g} to {high:.3g})",
            *(f"  failed: {word} in {count} run{'s' if count > 1 else ''}" for word, count in self.reasons.items()),
        ]
        if self.influences:
            lines.append(f"  {self.influences[0]}")
        elif self.uncertainty.parameters:
            lines.append(f"  the influence of the parameters shows from {MIN_RUNS} runs on")
        else:
            lines.append("  no influence of parameters: only sensor noise varies")
        lines.append(f"  worst: {self.worst}")
        return "\n".join(lines)


def monte_carlo(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    runs: int = 1000,
    seed: int = 0,
    controller: Any = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
    identification: str | Path | None = None,
    jobs: int | None = None,
    file: str | Path | None = None,
    anew: bool = False,
    watch: Callable[[int, int], None] | None = None,
) -> MonteCarlo:
    """Run a scenario many times, each time on a random plant and with a new seed of the sensor noise.

    The controller keeps its design for the nominal plant. Run k always has the same draw, whatever the number of runs,
    jobs or machines.

    Parameters
    ----------
    scenario, controller, plant, design, settings: as for `run`. `uncertainty.uncertainty_of` defines the distributions.
    identification: path of an identification.json, whose parameters are drawn from its covariance.
    jobs: workers; -1 for all; by default those of joblib's context (`joblib.parallel_config`), else 1. Unless that
        context sets a backend, a compiled controller uses threads, as its simulation releases Python's global lock,
        and a controller in plain Python uses processes.
    file: results are appended to it; the file of an interrupted campaign is continued.
    anew: start the file again as soon as the first results exist.
    watch: callback with the number of finished runs and the total.

    Returns
    -------
    The finished runs; after a keyboard interrupt too, provided that there is at least one.

    Raises
    ------
    InputError: a definition is invalid, the scenario has no limit, or the file belongs to another campaign.
    """
    if runs < 1:
        raise InputError(f"runs = {runs}: expected at least 1")
    case = prepare(scenario, controller=controller, plant=plant, design=design, settings=settings)
    definition = case.scenario.definition
    if not definition.limits and not definition.expect_trips:
        raise InputError(
            f"{case.scenario.path or case.scenario.name}: has no limits, so every run would pass; add [limits]"
        )
    try:
        uncertainty = uncertainty_of(
            case.nonlinear, definition.spread, Path(identification) if identification else None
        )
    except InputError as error:
        raise InputError(f"{case.scenario.path or case.scenario.name}: {error}") from None
    campaign = open_campaign(None if file is None else Path(file), _campaign_key(case, uncertainty, seed), anew=anew)
    done = {outcome.run: outcome for outcome in campaign.results if outcome.run < runs}
    todo = [number for number in range(runs) if number not in done]
    work = partial(_run_chunk, case, uncertainty, seed)
    count = min(worker_count(jobs), max(len(todo) // CHUNK, 1))
    prefer: Prefer = "processes" if case.controller.compiled is None else "threads"
    interrupted = False
    try:
        for part in in_rounds(work, todo, count=count, chunk=CHUNK, prefer=prefer):
            campaign.append(outcome.to_line() for outcome in part)
            done |= {outcome.run: outcome for outcome in part}
            if watch is not None:
                watch(len(done), runs)
    except KeyboardInterrupt:
        if not done:
            raise
        interrupted = True
    outcomes = tuple(done[number] for number in sorted(done))
    return MonteCarlo(
        case.scenario.name, case.controller.name, uncertainty, outcomes, seed, interrupted, case.nonlinear, case.files,
        {name: (bound.min, bound.max) for name, bound in definition.limits.items()},
    )  # fmt: skip


def open_campaign(path: Path | None, key: str, *, anew: bool = False) -> Checkpoint[Outcome]:
    """Continue the campaign in this file, or start one.

    key: hash of all inputs of the results, see `_campaign_key`. anew: replace the campaign in the file.

    Raises InputError if the file belongs to another campaign or is not a campaign file.
    """
    return open_checkpoint(
        path,
        "campaign",
        key,
        Outcome.from_line,
        anew=anew,
        none="is not a file of a Monte Carlo campaign; choose another one",
        other="holds runs of another campaign (scenario, plant, controller, uncertainty or seed differ); choose "
        "another folder, or start again with --force",
        wrong="is not the result of a run",
    )


def _run_chunk(
    case: PreparedScenario, uncertainty: ParameterUncertainty, seed: int, numbers: Sequence[int]
) -> list[Outcome]:
    """Simulate some runs of a campaign on a worker."""
    return [_run_one(case, uncertainty, seed, number) for number in numbers]


def _run_one(case: PreparedScenario, uncertainty: ParameterUncertainty, seed: int, number: int) -> Outcome:
    rng = np.random.default_rng([seed, number])
    drawn = uncertainty.draw(rng)
    noise = int(rng.integers(LARGEST_SEED))
    try:
        found = case.evaluate(case.simulate(case.nonlinear.set(**drawn), noise))
    except SimulationError as error:
        return Outcome(number, False, float("-inf"), noise, drawn, {}, (str(error),))
    margin = min((check.margin for check in found.checks), default=float("nan"))
    finite = {name: value for name, value in found.metrics.items() if np.isfinite(value)}
    return Outcome(number, not found.failures, margin, noise, drawn, finite, found.failures)


def _campaign_key(case: PreparedScenario, uncertainty: ParameterUncertainty, seed: int) -> str:
    """Hash of all inputs of the results: runs with the same key may share a file."""
    parts = [
        case.scenario.definition.model_dump(mode="json", exclude={"title", "why", "baseline"}),
        [str(case.nonlinear.structure), case.nonlinear.values, [str(s) for s in case.nonlinear.sensors.values()]],
        [float(f"{value:.9g}") for value in case.controller.settings()],
        getattr(getattr(case.controller, "law", None), "identity", ""),
        [str(parameter) for parameter in uncertainty.parameters],
        None if uncertainty.correlation is None else uncertainty.correlation.tolist(),
        seed,
    ]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:16]
