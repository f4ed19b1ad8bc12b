"""How likely a scenario passes on a plant that is not known exactly, and which parameter decides it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.controller_interface import Controller
from ..core.errors import InputError, SimulationError
from ..core.parallel import in_rounds, workers
from ..core.plotting import draw
from ..core.text import TextResult
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .campaign import Outcome, line_of, open_campaign
from .influence import Influence, influences
from .metrics import METRICS
from .result import failures_of
from .run import Case, prepare
from .scenario import Scenario
from .spread import Uncertainty, uncertainty_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

#: Runs that a worker gets at once: enough for its answer to be worth the way, few enough for progress to be seen.
CHUNK = 10
#: Of sensors' seeds.
LARGEST_SEED = 2**31


@dataclass(frozen=True)
class MonteCarlo(TextResult):
    """A scenario on many plants.

    Attributes
    ----------
    scenario, controller: names.
    uncertainty: what was drawn. outcomes: in the order of the runs.
    seed: of the draws. interrupted: there are fewer runs than were asked for.
    plant: as believed. files: scenario, controller and plants, as far as they were read from files.
    """

    scenario: str
    controller: str
    uncertainty: Uncertainty
    outcomes: tuple[Outcome, ...]
    seed: int
    interrupted: bool = False
    plant: Plant | None = None
    files: tuple[Path, ...] = ()

    @property
    def passes(self) -> int:
        return sum(outcome.passed for outcome in self.outcomes)

    @property
    def probability(self) -> float:
        """Share of the runs that passed."""
        return self.passes / len(self.outcomes)

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Of the pass probability: exact binomial (C. J. Clopper, E. S. Pearson, Biometrika 26, 1934), by SciPy."""
        from scipy.stats import binomtest

        found = binomtest(self.passes, len(self.outcomes)).proportion_ci(confidence, method="exact")
        return float(found.low), float(found.high)

    @property
    def influences(self) -> tuple[Influence, ...]:
        """What decides pass or fail, the strongest first."""
        return influences(self.outcomes, self.uncertainty.names)

    def to_pandas(self) -> pandas.DataFrame:
        """One row a run: passed, margin, the drawn parameters and the metrics, SI units."""
        import pandas

        rows = [
            {"run": o.run, "passed": o.passed, "margin": o.margin, "seed": o.seed, **o.parameters, **o.metrics}
            for o in self.outcomes
        ]
        return pandas.DataFrame(rows).set_index("run")

    def to_dict(self, confidence: float = 0.95) -> dict[str, Any]:
        """Plain values for montecarlo.json, SI units."""
        return {
            "scenario": self.scenario,
            "controller": self.controller,
            "runs": len(self.outcomes),
            "passes": self.passes,
            "probability": self.probability,
            "confidence": confidence,
            "interval": list(self.interval(confidence)),
            "seed": self.seed,
            "interrupted": self.interrupted,
            "uncertain": [str(parameter) for parameter in self.uncertainty.parameters],
            "influences": [influence.to_dict() for influence in self.influences],
            "failures": self.reasons,
            "provenance": versions(),
        }

    @property
    def reasons(self) -> dict[str, int]:
        """What failed in how many runs, the most frequent first."""
        counts: dict[str, int] = {}
        for outcome in self.outcomes:
            # A metric's name, or "trip" with the limit that was passed.
            words = [" ".join(reason.split()[: 3 if reason.startswith("trip") else 1]) for reason in outcome.failures]
            for word in dict.fromkeys(words):
                counts[word] = counts.get(word, 0) + 1
        return dict(sorted(counts.items(), key=lambda item: -item[1]))

    def plot(self) -> Figure:
        """The decisive parameters: how they lie in runs that pass and in runs that fail."""
        return draw(self)

    def __str__(self) -> str:
        low, high = self.interval()
        lines = [
            f"{self.scenario} with {self.controller}: {self.passes} of {len(self.outcomes)} runs pass, probability "
            f"{self.probability:.3g} (95 %: {low:.3g} to {high:.3g})",
            *(f"  failed: {word} in {count} runs" for word, count in self.reasons.items()),
        ]
        first = self.influences[0] if self.influences else None
        lines.append(f"  {first}" if first is not None else "  nothing was uncertain but the sensors' noise")
        return "\n".join(lines)

    __repr__ = __str__


def monte_carlo(
    scenario: str | Path | Scenario,
    *,
    runs: int = 1000,
    seed: int = 0,
    controller: str | Path | Controller | None = None,
    plant: str | Path | Plant | None = None,
    design: str | Path | Plant | None = None,
    settings: Mapping[str, str | float] | None = None,
    identification: str | Path | None = None,
    jobs: int = 1,
    backend: str | None = None,
    address: str | None = None,
    file: str | Path | None = None,
    anew: bool = False,
    watch: Callable[[int, int], None] | None = None,
) -> MonteCarlo:
    """Run a scenario many times, each on a plant drawn from what is uncertain, with its own seed of sensor noise.

    The controller stays as it was designed on the believed plant. Run k has the same draw whatever the number of runs,
    jobs or machines.

    Parameters
    ----------
    scenario, controller, plant, design, settings: as for `run`. The scenario's [spread] says what is uncertain beyond
        the plant's own file; see `spread.uncertainty_of`.
    identification: an identification.json, whose covariance is drawn from.
    jobs, backend, address: see `core.parallel.workers`; by default threads for a compiled controller, whose
        simulation runs outside Python's lock, and processes for one in plain Python.
    file: where each result is appended as it comes; a file of the same campaign is continued.
    anew: begin the file again instead, once the first results are there.
    watch: called with how many runs are done and how many there will be.

    Returns
    -------
    What is there, also after an interrupt from the keyboard, if at least one run is done.

    Raises
    ------
    InputError: a definition is wrong, nothing is judged by the scenario, or the file is of another campaign.
    """
    if runs < 1:
        raise InputError(f"runs = {runs}: expected at least 1")
    case = prepare(scenario, controller=controller, plant=plant, design=design, settings=settings)
    definition = case.scenario.definition
    if not definition.limits and not definition.expect_trips:
        raise InputError(f"{case.scenario.path or case.scenario.name}: sets no limit, so that every run would pass")
    try:
        uncertainty = uncertainty_of(
            case.nonlinear, definition.spread, Path(identification) if identification else None
        )
    except InputError as error:
        raise InputError(f"{case.scenario.path or case.scenario.name}: {error}") from None
    campaign = open_campaign(None if file is None else Path(file), _mark(case, uncertainty, seed), anew=anew)
    done = {outcome.run: outcome for outcome in campaign.results if outcome.run < runs}
    todo = [number for number in range(runs) if number not in done]
    work = partial(_some, case, uncertainty, seed)
    backend = backend or ("loky" if case.controller.compiled is None else "threading")
    interrupted = False
    try:
        with workers(backend, jobs, address) as count:
            for part in in_rounds(work, todo, count=min(count, max(len(todo) // CHUNK, 1)), chunk=CHUNK):
                campaign.append(map(line_of, part))
                done |= {outcome.run: outcome for outcome in part}
                if watch is not None:
                    watch(len(done), runs)
    except KeyboardInterrupt:
        if not done:
            raise
        interrupted = True
    outcomes = tuple(done[number] for number in sorted(done))
    return MonteCarlo(
        case.scenario.name, case.controller.name, uncertainty, outcomes, seed, interrupted, case.nonlinear, case.files
    )


def _some(case: Case, uncertainty: Uncertainty, seed: int, numbers: Sequence[int]) -> list[Outcome]:
    """Some runs of a campaign; on a worker."""
    return [_one(case, uncertainty, seed, number) for number in numbers]


def _one(case: Case, uncertainty: Uncertainty, seed: int, number: int) -> Outcome:
    rng = np.random.default_rng([seed, number])
    drawn = uncertainty.draw(rng)
    noise = int(rng.integers(LARGEST_SEED))
    plant: Plant = case.nonlinear.set(**drawn)
    definition = case.scenario.definition
    try:
        loop = case.loop(plant, noise)
    except SimulationError as error:
        return Outcome(number, False, float("-inf"), noise, drawn, {}, (str(error),))
    metrics = case.metrics(loop, wanted=tuple(definition.limits))
    judgements = case.judge(metrics)
    failures = failures_of(judgements, loop.trajectory, definition.expect_trips)
    margin = min((judgement.margin for judgement in judgements), default=float("nan"))
    kept: Mapping[str, float] = {name: metrics[name] for name in METRICS if np.isfinite(metrics[name])}
    return Outcome(number, not failures, margin, noise, drawn, kept, failures)


def _mark(case: Case, uncertainty: Uncertainty, seed: int) -> str:
    """What makes two campaigns the same: their results may stand in one file."""
    parts = [
        case.scenario.definition.model_dump(mode="json", exclude={"title", "why", "baseline"}),
        [str(case.nonlinear.structure), case.nonlinear.values, [str(s) for s in case.nonlinear.sensors.values()]],
        [float(f"{value:.9g}") for value in case.controller.settings()],
        [str(parameter) for parameter in uncertainty.parameters],
        None if uncertainty.correlation is None else uncertainty.correlation.tolist(),
        seed,
    ]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:16]
