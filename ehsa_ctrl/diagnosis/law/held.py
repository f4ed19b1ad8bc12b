"""Dry friction that a standstill shows: while a contact sticks, its friction balances the effort on it.

The unknown input of a balance is known only while the contact slides. Where the rig stands still under an effort that
would move the nominal plant, its friction is larger by that much at least, and what it grows with is seen there.
"""

from __future__ import annotations

import numpy as np

from ...core.expression import put
from ...physics.effects import ADDENDS
from ...plant.arrays import array_evaluator, needs
from ...plant.plant import Plant
from ..regressors import balance_contact
from ..unknown_inputs import BalanceSignals
from .grammar import DRY, Grammar, Term
from .law_fit import LawFit

# The numbers below are engineering judgement.

#: Share of the fitted samples that are a standstill, and share of these in which the effort would move the plant.
STANDS, MOVES = 0.03, 0.5
#: By how much of the effort at standstill it exceeds the nominal friction (RMS).
EXCESS = 0.1
#: Most laws.
MOST_HELD = 6


def held_laws(plant: Plant, signals: BalanceSignals, grammar: Grammar, fitted: np.ndarray) -> list[LawFit]:
    """Terms of dry friction, each alone, that explain best why the contact of a balance stands still; their factors
    are where a refit may start.

    fitted: (N - 1,) samples that may be used. Empty for a balance without a contact that sticks, and where the nominal
    friction is enough.
    """
    place = ADDENDS[grammar.name].place
    if not grammar.direction or place not in ("torque", "force"):
        return []
    contact = balance_contact(plant, place)
    if not plant.structure.law(contact).sticks:
        return []
    known = {**plant.values, **signals.values}
    if contact.name not in signals.slides or not needs(plant.structure.equations, contact.net) <= known.keys():
        return []
    net = array_evaluator(plant.structure.equations, [contact.net])(known)[contact.net][:-1]
    excess = np.abs(net) - np.abs(grammar.friction)
    stands = fitted & ~signals.slides[contact.name][:-1]
    at = stands & (excess > 0.0)
    if stands.sum() < STANDS * fitted.sum() or at.sum() < MOVES * stands.sum():
        return []
    if float(np.mean(excess[at] ** 2)) < EXCESS**2 * float(np.mean(net[at] ** 2)):
        return []
    found = []
    for term in _terms(grammar):
        column = np.abs(grammar.values(term))[at]
        if not column.any():
            continue
        # Both are positive. A standstill gives a lower bound, whose scatter says nothing of the law.
        factor = float(column @ excess[at]) / float(column @ column)
        left = float(np.sum((excess[at] - factor * column) ** 2))
        found.append((left, LawFit(grammar, (term,), (grammar.resists * factor,), (0.0,), 0.0)))
    return [law for _, law in sorted(found, key=lambda row: row[0])[:MOST_HELD]]


def _terms(grammar: Grammar) -> list[Term]:
    direction = grammar.direction
    found = [Term(direction, frozenset())]
    for one in grammar.variables:
        if not one.speed:
            found.append(Term(put(DRY[0], z=one.text, d=direction), frozenset({one.text})))
    return found
