"""Free run of a plant with the inputs of a log, compared with the measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.errors import InputError, SimulationError, choices
from ..core.log import Log
from ..core.plotting import draw
from ..core.result import Result, as_dict
from ..core.text import join_words
from ..plant.plant import Plant
from ..simulation.engine import LARGEST
from ..simulation.sensors import noise_free_reading
from ..simulation.trajectory import Trajectory, versions
from .initial_state import InitialState, find_initial_state
from .logged_inputs import simulate_log
from .plant_log import plant_of_log

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

#: Fit [%] from which a channel is good, and below which it is poor: what is left of the signal is at most a tenth of
#: its standard deviation, or more than three tenths.
GOOD, POOR = 90.0, 70.0


def fit_percent(measured: np.ndarray, simulated: np.ndarray) -> float:
    """100 (1 - ||y - yhat|| / ||y - mean(y)||): 100 is exact, 0 no better than the mean; nan for a constant y.

    measured y, simulated yhat: (N,), same unit. Source: L. Ljung, "System Identification: Theory for the User",
    2nd ed., as its toolbox computes the fit.

    Raises InputError for vectors of different lengths, empty ones, and values that are not finite.
    """
    if measured.ndim != 1 or measured.size == 0 or measured.shape != simulated.shape:
        raise InputError(
            f"measured has shape {measured.shape} and simulated {simulated.shape}; expected two vectors of equal length"
        )
    if not (np.isfinite(measured).all() and np.isfinite(simulated).all()):
        raise InputError("measured and simulated must be finite numbers at every sample")
    size = max(float(np.max(np.abs(measured))), float(np.max(np.abs(simulated))))
    if size > LARGEST:
        # Their squares would overflow.
        measured, simulated = measured / size, simulated / size
    spread = float(np.linalg.norm(measured - np.mean(measured)))
    # The mean of equal numbers differs from them in the last digit.
    if spread <= 1e-12 * float(np.linalg.norm(measured)):
        return float("nan")
    return 100.0 * (1.0 - float(np.linalg.norm(measured - simulated)) / spread)


def quality(percent: float) -> Literal["good", "fair", "poor"]:
    """A fit in percent as a word, by GOOD and POOR."""
    return "good" if percent >= GOOD else "fair" if percent >= POOR else "poor"


def fit_words(fits: Mapping[str, float]) -> str:
    """Channels by the quality of their fit, the worst first: "poor in p1 and p2; good in speed"; "" for none."""
    known = {channel: quality(fit) for channel, fit in fits.items() if not math.isnan(fit)}
    groups = {word: [channel for channel in known if known[channel] == word] for word in ("poor", "fair", "good")}
    return "; ".join(f"{word} in {join_words(channels)}" for word, channels in groups.items() if channels)


def fit_cell(percent: float) -> str:
    """A fit in percent for a table, at most 10 characters."""
    if math.isnan(percent):
        return "-"
    return f"{percent:.2f}" if abs(percent) < 1e6 else f"{percent:.2e}"


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """A free run and the log that drove it.

    Attributes
    ----------
    plant: the simulated one.
    log: the measurement.
    start: the state at the first sample and how it was found.
    trajectory: the run; None if it could not start.
    simulated: channel -> (N,) sensor output without noise and converter steps; nan after the end of a run that stopped
        early. Includes channels that the log lacks.
    fit_percent: channel of the log -> fit; nan if the channel is constant or the run stopped early.
    stopped: why the run ended before the log did, in a sentence; empty for a complete run.
    """

    plant: Plant
    log: Log
    start: InitialState
    trajectory: Trajectory | None
    simulated: Mapping[str, np.ndarray]
    fit_percent: Mapping[str, float]
    stopped: str = ""
    provenance: dict[str, str] = field(default_factory=versions)

    def residual(self, channel: str) -> np.ndarray:
        """Measured minus simulated (N,), in the channel's SI unit. Raises InputError for a channel not measured."""
        if channel not in self.fit_percent:
            raise InputError(f"no residual of {channel!r}; {choices(channel, self.fit_percent)}")
        return self.log[channel] - self.simulated[channel]

    def to_pandas(self) -> pandas.DataFrame:
        """One row a sample: t, the inputs, and each output as measured and as simulated."""
        import pandas

        columns = {"t": self.log.time}
        columns |= {channel: self.log[channel] for channel in self.plant.structure.system.drives.values()}
        for channel, values in self.simulated.items():
            if channel in self.log.channels:
                columns[f"{channel}_measured"] = self.log[channel]
            columns[f"{channel}_simulated"] = values
        return pandas.DataFrame(columns)

    def to_dict(self) -> dict[str, Any]:
        """As of one model in comparison.json: fits, and the state at the first sample in SI units."""
        states = [state.name for state in self.plant.structure.equations.states]
        start = {"words": self.start.words, "state": dict(zip(states, self.start.state, strict=True))}
        return as_dict(self, "fit_percent stopped", start=start)

    def plot(self) -> Figure:
        """Inputs, and each output measured and simulated, over the log's time."""
        return draw(self)

    def __str__(self) -> str:
        log = self.log
        lines = [
            f"{self.plant.name} ({self.plant.model}) beside {log.name}: "
            f"{len(log)} samples, {log.time[-1] - log.time[0]:g} s",
            f"  starts {self.start}",
        ]
        lines += [
            f"  {channel:<10} {fit_cell(percent):>9} % fit" + ("" if math.isnan(percent) else f", {quality(percent)}")
            for channel, percent in self.fit_percent.items()
        ]
        return "\n".join([*lines, *([f"  {self.stopped}"] if self.stopped else [])])


def replay(plant: Plant, log: Log) -> Comparison:
    """Simulate the plant in free run with the inputs of a log and compare with its outputs.

    Parameters
    ----------
    log: has the channels of the plant's inputs. What it was cut from (`Log.segment`) gives its initial state if it
        begins in motion, see `find_initial_state`.

    Returns
    -------
    Comparison. A run that leaves the range of the equations is not an error: `stopped` gives the reason and its fits
    are nan.

    Raises
    ------
    InputError: the log lacks an input, or has a sample time that can't be simulated with.
    """
    plant = plant_of_log(plant, log)
    system = plant.structure.system
    for channel in system.drives.values():
        log[channel]
    start = find_initial_state(plant, log, log.before)
    measured = [channel for channel in system.outputs if channel in log.channels]
    no_fit = dict.fromkeys(measured, float("nan"))
    try:
        run = simulate_log(plant, log, start.state)
    except SimulationError as error:
        nothing = {channel: np.full(len(log), np.nan) for channel in system.outputs}
        return Comparison(plant, log, start, None, nothing, no_fit, str(error))
    simulated = {channel: _sensor_output(plant, channel, run, len(log)) for channel in system.outputs}
    fits = no_fit if run.stopped else {c: fit_percent(log[c], simulated[c]) for c in measured}
    return Comparison(plant, log, start, run, simulated, fits, run.stopped)


def _sensor_output(plant: Plant, channel: str, run: Trajectory, samples: int) -> np.ndarray:
    """The channel's sensor output (samples,) along a run, without noise and converter steps."""
    values = np.full(samples, np.nan)
    true = run[plant.structure.system.outputs[channel]]
    sensor = plant.sensors.get(channel)
    values[: len(run)] = true if sensor is None else noise_free_reading(sensor, true, float(run.time[1] - run.time[0]))
    return values
