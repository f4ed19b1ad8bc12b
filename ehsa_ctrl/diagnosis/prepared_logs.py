"""The logs of a diagnosis: checked, with the model of all hypotheses, and split into training and held-out data."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from ..core.errors import InputError, choices
from ..core.log import Log, named
from ..core.text import join_words
from ..identification.checks import check_log, raise_on_error
from ..identification.plant_log import plant_of_log
from ..physics.effects import EFFECTS, CandidateEffect
from ..plant.plant import Plant
from .acting_model import law_switches
from .candidate_effects import candidate_effects
from .free_curve import CurveLog
from .hypothesis_model import (
    STRIBECK_SPECIAL_CASES,
    HypothesisModel,
    inapplicable_effects,
    with_every_effect,
)
from .improved_plant import improved_plant
from .own_offsets import log_of, values_in_log, with_own_offsets
from .records import Record, Segment, mean_square_root
from .refit import HypothesisFit
from .signals import largest, noise_of, slow_channels
from .split import NO_GAP, Split, choose_split
from .stretch import search_segment
from .together import check_other, check_together
from .validation_segment import initial_state, part_of_log, prepare_replay, replayed_effects, windows_by_log

#: Shortest log [s]. Engineering judgement: 2 s to fit and 1 s to hold out.
SHORTEST = 3.0
#: Windows of a segment in which laws are compared: a minute. Engineering judgement: longer records add time alone.
MOST_WINDOWS = 30


@dataclass(frozen=True)
class PreparedLog:
    """A checked log and the model that is compared with it.

    plant: nominal, with the settings of this log. log: as given. model: the plant with every effect, and the log with
    the channels that replayed effects need. noise: channel -> standard deviation, SI units.
    """

    plant: Plant
    log: Log
    model: HypothesisModel
    noise: Mapping[str, float]

    @property
    def record(self) -> Record:
        """The whole log as a record."""
        return Record(self.model, self.noise)

    def part(self, parts: Sequence[slice]) -> Record:
        """Parts of the log as a record."""
        return part_of_log(self.plant, self.model, self.noise, parts)


@dataclass(frozen=True)
class PreparedLogs:
    """The logs of a rig, and the second log for validation. plant: as given. findings: warnings."""

    plant: Plant
    logs: tuple[PreparedLog, ...]
    validation: PreparedLog | None
    findings: tuple[str, ...]
    threshold: float

    @property
    def model(self) -> HypothesisModel:
        """The model of the first log."""
        return self.logs[0].model

    @property
    def held_out_plants(self) -> list[Plant]:
        """Nominal plant of each record that is held out."""
        return [one.plant for one in (self.logs if self.validation is None else (self.validation,))]

    @property
    def noise(self) -> dict[str, float]:
        """Channel -> standard deviation, RMS over the logs."""
        return mean_square_root([log.noise for log in self.logs])


@dataclass(frozen=True)
class Segments:
    """The whole logs, the part for fitting, and the part held out for validation.

    searched: the part for fitting, or a stretch of it if it is long, see `search_segment`. splits: of each log; None
    with a second log for validation.
    """

    whole: Segment
    training: Segment
    held_out: Segment
    searched: Segment
    splits: tuple[Split, ...] | None

    def each(self, change: Callable[[Segment], Segment]) -> Segments:
        """The same segments, changed one by one."""
        whole, training, held_out, searched = map(change, (self.whole, self.training, self.held_out, self.searched))
        return Segments(whole, training, held_out, searched, self.splits)

    def searched_samples(self, prepared: PreparedLogs) -> list[tuple[slice, ...]]:
        """The samples of each log that are searched."""
        found = []
        for record, one in zip(self.searched.records, prepared.logs, strict=True):
            log = record.model.log
            first = int(round((log.time[0] - one.log.time[0]) / log.sample_time))
            spans = (part.indices(len(log)) for part in record.parts)
            found.append(tuple(slice(first + begin, first + end) for begin, end, _ in spans))
        return found

    def windows(self, prepared: PreparedLogs) -> tuple[tuple[Segment, ...], tuple[Segment, ...]] | None:
        """Training and held-out data of each log in windows, at most MOST_WINDOWS of each.

        None where a log does not show the state at their start.
        """
        plants = [one.plant for one in prepared.logs]
        training = windows_by_log(plants, self.training)
        held_out = windows_by_log(prepared.held_out_plants, self.held_out)
        return None if training is None or held_out is None else (_thinned(training), _thinned(held_out))


def _thinned(by_log: Sequence[Segment]) -> tuple[Segment, ...]:
    """Windows at equal distances, at most MOST_WINDOWS in all logs together."""
    step = -(-sum(len(one.records) for one in by_log) // MOST_WINDOWS)
    return tuple(replace(one, records=one.records[::step]) for one in by_log)


def prepare_logs(
    plant: Plant, logs: Sequence[Log], validate: Log | None, threshold: float, *, check: bool
) -> PreparedLogs:
    """Check threshold and logs, and set up the model of all hypotheses.

    Raises InputError as `diagnose`.
    """
    check_threshold(threshold)
    everything = named([*logs, *([] if validate is None else [validate])])
    check_together(everything[: len(logs)])
    if validate is not None:
        check_other(logs, validate)
    findings = [*_check_logs(plant, everything, check), *(e.caveat for e in replayed_effects(plant))]
    findings += [words for log in everything if (words := _too_slow(plant, log))]
    findings += [f"effect {name} was not tested: {reason}" for name, reason in inapplicable_effects(plant).items()]
    found: list[PreparedLog] = []
    labels = [log.name for log in everything]
    labels = labels if len(set(labels)) == len(labels) else [str(number) for number in range(1, len(labels) + 1)]
    for log, label in zip(everything, labels, strict=True):
        own = plant_of_log(plant, log)
        ready = prepare_replay(own, log, found[0].model.log if found else None, all_effects=True)
        start, laws = initial_state(own, log), _plants_by_law(own)
        model = HypothesisModel(with_every_effect(own), ready, start, laws, label=label)
        found.append(PreparedLog(own, log, model, noise_of(own, log)))
    validation = None if validate is None else found.pop()
    return PreparedLogs(plant, tuple(found), validation, tuple(filter(None, findings)), threshold)


def _too_slow(plant: Plant, log: Log) -> str:
    """Finding on a log whose samples are too far apart to show the noise of its sensors; empty for others."""
    names = slow_channels(plant, log)
    if not names:
        return ""
    return (
        f"{log.name}: {join_words(names)} {'moves' if len(names) == 1 else 'move'} too far between two samples "
        f"({1e3 * log.sample_time:.3g} ms) to tell noise from motion; the noise that the plant states for its sensors "
        "is taken; a faster log tells more"
    )


def segment_candidates(training: Segment, without: Collection[str] = ()) -> tuple[CandidateEffect, ...]:
    """Candidate effects on a segment; parameters that are set for single logs can't be estimated.

    without: ids that are left out.
    """
    found = candidate_effects(training.model, [record.scored_log for record in training.records])
    found = with_own_offsets(found, [record.model.label for record in training.records])
    return tuple(c for c in found if training.own_parameters.isdisjoint(c.names) and c.id not in without)


def left_out(without: Collection[str]) -> list[str]:
    """Finding on effects that a diagnosis leaves out. Raises InputError for an unknown id."""
    for id in without:
        if id not in EFFECTS:
            raise InputError(f"without = {id!r} is no effect; {choices(id, EFFECTS)}")
    return [f"left out of the catalogue: {join_words(sorted(without))}"] if without else []


def check_threshold(threshold: float) -> None:
    """Raises InputError unless the threshold is a share between 0 and 1."""
    if not 0.0 < threshold < 1.0:
        raise InputError(f"threshold = {threshold:g}; expected a share between 0 and 1, such as 0.03")


def _plants_by_law(plant: Plant) -> dict[str, Plant]:
    """Friction law -> the plant with this law, for hypotheses that replace the rod's friction law.

    Empty where no replacement is possible: presliding needs a rod that the chamber pressures move.
    """
    structure = plant.structure
    if plant.model != "nonlinear" or structure.chambers is None or structure.system.prescribed:
        return {}
    own = [plant.structure.law(contact) for contact in plant.structure.system.contacts if contact.name == "rod"]
    if any(law.name not in STRIBECK_SPECIAL_CASES and law.state_rate is None for law in own):
        # The two laws are not nested: replacing one by the other would change more than the effect does.
        return {}
    return {switch.law: with_every_effect(plant, switch.law) for switch in law_switches()}


def _check_logs(plant: Plant, logs: Sequence[Log], check: bool) -> list[str]:
    """Warnings on the logs.

    Raises InputError for a log that is too short, lacks the channel of the drive or, with `check`, has an error.
    """
    sentences = []
    for log in logs:
        for drive in plant.structure.system.drives.values():
            if drive not in log.channels:
                raise InputError(
                    f"{log.path or 'the log'}: has no channel {drive}, which drives the simulation; record it, or map "
                    "it in the plant's [log] table"
                )
        findings = check_log(log, plant)
        if check:
            raise_on_error(log, findings)
        sentences += [finding.labelled(log).sentence for finding in findings]
        length = float(log.time[-1] - log.time[0])
        if length < SHORTEST:
            raise InputError(
                f"{log.path or 'the log'}: lasts {length:.3g} s; a diagnosis needs at least {SHORTEST:g} s, of which "
                "a third is held out"
            )
    return sentences


def split_logs(prepared: PreparedLogs, whole: Segment, *, has_gap: bool) -> Segments:
    """The segments: the validation log is held out, or else a part of each log.

    has_gap: whether the nominal model has a gap, so that the parts of a single log should have it too.
    """
    logs, validation = prepared.logs, prepared.validation

    def segments(fitted: Sequence[Record], held_out: Segment, splits: tuple[Split, ...] | None) -> Segments:
        training = Segment(tuple(fitted), "the training data")
        searched = search_segment([one.plant for one in logs], training) if has_gap else training
        return Segments(whole, training, held_out, searched, splits)

    if validation is not None:
        return segments(whole.records, Segment((validation.record,), validation.log.name), None)

    def nominal_gaps(split: Split) -> tuple[float, float]:
        training, held_out = (Segment((logs[0].part(parts),), "") for parts in (split.training, split.held_out))
        return largest(training.gap({})), largest(held_out.gap({}))

    compare = nominal_gaps if has_gap and len(logs) == 1 else None
    chosen = tuple(choose_split(log.record, prepared.threshold, compare) for log in logs)
    fitted = [log.part(split.training) for log, split in zip(logs, chosen, strict=True)]
    kept = tuple(log.part(split.held_out) for log, split in zip(logs, chosen, strict=True))
    words = join_words(split.words(log.model.log) for log, split in zip(logs, chosen, strict=True))
    return segments(fitted, Segment(kept, words), chosen)


def unmoved_signals(segments: Segments) -> list[str]:
    """Findings on signals that stand still in a segment.

    Raises InputError if no signal moves in it.
    """
    found = []
    for segment in (segments.training, segments.held_out):
        names = sorted(segment.unmoved)
        if not any(record.measured for record in segment.records):
            raise InputError(
                f"{segment.paths}: no signal moves by more than its noise in {segment.name}; record the rig in motion, "
                "or select a part in which it moves"
            )
        if names:
            found.append(f"not scored in {segment.name}, because it stands still there: {join_words(names)}")
    return found


def curve_logs(
    prepared: PreparedLogs, segments: Segments, improved: Plant, fit: HypothesisFit | None = None
) -> list[CurveLog]:
    """The logs for a free curve beside the improved plant, with those offsets of a fit that act in one log alone."""
    found = []
    for i, one in enumerate(prepared.logs):
        split = segments.splits[i] if segments.splits is not None else None
        parts = (split.training, split.held_out) if split is not None else ((slice(0, len(one.log)),), ())
        there = plant_of_log(improved, one.log)
        if fit is not None and (own := {n: v for n, v in fit.values.items() if log_of(n) == one.model.label}):
            there = improved_plant(there, fit.candidates, values_in_log(own, one.model.label), {})
        found.append(CurveLog(there, one.log, one.noise, *parts))
    if prepared.validation is not None:
        log = prepared.validation.log
        # The curve's noise is that of the data it is fitted to.
        found.append(CurveLog(plant_of_log(improved, log), log, prepared.noise, (), (slice(0, len(log)),)))
    return found


def one_sided_gap(segments: Segments, threshold: float) -> list[str]:
    """A finding where the nominal model has a gap in the training or the held-out data only."""
    training, held_out = (largest(segment.gap({})) for segment in (segments.training, segments.held_out))
    if min(training, held_out) >= NO_GAP * threshold or max(training, held_out) < threshold:
        return []
    two_logs = segments.splits is None
    names = (
        ("the log that is fitted", "the log for validation") if two_logs else ("the training data", "the held-out data")
    )
    here, there = names if training > held_out else names[::-1]
    sizes = f"{100 * max(training, held_out):.3g} %, {100 * min(training, held_out):.2g} % in {there}"
    why = "what was fitted could not be validated" if training > held_out else "nothing could be fitted to it"
    todo = "give a second log with --validate"
    if two_logs:
        todo = "the logs are of different rigs or states, or one does not excite what causes the gap; give another log"
    return [f"the gap of the nominal model lies in {here} alone ({sizes}), so that {why}: {todo}"]
