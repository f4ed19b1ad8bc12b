"""What a log will tell before it is recorded: the covariance that an input leads to on the plant as it is believed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError, SimulationError
from ..core.log import Log
from ..core.text import TextResult
from ..plant.file import both
from ..plant.plant import Plant
from ..simulation.bench import record
from ..simulation.sensors import shown
from ..simulation.trajectory import Trajectory
from .estimator import Fit, fit
from .free import FreeParameter, free_parameters
from .identify import size_of
from .uncertainty import POOR, Estimate, Uncertainty, estimates, uncertainty
from .window import Window

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Forecast(TextResult):
    """Standard deviations to expect.

    run: the believed plant under the input, without noise. estimates: one row a free parameter, the value is the one
    that is believed. uncertainty: covariance and correlation. sizes (k,): against what each sd is small or large.
    """

    run: Trajectory = field(repr=False)
    estimates: tuple[Estimate, ...]
    uncertainty: Uncertainty
    fit: Fit = field(repr=False)
    sizes: np.ndarray

    def __getitem__(self, name: str) -> Estimate:
        """The row of a parameter. Raises InputError for one that is not free."""
        from ..core.errors import choices

        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise InputError(f"{name} is not free; {choices(name, [e.name for e in self.estimates])}")

    def scaled(self, factor: float) -> Forecast:
        """The same with every sd `factor` times as large, as rehearsals ask for; `fit` stays what it was."""
        found = replace(self.uncertainty, covariance=factor**2 * self.uncertainty.covariance)
        return replace(self, estimates=estimates(self.fit, found, self.sizes), uncertainty=found)

    @property
    def relative(self) -> dict[str, float]:
        """Name -> sd over the parameter's size; infinite where the log tells nothing."""
        return {
            e.name: e.sd / size if size > 0.0 else np.inf for e, size in zip(self.estimates, self.sizes, strict=True)
        }

    @property
    def undetermined(self) -> dict[str, tuple[str, ...]]:
        """Parameters that the log would not tell -> with what they trade places."""
        return {
            e.name: e.trades
            for e, size in zip(self.estimates, self.sizes, strict=True)
            if not np.isfinite(e.sd) or (size > 0.0 and e.sd > POOR * size)
        }

    def table(self, worst: Mapping[str, float] | None = None) -> str:
        """Rows: parameter, believed, expected sd, relative, `worst` (another relative sd), and what is in the way."""
        relative = self.relative
        more = "" if worst is None else f" {'at worst':>9}"
        lines = [f"  {'':<14} {'believed':>11} {'expected sd':>12} {'relative':>9}{more}  unit"]
        for e in self.estimates:
            sd = f"{e.sd:.2g}" if np.isfinite(e.sd) else "-"
            share = f"{percent(relative[e.name]):>9}" + ("" if worst is None else f" {percent(worst[e.name]):>9}")
            words = "" if e.verdict == "well determined" else e.verdict.replace("this log", "this input")
            if relative[e.name] == np.inf and np.isfinite(e.sd):
                words = "believed to be zero, so that it has no relative sd"
            if e.trades and words:
                words += f", trades with {', '.join(map(both, e.trades))}"
            lines.append(f"  {both(e.name):<14} {e.value:>11.5g} {sd:>12} {share}  {e.unit:<10} {words}".rstrip())
        return "\n".join(lines)

    def to_pandas(self) -> pandas.DataFrame:
        """One row a parameter: what is believed, the sd to expect, absolute and relative, what it trades with."""
        import pandas

        relative = self.relative
        rows = [
            {
                "name": e.name,
                "unit": e.unit,
                "believed": e.value,
                "sd": e.sd,
                "relative_sd": relative[e.name],
                "verdict": e.verdict,
                "trades_with": ", ".join(e.trades),
            }
            for e in self.estimates
        ]
        return pandas.DataFrame(rows).set_index("name")

    def __str__(self) -> str:
        return self.table()

    __repr__ = __str__


def percent(value: float) -> str:
    """Two figures of a relative sd; a dash for one that says nothing."""
    return f"{100 * value:.2g} %" if value < 10 else "-"


def forecast(
    plant: Plant,
    time: np.ndarray,
    current: np.ndarray,
    *,
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    centre: bool = False,
) -> Forecast:
    """Standard deviations that `identify` will give for a log of this current, as far as the plant is as believed.

    The information of the estimator itself (see `estimator.fit`): derivatives of a run from rest, whitened with the
    noise of the sensors and of the logged drive, the initial state eliminated.

    Parameters
    ----------
    time, current: (N,) s and A, uniformly sampled, from rest.
    free, fix: as for `identify`.
    centre: with the bench's slow loop around the rod.

    Raises
    ------
    InputError: as `free_parameters`; a sensor without noise; a current that the run does not survive.
    """
    _, run = record(plant, time, current, sensor_noise=False, centre=centre)
    if run.stopped:
        raise InputError(f"the current can't be applied to its end: {run.stopped}; make it smaller or add the centring")
    return forecast_run(run, free_parameters(plant, free=free, fix=fix))


def forecast_run(run: Trajectory, parameters: Sequence[FreeParameter]) -> Forecast:
    """The same for a run from rest that is there already, at the values of its plant.

    Raises SimulationError if it can't be repeated.
    """
    plant = run.plant
    log = _log(run)
    parameters = [p if p.sensor else replace(p, value=plant[p.name]) for p in parameters]
    states = plant.structure.equations.states
    sure = {contact.velocity for contact in plant.structure.system.contacts}
    unknown = tuple(i for i, s in enumerate(states) if s.name not in sure and not s.name.startswith("z_"))
    window = Window(log, 0, len(log) - 1, plant.rest, unknown, np.full(len(states), np.inf))
    try:
        # No step is made: what is wanted is the information at the believed values.
        here = fit(plant, [window], parameters, steps=0)
    except InputError as error:
        raise SimulationError(str(error)) from None
    found = uncertainty(here)
    sizes = np.array([size_of(plant, p, p.value, [log]) for p in parameters])
    return Forecast(run, estimates(here, found, sizes), found, here, sizes)


def _log(run: Trajectory) -> Log:
    """What the sensors would show of a run without noise and converter steps."""
    plant = run.plant
    system = plant.structure.system
    wanted = {**{channel: signal for signal, channel in system.drives.items()}, **system.outputs}
    channels = {}
    for channel, signal in wanted.items():
        sensor = plant.sensors[channel]
        if channel in system.outputs and not sensor.sd > 0.0:
            raise InputError(
                f"{plant.path or plant.name}: says nothing of the noise of {channel}, on which every standard "
                f"deviation depends; give noise in [sensors.{channel}]"
            )
        held = run.hold == "zero_order" and channel not in system.outputs
        channels[channel] = shown(sensor, run[signal], float(run.time[1] - run.time[0]), held=held)
    return Log(run.time, channels)
