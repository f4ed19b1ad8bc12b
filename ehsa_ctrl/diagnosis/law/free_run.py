"""Laws in free run: each is an effect, refitted together with the nominal parameters and judged on held-out data."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...core.expression import put
from ...physics.effects import EFFECTS, CandidateEffect, Effect, LawFile, effect_of, law_candidate
from ..hypothesis_model import HypothesisModel, Setting
from ..objective import Objective
from ..pool import Pool
from ..records import Segment
from ..refit import HypothesisFit, refit, stated_sd
from ..scoring import ScoredHypothesis, Scoring
from .begin import Begin
from .grammar import Term
from .law_fit import LawFit
from .memory import RATE, STATE, TOWARDS_END
from .shapes import STABLE

#: Gauss-Newton steps of a refit, and after how many the Jacobian is computed again. Engineering judgement.
STEPS, RENEW = 6, 2
#: An end value is far away if its time constant is at least this share of the longest running time. Engineering
#: judgement: at half, the best straight line from the start is nowhere more than 15 % of the end value off.
FAR_END = 0.5
#: A width may change by this factor, a location by this share of the variable's range. Engineering judgement.
WIDER, FARTHER = 5.0, 0.5
#: Local name of a state of a term -> what it is called in the definition, between a prefix and a number.
STATES = {STATE: "m", RATE: "w"}


@dataclass(frozen=True)
class FreeRunLaw:
    """A law refitted in free run.

    law: what it started from. file: its definition with the values of the refit. begin: of its states. sd: of all
    parameters of effects. objective: of the refit.
    """

    law: LawFit
    file: LawFile
    begin: Begin
    scored: ScoredHypothesis
    sd: Mapping[str, float]
    objective: Objective = field(repr=False)

    @property
    def _kept(self) -> list[bool]:
        """Of each term, whether its factor keeps the sign of the regression, and is beyond its scatter there.

        Of a single one the gap tells whether it vanishes.
        """
        found = [one.value for one in self.file.parameters.values() if one.neutral is not None]
        least = STABLE if len(found) > 1 else 0.0
        pairs = zip(found, self.law.factors, self.law.sd, strict=True)
        return [value * before > 0.0 and abs(value) > least * sd for value, before, sd in pairs]

    @property
    def stable(self) -> bool:
        """Whether the refit keeps every term."""
        return all(self._kept)

    @property
    def refitted(self) -> LawFit:
        """The law with the values of the refit."""
        given = iter(one.value for one in self.file.parameters.values())
        found = [(next(given), replace(t, shapes={n: next(given) for n in t.shapes})) for t in self.law.terms]
        factors, terms = zip(*found, strict=True)
        return replace(self.law, terms=terms, factors=factors)

    @property
    def others(self) -> Setting:
        """The refitted values of all parameters but its own."""
        return {name: value for name, value in self.scored.fit.values.items() if name not in self.file.parameters}

    @property
    def reduced(self) -> LawFit | None:
        """The terms that the refit keeps, from its values; None without one.

        What made up in the regression for a wrong nominal parameter vanishes where that parameter is refitted.
        """
        law = self.refitted
        rows = [row for *row, kept in zip(law.factors, law.terms, law.sd, self._kept, strict=True) if kept]
        if not rows:
            return None
        factors, terms, sd = zip(*rows, strict=True)
        return replace(law, terms=terms, factors=factors, sd=sd)

    @property
    def proportional(self) -> LawFit | None:
        """With terms in proportion to time in the place of those towards an end value from which the log is far; None
        without one.
        """
        law, rows = self.refitted, []
        for factor, sd, term in zip(law.factors, law.sd, law.terms, strict=True):
            if TOWARDS_END in term.text and self._far_end(term):
                tau, text = term.shapes["tau"], term.text.replace(TOWARDS_END, STATE)
                rows.append((factor / tau, sd / tau, replace(term, text=text, shapes={}, units={})))
            else:
                rows.append((factor, sd, term))
        factors, sds, terms = zip(*rows, strict=True)
        return None if terms == law.terms else replace(law, factors=factors, sd=sds, terms=terms)

    def _far_end(self, term: Term) -> bool:
        """Whether the log ends far from the end value of a term."""
        assert term.memory is not None
        longest = float(np.max(self.law.grammar.course(term.memory, term.shapes)[STATE]))
        return term.shapes["tau"] >= FAR_END * longest


def definition_of(law: LawFit, taken: Sequence[str]) -> LawFile:
    """The definition of an effect with this law. taken: names that its parameters must not have."""
    ends = [f"_{i}" for i in range(1, len(law.terms) + 1)]
    ends += [f"_{name}_{i}" for i, term in enumerate(law.terms, 1) for name in (*term.shapes, *STATES.values())]
    prefix = next(one for one in ("c", "q", "law") if not any(f"{one}{end}" in taken for end in ends))
    grammar = law.grammar
    parameters: dict[str, dict[str, object]] = {}
    states: dict[str, dict[str, object]] = {}
    texts = []
    for i, (term, factor, sd) in enumerate(zip(law.terms, law.factors, law.sd, strict=True), 1):
        shapes = {name: f"{prefix}_{name}_{i}" for name in term.shapes}
        parameters[f"{prefix}_{i}"] = {"value": factor, "unit": grammar.factor_unit(term), "neutral": 0.0, "sd": sd}
        for name, own in shapes.items():
            parameters[own] = {"value": term.shapes[name], "unit": term.units[name]} | _bounds(law, term, name)
        if term.memory is not None:
            own_names = shapes | {name: f"{prefix}_{short}_{i}" for name, short in STATES.items()}
            memory, inner = term.memory, put(term.text, **own_names)
            states |= {
                own_names[n]: {"rate": put(rate, **own_names), "unit": memory.units[n], "scale": memory.scales[n]}
                for n, rate in memory.rates.items()
            }
        else:
            inner = put(term.text, **shapes)
        texts.append(f"{prefix}_{i}" + ("" if inner == "1" else f" * {inner}"))
    expression = " + ".join(texts)
    # A direction of motion takes its two values in any log.
    shown = sorted(grammar.known.keys() - {grammar.direction})
    ranges = {n: (float(np.min(grammar.known[n])), float(np.max(grammar.known[n]))) for n in shown}
    file = {
        "schema": 1, "status": "proposed", "summary": f"found by a diagnosis: {' + '.join(t.text for t in law.terms)}",
        "adds_to": grammar.name, "expression": expression, "parameters": parameters, "states": states,
    }  # fmt: skip
    names = LawFile.model_validate(file).variables
    return LawFile.model_validate({**file, "range": {n: pair for n, pair in ranges.items() if n in names}})


def _bounds(law: LawFit, term: Term, name: str) -> dict[str, object]:
    if name == "damping" or (name != "at" and term.units[name] != "1"):
        return {"bounds": (term.shapes[name] / WIDER, term.shapes[name] * WIDER)}
    if term.units[name] == "1":
        return {}
    if "time" in term.variables:
        # A refit may have ended at the beginning of the log.
        return {"bounds": (0.0, 2.0 * max(term.shapes[name], law.grammar.sample_time))}
    reach = max(float(np.ptp(v.values)) for v in law.grammar.variables if v.text in term.variables)
    return {"bounds": (term.shapes[name] - FARTHER * reach, term.shapes[name] + FARTHER * reach)}


def kept_effect(name: str, file: LawFile) -> Effect:
    """The effect of a definition, known by its name in this process."""
    effect = effect_of(name, file, "a law of a diagnosis")
    EFFECTS.keep(name, effect)
    return effect


@dataclass(frozen=True)
class _Start:
    """A law beside the effects of a hypothesis, before it is refitted: its definition, and where the refit starts."""

    file: LawFile
    begin: Begin
    scoring: Scoring
    candidate: CandidateEffect
    values: Setting

    @classmethod
    def of(cls, law: LawFit, scoring: Scoring, base: HypothesisFit, others: Setting | None = None) -> _Start:
        """others: refitted values of all other parameters, if the law is another form of one that was refitted."""
        file = definition_of(law, [*scoring.objective.model.plant.parameters])
        begin = Begin.of(file, law.grammar)
        effect = kept_effect(f"law_{file.digest}", file)
        own = _scoring_with(scoring, effect, begin)
        candidate = law_candidate(effect, own.objective.model.plant.values)
        # Nominal parameters start at their nominal values: without the law, a refit bends them to make up for it.
        values = dict(others or {name: base.values[name] for c in base.candidates for name in c.names})
        return cls(file, begin, own, candidate, values | dict(zip(candidate.names, candidate.starts[0], strict=True)))


def gap_as_found(law: LawFit, scoring: Scoring, base: HypothesisFit) -> float:
    """Gap in total that a law leaves on the training data before any refit; infinite if the run stops."""
    start = _Start.of(law, scoring, base)
    segment = start.scoring.training
    gap = segment.gap_of(segment.run([start.values])[0])["total"]
    return gap if np.isfinite(gap) else np.inf


def screen_laws(laws: Sequence[LawFit], scoring: Scoring, base: HypothesisFit, pool: Pool, far: float) -> list[LawFit]:
    """The laws by the gap that they leave on the training data as they were found, the smallest first; without those
    that leave `far` or more.

    A regression on measured signals is no such test: a law of the pressures fits any error of the friction, because
    the pressures balance the friction.
    """
    return _nearest(laws, lambda law: gap_as_found(law, scoring, base), pool, far)


def screen_in_windows(
    laws: Sequence[LawFit], scoring: Scoring, base: HypothesisFit, pool: Pool, far: float
) -> list[LawFit]:
    """As `screen_laws`, by the deviance above noise over windows of the training data."""

    def left(law: LawFit) -> float:
        start = _Start.of(law, scoring, base)
        return start.scoring.window_deviance(0, start.values)

    return _nearest(laws, left, pool, far)


def _nearest(laws: Sequence[LawFit], left: Callable[[LawFit], float], pool: Pool, far: float) -> list[LawFit]:
    """The laws that leave less than `far`, the smallest first. left: of a law."""
    found = pool.map("laws", left, list(laws))
    return [laws[int(i)] for i in np.argsort(found, kind="stable") if found[int(i)] < far]


def refit_laws(
    laws: Sequence[LawFit],
    scoring: Scoring,
    base: HypothesisFit,
    pool: Pool,
    others: Sequence[Setting] | None = None,
    *,
    by_windows: bool = False,
) -> list[FreeRunLaw]:
    """Each law refitted beside the effects of a hypothesis, from its values; those that can be simulated.

    others: of each law, values of the other parameters to begin with, see `_Start.of`. by_windows: over windows of the
    training data first, in which a wave keeps its phase.
    """

    def one(started: tuple[LawFit, Setting | None]) -> FreeRunLaw | None:
        begin = _Start.of(started[0], scoring, base, started[1])
        own, candidate, file, start = begin.scoring, begin.candidate, begin.file, begin.values
        candidates = (*base.candidates, candidate)
        if by_windows and (smooth := own.objective_in_windows) is not None:
            over_windows = refit(smooth, candidates, start, {}, steps=STEPS, renew_after=RENEW)
            start = start if over_windows is None else over_windows.values
        fit = refit(own.objective, candidates, start, {}, steps=STEPS, renew_after=RENEW)
        if fit is None:
            return None
        scored, sd = own.score(fit), own.standard_deviations(fit)
        return FreeRunLaw(started[0], _refitted(file, fit, candidate, sd), begin.begin, scored, sd, own.objective)

    starts = list(zip(laws, others or itertools.repeat(None), strict=False))
    return [found for found in pool.map("laws", one, starts) if found is not None]


def _refitted(file: LawFile, fit: HypothesisFit, candidate: CandidateEffect, sd: Mapping[str, float]) -> LawFile:
    """The definition with the values of a fit."""
    changed = {n: {"value": fit.values[n], "sd": stated_sd(sd[n])} for n in candidate.names}
    own = {n: one.model_copy(update=changed[n]) for n, one in file.parameters.items()}
    return file.model_copy(update={"parameters": own})


def with_effect(segment: Segment, effect: Effect, begin: Begin) -> Segment:
    """The same segment with an effect, neutral, in every model. begin: of its states."""
    return begin.on(_Neutral(effect).in_segment(segment))


def model_with(model: HypothesisModel, effect: Effect) -> HypothesisModel:
    """The same model with an effect, neutral."""
    return _Neutral(effect).in_model(model)


def _scoring_with(scoring: Scoring, effect: Effect, begin: Begin) -> Scoring:
    neutral = _Neutral(effect)
    training, held_out = (begin.on(neutral.in_segment(one)) for one in (scoring.training, scoring.held_out))
    objective: Objective = replace(scoring.objective, model=training.model, segment=training)
    windows = scoring.windows
    if windows is not None:
        fitted, kept = (begin.on_windows([neutral.in_segment(one) for one in by_log]) for by_log in windows)
        windows = None if fitted is None or kept is None else (fitted, kept)
    return replace(scoring, objective=objective, training=training, held_out=held_out, windows=windows)


@dataclass(frozen=True)
class _Neutral:
    """Puts an effect, neutral, into models.

    models: those done, by the identity of their plants: the windows of a log share plants, and what acts in them.
    """

    effect: Effect
    models: dict[tuple[int, int], tuple[HypothesisModel, HypothesisModel]] = field(default_factory=dict)

    def in_segment(self, segment: Segment) -> Segment:
        """The same records with the effect in their models."""
        return replace(segment, records=tuple(replace(r, model=self.in_model(r.model)) for r in segment.records))

    def in_model(self, model: HypothesisModel) -> HypothesisModel:
        """The same model with the effect."""
        key = id(model.plant), id(model.plants_by_law)
        if key not in self.models:
            values = {p.name: p.neutral for p in self.effect.parameters}
            plant, *others = (
                one.with_effects(self.effect.name, **values) for one in (model.plant, *model.plants_by_law.values())
            )
            by_law = dict(zip(model.plants_by_law, others, strict=True))
            # Both are kept: the identity of a plant that is gone may be that of another one.
            self.models[key] = model, replace(model, plant=plant, plants_by_law=by_law, shared={})
        known = self.models[key][1]
        return replace(model, plant=known.plant, plants_by_law=known.plants_by_law, shared=known.shared)
