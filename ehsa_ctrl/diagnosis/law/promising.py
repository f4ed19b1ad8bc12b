"""Which laws of the regression are promising enough for a refit in free run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..free_curve import BETTER
from ..pool import Pool
from ..refit import HypothesisFit
from ..scoring import ScoredHypothesis, Scoring
from .free_run import FreeRunLaw, refit_laws, screen_in_windows, screen_laws
from .inputs import LawInput
from .law_fit import LawFit
from .sum_problem import explained_by

# The numbers below are engineering judgement.

#: Most laws of one unknown input that are refitted.
EACH = 4
#: A law must explain this share of the unknown input more than the placebo does.
MORE = 0.1
#: A sum that explains this share of the unknown input is refitted if no other that is near explains more, and is tried
#: in windows, from which at most so many are refitted.
SHOWN, MOST_IN_WINDOWS = 0.4, 3


def beyond_chance(fits: Sequence[LawFit], placebo: float) -> list[LawFit]:
    """The sums that explain clearly more of an unknown input than the placebo does."""
    return [one for one in fits if one.explained > placebo + MORE]


def promising(
    sums: Sequence[LawFit], scoring: Scoring, fit: HypothesisFit, most: int, far: float, pool: Pool
) -> list[LawFit]:
    """The laws that leave least of the gap as they were found, less than `far`, of different inputs and terms.

    Laws that hardly act leave no more than there was. Steps of a drive, which explained most of the torque, left a
    quarter more before their refit: of each unknown input, the sum that explains most is there too.
    """
    near = varied(screen_laws(sums, scoring, fit, pool, far))
    best: dict[str, LawFit] = {}
    for one in sorted(near, key=lambda one: -one.explained):
        if one.explained > SHOWN:
            best.setdefault(one.grammar.name, one)
    chosen = near[:most]
    return [*chosen, *(one for one in best.values() if not any(one is other for other in chosen))]


def refitted_over_windows(
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
    # A wave over the shaft angle has no rival, however little of the input it explains: no pressure balances it.
    tried = [
        one for one in sums if one.is_wave or (one.explained > SHOWN and not any(one is other for other in chosen))
    ]
    found = screen_in_windows(tried, scoring, fit, pool, BETTER * without.window_deviances[0])
    return refit_laws(varied(found)[:MOST_IN_WINDOWS], scoring, fit, pool, by_windows=True)


def reduced(refitted: Sequence[FreeRunLaw], inputs: Sequence[LawInput]) -> list[LawFit]:
    """What the refits keep of laws of which some terms vanish."""
    found = [law for one in refitted if not one.stable and (law := one.reduced) is not None]
    return varied(with_explained(found, inputs))


def varied(laws: Sequence[LawFit]) -> list[LawFit]:
    """Those that come first, at most EACH for each unknown input and each family of terms."""
    kept: list[LawFit] = []
    for one in laws:
        same = [other for other in kept if other.grammar.name == one.grammar.name]
        if len(same) < EACH and one.families not in [other.families for other in same]:
            kept.append(one)
    return kept


def with_explained(laws: Sequence[LawFit], inputs: Sequence[LawInput]) -> list[LawFit]:
    """The laws with what each explains of its unknown input, over the windows in which that is most."""

    def explained(law: LawFit) -> float:
        of = [one for one in inputs if one.name == law.grammar.name]
        return max(explained_by(law, one.windows, one.nuisance) for one in of)

    return [replace(law, explained=explained(law)) for law in laws]
