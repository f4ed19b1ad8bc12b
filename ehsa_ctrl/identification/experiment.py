"""Design of an experiment: an input within a plant's limits that determines its free parameters.

Inputs are compared by the covariance that the estimator will report for their log (see `forecast`), for the nominal
plant. The excitations of the bench are tried at several time scales, seeds and amplitudes up to the largest that the
limits allow. Information adds over pieces of a log, so that complementary pairs are found without simulating all of
them. The best are then tried in full on the plant and on variations of it.

Source: optimal input design by the Fisher information, G. C. Goodwin, R. L. Payne, "Dynamic System Identification:
Experiment Design and Data Analysis", 1977; here over a library of inputs instead of spectra, because the plant sticks.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError, choices
from ..core.files import write_text
from ..core.plotting import draw
from ..core.result import Result, as_dict
from ..plant.file import label
from ..plant.plant import Plant
from ..simulation.trajectory import Trajectory, versions
from .input_limits import LimitUse
from .input_search import CRITERIA, InputCandidate, InputSearch, Watch
from .parameters import free_parameters
from .predicted_accuracy import MonteCarloCheck, PredictedAccuracy, percent

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

#: Shortest and longest experiment [s].
SHORTEST, LONGEST = 1.0, 600.0


@dataclass(frozen=True, repr=False)
class ExperimentDesign(Result):
    """A proposed input and the accuracy to expect from it.

    Attributes
    ----------
    plant: the nominal plant.
    time, current: (N,) s and A, or the unit of another drive, to apply from rest.
    centre: whether the bench's slow loop around the rod has to be on too, because without it the rod of a plant with
        somewhat different parameters leaves its stroke.
    chosen: the selected candidate. candidates: all that were tried in full, best first.
    checks: number of a candidate -> check of its predicted sd on simulated logs; empty if none was asked for.
    at_worst: name -> largest relative sd over the variations of the plant, calibrated like the forecast.
    margin: share of each limit that the nominal plant leaves. spread: relative error of the variations' parameters.
    draws: number of variations that keep the limits without margin.
    criterion: "worst" or "D".
    """

    plant: Plant
    time: np.ndarray
    current: np.ndarray
    centre: bool
    chosen: InputCandidate
    candidates: tuple[InputCandidate, ...]
    checks: Mapping[int, MonteCarloCheck]
    at_worst: Mapping[str, float]
    margin: float
    spread: float
    draws: int
    criterion: str
    seed: int
    seconds: float
    provenance: dict[str, str] = field(default_factory=versions)

    @property
    def run(self) -> Trajectory:
        """The nominal plant under the input."""
        return self.chosen.forecast.run

    @property
    def check(self) -> MonteCarloCheck | None:
        """That of the chosen candidate."""
        return self.checks.get(self.candidates.index(self.chosen))

    @property
    def calibration(self) -> float:
        """Factor on the sd of linear theory from the check on simulated logs; one if errors were no larger."""
        return _calibration(self.check)

    @property
    def forecast(self) -> PredictedAccuracy:
        """Expected standard deviations, calibrated."""
        return self.chosen.forecast.scaled(self.calibration)

    @property
    def limits(self) -> tuple[LimitUse, ...]:
        """How close the input comes to each limit."""
        return self.chosen.limits

    @property
    def undetermined(self) -> dict[str, tuple[str, ...]]:
        """Parameters that even this input does not determine -> the parameters that each trades off against."""
        return self.forecast.undetermined

    def write(self, path: str | Path) -> Path:
        """Write columns t and current (or another drive) for `ehsa-ctrl simulate --input`, replacing such a file."""
        import pandas

        table = pandas.DataFrame({"t": self.time.round(6), self.plant.structure.system.drive: self.current.round(6)})
        return write_text(path, table.to_csv(index=False))

    def to_pandas(self) -> pandas.DataFrame:
        """One row a candidate, best first: its parts, criterion, and the relative sd of each parameter."""
        import pandas

        return pandas.DataFrame([{"input": c.words, "score": c.score, **c.forecast.relative} for c in self.candidates])

    def plot(self) -> Figure:
        """Current, speed, pressures and position with the limits, and the expected sd of each parameter."""
        return draw(self)

    def to_dict(self) -> dict[str, Any]:
        """The content of excitation.json."""
        relative = self.forecast.relative
        return as_dict(
            self, "centre margin calibration undetermined seed seconds provenance",
            parameters={
                e.name: as_dict(
                    e, "sd unit verdict", believed=e.value, relative_sd=relative[e.name],
                    relative_sd_at_worst=self.at_worst[e.name], trades_with=e.trades,
                )
                for e in self.forecast.estimates
            },
            input=self.chosen.words,
            kind=self.chosen.shape.kind,
            parts=[
                as_dict(part, "kind pace seed share", amplitude=part.size * self.chosen.amplitude)
                for part in self.chosen.shape.parts
            ],
            duration=float(self.time[-1]),
            sample_time=float(self.time[1] - self.time[0]),
            peak=float(np.max(np.abs(self.current))),
            limits={use.limit: as_dict(use, "allowed reached worst unit share worst_share") for use in self.limits},
            variations=as_dict(self, "draws spread"),
            candidates=[
                as_dict(
                    c, "score centre", input=c.words, not_determined=c.rank[0], relative_sd=c.forecast.relative,
                    tightest_limit=c.tightest.limit if c.tightest else None, rehearsal=self.checks.get(number),
                )
                for number, c in enumerate(self.candidates)
            ],
        ) | {"criterion": {"name": self.criterion, "value": self.chosen.score}}  # fmt: skip

    def _lines(self) -> Iterator[str]:
        yield f"{self.plant.name} ({self.plant.model}): {self.chosen.words}; {self.time[-1]:g} s from rest"
        yield self.forecast.table(self.at_worst if self.draws else None)
        for name, trades in self.undetermined.items():
            others = f"; it trades with {', '.join(map(label, trades))}" if trades else ""
            yield f"  {label(name)}: no candidate determines it{others}"
        others = f"; at worst of {self.draws} plants with parameters up to {100 * self.spread:.0f} % off"
        yield "limits" + (others if self.draws else "")
        for use in self.limits:
            yield f"  {use}"
        what = {"worst": "largest relative sd of a parameter", "D": "mean relative axis of the uncertainty"}
        yield f"candidates: {what[self.criterion]}, with nominal or high friction, whichever is worse"
        for number, c in enumerate(self.candidates):
            tried = self.checks.get(number)
            errors = f"; rehearsed, errors {tried.ratio:.2f} sd" if tried is not None else ""
            missing = f", {c.rank[0]} not determined" if c.rank[0] else ""
            yield f"  {percent(c.score):>9}  {c.words}{missing}{errors}"
        if self.check is not None:
            yield str(self.check)
            if self.calibration > 1.0:
                yield f"all expected sd above are {self.calibration:.2f} times those of the linear theory"
        yield (
            "apply it with the slow loop around the rod on: without it a plant with slightly different parameters "
            "leaves the stroke" if self.centre else "apply it as it is, without a loop around the rod"
        )  # fmt: skip

    def __str__(self) -> str:
        return "\n".join(self._lines())


def design_experiment(
    plant: Plant,
    *,
    duration: float = 20.0,
    kind: str = "best",
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    amplitude: float | None = None,
    criterion: str = "worst",
    margin: float = 0.15,
    spread: float = 0.3,
    draws: int = 8,
    rehearsals: int = 6,
    seed: int = 0,
    jobs: int | None = None,
    watch: Watch | None = None,
) -> ExperimentDesign:
    """Propose an input, within the plant's limits, that determines the free parameters as accurately as possible.

    Parameters
    ----------
    duration: s, from rest.
    kind: noise (band-limited, as in the paper), multisine, steps, sine, chirp, ramp, or best: the best of them all,
        two of them one after the other included.
    free, fix: as for `identify`.
    amplitude: largest current to use, A, or the unit of another drive; by default what the limits allow.
    criterion: "worst": the largest relative sd of a parameter; "D": the volume of the uncertainty, as the geometric
        mean of its axes. The number of undetermined parameters counts first.
    margin: share of the way from rest to each limit that the nominal plant leaves.
    spread, draws: number of variations of the plant, with free parameters off by up to `spread` (two sd where the
        plant has one), that have to keep the limits without margin.
    rehearsals: number of simulated noisy logs from which the parameters are estimated with the best candidate; if the
        estimates scatter more than predicted the next best is taken, up to three of them. 0: no check.
    seed: of the random inputs, the variations and the simulated logs.
    jobs: threads; all cores by default.
    watch: is called with the stage, the number of items done and their total.

    Raises
    ------
    InputError: values out of range, a system whose motion is prescribed, no input within the limits that moves shaft
        and rod, a free parameter that no measured channel shows.
    """
    began = clock.monotonic()
    if plant.structure.system.prescribed:
        raise InputError(
            f"{plant.name}: the motion of its rod is prescribed, and an experiment needs one beside the "
            f"{plant.structure.system.drive}; inputs are designed for systems with one drive"
        )
    if not SHORTEST <= duration <= LONGEST:
        raise InputError(f"duration = {duration:g} s; expected {SHORTEST:g} to {LONGEST:g} s")
    if criterion not in CRITERIA:
        raise InputError(f"no criterion {criterion!r}; {choices(criterion, CRITERIA)}")
    if amplitude is not None and not 0.0 < amplitude < np.inf:
        raise InputError(f"amplitude = {amplitude:g} {plant.structure.system.drive_unit}; expected more than 0")
    if not 0.0 <= margin < 1.0:
        raise InputError(f"margin = {margin:g}; expected a share of the limits, 0 or more and less than 1")
    if not 0.0 <= spread < 1.0:
        raise InputError(f"spread = {spread:g}; expected a relative error of the parameters, 0 or more and less than 1")
    if draws < 0 or seed < 0 or rehearsals < 0:
        raise InputError(f"draws = {draws}, seed = {seed}, rehearsals = {rehearsals}; expected 0 or more")
    if not plant.limits and amplitude is None:
        raise InputError(f"{plant.path or plant.name}: has no [limits], so any input is allowed; give an amplitude")
    parameters = free_parameters(plant, free=free, fix=fix)
    search = InputSearch(plant, parameters, duration, amplitude, criterion, margin, spread, draws, seed, jobs, watch)
    candidates = search.candidates(kind)
    chosen, checks = search.checked(candidates, rehearsals)
    factor = _calibration(checks.get(candidates.index(chosen)))
    return ExperimentDesign(
        plant=plant,
        time=search.time,
        current=chosen.current,
        centre=chosen.centre,
        chosen=chosen,
        candidates=tuple(candidates),
        checks=checks,
        at_worst={name: value * factor for name, value in search.worst_relative(chosen).items()},
        margin=margin,
        spread=spread,
        draws=len(search.others),
        criterion=criterion,
        seed=seed,
        seconds=clock.monotonic() - began,
    )


def _calibration(check: MonteCarloCheck | None) -> float:
    return max(1.0, check.ratio) if check is not None and check.logs else 1.0
