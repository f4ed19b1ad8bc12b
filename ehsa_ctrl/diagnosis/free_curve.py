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


def free_curve(
    plant: Plant, log: Log, noise: Mapping[str, float], edge: int, validation: Log | None = None
) -> FreeCurve | None:
    """The best free curve beside a plant; None where the log shows no balance.

    plant: with its causes. log: from its beginning. edge: its first held-out sample, ignored with a `validation` log.
    """
    cases = [InjectionCase.of(plant, one, noise) for one in (log, validation) if one is not None]
    training, *others = _with_curves(cases, edge if validation is None else len(log) - 1)
    forms = _curve_forms(training)
    if not forms:
        return None
    base, *runs = training.run([{}, *(form.inputs for _, form in forms)])
    last = edge if validation is None else len(log)
    best = int(np.argmin([_total(training.gap, run, slice(0, last)) for run in runs]))
    held_out, scored, ends = training, slice(edge, None), [base, runs[best]]
    if others:
        held_out, scored = others[0], slice(None)
        ends = held_out.run([{}, _curve_forms(held_out)[best][1].inputs])
    without, with_curve = (_total(held_out.gap, run, scored) for run in ends)
    place, form = forms[best]
    return FreeCurve(place, form.curves, without, with_curve)


def _curve_forms(case: InjectionCase) -> list[tuple[str, Form]]:
    """Place and form of every curve that can be injected; in one order for all cases with the same curves."""
    by_place = {**forms_by_place(case), "flow": flow_forms(case)}
    return [(place, form) for place, forms in by_place.items() for form in forms if form.curves]


def _with_curves(cases: Sequence[InjectionCase], last: int) -> list[InjectionCase]:
    """Curves fitted up to sample `last` of the first case, and followed over all of them."""
    signals = BalanceSignals(
        {n: np.concatenate([c.signals[n] for c in cases]) for n in cases[0].signals.values},
        {n: np.concatenate([c.signals.slides[n] for c in cases]) for n in cases[0].signals.slides},
        cases[0].signals.sample_time,
    )
    curves: list[dict[str, list[Curve]]] = [{} for _ in cases]
    for name in cases[0].unknown.values:
        values = np.concatenate([np.append(c.unknown.values[name], np.nan) for c in cases])[:-1]
        found = curves_of(cases[0].plant, signals, name, values, last)
        begin = 0
        for case, own in zip(cases, curves, strict=True):
            part = slice(begin, begin + len(case.log) - 1)
            begin += len(case.log)
            own[name] = [curve.over(part) for curve in found]
    return [replace(case, curves=own) for case, own in zip(cases, curves, strict=True)]


def _total(gap: GapMeasure, run: Mapping[str, np.ndarray], part: slice) -> float:
    """Gap in total over a part of a run."""
    errors = gap.errors(run)[:, part]
    if not np.isfinite(errors).all():
        return float("inf")
    return float(np.sqrt(np.mean(np.maximum(np.mean(errors**2, axis=1) - gap.noise_floor, 0.0))))
