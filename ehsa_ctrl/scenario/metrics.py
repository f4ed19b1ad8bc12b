"""Metrics of a closed loop, defined so that they remain meaningful for a plant with stick-slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..core.errors import InputError
from ..core.unit import factor, parse, unit_suffix
from ..plant.motion_current import has_motion_current
from ..simulation.closed_loop import ClosedLoop
from ..simulation.minimum_time import shortest_time
from .force_metrics import force_metrics
from .force_reference import ForceChange
from .impedance_metrics import TargetImpedance, impedance_metrics
from .response import hunting, settling_band, step_metrics

#: Hunting is evaluated over this final share of the last hold, after the transient (engineering judgement).
HUNTING_SHARE = 0.5
#: Controller trace with the state of the supervision, and its value once supervision has stopped the loop.
STATUS, STOPPED = "status", 2.0

#: SI unit -> absolute tolerance of the comparison with a baseline, above the differences between machines (engineering
#: judgement: three samples of 4 ms for a time, the bench's position noise of 20 um for a length;
#: 20 N for a force, 0.2 % of 10 kN).
ABSOLUTE_TOLERANCES = {
    "s": 0.012, "1": 0.02, "m": 2e-5, "m s": 2e-5, "m2 s": 2e-8, "m s2": 2e-5, "m2 s2": 2e-8, "A": 0.02, "J": 1.0,
    "N": 20.0,
}  # fmt: skip


@dataclass(frozen=True)
class Metric:
    """Description of a metric, used by tables, limits and baselines.

    Attributes
    ----------
    unit: SI unit. display_unit: unit in tables and messages. meaning: one line.
    requires: what the reference must contain for the metric to be defined: a "step" or a "hold" of the
        position, a "force" target, a period ("cycle"), or nothing ("run").
    """

    unit: str
    display_unit: str
    meaning: str
    requires: Literal["run", "step", "hold", "force", "cycle"] = "run"

    @property
    def scale(self) -> float:
        """SI value of one display unit."""
        return factor(self.display_unit, self.unit)

    @property
    def absolute_tolerance(self) -> float:
        """Absolute tolerance of the comparison with a baseline, SI unit."""
        return ABSOLUTE_TOLERANCES[self.unit]

    def is_close(self, old: float, new: float, share: float, spread: float = 0.0) -> bool:
        """Whether two values differ by at most the absolute tolerance, `share` of the old one and `spread` [SI unit]
        together; nan equals nan."""
        if not (np.isfinite(old) and np.isfinite(new)):
            return bool(np.isnan(old) == np.isnan(new)) and not np.isinf(old) ^ np.isinf(new)
        return abs(new - old) <= self.absolute_tolerance + share * abs(old) + spread

    def format(self, value: float) -> str:
        """A value [SI unit] as text with the display unit."""
        if not np.isfinite(value):
            return "never" if np.isinf(value) else "nothing"
        return f"{value / self.scale:.4g}{unit_suffix(self.display_unit)}"

    def format_bounds(self, lower: float | None, upper: float | None) -> str:
        """The bounds of a limit with the display unit: "at least 1 mm and at most 3 mm"."""
        bounds = (("at least", lower), ("at most", upper))
        return " and ".join(
            f"{word} {b / self.scale:g}{unit_suffix(self.display_unit)}" for word, b in bounds if b is not None
        )

    def read_bound(self, value: Any, *, si: bool = False) -> Any:
        """Convert a bound such as "0.3 mm" to the SI unit; a dimensionless metric also takes a plain number.

        si: whether every metric takes a plain number, in the SI unit.

        Raises ValueError for a number without its unit and for a text that is not a quantity of this unit.
        """
        if isinstance(value, int | float) and not isinstance(value, bool) and self.unit != "1" and not si:
            raise ValueError(f" = {value}: has no unit; write it with one, such as '{value} {self.display_unit}'")
        if isinstance(value, str):
            try:
                return parse(value, self.unit)
            except InputError as error:
                raise ValueError(f": {error}") from None
        return value


#: All times are displayed in ms and all lengths in mm, so that the rows of a table can be compared.
METRICS = {
    "RiseTime": Metric("s", "ms", "from 10 to 90 % of the step, slowest step", "step"),
    "SettlingTime": Metric(
        "s", "ms", "until the position stays within 2 % of the step (at least 0.1 mm), slowest step", "step"
    ),
    "SettlingTimeAbs": Metric("s", "ms", "until the position stays within 0.1 mm of the target, slowest step", "step"),
    "ShortestTime": Metric("s", "ms", "shortest settling time that current and pump allow, slowest step", "step"),
    "SettlingRatio": Metric("1", "1", "settling time over the shortest possible time, worst step", "step"),
    "Overshoot": Metric("1", "%", "overshoot of the target, % of the step, worst step", "step"),
    "Undershoot": Metric("1", "%", "initial motion in the wrong direction, % of the step, worst step", "step"),
    "Peak": Metric("m", "mm", "largest distance from mid-stroke"),
    "PeakTime": Metric("s", "ms", "time of the peak"),
    "SteadyStateError": Metric("m", "mm", "mean error over the last tenth of a hold, worst hold", "hold"),
    "SteadyStateErrorMax": Metric("m", "mm", "largest error over the last tenth of a hold, worst hold", "hold"),
    "MaxError": Metric("m", "mm", "largest error after the first change of target"),
    "RMSError": Metric("m", "mm", "root mean square of the error over the whole run"),
    "FirstCycleError": Metric("m", "mm", "root mean square of the error in the first period", "cycle"),
    "LastCycleError": Metric("m", "mm", "root mean square of the error in the last full period", "cycle"),
    "IAE": Metric("m s", "mm s", "integral of |e|"),
    "ISE": Metric("m2 s", "mm2 s", "integral of e^2"),
    "ITAE": Metric("m s2", "mm s2", "integral of t |e|, t from the first change of target"),
    "ITSE": Metric("m2 s2", "mm2 s2", "integral of t e^2, t from the first change of target"),
    "HuntingAmplitude": Metric("m", "mm", "peak-to-peak amplitude of hunting at the last target", "hold"),
    "HuntingPeriod": Metric("s", "ms", "period of hunting at the last target", "hold"),
    "Slips": Metric("1", "1", "number of breakaways while the last target is held", "hold"),
    "ForceOvershoot": Metric("1", "%", "overshoot of the force target, % of its change, worst change", "force"),
    "ForceSettlingTime": Metric(
        "s",
        "ms",
        "until the force stays within 2 % of its change (at least 100 N) of the target, worst change",
        "force",
    ),
    "ForceSteadyStateError": Metric(
        "N", "N", "mean error of the force over the last tenth of a hold, worst hold", "force"
    ),
    "ForceRMSError": Metric("N", "N", "root mean square of the force error from the first contact on", "force"),
    "ContactImpact": Metric("N", "N", "excess of the force over its target in the first 50 ms of contact", "force"),
    "LostContacts": Metric("1", "1", "how often the rod leaves a load behind a gap while a force is asked", "force"),
    "ImpedanceError": Metric(
        "1", "%", "distance from the motion of the controller's mass, damper and spring, % of that motion (rms)"
    ),
    "StickShare": Metric("1", "%", "share of the run in which the rod sticks"),
    "SaturationShare": Metric("1", "%", "share of the run with the current at the limit of the controller or drive"),
    "CurrentRMS": Metric("A", "A", "root mean square of the current"),
    "TV": Metric("A", "A", "total variation of the current"),
    "Energy": Metric("J", "J", "work of the drive, without the braking phases"),
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
    force_changes: Sequence[ForceChange] = (),
    cycles: Sequence[tuple[float, float]] = (),
    impedance: TargetImpedance | None = None,
) -> dict[str, float]:
    """All of METRICS for a run, SI units; nan for an event that did not happen.

    Parameters
    ----------
    jumps: times at which the target jumps [s]; step metrics are the worst over all jumps, nan without jumps.
    holds: intervals in which target and external force are constant [s]. The steady-state error is the worst over
        all holds; hunting is evaluated in the last one.
    current_limit: of the controller [A].
    first_fault: start of the first fault [s]; None for a run without faults.
    lag: samples of delay between measurement and current.
    shortest: False omits ShortestTime and SettlingRatio, which take as long to compute as all other metrics.
    force_changes: of the force target. cycles: start and end of each full period [s].
    impedance: that the controller gives the rod; None for another controller.
    """
    run = loop.trajectory
    time, x, error, target = run.time, run["x"], loop.error, loop.reference[:, 0]
    dt = float(time[1] - time[0])
    result = dict.fromkeys(METRICS, float("nan"))
    steps = []
    for part in _samples_within(time, list(zip(jumps, [*jumps[1:], np.inf], strict=False))):
        first = int(part[0])
        before, after = float(target[first - 1]) if first else 0.0, float(target[first])
        step = step_metrics(time[part], x[part], before, after)
        if shortest:
            step |= _settling_ratio(loop, step["SettlingTime"], before, after, current_limit)
        steps.append(step)
    for name, metric in METRICS.items():
        if steps and metric.requires == "step":
            # A step that never settles is worse than any that does: np.max propagates nan.
            result[name] = float(np.max(np.array([step.get(name, np.nan) for step in steps])))
    cycle_samples = _samples_within(time, cycles)
    if cycle_samples:
        for name, part in (("FirstCycleError", cycle_samples[0]), ("LastCycleError", cycle_samples[-1])):
            result[name] = float(np.sqrt(np.mean(error[part] ** 2)))
    hold_samples = _samples_within(time, holds)
    if hold_samples:
        tails = [error[part[-max(part.size // 10, 1) :]] for part in hold_samples]
        result["SteadyStateError"] = max(float(abs(np.mean(tail))) for tail in tails)
        result["SteadyStateErrorMax"] = max(float(np.max(np.abs(tail))) for tail in tails)
        last = hold_samples[-1]
        last = last[time[last] >= time[last[0]] + (1 - HUNTING_SHARE) * (time[-1] - time[last[0]])]
        can_stick = _rod_can_stick(loop)
        result |= hunting(time[last], x[last]) if can_stick else {"Slips": 0.0, "HuntingAmplitude": 0.0}
    start = min([*jumps, *(begin for begin, _ in holds)], default=float(time[0]))
    begun, since = time >= start - 1e-9, np.maximum(time - start, 0.0)
    peak = int(np.argmax(np.abs(x)))
    system = run.plant.structure.system
    is_current = system.drive_unit == "A"
    power = run.plant["K_T"] * run.current * run["omega"] if is_current else run.current * run["v"]
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
            "CurrentRMS": float(np.sqrt(np.mean(run.current**2))) if is_current else float("nan"),
            "TV": float(np.sum(np.abs(np.diff(loop.asked)))) if is_current else float("nan"),
            "Energy": float(np.sum(np.maximum(power, 0.0)) * dt),
        }
        | _stop_metrics(loop, first_fault)
        | force_metrics(loop, force_changes)
        | impedance_metrics(loop, impedance)
    )


def _settling_ratio(
    loop: ClosedLoop, settling: float, before: float, target: float, current_limit: float
) -> dict[str, float]:
    """Shortest possible settling time of a step [s], and the ratio of the actual one to it."""
    size = target - before
    known = has_motion_current(loop.trajectory.plant) and np.isfinite(current_limit)
    if size == 0.0 or settling_band(size) >= 1.0 or not known:
        return {"ShortestTime": float("nan"), "SettlingRatio": float("nan")}
    band = settling_band(size) * abs(size)
    least = shortest_time(loop.trajectory.plant, size, current_limit, start=before, band=band)
    return {"ShortestTime": least, "SettlingRatio": settling / least}


def _saturated(loop: ClosedLoop, limit: float, lag: int) -> np.ndarray:
    """(N,) bool: the commanded current is at its limit, or the drive delivers less than commanded."""
    command, actual = np.abs(loop.asked), np.abs(loop.trajectory.current)
    delayed = np.concatenate([np.zeros(lag), command[: command.size - lag]]) if lag else command
    return (command >= limit * (1 - 1e-9)) | (actual < delayed * (1 - 1e-9))


def _stop_metrics(loop: ClosedLoop, first_fault: float | None) -> dict[str, float]:
    """Time at which supervision stopped the loop, and travel of the rod after the stop."""
    status = loop.traces.get(STATUS)
    stopped = np.flatnonzero(status == STOPPED) if status is not None else np.array([], dtype=int)
    if stopped.size == 0:
        return {"StopTime": float("nan"), "TravelAfterStop": float("nan")}
    run, first = loop.trajectory, int(stopped[0])
    at = float(run.time[first]) - (first_fault if first_fault is not None else 0.0)
    return {"StopTime": at, "TravelAfterStop": float(np.max(np.abs(run["x"][first:] - run["x"][first])))}


def _rod_can_stick(loop: ClosedLoop) -> bool:
    """Whether the plant's friction law on the rod has a sticking mode; the linear model has none."""
    structure = loop.trajectory.plant.structure
    return any(structure.law(contact).sticks for contact in structure.system.contacts if contact.name == "rod")


def _samples_within(time: np.ndarray, spans: Sequence[tuple[float, float]]) -> list[np.ndarray]:
    """Indices of the samples within each span (start, end) [s]; spans of fewer than three samples are omitted."""
    parts = [np.flatnonzero((time >= start - 1e-9) & (time < end - 1e-9)) for start, end in spans]
    return [part for part in parts if part.size > 2]
