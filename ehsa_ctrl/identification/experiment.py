"""Design of an experiment: an input within a plant's limits that makes its free parameters determinable.

Inputs are judged by the covariance that the estimator will report for their log (see `forecast`), with the plant as it
is believed. The excitations of the bench are tried at several paces, seeds and amplitudes up to the largest that the
limits allow; information adds over pieces of a log, so that pairs that complete each other are found without
simulating them all. What is left is tried as it stands on the plant and on variations of it.

Source: optimal input design by the Fisher information, G. C. Goodwin, R. L. Payne, "Dynamic System Identification:
Experiment Design and Data Analysis", 1977; here over a library of inputs instead of spectra, for the plant sticks.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError, choices
from ..core.files import write_text
from ..core.plotting import draw
from ..core.text import TextResult
from ..plant.file import both
from ..plant.plant import Plant
from ..simulation.trajectory import Trajectory, versions
from .admissible import LimitUse
from .forecast import Forecast, percent
from .free import free_parameters
from .rehearsal import Rehearsal
from .search import CRITERIA, Candidate, Search, Watch

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

#: Shortest and longest experiment [s].
SHORTEST, LONGEST = 1.0, 600.0


@dataclass(frozen=True)
class Experiment(TextResult):
    """A proposed input and what to expect of it.

    Attributes
    ----------
    plant: as it is believed.
    time, current: (N,) s and A, what to apply from rest. centre: whether the bench's slow loop around the rod has to
        be on as well, because without it the rod of a plant that is not quite as believed leaves its stroke.
    chosen: the candidate it is. candidates: all that were tried in full, best first.
    rehearsals: candidate's number -> whether the promised sd came out on the bench; empty if none was asked for.
    at_worst: name -> largest relative sd if the plant is one of the variations; calibrated as the forecast is.
    margin: share of each limit that the believed plant leaves. spread: how far the variations' parameters are off.
    draws: how many variations kept the plain limits.
    criterion: "worst" or "D".
    """

    plant: Plant
    time: np.ndarray
    current: np.ndarray
    centre: bool
    chosen: Candidate
    candidates: tuple[Candidate, ...]
    rehearsals: Mapping[int, Rehearsal]
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
        """The believed plant under the input."""
        return self.chosen.forecast.run

    @property
    def calibration(self) -> float:
        """What the deviations of the linear theory are multiplied by, so that they are those that came out rehearsed.

        One where they came out no larger, or where nothing was rehearsed.
        """
        return max(1.0, self.rehearsal.ratio) if self.rehearsal is not None and self.rehearsal.logs else 1.0

    @property
    def forecast(self) -> Forecast:
        """Expected standard deviations, as rehearsals found them where there were some."""
        return self.chosen.forecast.scaled(self.calibration)

    @property
    def limits(self) -> tuple[LimitUse, ...]:
        """How far the input goes towards each limit."""
        return self.chosen.limits

    @property
    def rehearsal(self) -> Rehearsal | None:
        """That of the chosen candidate."""
        return self.rehearsals.get(self.candidates.index(self.chosen))

    @property
    def undetermined(self) -> dict[str, tuple[str, ...]]:
        """Parameters that even this input does not determine -> with what they trade places."""
        return self.forecast.undetermined

    def write(self, path: str | Path) -> Path:
        """Write columns t, current as `ehsa-ctrl simulate --input` reads them, over a file of that name."""
        import pandas

        table = pandas.DataFrame({"t": self.time.round(6), "current": self.current.round(6)})
        return write_text(path, table.to_csv(index=False))

    def to_pandas(self) -> pandas.DataFrame:
        """One row a candidate, best first: its parts, criterion, and the relative sd of each parameter."""
        import pandas

        return pandas.DataFrame([{"input": c.words, "score": c.score, **c.forecast.relative} for c in self.candidates])

    def plot(self) -> Figure:
        """Current, speed, pressures and position with the limits' share, and the expected sd of each parameter."""
        return draw(self)

    def to_dict(self) -> dict[str, Any]:
        """As it stands in excitation.json."""
        relative = self.forecast.relative
        return {
            "parameters": {
                e.name: {
                    "believed": e.value,
                    "sd": e.sd,
                    "relative_sd": relative[e.name],
                    "relative_sd_at_worst": self.at_worst[e.name],
                    "unit": e.unit,
                    "verdict": e.verdict,
                    "trades_with": list(e.trades),
                }
                for e in self.forecast.estimates
            },
            "input": self.chosen.words,
            "kind": self.chosen.shape.kind,
            "parts": [
                {
                    "kind": part.kind, "pace": part.pace, "seed": part.seed, "share": part.share,
                    "amplitude": part.size * self.chosen.amplitude,
                }
                for part in self.chosen.shape.parts
            ],
            "centre": self.centre,
            "duration": float(self.time[-1]),
            "sample_time": float(self.time[1] - self.time[0]),
            "peak": float(np.max(np.abs(self.current))),
            "criterion": {"name": self.criterion, "value": self.chosen.score},
            "limits": {
                use.limit: {
                    "allowed": use.allowed, "reached": use.reached, "worst": use.worst, "unit": use.unit,
                    "share": use.share, "worst_share": use.worst_share,
                }
                for use in self.limits
            },
            "margin": self.margin,
            "calibration": self.calibration,
            "variations": {"draws": self.draws, "spread": self.spread},
            "undetermined": {name: list(trades) for name, trades in self.undetermined.items()},
            "candidates": [
                {
                    "input": c.words, "score": c.score, "not_determined": c.rank[0], "centre": c.centre,
                    "relative_sd": c.forecast.relative, "tightest_limit": c.tightest.limit if c.tightest else None,
                    "rehearsal": asdict(self.rehearsals[number]) if number in self.rehearsals else None,
                }
                for number, c in enumerate(self.candidates)
            ],
            "seed": self.seed,
            "seconds": self.seconds,
            "provenance": self.provenance,
        }  # fmt: skip

    def _lines(self) -> Iterator[str]:
        yield f"{self.plant.name} ({self.plant.model}): {self.chosen.words}; {self.time[-1]:g} s from rest"
        yield self.forecast.table(self.at_worst if self.draws else None)
        for name, trades in self.undetermined.items():
            others = f"; it trades with {', '.join(map(both, trades))}" if trades else ""
            yield f"  {both(name)}: no candidate determines it{others}"
        others = f"; at worst of {self.draws} plants with parameters up to {100 * self.spread:.0f} % off"
        yield "limits" + (others if self.draws else "")
        for use in self.limits:
            yield f"  {use}"
        what = {"worst": "largest relative sd of a parameter", "D": "mean relative axis of the uncertainty"}
        yield f"candidates: {what[self.criterion]}, with friction as believed or high, whichever is worse"
        for number, c in enumerate(self.candidates):
            tried = self.rehearsals.get(number)
            errors = f"; rehearsed, errors {tried.ratio:.2f} sd" if tried is not None else ""
            missing = f", {c.rank[0]} not determined" if c.rank[0] else ""
            yield f"  {percent(c.score):>9}  {c.words}{missing}{errors}"
        if self.rehearsal is not None:
            yield str(self.rehearsal)
            if self.calibration > 1.0:
                yield f"all expected sd above are {self.calibration:.2f} times those of the linear theory"
        yield (
            "apply it with the slow loop around the rod on: without it a plant that is a little other than believed "
            "leaves the stroke" if self.centre else "apply it as it stands, without a loop around the rod"
        )  # fmt: skip

    def __str__(self) -> str:
        return "\n".join(self._lines())

    __repr__ = __str__


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
) -> Experiment:
    """Propose an input that determines the free parameters as well as the limits let it.

    Parameters
    ----------
    duration: s, from rest.
    kind: noise (band-limited, as in the paper), multisine, steps, sine, chirp, ramp, or best: the best of them all,
        two of them one after the other included.
    free, fix: as for `identify`.
    amplitude: most current to use, A; by default what the limits allow.
    criterion: "worst": the largest relative sd of a parameter; "D": the volume of the uncertainty, as the geometric
        mean of its axes. Parameters that an input does not determine count first: fewer of them is better.
    margin: of each limit, this share of the way from rest is left on the believed plant.
    spread, draws: so many variations of the plant, with free parameters off by up to `spread` (two sd where the plant
        has one), have to keep the limits too, without margin.
    rehearsals: so many logs of the bench are made with the best candidate and estimated from; if the estimates scatter
        more than promised the next best is taken, up to three of them. 0: none.
    seed: of the random inputs, of the draws and of the rehearsals.
    jobs: threads; all cores by default.
    watch: is told what is being done, how much of it is done, and of how much.

    Raises
    ------
    InputError: values out of range, a system other than the EHSA, no input within the limits that moves shaft and rod,
        a free parameter that nothing measured shows.
    """
    began = clock.monotonic()
    if plant.structure.system_name != "ehsa":
        raise InputError(
            f"{plant.name} is a {plant.structure.system_name!r} system; inputs are designed for 'ehsa' systems alone"
        )
    if not SHORTEST <= duration <= LONGEST:
        raise InputError(f"duration = {duration:g} s; expected {SHORTEST:g} to {LONGEST:g} s")
    if criterion not in CRITERIA:
        raise InputError(f"no criterion {criterion!r}; {choices(criterion, CRITERIA)}")
    if amplitude is not None and not 0.0 < amplitude < np.inf:
        raise InputError(f"amplitude = {amplitude:g} A; expected more than 0")
    if not 0.0 <= margin < 1.0:
        raise InputError(f"margin = {margin:g}; expected a share of the limits, 0 or more and less than 1")
    if not 0.0 <= spread < 1.0:
        raise InputError(f"spread = {spread:g}; expected a relative error of the parameters, 0 or more and less than 1")
    if draws < 0 or seed < 0 or rehearsals < 0:
        raise InputError(f"draws = {draws}, seed = {seed}, rehearsals = {rehearsals}; expected 0 or more")
    if not plant.limits and amplitude is None:
        raise InputError(
            f"{plant.path or plant.name}: has no [limits], so that any input is allowed; give an amplitude"
        )
    parameters = free_parameters(plant, free=free, fix=fix)
    search = Search(plant, parameters, duration, amplitude, criterion, margin, spread, draws, seed, jobs, watch)
    candidates = search.run(kind)
    chosen, rehearsed = search.rehearsed(candidates, rehearsals)
    at = candidates.index(chosen)
    return Experiment(
        plant=plant,
        time=search.time,
        current=chosen.current,
        centre=chosen.centre,
        chosen=chosen,
        candidates=tuple(candidates),
        rehearsals=rehearsed,
        at_worst={
            name: value * max(1.0, rehearsed[at].ratio if at in rehearsed and rehearsed[at].logs else 1.0)
            for name, value in search.worst_relative(chosen).items()
        },
        margin=margin,
        spread=spread,
        draws=len(search.others),
        criterion=criterion,
        seed=seed,
        seconds=clock.monotonic() - began,
    )
