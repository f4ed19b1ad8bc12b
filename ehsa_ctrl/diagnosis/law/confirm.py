"""Confirm a proposed law on logs that it was not found from: another load or waveform of the same rig.

The law is simulated in free run as its file states it, and with its numbers refitted. It is refused where the logs
can't tell: they are the old ones, or the law hardly acts in them; and where they contradict it: it gains nothing, its
numbers change, or the catalogue explains the logs better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import correlate

from ...core.errors import InputError, choices
from ...core.log import Log
from ...core.parallel import one_blas_thread
from ...core.text import join_words
from ...core.unit import unit_suffix
from ...identification.plant_log import read_plant_log
from ...physics.effects import ADDENDS, EFFECTS, CandidateEffect, Effect, LawFile, LawLog, law_candidate
from ...plant.plant import Plant
from ..diagnose import diagnose
from ..diagnosis import Cause, Diagnosis
from ..free_curve import BETTER
from ..objective import Objective, objective_of
from ..place_sets import InjectionCase
from ..pool import Watch
from ..prepared_logs import PreparedLogs, Segments, prepare_logs, split_logs
from ..records import Segment
from ..refit import HypothesisFit, refit_until_converged
from ..regressors import contact_efforts
from ..signals import largest
from ..sizes import fit_sizes, uncertain
from .confirmation import Confirmation, RefittedNumber, SeenRange

# The numbers below are engineering judgement.

#: A number has changed if its 95 % interval and that of the proposal are apart, and it differs by this share; one that
#: places or shapes a term, if it alone changes a run by this share of what the whole law does.
INTERVAL, CHANGED = 1.96, 0.1
#: The size of a law is not determined if its standard deviation is this share of it.
UNSURE = 0.5
#: A log repeats another one if each channel of both correlates by more than this over the same stretch, at any shift in
#: time, and this stretch is at least so much of the shorter log.
SAME, STRETCH = 0.995, 0.5


@one_blas_thread()
def confirm_law(
    plant: Plant, name: str, logs: Sequence[Log], *, threshold: float = 0.03, watch: Watch | None = None
) -> Confirmation:
    """Test the law of an effect's file on further logs of the rig.

    Parameters
    ----------
    plant: nominal plant; the law in it, if it has it, is left out for comparison.
    name: of the effect.
    logs: of one rig, under loads or waveforms that the law was not found from.
    threshold, watch: as for `diagnose`.

    Raises
    ------
    InputError: as `diagnose`; or the effect is not one of a TOML file, or does not fit the plant.
    """
    effect = law_effect(name)
    assert effect.law is not None
    law = effect.law.definition
    bare = plant.with_structure(
        replace(plant.structure, effects=tuple(n for n in plant.structure.effects if n != name))
    )
    bare.with_effects(name)  # raises InputError for one that does not fit
    file = Path(effect.law.where)
    same = [words for log in logs for words in _repetitions(log, law, file, bare)]
    empty = Confirmation(name, file, law, tuple(logs), tuple(same))
    if same:
        return empty
    prepared = prepare_logs(bare, logs, None, threshold, check=True)
    whole = Segment(tuple(one.record for one in prepared.logs), join_words(one.log.name for one in prepared.logs))
    before = whole.gap({})
    if largest(before) < threshold:
        words = f"the nominal plant has no gap of {100 * threshold:g} % on it ({100 * largest(before):.2g} %), so that"
        return replace(empty, refused=(f"{words} nothing is left for a law to explain; drive the rig harder",))
    tested = _Test.of(prepared, split_logs(prepared, whole, has_gap=True), effect, law, threshold)
    refused = tested.refusals
    alternatives: tuple[str, ...] = ()
    if not refused:
        found = diagnose(bare, list(logs), threshold=threshold, watch=watch)
        refused, alternatives = tested.closed_by(found, name), _alternatives(found, name)
    return replace(
        empty,
        refused=refused,
        gap=tested.gap,
        parameters=tested.numbers,
        range=_ranges(prepared, law),
        alternatives=alternatives,
        held_out=tested.segments.held_out.name,
    )


def law_effect(name: str) -> Effect:
    """The effect of a TOML file by its name. Raises InputError for another one."""
    own = {key: one for key, one in EFFECTS.items() if one.law is not None}
    if name in own:
        return own[name]
    if name in EFFECTS:
        raise InputError(f"{name} is not an effect from a TOML file, so that it has no status to confirm")
    known = choices(name, own) if own else "none is known here"
    raise InputError(
        f"effect {name!r} is not known among those of TOML files: {known}; give the file of a proposed law, such as "
        "effects/NAME.toml in the folder of a diagnosis"
    )


def _repetitions(log: Log, law: LawFile, file: Path, plant: Plant) -> list[str]:
    """Why a log is not a second one: it is known, or it repeats one that can still be read.

    file: of the law. A log with a relative path was read from the folder of the project, above that file.
    """
    own = LawLog.of(log)
    for known in law.logs:
        if own is not None and own.sha256 == known.sha256:
            return [f"{log.name} is a log from which the law was found ({known.path}); give another load or waveform"]
    for known in law.logs:
        places = (folder / known.path for folder in (Path(), *file.resolve().parents))
        try:
            other = read_plant_log(next(filter(Path.is_file, places), Path(known.path)), plant)
        except InputError:
            continue
        if _alike(log, other):
            return [f"{log.name} repeats {known.path}, channel by channel; give another load or waveform"]
    return []


def _alike(one: Log, other: Log) -> bool:
    """Whether a stretch of one log repeats one of the other, which may be cut, shifted in time or sampled otherwise."""
    shared = [name for name in one.channels if name in other.channels]
    shared = [name for name in shared if np.std(one[name]) > 0.0 and np.std(other[name]) > 0.0]
    if not shared:
        return False
    dt = max(one.sample_time, other.sample_time)
    found: list[np.ndarray] = []
    for name in shared:
        a, b = (np.interp(np.arange(log.time[0], log.time[-1], dt), log.time, log[name]) for log in (one, other))
        found.append(_correlations(a, b, int(STRETCH * min(a.size, b.size))))
    return bool(np.max(np.min(found, axis=0), initial=-1.0) > SAME)


def _correlations(one: np.ndarray, other: np.ndarray, shortest: int) -> np.ndarray:
    """Correlation coefficients of two signals (N,) and (M,) where they overlap, for each shift that leaves `shortest`
    samples of overlap or more."""
    # Deviations from the mean, because differences of large sums lose digits.
    a, b = one - one.mean(), other - other.mean()
    ones = np.ones_like(a), np.ones_like(b)
    pairs = (ones[0], ones[1]), (a, ones[1]), (ones[0], b), (a**2, ones[1]), (ones[0], b**2), (a, b)
    n, A, B, AA, BB, AB = (correlate(first, second, "full", "fft") for first, second in pairs)
    kept = n > max(shortest, 2) - 0.5
    n, A, B, AA, BB, AB = (part[kept] for part in (n, A, B, AA, BB, AB))
    variances = np.maximum(AA - A**2 / n, 0.0) * np.maximum(BB - B**2 / n, 0.0)
    # Where a channel hardly moves in the stretch, the sums are rounding errors.
    moves = variances > 1e-6 * (a @ a) * (b @ b)
    return np.where(moves, (AB - A * B / n) / np.sqrt(np.where(moves, variances, 1.0)), 0.0)


@dataclass(frozen=True)
class _Test:
    """Free runs of a law. values: of the file. refitted, sd: of its numbers. gap: model -> signal -> gap, held out.

    change: largest gap that the law alone makes. moved: number of the law that places or shapes a term -> the same that
    its refitted value alone makes, beside the law as proposed.
    """

    segments: Segments
    values: Mapping[str, float]
    law: LawFile
    refitted: Mapping[str, float]
    sd: Mapping[str, float]
    gap: Mapping[str, Mapping[str, float]]
    change: float
    moved: Mapping[str, float]
    threshold: float

    @classmethod
    def of(cls, prepared: PreparedLogs, segments: Segments, effect: Effect, law: LawFile, threshold: float) -> _Test:
        """Fit on the training data of the logs, score on the held-out data."""
        objective, _ = objective_of(segments.training, threshold)
        free = law_candidate(effect, prepared.model.plant.values)
        fixed = replace(free, free=tuple(replace(one, fixed=True) for one in free.free))
        values = {n: one.value for n, one in law.parameters.items()}
        settings: dict[str, Mapping[str, float]] = {"nominal": {}}
        fits: dict[str, HypothesisFit | None] = {}
        for model, candidates in {"refit": (), "with_law": (fixed,), "law_refitted": (free,)}.items():
            fits[model] = _fit(objective, candidates, values)
            settings[model] = {} if (fit := fits[model]) is None else fit.values
        sd: Mapping[str, float] = {}
        if (best := fits["law_refitted"]) is not None:
            best, sd = fit_sizes(uncertain(objective, best), best)
            settings["law_refitted"] = best.values
        refitted = {n: settings["law_refitted"].get(n, float("nan")) for n in values}
        shapes = [n for n, one in law.parameters.items() if one.neutral is None and np.isfinite(refitted[n])]
        whole = segments.whole
        without, proposed, *others = whole.run([{}, values, *(values | {n: refitted[n]} for n in shapes)])
        change = 0.0 if without is None or proposed is None else largest(whole.change(proposed, without))
        moved = {
            n: float("inf") if run is None or proposed is None else largest(whole.change(run, proposed))
            for n, run in zip(shapes, others, strict=True)
        }
        gap = {model: segments.held_out.gap(setting) for model, setting in settings.items()}
        return cls(segments, values, law, refitted, sd, gap, change, moved, threshold)

    @property
    def numbers(self) -> dict[str, RefittedNumber]:
        """Each number of the law in the file and refitted."""
        found = {}
        for name, one in self.law.parameters.items():
            # A diagnosis leaves out the deviation of a number that its log does not determine. In a file that was
            # written by hand, without logs, the number holds as it stands.
            unknown = float("inf") if self.law.logs else 0.0
            before = unknown if one.sd is None else one.sd
            after, sd = self.refitted[name], self.sd.get(name, float("inf"))
            apart = abs(after - one.value) > INTERVAL * (before + sd)
            if name in self.moved:
                # The width of a step may be any small one: what counts is what the law does.
                changed = self.moved[name] > CHANGED * self.change
            else:
                changed = abs(after - one.value) > CHANGED * abs(one.value)
            found[name] = RefittedNumber(one.value, one.sd, after, sd, one.unit, not (apart and changed))
        return found

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why the logs do not confirm the law, whatever the catalogue explains; empty if they do."""
        if self.change < self.threshold:
            words = f"too little excitation: the law changes no signal by {100 * self.threshold:g} % there (largest "
            return (f"{words}{100 * self.change:.2g} %); drive the rig through the range of the law",)
        out = []
        without, with_law = self.gap["refit"]["total"], self.gap["with_law"]["total"]
        if not np.isfinite(with_law):
            out.append(
                "the simulation with the law as proposed stops early there: the log may leave the range in which the "
                "law was found"
            )
        elif not with_law < BETTER * without:
            out.append(
                f"the law gains nothing: with it as proposed {100 * with_law:.3g} % of gap are left, without it "
                f"{100 * without:.3g} %, nominal parameters refitted in both; expected less than {100 * BETTER:.0f} % "
                "of that"
            )
        numbers = self.numbers
        sizes = {n: one for n, one in numbers.items() if self.law.parameters[n].neutral is not None}
        unsure = [n for n, one in sizes.items() if one.sd > UNSURE * abs(one.value)]
        if unsure:
            out.append(f"too little excitation: {join_words(unsure)} can't be determined from these logs")
        out += [
            f"the size changes: {n} is {one.value:.4g} +- {INTERVAL * one.sd:.2g}{unit_suffix(one.unit)} here, "
            f"proposed {one.proposed:.4g} +- {INTERVAL * (one.proposed_sd or 0.0):.2g}"
            for n, one in numbers.items()
            if not one.overlaps and n not in unsure
        ]
        return tuple(out)

    def closed_by(self, found: Diagnosis, name: str) -> tuple[str, ...]:
        """Why the catalogue explains the logs better; empty if it does not, and where the law is what it names. found:
        diagnosis of the logs with the law as one of the effects. name: of the law."""
        if _naming(found, name):
            return ()
        named = [cause.name for cause in found.effects if cause.probability >= 0.5]
        closed, own = found.explained, 1.0 - self.gap["with_law"]["total"] / max(self.gap["nominal"]["total"], 1e-12)
        if named and closed > own and found.verdict in ("effect", "parameters"):
            words = f"{join_words(named)} of the catalogue closes more: {100 * closed:.0f} % against {100 * own:.0f} %"
            return (words,)
        return ()


def _fit(
    objective: Objective, candidates: Sequence[CandidateEffect], values: Mapping[str, float]
) -> HypothesisFit | None:
    """Nominal parameters as uncertain as on a typical rig, with the law, from its numbers."""
    nominal = objective.nominal
    wide = replace(objective, nominal=replace(nominal, sd=nominal.typical))
    return refit_until_converged(wide, candidates, values if candidates else {})


def _ranges(prepared: PreparedLogs, law: LawFile) -> dict[str, SeenRange]:
    """Range of each variable of the law but the direction of motion: where it was found, and in these logs."""
    cases = [InjectionCase.of(one.plant, one.log, one.noise) for one in prepared.logs]
    contacts = prepared.plant.structure.system.all_contacts
    known = [
        {k: v for c in contacts for k, v in contact_efforts(case.plant, case.signals, c).items()}
        | dict(case.signals.values)
        for case in cases
    ]
    found, own = {}, ADDENDS[law.adds_to].own
    for name in law.variables:
        if any(name == contact.direction for contact in contacts):
            continue
        values = [one[n] for one in known for n in own.get(name, (name,)) if n in one]
        if values:
            low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
            found[name] = SeenRange(law.range.get(name), (low, high))
    return found


def _alternatives(found: Diagnosis, name: str) -> tuple[str, ...]:
    """Effects that explain the logs as well."""
    others = [other for cause in _naming(found, name) for other in (cause.id, *cause.ambiguous_with)]
    return tuple(dict.fromkeys(other for other in others if other != name))


def _naming(found: Diagnosis, name: str) -> list[Cause]:
    """The causes of a diagnosis that are an effect, or may be."""
    return [cause for cause in found.effects if name in (cause.id, *cause.ambiguous_with)]
