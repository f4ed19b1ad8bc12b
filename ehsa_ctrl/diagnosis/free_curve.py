"""What a free curve reaches: the best unknown input that follows one variable, fitted to the training data and injected
on held-out data.

A catalogue effect has a form; a curve has none. Where a curve closes clearly more of the gap on data that it was not
fitted to, the form of the effect is wrong. Where it does not, no other law of the same variables would do better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.log import Log
from ..plant.plant import Plant
from .injection import GapMeasure
from .place_sets import Form, InjectionCase, flow_forms, forms_by_place
from .regimes import Curve, curves_of
from .unknown_inputs import BalanceSignals

#: A free curve is clearly better if it leaves less than this part of the gap.
BETTER = 0.7


@dataclass(frozen=True)
class FreeCurve:
    """The free curve that leaves least of the gap on the training data.

    place: where it is injected. curves: of its unknown inputs. without, with_curve: gap in total on the held-out data
    without and with it, of one run over both segments; infinite where the run stopped.
    """

    place: str
    curves: tuple[Curve, ...]
    without: float
    with_curve: float

    @property
    def better(self) -> bool:
        """Whether it leaves clearly less."""
        return self.with_curve < BETTER * self.without


@dataclass(frozen=True)
class CurveLog:
    """A log for a free curve: plant with its causes, whole log, noise, and the parts that are fitted and held out."""

    plant: Plant
    log: Log
    noise: Mapping[str, float]
    training: tuple[slice, ...]
    held_out: tuple[slice, ...]


def free_curve(logs: Sequence[CurveLog]) -> FreeCurve | None:
    """The best free curve of a rig; None where the logs show no balance."""
    cases = _with_curves([InjectionCase.of(one.plant, one.log, one.noise) for one in logs], logs)
    forms = [_curve_forms(case) for case in cases]
    if not forms[0]:
        return None
    fitted = [i for i, one in enumerate(logs) if one.training]
    runs = {i: cases[i].run([{}, *(form.inputs for _, form in forms[i])]) for i in fitted}
    left = [[_total(cases[i].gap, run, logs[i].training) for run in runs[i][1:]] for i in fitted]
    best = int(np.argmin(np.mean(np.square(left), axis=0)))
    ends = []
    for i, one in enumerate(logs):
        if one.held_out:
            pair = [runs[i][0], runs[i][1 + best]] if i in runs else cases[i].run([{}, forms[i][best][1].inputs])
            ends.append([_total(cases[i].gap, run, one.held_out) for run in pair])
    without, with_curve = np.sqrt(np.mean(np.square(ends), axis=0)).tolist()
    place, form = forms[0][best]
    return FreeCurve(place, form.curves, without, with_curve)


def _curve_forms(case: InjectionCase) -> list[tuple[str, Form]]:
    """Place and form of every curve that can be injected; in one order for all cases with the same curves."""
    by_place = {**forms_by_place(case), "flow": flow_forms(case)}
    return [(place, form) for place, forms in by_place.items() for form in forms if form.curves]


def _with_curves(cases: Sequence[InjectionCase], logs: Sequence[CurveLog]) -> list[InjectionCase]:
    """Curves fitted to the training data of all logs, and followed over the whole of each."""
    signals, joint, fitted = joined(cases, logs)
    curves: list[dict[str, list[Curve]]] = [{} for _ in cases]
    for name, values in joint.items():
        found = curves_of(cases[0].plant, signals, name, values, fitted)
        begin = 0
        for case, own in zip(cases, curves, strict=True):
            part = slice(begin, begin + len(case.log) - 1)
            begin += len(case.log)
            own[name] = [curve.over(part) for curve in found]
    return [replace(case, curves=own) for case, own in zip(cases, curves, strict=True)]


def joined(
    cases: Sequence[InjectionCase], logs: Sequence[CurveLog]
) -> tuple[BalanceSignals, dict[str, np.ndarray], np.ndarray]:
    """Signals (N,) and unknown inputs (N - 1,) of all logs, one after the other, and the samples (N - 1,) to fit.

    Unknown inputs are NaN between two logs.
    """
    masks = [np.zeros(len(one.log), dtype=bool) for one in logs]
    for mask, one in zip(masks, logs, strict=True):
        for part in one.training:
            mask[part] = True
    signals = BalanceSignals(
        {n: np.concatenate([c.signals[n] for c in cases]) for n in cases[0].signals.values},
        {n: np.concatenate([c.signals.slides[n] for c in cases]) for n in cases[0].signals.slides},
        cases[0].signals.sample_time,
    )
    joint = {
        name: np.concatenate([np.append(c.unknown.values[name], np.nan) for c in cases])[:-1]
        for name in cases[0].unknown.values
    }
    return signals, joint, np.concatenate(masks)[:-1]


def _total(gap: GapMeasure, run: Mapping[str, np.ndarray], parts: Sequence[slice]) -> float:
    """Gap in total over parts of a run."""
    errors = gap.errors(run)
    errors = np.concatenate([errors[:, part] for part in parts], axis=1)
    if not np.isfinite(errors).all():
        return float("inf")
    return float(np.sqrt(np.mean(np.maximum(np.mean(errors**2, axis=1) - gap.noise_floor, 0.0))))
