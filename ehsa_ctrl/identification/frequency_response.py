"""Measured frequency response of a plant from its logs, beside those of its models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.errors import InputError, choices
from ..core.log import CHANNELS, Log
from ..core.plotting import draw
from ..core.result import Result, as_dict
from ..plant.linearise import linearise
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .frequency_signals import model_response, output_signals
from .spectra import SEGMENTS, ResponseLines, find_period, periodic_response, spectral_response
from .subspace import SubspaceModel, identify_subspace

if TYPE_CHECKING:
    import control
    import pandas
    from matplotlib.figure import Figure

Method = Literal["auto", "spectral", "periodic"]


@dataclass(frozen=True)
class MeasuredChannel:
    """Frequency response from the drive to one output. unit: of the response, SI. lines: its values."""

    output: str
    unit: str
    lines: ResponseLines


@dataclass(frozen=True, repr=False)
class FrequencyResponse(Result):
    """Frequency response from the drive of a plant to its outputs.

    Attributes
    ----------
    drive: channel of the input. channels: one per output.
    method: "spectral" or "periodic". estimator: "H1" or "H2" of a spectral one.
    sample_time: s. logs: names. period: s, of a periodic input. averages: segments, or periods of all logs.
    models: name -> output -> response (n,) of the sampled model at the channel's frequencies.
    subspace: model from the same data; None if not requested.
    """

    drive: str
    channels: tuple[MeasuredChannel, ...]
    method: str
    estimator: str
    sample_time: float
    logs: tuple[str, ...]
    period: float | None
    averages: int
    models: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    subspace: SubspaceModel | None = None

    def __getitem__(self, output: str) -> ResponseLines:
        """The lines of an output. Raises InputError for one that was not measured."""
        found = {each.output: each.lines for each in self.channels}
        if output not in found:
            raise InputError(f"no response of {output!r}; {choices(output, found)}")
        return found[output]

    def distance(self, model: str, output: str) -> float:
        """RMS over the reliable frequencies of |measured / model - 1|: 0 for equal ones, nan without any."""
        lines = self[output]
        if not lines.reliable.any():
            return float("nan")
        ratio = lines.response[lines.reliable] / self.models[model][output][lines.reliable]
        return float(np.sqrt(np.mean(np.abs(ratio - 1.0) ** 2)))

    def to_frd(self, output: str) -> control.FrequencyResponseData:
        """The response of an output for python-control."""
        import control

        lines = self[output]
        return control.frd(lines.response, 2.0 * np.pi * lines.frequency)

    def to_dict(self) -> dict[str, Any]:
        """Content of frequency_response.json, SI units; frequencies in Hz, complex numbers by their parts."""
        channels = {}
        for each in self.channels:
            lines = each.lines
            channels[each.output] = as_dict(
                lines, "frequency noise_sd nonlinear_sd coherence even odd", unit=each.unit,
                reliable=lines.reliable, real=lines.response.real, imaginary=lines.response.imag,
                models={
                    name: {"real": values[each.output].real, "imaginary": values[each.output].imag,
                           "distance": self.distance(name, each.output)}
                    for name, values in self.models.items()
                },
            )  # fmt: skip
        return as_dict(
            self, "drive method estimator sample_time logs period averages subspace", channels=channels,
            provenance=versions(),
        )  # fmt: skip

    def to_pandas(self) -> pandas.DataFrame:
        """One row per output and frequency [Hz]: magnitude, phase [deg], standard deviations, coherence, models."""
        import pandas

        tables = []
        for each in self.channels:
            lines = each.lines
            columns: dict[str, Any] = {
                "output": each.output, "frequency_Hz": lines.frequency, "magnitude": np.abs(lines.response),
                "phase_deg": np.degrees(np.angle(lines.response)), "noise_sd": lines.noise_sd,
                "nonlinear_sd": lines.nonlinear_sd, "coherence": lines.coherence,
            }  # fmt: skip
            for name, values in self.models.items():
                columns[f"magnitude_{name}"] = np.abs(values[each.output])
                columns[f"phase_{name}_deg"] = np.degrees(np.angle(values[each.output]))
            tables.append(pandas.DataFrame(columns))
        return pandas.concat(tables, ignore_index=True)

    def plot(self) -> Figure:
        """Figure: magnitude and phase of each output with their uncertainty, and the models."""
        return draw(self)

    def __str__(self) -> str:
        how = (
            f"best linear approximation at the lines of a multisine, period {self.period:g} s, {self.averages} periods"
            if self.period is not None
            else f"{self.estimator} of {self.averages} segments"
        )
        lines = [f"frequency response from {self.drive}, {how}, {', '.join(self.logs)}"]
        for each in self.channels:
            values = each.lines
            size = np.abs(values.response)
            words = [f"{values.frequency.size} frequencies, {values.frequency[0]:.3g} to {values.frequency[-1]:.3g} Hz"]
            if not values.reliable.all():
                words.append(f"{np.count_nonzero(values.reliable)} of them reliable")
            words.append(f"sd by noise {100 * np.median(values.noise_sd / size):.2g} %")
            if np.isfinite(values.nonlinear_sd).any():
                words.append(f"by nonlinearity {100 * np.nanmedian(values.nonlinear_sd / size):.2g} %")
            if np.isfinite(values.coherence).any():
                words.append(f"coherence {np.median(values.coherence):.3f}")
            if np.isfinite(values.even):
                words.append(f"even lines {100 * values.even:.2g} %")
            words += [f"{100 * self.distance(name, each.output):.3g} % from the {name} model" for name in self.models]
            lines.append(f"  {each.output}: {', '.join(words)}")
        if self.subspace is not None:
            lines.append(f"  {self.subspace}")
        return "\n".join(lines)


def frequency_response(
    plant: Plant,
    logs: Log | Sequence[Log],
    *,
    models: Mapping[str, control.StateSpace] | None = None,
    method: Method = "auto",
    estimator: str = "H1",
    segment: float | None = None,
    period: float | None = None,
    settle: float | None = None,
    subspace: bool = False,
    order: int | None = None,
) -> FrequencyResponse:
    """Frequency response from the drive to the outputs that logs have in common.

    Parameters
    ----------
    plant: of the logs; names the drive and the outputs.
    logs: records with equal sample times; of a periodic input each one is a realisation with other phases.
    models: name -> continuous linear model with the drive as first input and the plant's states as outputs, to be
        compared; by default the plant, linearised.
    method: "periodic" for an input with a period, "spectral" for any; "auto" decides by the drive of the first log.
    estimator: "H1" (noise at the output) or "H2" (noise at the drive), of the spectral method.
    segment: s, length of the averaged segments; by default a record has about SEGMENTS of them.
    period: s; by default found in the drive. settle: s, discarded at the beginning; by default a period.
    subspace: also identify a linear model from the first log, whose drive must be white, without the position.
    order: of that model; by default by singular values.

    Raises InputError for different sample times, a record that is too short, a drive without period for the periodic
    method, and unknown words.
    """
    if method not in ("auto", "spectral", "periodic"):
        raise InputError(f"method = {method!r}; {choices(method, ('auto', 'spectral', 'periodic'))}")
    if estimator not in ("H1", "H2"):
        raise InputError(f"estimator = {estimator!r}; expected H1 or H2")
    logs = [logs] if isinstance(logs, Log) else list(logs)
    if not logs:
        raise InputError("no log; expected at least one")
    dt, system = logs[0].sample_time, plant.structure.system
    for log in logs[1:]:
        if abs(log.sample_time - dt) > 1e-6 * dt:
            raise InputError(
                f"{log.name}: sample time {log.sample_time:g} s, but {logs[0].name} has {dt:g} s; resample one of them"
            )
    drive = system.drive
    inputs = [log[drive] for log in logs]
    outputs = output_signals(plant, logs)
    found = None
    if method != "spectral":
        found = round(period / dt) if period is not None else find_period(inputs[0])
        if found is None and method == "periodic":
            raise InputError(f"{logs[0].name}: {drive} has no period; give it by --period, or use --method spectral")
    shortest = min(len(log) for log in logs)
    if found is not None:
        skip = found if settle is None else round(settle / dt)
        if found < 4 or shortest < skip + 2 * found:
            raise InputError(
                f"{logs[0].name}: a period of {found * dt:g} s after {skip * dt:g} s; expected at least two whole "
                f"periods in {shortest * dt:g} s, each of four samples or more"
            )
        averages = sum((len(log) - skip) // found for log in logs)
        lines = {name: periodic_response(inputs, signals, dt, found, skip) for name, (signals, _) in outputs.items()}
    else:
        length = round(segment / dt) if segment is not None else 2 * shortest // (SEGMENTS + 1)
        if not 16 <= length <= shortest // 2:
            raise InputError(
                f"{logs[0].name}: segments of {length * dt:g} s; expected 16 samples to half of {shortest * dt:g} s"
            )
        averages = sum(2 * (len(log) // length) - 1 for log in logs)
        lines = {
            name: spectral_response(inputs, signals, dt, length, estimator) for name, (signals, _) in outputs.items()
        }
    compared = {plant.model: linearise(plant)} if models is None else models
    unit = CHANNELS[drive].unit
    channels = tuple(
        MeasuredChannel(name, f"{of}/{unit}", lines[name]) for name, (_, of) in outputs.items() if len(lines[name])
    )
    responses = {
        name: {each.output: model_response(model, plant, each.output, each.lines.frequency, dt) for each in channels}
        for name, model in compared.items()
    }
    # An integrating output has no decaying impulse response.
    decaying = {name: signals[0] for name, (signals, _) in outputs.items() if name != "position"}
    return FrequencyResponse(
        drive=drive,
        channels=channels,
        method="spectral" if found is None else "periodic",
        estimator=estimator if found is None else "",
        sample_time=dt,
        logs=tuple(log.name for log in logs),
        period=None if found is None else found * dt,
        averages=averages,
        models=responses,
        subspace=identify_subspace(inputs[0], decaying, dt, order=order) if subspace else None,
    )
