"""The law that a search finds, and the causes that it makes superfluous."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...core.text import join_words
from ...core.unit import unit_suffix
from ...physics.effects import CandidateEffect, Effect
from ...plant.plant import sensor_unit
from ..hypothesis_model import Setting
from ..model_selection import Reference, Selection
from ..scoring import CauseKey, ScoredHypothesis
from ..validation_segment import WINDOW
from .begin import Begin
from .free_run import kept_effect
from .grammar import variables_of
from .judgement import leaves_less_gap
from .proposed import LawForm, ProposedLaw
from .tried import TriedLaw, laws_of_best, likely_forms

#: A law replaces causes that explain the gap where it is simpler: each of its terms takes the place of so many of them
#: at least. Five causes stood for a leak in one direction, which is one term; on a measured record three terms leave a
#: third of what the carriage's three published causes do, and replace nothing. Engineering judgement.
SIMPLER = 2


@dataclass(frozen=True)
class FoundLaw:
    """A proposed law and the model that has it.

    effect: of its best form, neutral in a plant that does not set its parameters. begin: of its states. candidates:
    effects of the model. values: its parameters that are not nominal. sd: of those of its effects. settings: values of
    each form's model. without: the hypothesis beside which it was found. beside: effects that are causes in its model.
    changed: the keys of nominal parameters that changed much there.
    """

    proposed: ProposedLaw
    effect: Effect
    begin: Begin
    candidates: tuple[CandidateEffect, ...]
    values: Setting
    sd: Mapping[str, float]
    settings: tuple[Setting, ...]
    without: ScoredHypothesis
    beside: tuple[CauseKey, ...]
    changed: tuple[CauseKey, ...]
    by_windows: bool

    @classmethod
    def of(cls, proposed: ProposedLaw, forms: Sequence[TriedLaw], *, by_windows: bool) -> FoundLaw:
        """From the laws of all forms, the best first; the last candidate of each is the law."""
        best, settings = forms[0].law, tuple(one.law.scored.fit.values for one in forms)
        fit = best.scored.fit
        effect = kept_effect(proposed.name, proposed.forms[0].file)
        candidates = (*fit.candidates[:-1], replace(fit.candidates[-1], effect=effect))
        changed = tuple(key for key in best.scored.own_gaps if key not in {c.key for c in fit.candidates})
        return cls(
            proposed, effect, best.begin, candidates, fit.values, best.sd, settings, forms[0].without,
            forms[0].beside, changed, by_windows,
        )  # fmt: skip

    @property
    def caveats(self) -> list[str]:
        """What has to be known of its gap."""
        small = [c for c in self.candidates if c.effect.sensor is not None and c.key not in self.beside]
        words = [f"{n} = {self.values[n]:.3g}{unit_suffix(sensor_unit(n))}" for c in small for n in c.names]
        out = []
        if words:
            out.append(
                f"the law was fitted beside errors of sensors that are too small to be causes: {join_words(words)}; "
                "the corrected plant has them"
            )
        if self.by_windows:
            out.append(
                f"the law was judged by runs of {WINDOW:g} s that begin with measured states: in one free run over "
                "training or held-out data, a lost phase or a single slip decides the gap"
            )
        return out

    @property
    def terms(self) -> int:
        """Number of terms of its best form: their factors alone have a neutral value."""
        return sum(one.neutral is not None for one in self.proposed.forms[0].file.parameters.values())


def best_law(tried: Sequence[TriedLaw], last: ScoredHypothesis, reference: Reference) -> FoundLaw | None:
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
        beside=tuple(dict.fromkeys(id for id, _ in best.beside)),
    )
    by_windows = not leaves_less_gap(best.law.scored, best.without, reference)
    return FoundLaw.of(proposed, [one for one, _ in likely], by_windows=by_windows)


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
    needed = tuple(key for key in chosen.causes if key in (law.beside if key in effects else law.changed))
    if needed == chosen.causes:
        return selection
    beside = law.without.own_gaps if law.proposed.beside else {}
    causes = tuple(key for key in needed if key in beside)
    simpler = len(chosen.causes) - len(causes) >= SIMPLER * law.terms
    if selection.explains and not simpler and not reference.leaves_much(chosen):
        return selection
    if not causes:
        return replace(selection, verdict="outside_catalogue")
    return replace(selection, verdict="partly", chosen=replace(law.without, causes=causes))
