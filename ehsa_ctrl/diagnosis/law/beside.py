"""The effects beside a law: one of the catalogue less, or one more error of a sensor."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from ...physics.effects import CandidateEffect
from ..hypothesis_model import Setting
from ..hypothesis_search import MIN_ADDED_GAIN
from ..pool import Pool
from ..refit import refit
from ..scoring import ScoredHypothesis
from ..screening import Gain, screen
from .free_run import RENEW, STEPS, FreeRunLaw, refit_laws
from .promising import EACH, reduced, with_explained
from .regression import placebo
from .sum_problem import all_terms
from .tried import LawData, TriedLaw, as_long_as_better, likely_forms


def with_fewer_effects(
    tried: Sequence[TriedLaw],
    last: ScoredHypothesis,
    data: LawData,
    pool: Pool,
) -> list[TriedLaw]:
    """Laws with the best of them beside one effect less, as long as that is better. last: as in `laws_of_best`.

    An effect may imitate a part of the law; another term of the law cancels it then. Laws that were found beside other
    effects are tried too: a constant leakage and a law that corrects it are far from a leakage that grows with time.
    """

    def fewer(tried: Sequence[TriedLaw], alike: Sequence[TriedLaw]) -> list[TriedLaw]:
        best = alike[0]
        found = []
        for out in best.base.fit.candidates:
            laws = [one.law for one in (*alike, *found_elsewhere(tried, best, out))]
            rest = tuple(c for c in best.base.fit.candidates if c is not out)
            start = best.base.fit.without(out, data.scoring.objective)
            own = {name: best.law.others[name] for c in rest for name in c.names}
            found += _refitted_beside(best, laws, rest, start, own, out.names, data, pool)
        return found

    return as_long_as_better(tried, last, data.reference, fewer)


def with_sensor_errors(
    tried: Sequence[TriedLaw],
    last: ScoredHypothesis,
    candidates: Sequence[CandidateEffect],
    data: LawData,
    pool: Pool,
) -> list[TriedLaw]:
    """Laws with the best of them beside errors of sensors, as long as that is better. last: as in `laws_of_best`.

    A filter that is too small to be a cause has no place in a law, and neither the law nor the nominal parameters can
    make up for it. Sensors of one kind have it alike, and one alone tells little: that which promises most is tried,
    and one for each channel that promises something.
    """
    of_sensors = [one for one in candidates if one.effect.sensor is not None]

    def more(_tried: Sequence[TriedLaw], alike: Sequence[TriedLaw]) -> list[TriedLaw]:
        best, laws = alike[0], [one.law for one, _ in likely_forms(alike, data.reference)]
        law, base = best.law, best.base.fit
        known = {c.key for c in base.candidates}
        new = [one for one in of_sensors if one.key not in known]
        if not new:
            return []
        fit = law.scored.fit
        gains = screen(law.objective, new, pool, fit.residual, fit.values).gains(fit)
        by_channel: dict[str | None, Gain] = {}
        for gain in gains:
            if gain.decrease > MIN_ADDED_GAIN:
                by_channel.setdefault(gain.candidate.channel, gain)
        added = list(by_channel.values())
        found = []
        for count in sorted({1, len(added)}) if added else ():
            some = added[:count]
            effects = (*base.candidates, *(gain.candidate for gain in some))
            start = {name: value for gain in some for name, value in gain.start({}).items()}
            own = {name: law.others[name] for c in base.candidates for name in c.names} | start
            found += _refitted_beside(best, laws, effects, {**base.values, **start}, own, (), data, pool)
        # What changes a signal by the threshold is a cause, which the selection would have to name.
        return [one for one in found if known.issuperset(one.beside)]

    return as_long_as_better(tried, last, data.reference, more)


def refitted_to_all_data(alike: Sequence[TriedLaw], stretch: LawData, data: LawData, pool: Pool) -> list[TriedLaw]:
    """The likely forms of laws that were found on a stretch, refitted beside the same effects to all training data.

    alike: see `laws_of_best`.
    """
    best, laws = alike[0], [one.law for one, _ in likely_forms(alike, stretch.reference)]
    base = best.base.fit
    own = {name: best.law.others[name] for c in base.candidates for name in c.names}
    # A wave with the phase of the stretch is out of phase over hundreds of seconds.
    by_windows = any(law.law.is_wave for law in laws)
    found = _refitted_beside(best, laws, base.candidates, base.values, own, (), data, pool, by_windows=by_windows)
    if not found:
        return []
    inputs = found[0].base.inputs(data.scoring.objective.nominal)
    here = next(one for one in inputs if one.name == best.input.name)
    chance = placebo(all_terms(here.grammar, here.windows, here.nuisance))
    explained = with_explained([one.law.law for one in found], inputs)
    pairs = zip(found, explained, strict=True)
    return [replace(one, input=here, placebo=chance, law=replace(one.law, law=law)) for one, law in pairs]


def found_elsewhere(tried: Sequence[TriedLaw], best: TriedLaw, out: CandidateEffect) -> list[TriedLaw]:
    """The best laws of the same unknown input that were found beside other effects, and without one of them."""
    found: dict[str, TriedLaw] = {}
    for one in sorted(tried, key=lambda one: one.law.scored.deviance):
        same_input = one.law.law.grammar.name == best.law.law.grammar.name
        if same_input and one.law.stable and out.key not in [c.key for c in one.base.fit.candidates]:
            found.setdefault(one.law.file.form, one)
    return list(found.values())[:EACH]


def _refitted_beside(
    best: TriedLaw,
    laws: Sequence[FreeRunLaw],
    effects: tuple[CandidateEffect, ...],
    start: Setting,
    own: Setting,
    left_out: Collection[str],
    data: LawData,
    pool: Pool,
    *,
    by_windows: bool = False,
) -> list[TriedLaw]:
    """Laws of the same unknown input as the best, refitted beside other effects.

    start: of a fit of these effects without a law. own: their numbers, beside the law. left_out: numbers that return to
    their nominal values. by_windows: see `refit_laws`.
    """
    scoring = data.scoring
    fit = refit(scoring.objective, effects, start, {}, steps=STEPS, renew_after=RENEW)
    if fit is None:
        return []
    kept = {*scoring.objective.nominal.names, *own}.difference(left_out)
    others = [{**own, **{n: v for n, v in law.others.items() if n in kept}} for law in laws]
    found = refit_laws([law.refitted for law in laws], scoring, fit, pool, others, by_windows=by_windows)
    found += refit_laws(reduced(found, [best.input]), scoring, fit, pool)
    base, without = data.base_of(fit), scoring.score(fit)
    return [replace(best, law=law, base=base, without=without) for law in found]
