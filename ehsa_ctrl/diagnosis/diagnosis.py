"""The result of a diagnosis: verdict, places, causes, and the gap of each model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.log import Log
from ..core.plotting import draw
from ..core.result import Result, as_dict, as_table
from ..core.text import join_words
from ..core.unit import unit_suffix
from ..physics.effects import EFFECTS, all_parameters
from ..plant.file import label
from ..plant.plant import Plant, Sensor
from .folds import Fold, folds_sentence
from .own_offsets import log_of, shared_name
from .records import joint_gap
from .signals import gap, scored_signals, signal_noise
from .verdict_text import alternatives_of, name_of, nearest_sentence, the_data, verdict_sentence

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from .closed_loop_replay import ClosedLoopReplay
    from .gap_attribution import Location
    from .law.proposed import ProposedLaw
    from .next_experiment import NextExperiment

Verdict = Literal["no_gap", "effect", "ambiguous", "partly", "parameters", "outside_catalogue", "underdetermined"]
#: Verdicts that name causes.
NAMING: tuple[Verdict, ...] = ("effect", "ambiguous", "partly", "parameters")
#: The models of which a result gives the gap.
MODELS = {
    "nominal": "nominal plant",
    "refit": "nominal parameters refitted",
    "with_effects": "with the causes",
    "upper_bound": "with free unknown inputs",
}
#: The same with that of a proposed law, if there is one.
MODEL_WORDS = MODELS | {"with_law": "with the proposed law"}


def models_shown(verdict: str, models: Iterable[str]) -> list[str]:
    """The models whose gaps are meaningful: "with_effects" only if causes are named, none but nominal without a gap."""
    omitted = {"no_gap": ("refit", "with_effects", "with_law", "upper_bound")} | dict.fromkeys(NAMING, ())
    return [model for model in models if model not in omitted.get(verdict, ("with_effects",))]


@dataclass(frozen=True)
class CauseParameter:
    """An estimated parameter in SI units: `value` is the new value, not the change."""

    value: float
    sd: float
    unit: str


@dataclass(frozen=True)
class Cause:
    """A cause, or a candidate.

    Attributes
    ----------
    id, place: of the effect in the catalogue. channel: of the sensor, if the effect is a sensor error.
    probability: that the cause, or one in `ambiguous_with`, is present.
    parameters: name -> estimate.
    ambiguous_with: ids of effects that explain this log as well.
    absorbed_by_refit: share of its improvement that a refit of the nominal parameters alone achieves.
    gap_closed: 1 - G_with / G_nominal on held-out data; of several causes, the part of this one.
    alone: signal -> gap that it makes with the other causes unchanged.
    why_same: those of `ambiguous_with` that are equivalent on any log -> reason.
    """

    id: str
    channel: str | None
    place: str
    probability: float
    parameters: Mapping[str, CauseParameter]
    ambiguous_with: tuple[str, ...] = ()
    absorbed_by_refit: float = 0.0
    gap_closed: float = 0.0
    alone: Mapping[str, float] = field(default_factory=dict)
    why_same: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Id, with the channel for a sensor error."""
        return name_of((self.id, self.channel))

    @property
    def summary(self) -> str:
        """The effect in one line, from the catalogue."""
        return EFFECTS[self.id].summary

    to_dict = as_dict


@dataclass(frozen=True)
class RankedHypothesis:
    """A scored hypothesis.

    members: names of its causes. evidence: its deviance (-2 log-likelihood) minus that of the best hypothesis. gap: the
    largest gap of a signal on held-out data.
    """

    members: tuple[str, ...]
    evidence: float
    gap: float


@dataclass(frozen=True)
class RelatedEffect:
    """An effect that is near to what stays unexplained, and is not claimed.

    gap_closed: share of the nominal gap in total that its hypothesis closes on held-out data. parameters: its numbers
    in that hypothesis.
    """

    id: str
    channel: str | None
    gap_closed: float
    parameters: Mapping[str, CauseParameter]


@dataclass(frozen=True)
class LogGap:
    """One of several logs that were diagnosed together: the fields of `Diagnosis` that are its own."""

    log: Log
    gap: Mapping[str, Mapping[str, float]]
    whole: Mapping[str, float]
    noise_sd: Mapping[str, float]
    held_out: str
    held_spans: tuple[tuple[float, float], ...]
    simulated: Mapping[str, Mapping[str, np.ndarray]] = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """As under `logs` in diagnosis.json."""
        log = self.log
        return as_dict(
            self, "gap held_out held_spans", path=log.path, samples=len(log), gap_whole_log=self.whole,
            settings={name: float(value) for name, value in log.settings.items()},
        )  # fmt: skip


@dataclass(frozen=True, repr=False)
class Diagnosis(Result):
    """Where a log differs from the nominal plant, which effect is the cause, and how much of the gap it closes.

    Attributes
    ----------
    plant, log: nominal plant and measured log, the first one of several. threshold: smallest relevant gap.
    verdict: one of Verdict; `sentence` is the verdict in words.
    where: (place, share of the gap), the largest first; the shares add up to one.
    effects: causes, the largest first; candidates if the verdict is "underdetermined".
    gap: model (see MODELS) -> signal -> gap on held-out data. whole: signal -> gap of the nominal plant, whole log.
    held_out: description of the held-out data. held_spans: start and end of its parts in the log [s].
    logs: of several logs that were diagnosed together, each one's own figures; empty for a single log. The gaps above
        are then averages of squares over the logs.
    noise_sd: channel -> standard deviation of its noise, SI units.
    values: model -> parameters and sensor settings that differ from the nominal plant.
    simulated: model -> channel -> (N,) free run over the whole log.
    floor: signal -> gap on held-out data that sensor noise, noise of the logged input and single slips make.
    folds: gaps with each third of a long log held out in turn; empty for a short one, and where no cause is named.
    nearest: effects near to what stays unexplained, not claimed ("outside_catalogue" and "partly").
    rest: the free curve that closes most of what the causes leave, in words; None if none closes much of it.
    law: law that the catalogue lacks, for what the causes leave; None if none is clearly better.
    candidates: all scored hypotheses, the best first.
    location: place of the gap, found without the catalogue of effects.
    improved: the plant with the law, else with the causes added, or with refitted nominal parameters if none is named;
        None without a gap. with_causes: without the law, if there is one.
    next_experiment: the proposed experiment in words. experiment: its input, if there is one.
    closed_loop: the same models under the controller of the log; None without a closed-loop replay.
    findings: warnings on the log and notes on the gaps. seconds: computing time. runs: number of simulations.
    """

    plant: Plant
    log: Log
    threshold: float
    verdict: Verdict
    where: tuple[tuple[str, float], ...]
    effects: tuple[Cause, ...]
    gap: Mapping[str, Mapping[str, float]]
    whole: Mapping[str, float]
    held_out: str
    noise_sd: Mapping[str, float]
    values: Mapping[str, Mapping[str, float]]
    simulated: Mapping[str, Mapping[str, np.ndarray]] = field(repr=False)
    floor: Mapping[str, float] = field(default_factory=dict)
    folds: tuple[Fold, ...] = ()
    nearest: tuple[RelatedEffect, ...] = ()
    rest: str | None = None
    law: ProposedLaw | None = None
    candidates: tuple[RankedHypothesis, ...] = ()
    location: Location | None = None
    improved: Plant | None = field(default=None, repr=False)
    with_causes: Plant | None = field(default=None, repr=False)
    held_spans: tuple[tuple[float, float], ...] = ()
    logs: tuple[LogGap, ...] = ()
    next_experiment: str | None = None
    experiment: NextExperiment | None = field(default=None, repr=False)
    closed_loop: ClosedLoopReplay | None = None
    findings: tuple[str, ...] = ()
    seconds: float = 0.0
    runs: int = 0
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def whole_with_effects(self) -> dict[str, float] | None:
        """Gap of the model with the causes over the whole log, two thirds of which it may have been fitted to.

        None without a free run of this model.
        """
        if self.logs:
            own = [found for one in self.by_log() if (found := one.whole_with_effects) is not None]
            return joint_gap(own) if len(own) == len(self.logs) else None
        shown = self.simulated.get("with_effects")
        if not shown:
            return None
        signals, dt = self.plant.structure.system.scored, self.log.sample_time
        noise = signal_noise(signals, self.noise_sd, dt)
        measured, simulated = scored_signals(signals, self.log.channels, dt), scored_signals(signals, shown, dt)
        shared = {name: values for name, values in measured.items() if name in simulated and name in noise}
        return gap(shared, simulated, noise) if shared else None

    def by_log(self) -> list[Diagnosis]:
        """The diagnosis with the figures of one log at a time, for figures and tables."""
        if not self.logs:
            return [self]
        names = ("log", "gap", "whole", "noise_sd", "held_out", "held_spans", "simulated")
        return [replace(self, logs=(), **{name: getattr(one, name) for name in names}) for one in self.logs]

    @property
    def improved_gap(self) -> Mapping[str, float]:
        """Signal -> gap that the improved plant leaves on held-out data: with the law, else with the causes."""
        return self.gap["with_effects" if self.law is None else "with_law"]

    @property
    def explained(self) -> float:
        """Share of the nominal gap in total that the causes close on held-out data."""
        before, after = (self.gap[model]["total"] for model in ("nominal", "with_effects"))
        named = self.verdict in NAMING and before > 0.0
        return float(np.clip(1.0 - after / before, 0.0, 1.0)) if named else 0.0

    @property
    def nearest_sentence(self) -> str:
        """The most similar set of effects if none is the cause; empty if it closes less than half of the gap."""
        return nearest_sentence(self)

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        return verdict_sentence(self)

    def to_dict(self) -> dict[str, Any]:
        """Content of diagnosis.json."""
        plant, log = self.plant, self.log
        return as_dict(
            self, "verdict sentence gap held_out held_spans noise_sd next_experiment threshold candidates location "
            "findings seconds runs provenance explained floor nearest nearest_sentence rest folds",
            log=log.path, samples=len(log), sample_time=log.sample_time,
            plant=plant.name, plant_title=plant.title, model=plant.model,
            settings={p.name: p.written for p in plant.parameters.values() if p.source == "given"},
            where=[{"place": place, "share": share} for place, share in self.where],
            effects=[self._described(cause) for cause in self.effects],
            gap_whole_log=self.whole, law=None if self.law is None else self.law.to_dict(),
            **({"logs": [one.to_dict() for one in self.logs]} if self.logs else {}),
            **({"closed_loop": loop.gap, "closed_loop_replay": loop} if (loop := self.closed_loop) else {}),
        )  # fmt: skip

    def _shown(self, figures: Mapping[str, Any]) -> dict[str, Any]:
        """Of figures by model those that the verdict makes meaningful."""
        return {model: figures[model] for model in models_shown(self.verdict, figures)}

    def _described(self, cause: Cause) -> dict[str, Any]:
        """A cause with its text in the catalogue, and the nominal value and meaning of its parameters."""
        effect, found = EFFECTS[cause.id], as_dict(cause)
        own = {parameter.name: parameter for parameter in all_parameters(cause.id)}
        meanings = {kind.name: kind.meaning for kind in self.plant.structure.equations.parameters}
        for key, number in found["parameters"].items():
            name, log = shared_name(key), log_of(key)
            within = f" ({log})" if log else ""
            if cause.channel is not None and name == "value" and effect.sensor:
                sensor = self.plant.sensors.get(cause.channel, Sensor(cause.channel, number["unit"]))
                number |= {"name": f"{effect.sensor}{within}", "belongs_to": "sensor"}
                number["nominal"] = getattr(sensor, effect.sensor)
                number["meaning"] = f"{effect.sensor} of the sensor of {cause.channel}"
            else:
                # None: the nominal plant lacks this friction, or this parameter of another friction law.
                absent = own[name].neutral if name in own else None
                nominal = self.plant[name] if name in self.plant.parameters else absent
                number |= {
                    "name": f"{name}{within}",
                    "belongs_to": "effect" if name in own else "plant",
                    "nominal": nominal,
                }
                number["meaning"] = own[name].meaning if name in own else meanings.get(name, "")
        return {**found, "summary": effect.summary, "fingerprint": effect.fingerprint}

    def to_pandas(self) -> pandas.DataFrame:
        """One row per cause."""
        import pandas

        names = "place probability gap_closed absorbed_by_refit ambiguous_with"
        causes = as_table(self.effects, names, ambiguous_with=lambda cause: ", ".join(cause.ambiguous_with))
        numbers = [{name: number.value for name, number in cause.parameters.items()} for cause in self.effects]
        return causes.rename_axis("cause").reset_index().join(pandas.DataFrame(numbers))

    def plot(self) -> Figure:
        """Measured and simulated signals, with the nominal plant and with the causes."""
        return draw(self)

    def __str__(self) -> str:
        lines = [self.sentence, f"  held-out data: {self.held_out}"]
        lines += _gap_table("gap there (%)", self._shown(self.gap))
        if self.folds:
            lines.append(f"  {folds_sentence(self.folds)}")
        for one in self.logs:
            shown = [f"{MODEL_WORDS[m]} {100.0 * gaps['total']:.2f} %" for m, gaps in self._shown(one.gap).items()]
            lines.append(f"  {one.log.name}: total gap {', '.join(shown)}")
        if self.closed_loop is not None:
            loop = self.closed_loop
            lines += _gap_table("in closed loop (%)", {**self._shown(loop.gap), "sensor noise alone": loop.floor})
            errors, drives = self._shown(loop.position_error), self._shown(loop.drive_gap)
            rows = [f"{MODEL_WORDS[model]} {1e3 * value:.3g} mm" for model, value in errors.items()]
            lines.append(f"  position error with {loop.controller} (RMS): {', '.join(rows)}")
            rows = [f"{MODEL_WORDS[model]} {100.0 * value:.2f} %" for model, value in drives.items()]
            lines.append(f"  gap of the drive: {', '.join(rows)}")
        if self.where:
            lines.append(
                "  place of the gap, over the whole log: "
                + ", ".join(f"{place} {100 * share:.0f} %" for place, share in self.where if share >= 0.01)
            )
        for cause in self.effects:
            numbers = ", ".join(
                f"{label(n)} = {p.value:.4g}{unit_suffix(p.unit)}, not determined by {the_data(self)}"
                if np.isinf(p.sd)
                else f"{label(n)} = {p.value:.4g} +- {p.sd:.2g}{unit_suffix(p.unit)}"
                for n, p in cause.parameters.items()
            )
            lines.append(f"  {cause.name}: probability {cause.probability:.2f}, {numbers}")
            if cause.ambiguous_with:
                lines.append(f"    {the_data(self)} can't separate it from {join_words(alternatives_of(cause))}")
        if self.nearest_sentence:
            lines.append(f"  {self.nearest_sentence}")
        if self.next_experiment:
            lines.append(f"  next experiment: {self.next_experiment}")
        return "\n".join(lines)


def _gap_table(title: str, gap: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Gaps in percent, one line per model; the first line names the signals."""
    signals = tuple(next(iter(gap.values())))
    lines = [f"  {title:<28}" + "".join(f"{signal:>14}" for signal in signals)]
    for model, gaps in gap.items():
        cells = (f"{100.0 * gaps.get(signal, np.nan):>14.2f}" for signal in signals)
        lines.append(f"  {MODEL_WORDS.get(model, model):<28}" + "".join(cells))
    return lines
