"""Find the law behind what the causes of a diagnosis leave."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...physics.effects import CandidateEffect, Effect
from ..free_curve import BETTER, CurveLog, joined
from ..hypothesis_model import Setting
from ..model_selection import Reference, Selection, relative_weights
from ..objective import NominalParameters
from ..place_sets import InjectionCase
from ..pool import Pool
from ..records import Segment
from ..refit import HypothesisFit, refit
from ..scoring import CauseKey, ScoredHypothesis, Scoring
from ..validation_segment import WINDOW
from .begin import Begin
from .free_run import RENEW, STEPS, FreeRunLaw, kept_effect, refit_laws, screen_in_windows, screen_laws
from .grammar import variables_of
from .inputs import LawInput, law_inputs, with_combined
from .judgement import clearly_better, leaves_less_gap, replaces
from .proposed import LawForm, ProposedLaw
from .regression import LawFit, evidence, explained_by, sums_and_placebo

# The numbers below are engineering judgement.

#: Most laws that are refitted in free run, and the smallest probability of a law in the result.
MOST, LIKELY = 6, 0.02
#: Most laws of one unknown input among these.
EACH = 4
#: A law must explain this share of the unknown input more than the placebo does.
MORE = 0.1
#: A law is refitted if it leaves, as it was found, less than the threshold or than so many times what is left without a
#: law: one of a regression, and one of a standstill, whose factor is only where a refit may start. On the bench true
#: laws left 0.05 to 0.7 times that, and one 2.2 times, of a tenth of the threshold. On records of a servo those of a
#: standstill left 1.3 to 4 times that, and a fifth to three quarters of it once they were refitted.
FAR, FAR_HELD = 2.0, 8.0
#: More causes than FEW may imitate a law however little they leave above noise. It has to be simpler then: each of its
#: terms takes the place of SIMPLER causes at least. Five causes stood for a leak in one direction, which is one term;
#: on a measured record three terms leave a third of what the carriage's three published causes do, and replace nothing.
FEW, SIMPLER = 2, 2
#: A sum that explains this share of the unknown input is tried in windows, and at most so many are refitted from there.
SHOWN, MOST_IN_WINDOWS = 0.4, 3


@dataclass(frozen=True)
class LawBase:
    """What a law is added to. logs: with the plant. fit: the hypothesis, refitted in the scoring."""

    logs: Sequence[CurveLog]
    fit: HypothesisFit

    def inputs(self, nominal: NominalParameters) -> list[LawInput]:
        """The unknown inputs of its plant."""
        cases = [InjectionCase.of(one.plant, one.log, one.noise) for one in self.logs]
        return law_inputs(cases, *joined(cases, self.logs), nominal)


@dataclass(frozen=True)
class _Tried:
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
    def evidence(self) -> float:
        """What the balance says of its terms, see `regression.evidence`."""
        return evidence(self.law.law, self.input.windows, self.input.nuisance)


@dataclass(frozen=True)
class FoundLaw:
    """A proposed law and the model that has it.

    effect: of its best form, neutral in a plant that does not set its parameters. begin: of its states. candidates:
    effects of the model. values: its parameters that are not nominal. sd: of those of its effects. settings: values of
    each form's model. without: the hypothesis beside which it was found. own_gaps: of effects and nominal parameters
    that are causes in its model.
    """

    proposed: ProposedLaw
    effect: Effect
    begin: Begin
    candidates: tuple[CandidateEffect, ...]
    values: Setting
    sd: Mapping[str, float]
    settings: tuple[Setting, ...]
    without: ScoredHypothesis
    own_gaps: Mapping[CauseKey, Mapping[str, float]]
    by_windows: bool

    @classmethod
    def of(
        cls, proposed: ProposedLaw, forms: Sequence[FreeRunLaw], without: ScoredHypothesis, *, by_windows: bool
    ) -> FoundLaw:
        """From the laws in free run of all forms, the best first; the last candidate of each is the law."""
        best, settings = forms[0], tuple(one.scored.fit.values for one in forms)
        fit = best.scored.fit
        effect = kept_effect(proposed.name, proposed.forms[0].file)
        candidates = (*fit.candidates[:-1], replace(fit.candidates[-1], effect=effect))
        return cls(
            proposed, effect, best.begin, candidates, fit.values, best.sd, settings, without, best.scored.own_gaps,
            by_windows,
        )  # fmt: skip

    @property
    def caveat(self) -> str:
        """What has to be known of its gap; empty where nothing has."""
        if not self.by_windows:
            return ""
        return (
            f"the law was judged by runs of {WINDOW:g} s that begin with measured states: in one free run over "
            "training or held-out data, a lost phase or a single slip decides the gap"
        )

    @property
    def terms(self) -> int:
        """Number of terms of its best form: their factors alone have a neutral value."""
        return sum(one.neutral is not None for one in self.proposed.forms[0].file.parameters.values())


def find_law(
    fits: Sequence[HypothesisFit],
    base_of: Callable[[HypothesisFit], LawBase],
    scoring: Scoring,
    reference: Reference,
    pool: Pool,
    screened: Segment,
    windows: tuple[Sequence[Segment], Sequence[Segment]] | None,
) -> FoundLaw | None:
    """The law that closes most of what the last of the hypotheses leaves; None where none is clearly better than it.

    Where effects are named beside the unknown one, they may be its image: the plant without them is tried too, and the
    law that is found without each of them. screened: data on which laws are simulated before any refit, all training
    data or a stretch of them. windows: see `Scoring.windows`.
    """
    scoring = replace(with_typical_priors(scoring), windows=windows)
    screening = replace(scoring, training=screened)
    bases = [base_of(fit) for fit in fits]
    without = pool.map("laws", lambda base: without_law(base.fit, scoring), bases)
    most = MOST // len(bases)
    left = min(screened.gap(one.fit.values)["total"] for one in without)
    pairs = zip(bases, without, strict=True)
    tried = [one for base, own in pairs for one in _try(base, own, scoring, screening, most, left, pool)]
    tried = _with_fewer_effects(tried, without[-1], base_of, scoring, reference, pool)
    tried = _with_fewer_terms(tried, without[-1], scoring, reference, pool)
    return _select(tried, without[-1], reference)


def law_is_sought(selection: Selection, reference: Reference) -> bool:
    """Whether the catalogue does not explain the gap, or only with causes that may imitate a law."""
    if not selection.explains:
        return True
    chosen = selection.chosen
    # No law is ahead by the margin of causes that leave less than that.
    many = len(chosen.causes) > FEW and reference.unexplained(chosen) > reference.margin(chosen)
    return selection.has_causes and (many or reference.leaves_much(chosen))


def without_imitators(selection: Selection, law: FoundLaw, reference: Reference) -> Selection:
    """The selection without the effects and changes of nominal parameters that the law makes superfluous: they imitated
    it.

    The other causes are those of the hypothesis beside which the law was found. Without an effect beside it, the law
    alone explains the gap, and nothing of the catalogue is named. Causes that explain the gap and leave little stay
    unless the law is much simpler.
    """
    if not selection.has_causes:
        return selection
    chosen = selection.chosen
    effects = {c.key for c in chosen.fit.candidates}
    left_out = effects - {c.key for c in law.candidates}
    left_out |= {key for key in chosen.causes if key not in effects and key not in law.own_gaps}
    if not left_out:
        return selection
    beside = law.without.own_gaps if law.proposed.beside else {}
    causes = tuple(key for key in chosen.causes if key not in left_out and key in beside)
    simpler = len(chosen.causes) - len(causes) >= SIMPLER * law.terms
    if selection.explains and not simpler and not reference.leaves_much(chosen):
        return selection
    if not causes:
        return replace(selection, verdict="outside_catalogue")
    return replace(selection, verdict="partly", chosen=replace(law.without, causes=causes))


def _with_fewer_effects(
    tried: Sequence[_Tried],
    last: ScoredHypothesis,
    base_of: Callable[[HypothesisFit], LawBase],
    scoring: Scoring,
    reference: Reference,
    pool: Pool,
) -> list[_Tried]:
    """Laws with the best of them beside one effect less, as long as that is better. last: as in `laws_of_best`.

    An effect may imitate a part of the law; another term of the law cancels it then. Laws that were found beside other
    effects are tried too: a constant leakage and a law that corrects it are far from a leakage that grows with time.
    """

    def fewer(tried: Sequence[_Tried], alike: Sequence[_Tried]) -> list[_Tried]:
        return [
            one
            for out in alike[0].base.fit.candidates
            for one in _without_effect(alike, _found_elsewhere(tried, alike[0], out), out, base_of, scoring, pool)
        ]

    return _as_long_as_better(tried, last, reference, fewer)


def _as_long_as_better(
    tried: Sequence[_Tried],
    last: ScoredHypothesis,
    reference: Reference,
    smaller: Callable[[Sequence[_Tried], Sequence[_Tried]], list[_Tried]],
) -> list[_Tried]:
    """The laws with smaller ones than the best, as long as one of these becomes the best.

    smaller: laws tried, and those of the best -> further ones. last: as in `laws_of_best`.
    """
    tried = list(tried)
    alike = laws_of_best(tried, last, reference)
    better = bool(alike)
    while better:
        found = smaller(tried, alike)
        tried += found
        alike = laws_of_best(tried, last, reference)
        better = any(alike[0] is one for one in found)
    return tried


def _found_elsewhere(tried: Sequence[_Tried], best: _Tried, out: CandidateEffect) -> list[_Tried]:
    """The best laws of the same unknown input that were found beside other effects, and without one of them."""
    found: dict[str, _Tried] = {}
    for one in sorted(tried, key=lambda one: one.law.scored.deviance):
        same_input = one.law.law.grammar.name == best.law.law.grammar.name
        if same_input and one.law.stable and out.key not in [c.key for c in one.base.fit.candidates]:
            found.setdefault(one.law.file.form, one)
    return list(found.values())[:EACH]


def _without_effect(
    alike: Sequence[_Tried],
    elsewhere: Sequence[_Tried],
    out: CandidateEffect,
    base_of: Callable[[HypothesisFit], LawBase],
    scoring: Scoring,
    pool: Pool,
) -> list[_Tried]:
    """Laws of the same unknown input beside the same effects, refitted without one of these.

    elsewhere: laws found beside other effects, which are tried here too.
    """
    best = alike[0]
    rest = tuple(c for c in best.base.fit.candidates if c is not out)
    values = best.base.fit.without(out, scoring.objective)
    fit = refit(scoring.objective, rest, values, {}, steps=STEPS, renew_after=RENEW)
    if fit is None:
        return []
    own = {name: best.law.others[name] for c in rest for name in c.names}
    kept = {*scoring.objective.nominal.names, *own}.difference(out.names)
    found = [one.law for one in (*alike, *elsewhere)]
    others = [own | {n: v for n, v in law.others.items() if n in kept} for law in found]
    laws = refit_laws([law.refitted for law in found], scoring, fit, pool, others)
    laws += refit_laws(_reduced(laws, [best.input]), scoring, fit, pool)
    base, without = base_of(fit), scoring.score(fit)
    return [replace(best, law=law, base=base, without=without) for law in laws]


def _with_fewer_terms(
    tried: Sequence[_Tried], last: ScoredHypothesis, scoring: Scoring, reference: Reference, pool: Pool
) -> list[_Tried]:
    """Laws with the best of them without one of its terms, as long as that is better. last: as in `laws_of_best`.

    The regression takes terms that its errors need, and a free run does not. The law of the lowest deviance is tried
    like that too, if it has more terms than the best: without what it does not need, it may be the best.
    """
    known: list[tuple[str, ...]] = []

    def fewer(tried: Sequence[_Tried], alike: Sequence[_Tried]) -> list[_Tried]:
        best = alike[0]
        name = best.law.law.grammar.name
        same = [one for one in tried if one.base is best.base and one.law.law.grammar.name == name and one.law.stable]
        lowest = min(same, key=lambda one: one.law.scored.deviance)
        pairs = []
        for of in [best, lowest] if lowest.terms > best.terms else [best]:
            for law in of.law.refitted.with_one_term_less:
                if law.families not in known:
                    known.append(law.families)
                    pairs.append((of, law))
        others = [of.law.others for of, _ in pairs]
        refitted = refit_laws([law for _, law in pairs], scoring, best.base.fit, pool, others)
        return [replace(best, law=law) for law in refitted]

    return _as_long_as_better(tried, last, reference, fewer)


def with_typical_priors(scoring: Scoring) -> Scoring:
    """Nominal parameters as uncertain as on a typical rig: with narrow priors a law makes up for a wrong one."""
    objective = scoring.objective
    nominal = replace(objective.nominal, sd=objective.nominal.typical)
    return replace(scoring, objective=replace(objective, nominal=nominal))


def without_law(fit: HypothesisFit, scoring: Scoring) -> ScoredHypothesis:
    """The hypothesis without a law, as it is or with all nominal parameters refitted: what leaves less."""
    refitted = refit(scoring.objective, fit.candidates, fit.values, {}, steps=STEPS, renew_after=RENEW)
    scored = [scoring.score(one) for one in (fit, refitted) if one is not None]
    return min(scored, key=lambda one: one.held_out_gap["total"])


def _try(
    base: LawBase,
    without: ScoredHypothesis,
    scoring: Scoring,
    screening: Scoring,
    most: int,
    left: float,
    pool: Pool,
) -> list[_Tried]:
    """The most promising laws beside a hypothesis, in free run. without: the hypothesis without a law. screening: the
    scoring on the data for screening. left: smallest gap that a hypothesis without a law leaves on these.
    """
    inputs = base.inputs(scoring.objective.nominal)
    found = pool.map("laws", _sums, inputs, lambda one: one.windows.values.size)
    placebos = {one.name: share for one, (_, share) in zip(inputs, found, strict=True)}
    sums = [one for fits, share in found for one in beyond_chance(fits, share)]
    held = _with_explained([law for one in inputs for law in one.held], inputs)
    valves = _with_explained([law for one in inputs for law in one.valves], inputs)
    far, far_held = (max(scoring.threshold, times * left) for times in (FAR, FAR_HELD))
    chosen = screen_laws(held, screening, base.fit, pool, far_held)
    chosen += promising([*sums, *valves], screening, base.fit, most, far, pool)
    by_name = {one.name: one for one in reversed(inputs)}
    refitted = refit_laws(chosen, scoring, base.fit, pool)
    refitted += _in_windows(sums, chosen, scoring, base.fit, without, pool)
    refitted += refit_laws(_reduced(refitted, inputs), scoring, base.fit, pool)
    limits = [(law, one.others) for one in refitted if (law := one.proportional) is not None]
    linear = _with_explained([law for law, _ in limits], inputs)
    refitted += refit_laws(linear, scoring, base.fit, pool, [others for _, others in limits])
    return [
        _Tried(one, base, without, by_name[one.law.grammar.name], placebos[one.law.grammar.name]) for one in refitted
    ]


def _in_windows(
    sums: Sequence[LawFit],
    chosen: Sequence[LawFit],
    scoring: Scoring,
    fit: HypothesisFit,
    without: ScoredHypothesis,
    pool: Pool,
) -> list[FreeRunLaw]:
    """Laws that windows show to be promising, in free run, refitted over these first: waves, which lose their phase in
    a free run as they were found, and what was not chosen by its gap there.
    """
    if without.window_deviances is None:
        return []
    tried = []
    for one in sums:
        if one.explained <= SHOWN:
            continue
        if (whole := one.with_whole_orders) is not None:
            tried += [whole, one]
        elif not any(one is other for other in chosen):
            tried.append(one)
    found = screen_in_windows(tried, scoring, fit, pool, BETTER * without.window_deviances[0])
    return refit_laws(_varied(found)[:MOST_IN_WINDOWS], scoring, fit, pool, by_windows=True)


def _reduced(refitted: Sequence[FreeRunLaw], inputs: Sequence[LawInput]) -> list[LawFit]:
    """What the refits keep of laws of which some terms vanish."""
    found = [law for one in refitted if not one.stable and (law := one.reduced) is not None]
    return _varied(_with_explained(found, inputs))


def beyond_chance(fits: Sequence[LawFit], placebo: float) -> list[LawFit]:
    """The sums that explain clearly more of an unknown input than the placebo does."""
    return [one for one in fits if one.explained > placebo + MORE]


def promising(
    sums: Sequence[LawFit], scoring: Scoring, fit: HypothesisFit, most: int, far: float, pool: Pool
) -> list[LawFit]:
    """The laws that leave least of the gap as they were found, less than `far`, of different inputs and terms."""
    return _varied(screen_laws(sums, scoring, fit, pool, far))[:most]


def _with_explained(laws: Sequence[LawFit], inputs: Sequence[LawInput]) -> list[LawFit]:
    """The laws with what each explains of its unknown input, over the windows in which that is most."""

    def explained(law: LawFit) -> float:
        of = [one for one in inputs if one.name == law.grammar.name]
        return max(explained_by(law, one.windows, one.nuisance) for one in of)

    return [replace(law, explained=explained(law)) for law in laws]


def _varied(laws: Sequence[LawFit]) -> list[LawFit]:
    """Those that come first, at most EACH for each unknown input and each family of terms."""
    kept: list[LawFit] = []
    for one in laws:
        same = [other for other in kept if other.grammar.name == one.grammar.name]
        if len(same) < EACH and one.families not in [other.families for other in same]:
            kept.append(one)
    return kept


def _sums(one: LawInput) -> tuple[list[LawFit], float]:
    """The best sums for an unknown input, and the share that the placebo explains."""
    return sums_and_placebo(one.grammar, one.windows, one.nuisance)


def _select(tried: Sequence[_Tried], last: ScoredHypothesis, reference: Reference) -> FoundLaw | None:
    """The forms that the data can't tell apart, if the best one is clearly better than none.

    last: the last hypothesis without a law.
    """
    alike = laws_of_best(tried, last, reference)
    if not alike:
        return None
    likely = likely_forms(alike, reference)
    best = likely[0][0]
    nominal = reference.nominal_gaps[1]
    forms = [
        LawForm(one.law.file, w, 1.0 - one.law.scored.held_out_gap["total"] / max(nominal, 1e-12)) for one, w in likely
    ]
    law = best.law.law
    used = variables_of(law.terms)
    shown = law.grammar.shown(law.terms[0])
    of_balance = [v.text for v in law.grammar.variables if v.text in used]
    proposed = ProposedLaw(
        place=law.grammar.name,
        variables=(*of_balance, *sorted(used.difference(of_balance))),
        forms=tuple(forms),
        range=dict(forms[0].file.range),
        unit=shown.unit,
        variable=shown.values,
        measured=best.measured,
        fitted=best.law.refitted.values,
        direction=law.grammar.direction_of(law.terms),
        explained=max(law.explained, 0.0),
        placebo=max(best.placebo, 0.0),
        beside=tuple(dict.fromkeys(one.id for one in best.base.fit.candidates)),
    )
    by_windows = not leaves_less_gap(best.law.scored, best.without, reference)
    return FoundLaw.of(proposed, [one.law for one, _ in likely], best.without, by_windows=by_windows)


def likely_forms(alike: Sequence[_Tried], reference: Reference) -> list[tuple[_Tried, float]]:
    """The forms that the data can't tell apart, with their probabilities, the most probable first.

    Forms that a free run hardly tells apart may differ in the balance: there the acceleration is measured.
    """
    # Refits from different locations on the grid may end at the same law: the better one counts.
    by_form: dict[str, _Tried] = {}
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


def laws_of_best(tried: Sequence[_Tried], last: ScoredHypothesis, reference: Reference) -> list[_Tried]:
    """The laws that are clearly better than none, for the same unknown input and beside the same effects as the best.

    The lowest deviance first. last: the last hypothesis without a law.
    """
    good = [one for one in tried if clearly_better(one.law.scored, one.without, reference) and one.law.stable]
    good = [one for one in good if replaces(one.law.scored, last, reference)]
    if not good:
        return []
    good.sort(key=lambda one: one.law.scored.deviance)
    # As in the selection of causes, each effect beside the law must lower the deviance by the margin, and each term.
    margin = reference.margin(good[0].law.scored)
    best = min(good, key=lambda one: one.law.scored.deviance + margin * (len(one.base.fit.candidates) + one.terms))
    alike = [one for one in good if one.base is best.base and one.law.law.grammar.name == best.law.law.grammar.name]
    return [one for one in alike if one.terms <= best.terms]
