"""Metrics of a closed loop, defined so that they hold for a plant that sticks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..core.errors import InputError
from ..core.unit import factor, parse
from ..simulation.closed_loop import ClosedLoop
from ..simulation.minimum_time import shortest_time
from .response import hunting, settling_band, step_metrics

#: Hunting is evaluated over this last share of the time after the last change of target.
HUNTING_SHARE = 0.5
#: Trace of the controller that shows supervision, and its value where supervision has stopped the loop.
STATUS, STOPPED = "status", 2.0

#: By SI unit: difference between runs on two machines that a regression ignores.
FLOORS = {
    "s": 0.012, "1": 0.02, "m": 2e-5, "m s": 2e-5, "m2 s": 2e-8, "m s2": 2e-5, "m2 s2": 2e-8, "A": 0.02, "J": 1.0,
}  # fmt: skip


@dataclass(frozen=True)
class Metric:
    """Description of a metric: everything that tables, limits and baselines know of it.

    Attributes
    ----------
    unit: SI. shown: unit in tables and messages. meaning: one line.
    of: what a reference must contain for the metric to be defined: a "step", a "hold", or nothing ("run").
    """

    unit: str
    shown: str
    meaning: str
    of: Literal["run", "step", "hold"] = "run"

    @property
    def scale(self) -> float:
        """SI units in one shown unit."""
        return factor(self.shown, self.unit)

    @property
    def suffix(self) -> str:
        """The shown unit after a number."""
        return "" if self.shown == "1" else f" {self.shown}"

    @property
    def floor(self) -> float:
        """Smallest difference that counts in a regression, SI unit."""
        return FLOORS[self.unit]

    def close(self, old: float, new: float, share: float) -> bool:
        """Whether two values differ by at most the floor and a share of the old one; nan is close to nan."""
        if not (np.isfinite(old) and np.isfinite(new)):
            return bool(np.isnan(old) == np.isnan(new)) and not np.isinf(old) ^ np.isinf(new)
        return abs(new - old) <= self.floor + share * abs(old)

    def format(self, value: float) -> str:
        """A value in the shown unit."""
        if not np.isfinite(value):
            return "never" if np.isinf(value) else "nothing"
        return f"{value / self.scale:.4g}{self.suffix}"

    def format_bounds(self, lower: float | None, upper: float | None) -> str:
        """The bounds of a limit in the shown unit: "at least 1 mm and at most 3 mm"."""
        bounds = (("at least", lower), ("at most", upper))
        return " and ".join(f"{word} {b / self.scale:g}{self.suffix}" for word, b in bounds if b is not None)

    def read_bound(self, value: Any) -> Any:
        """A bound of a limit in the SI unit, from a text such as "0.3 mm"; a number is allowed where there is no unit.

        Raises ValueError for a number without its unit, and for a text that is no quantity of this unit.
        """
        if isinstance(value, int | float) and not isinstance(value, bool) and self.unit != "1":
            raise ValueError(f" = {value}: has no unit; write it as in '{value} {self.shown}'")
        if isinstance(value, str):
            try:
                return parse(value, self.unit)
            except InputError as error:
                raise ValueError(f": {error}") from None
        return value


#: Times are shown in ms and lengths in mm, so that the rows of a table can be compared.
METRICS = {
    "RiseTime": Metric("s", "ms", "from 10 to 90 % of the step, the slowest step", "step"),
    "SettlingTime": Metric(
        "s", "ms", "until the position stays within 2 % of the step (at least 0.1 mm), slowest step", "step"
    ),
    "SettlingTimeAbs": Metric("s", "ms", "until the position stays within 0.1 mm of the target, slowest step", "step"),
    "ShortestTime": Metric("s", "ms", "shortest settling time that current and pump allow, slowest step", "step"),
    "SettlingRatio": Metric("1", "1", "settling time over the shortest possible time, worst step", "step"),
    "Overshoot": Metric("1", "%", "overshoot of the target in % of the step, worst step", "step"),
    "Undershoot": Metric("1", "%", "initial motion in the wrong direction in % of the step, worst step", "step"),
    "Peak": Metric("m", "mm", "largest distance from zero"),
    "PeakTime": Metric("s", "ms", "time of the peak"),
    "SteadyStateError": Metric("m", "mm", "mean error in the last tenth before the next change, worst step", "hold"),
    "SteadyStateErrorMax": Metric("m", "mm", "largest error in the same tenth", "hold"),
    "MaxError": Metric("m", "mm", "largest error, after the first change of target"),
    "RMSError": Metric("m", "mm", "root mean square of the error, whole run"),
    "IAE": Metric("m s", "mm s", "integral of |e|"),
    "ISE": Metric("m2 s", "mm2 s", "integral of e^2"),
    "ITAE": Metric("m s2", "mm s2", "integral of t |e|, t from the first change of target"),
    "ITSE": Metric("m2 s2", "mm2 s2", "integral of t e^2, t from the first change of target"),
    "HuntingAmplitude": Metric("m", "mm", "peak-to-peak amplitude of hunting at the last target", "hold"),
    "HuntingPeriod": Metric("s", "ms", "period of hunting at the last target", "hold"),
    "Slips": Metric("1", "1", "number of breakaways while the last target is held", "hold"),
    "StickShare": Metric("1", "%", "share of the run in which the rod sticks"),
    "SaturationShare": Metric("1", "%", "share of the run with the current at a limit of controller or drive"),
    "CurrentRMS": Metric("A", "A", "root mean square of the current"),
    "TV": Metric("A", "A", "total variation of the current"),
    "Energy": Metric("J", "J", "shaft work taken from the motor, positive part"),
    "StopTime": Metric("s", "ms", "from the first fault until supervision stops the loop"),
    "TravelAfterStop": Metric("m", "mm", "travel of the rod after the stop"),
}


def loop_metrics(
    loop: ClosedLoop,
    *,
    jumps: Sequence[float],
    holds: Sequence[tuple[float, float]],
    current_limit: float,
    first_fault: float | None = None,
    lag: int = 0,
    shortest: bool = True,
) -> dict[str, float]:
    """All of METRICS for a run; nan for what did not happen.

    Parameters
    ----------
    jumps: times at which the target jumps [s]; step metrics are the worst over them, nan if there is none.
    holds: intervals in which a target is held under the same force [s]. The steady-state error is the worst over them;
        hunting is evaluated in the last one.
    current_limit: of the controller [A].
    first_fault: start of the first fault [s]; None for a run without one.
    lag: samples of delay between measurement and current.
    shortest: False leaves out the shortest possible time, which takes as long to compute as everything else.
    """
    run = loop.trajectory
    time, x, error, target = run.time, run["x"], loop.error, loop.reference[:, 0]
    dt = float(time[1] - time[0])
    result = dict.fromkeys(METRICS, float("nan"))
    steps = []
    for part in _parts(time, list(zip(jumps, [*jumps[1:], np.inf], strict=False))):
        first = int(part[0])
        before = float(target[first - 1]) if first else 0.0
        found = step_metrics(time[part], x[part], before, float(target[first]))
        settling, wanted = found["SettlingTime"], float(target[first])
        steps.append(found | _against_shortest(loop, settling, before, wanted, current_limit, shortest))
    for name, metric in METRICS.items():
        if steps and metric.of == "step":
            # A step that never settles is worse than any that does: np.max keeps nan.
            result[name] = float(np.max(np.array([step[name] for step in steps])))
    held = _parts(time, holds)
    if held:
        tails = [error[part[-max(part.size // 10, 1) :]] for part in held]
        result["SteadyStateError"] = max(float(abs(np.mean(tail))) for tail in tails)
        result["SteadyStateErrorMax"] = max(float(np.max(np.abs(tail))) for tail in tails)
        last = held[-1]
        last = last[time[last] >= time[last[0]] + (1 - HUNTING_SHARE) * (time[-1] - time[last[0]])]
        sticks = _rod_sticks(loop)
        result |= hunting(time[last], x[last]) if sticks else {"Slips": 0.0, "HuntingAmplitude": 0.0}
    start = min([*jumps, *(begin for begin, _ in holds)], default=float(time[0]))
    begun, since = time >= start - 1e-9, np.maximum(time - start, 0.0)
    peak = int(np.argmax(np.abs(x)))
    power = run.plant["K_T"] * run.current * run["omega"]
    return (
        result
        | {
            "Peak": float(abs(x[peak])),
            "PeakTime": float(time[peak]),
            "MaxError": float(np.max(np.abs(error[begun]), initial=0.0)),
            "RMSError": float(np.sqrt(np.mean(error**2))),
            "IAE": float(np.sum(np.abs(error)) * dt),
            "ISE": float(np.sum(error**2) * dt),
            "ITAE": float(np.sum(since * np.abs(error)) * dt),
            "ITSE": float(np.sum(since * error**2) * dt),
            "StickShare": float(np.mean(run.sticks("rod"))),
            "SaturationShare": float(np.mean(_saturated(loop, current_limit, lag))),
            "CurrentRMS": float(np.sqrt(np.mean(run.current**2))),
            "TV": float(np.sum(np.abs(np.diff(loop.asked)))),
            "Energy": float(np.sum(np.maximum(power, 0.0)) * dt),
        }
        | _stop(loop, first_fault)
    )


def _against_shortest(
    loop: ClosedLoop, settling: float, before: float, target: float, current_limit: float, wanted: bool
) -> dict[str, float]:
    """The shortest possible settling time of a step, and how many times as long the loop took."""
    way = target - before
    if way == 0.0 or settling_band(way) >= 1.0 or not wanted or not np.isfinite(current_limit):
        return {"ShortestTime": float("nan"), "SettlingRatio": float("nan")}
    least = shortest_time(loop.trajectory.plant, way, current_limit, start=before, band=settling_band(way) * abs(way))
    return {"ShortestTime": least, "SettlingRatio": settling / least}


def _saturated(loop: ClosedLoop, limit: float, lag: int) -> np.ndarray:
    """(N,) bool: the controller asks for its limit, or the drive gives less than it was asked for."""
    asked, acting = np.abs(loop.asked), np.abs(loop.trajectory.current)
    late = np.concatenate([np.zeros(lag), asked[: asked.size - lag]]) if lag else asked
    return (asked >= limit * (1 - 1e-9)) | (acting < late * (1 - 1e-9))


def _stop(loop: ClosedLoop, first_fault: float | None) -> dict[str, float]:
    """When supervision stopped the loop, and how far the rod moved from there on."""
    status = loop.traces.get(STATUS)
    stopped = np.flatnonzero(status == STOPPED) if status is not None else np.array([], dtype=int)
    if stopped.size == 0:
        return {"StopTime": float("nan"), "TravelAfterStop": float("nan")}
    run, first = loop.trajectory, int(stopped[0])
    at = float(run.time[first]) - (first_fault if first_fault is not None else 0.0)
    return {"StopTime": at, "TravelAfterStop": float(np.max(np.abs(run["x"][first:] - run["x"][first])))}


def _rod_sticks(loop: ClosedLoop) -> bool:
    structure = loop.trajectory.plant.structure
    return any(structure.law(contact).sticks for contact in structure.system.contacts if contact.name == "rod")


def _parts(time: np.ndarray, spans: Sequence[tuple[float, float]]) -> list[np.ndarray]:
    """Indices of the samples within each span; spans of fewer than three samples are left out."""
    parts = [np.flatnonzero((time >= start - 1e-9) & (time < end - 1e-9)) for start, end in spans]
    return [part for part in parts if part.size > 2]
