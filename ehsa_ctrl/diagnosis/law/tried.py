"""Laws in free run beside their hypotheses, and which of them the data can't tell from the best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..free_curve import CurveLog, joined
from ..model_selection import Reference, relative_weights
from ..objective import NominalParameters
from ..place_sets import InjectionCase
from ..refit import HypothesisFit
from ..scoring import CauseKey, ScoredHypothesis, Scoring
from .free_run import FreeRunLaw
from .inputs import LawInput, law_inputs, with_combined
from .judgement import clearly_better, replaces
from .sum_problem import evidence

#: Smallest probability of a form in the result. Engineering judgement.
LIKELY = 0.02


@dataclass(frozen=True)
class LawBase:
    """What a law is added to. logs: with the plant. fit: the hypothesis, refitted in the scoring."""

    logs: Sequence[CurveLog]
    fit: HypothesisFit

    def inputs(self, nominal: NominalParameters) -> list[LawInput]:
        """The unknown inputs of its plant."""
        cases = [InjectionCase.of(one.plant, one.log, one.noise) for one in self.logs]
        return law_inputs(cases, *joined(cases, self.logs), nominal)


#: A fit without a law -> what a law is added to.
BaseOf = Callable[[HypothesisFit], LawBase]


@dataclass(frozen=True)
class LawData:
    """What laws are found on, fitted to and judged by: all data, or the stretches of a long log that are searched; the
    windows are always those of all data.

    reference: of the scoring.
    """

    base_of: BaseOf
    scoring: Scoring
    reference: Reference


@dataclass(frozen=True)
class TriedLaw:
    """A law in free run, with what it was found from.

    without: its hypothesis without the law. input: of the shorter windows, if there are two.
    """

    law: FreeRunLaw
    base: LawBase
    without: ScoredHypothesis
    input: LawInput
    placebo: float

    @property
    def measured(self) -> np.ndarray:
        """The unknown input (N - 1,) of the plant with the nominal parameters of the law's refit."""
        fit = self.law.scored.fit
        names = {one.name for one in fit.free[fit.n_effect :]} & self.base.logs[0].plant.parameters.keys()
        refitted = {name: fit.values[name] for name in names}
        logs = [replace(one, plant=one.plant.set(**refitted)) for one in self.base.logs]
        cases = [InjectionCase.of(one.plant, one.log, one.noise) for one in logs]
        _, values, _ = joined(cases, logs)
        return with_combined(values)[self.law.law.grammar.name]

    @property
    def terms(self) -> int:
        """Number of terms."""
        return len(self.law.law.terms)

    @property
    def beside(self) -> tuple[CauseKey, ...]:
        """The effects beside it that are causes; smaller ones lower the deviance and are not named."""
        return tuple(c.key for c in self.base.fit.candidates if c.key in self.law.scored.causes)

    @property
    def evidence(self) -> float:
        """What the balance says of its terms, see `sum_problem.evidence`."""
        return evidence(self.law.law, self.input.windows, self.input.nuisance)


def laws_of_best(tried: Sequence[TriedLaw], last: ScoredHypothesis | None, reference: Reference) -> list[TriedLaw]:
    """The laws that are clearly better than none, for the same unknown input and beside the same effects as the best.

    The lowest deviance first. last: the last hypothesis without a law, which they must replace; None if they need not.
    """
    good = [
        one
        for one in tried
        if one.law.stable
        and clearly_better(one.law.scored, one.without, reference, by_windows_alone=one.law.law.is_wave)
    ]
    if last is not None:
        good = [one for one in good if replaces(one.law.scored, last, reference)]
    if not good:
        return []
    good.sort(key=lambda one: one.law.scored.deviance)
    # As in the selection of causes, each cause beside the law must lower the deviance by the margin, and each term.
    margin = reference.margin(good[0].law.scored)
    best = min(good, key=lambda one: one.law.scored.deviance + margin * (len(one.beside) + one.terms))
    alike = [one for one in good if one.base is best.base and one.law.law.grammar.name == best.law.law.grammar.name]
    return [one for one in alike if one.terms <= best.terms]


def likely_forms(alike: Sequence[TriedLaw], reference: Reference) -> list[tuple[TriedLaw, float]]:
    """The forms that the data can't tell apart, with their probabilities, the most probable first.

    Forms that a free run hardly tells apart may differ in the balance: there the acceleration is measured.
    """
    # Refits from different locations on the grid may end at the same law: the better one counts.
    by_form: dict[str, TriedLaw] = {}
    for one in sorted(alike, key=lambda one: one.law.scored.deviance):
        by_form.setdefault(one.law.file.form, one)
    forms = list(by_form.values())
    scored = [one.law.scored for one in forms]
    pairs = zip(forms, relative_weights(scored, scored[0], reference), strict=True)
    alike_in_free_run = [(one, float(w)) for one, w in pairs if w >= LIKELY]
    balance = np.array([one.evidence for one, _ in alike_in_free_run])
    weights = np.array([w for _, w in alike_in_free_run]) * np.exp(np.clip(balance - balance.max(), -500.0, 0.0))
    weights /= weights.sum()
    order = np.argsort(-weights, kind="stable")
    return [(alike_in_free_run[int(i)][0], float(weights[i])) for i in order if weights[i] >= LIKELY]


def as_long_as_better(
    tried: Sequence[TriedLaw],
    last: ScoredHypothesis,
    reference: Reference,
    further: Callable[[Sequence[TriedLaw], Sequence[TriedLaw]], list[TriedLaw]],
) -> list[TriedLaw]:
    """The laws with others that start from the best, as long as one of these becomes the best.

    The best may not yet replace the effects that imitate it: beside a filter of the sensors, a torque constant that
    fell with the time left more of the training data than three effects did, and a tenth of it once it had the filter.
    further: laws tried, and those of the best -> others. last: as in `laws_of_best`.
    """

    def best(tried: Sequence[TriedLaw]) -> list[TriedLaw]:
        return laws_of_best(tried, last, reference) or laws_of_best(tried, None, reference)

    tried = list(tried)
    alike = best(tried)
    better = bool(alike)
    while better:
        found = further(tried, alike)
        tried += found
        alike = best(tried)
        better = any(alike[0] is one for one in found)
    return tried
