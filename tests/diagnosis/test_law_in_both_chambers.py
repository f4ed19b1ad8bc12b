"""A law that enters the balances of both chambers is one law: with its form, its size and both pressures."""

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.diagnosis.law.begin import Begin
from ehsa_ctrl.diagnosis.law.free_run import definition_of
from ehsa_ctrl.diagnosis.law.grammar import Grammar, Term
from ehsa_ctrl.diagnosis.law.inputs import law_inputs
from ehsa_ctrl.diagnosis.law.law_fit import LawFit
from ehsa_ctrl.diagnosis.law.memory import clock
from ehsa_ctrl.diagnosis.law.regression import find_sums
from ehsa_ctrl.diagnosis.law.sum_problem import all_terms
from ehsa_ctrl.diagnosis.objective import NominalParameters
from ehsa_ctrl.diagnosis.place_sets import InjectionCase
from ehsa_ctrl.physics.effects import LawFile


def both_chambers(plant, effect, **size):
    """The unknown input of both chambers, of a rig with an effect, over longer windows, and its measured signals."""
    drive = e.excitation("noise", amplitude=3.0, duration=9.0, sample_time=0.004, seed=3)
    log, _ = e.record(plant.with_effects(effect, **size), *drive, centre=True)
    case = InjectionCase.of(plant, log, {})
    fitted = np.ones(len(log) - 1, dtype=bool)
    none = np.zeros(0)
    inputs = law_inputs([case], case.signals, case.unknown.values, fitted, NominalParameters((), none, none, none))
    return next(one for one in reversed(inputs) if one.name == "flows"), case.signals


def test_leakage_to_the_tank_is_one_law(plant):
    """K_e P in each chamber, within 10 %: the sign is that of a flow out of it."""
    found, signals = both_chambers(plant, "external_leakage", K_e=2e-12)
    best = find_sums(all_terms(found.grammar, found.windows, found.nuisance))[0]
    count = signals["P_1"].size - 1

    assert [term.text for term in best.terms] == ["P"]
    assert best.factors[0] == pytest.approx(-2e-12, rel=0.1)
    assert (found.grammar.known["P"][:count] == signals["P_1"][:-1]).all()
    assert (found.grammar.known["P"][count + 1 :] == signals["P_2"][:-1]).all()


def test_the_flow_of_unequal_areas_is_one_law(plant):
    """Chamber 1 grows faster, chamber 2 shrinks more slowly: - dA A v / 2 in both. A free run needs the force too."""
    found, _ = both_chambers(plant, "unequal_areas", dA=0.1)
    best = find_sums(all_terms(found.grammar, found.windows, found.nuisance))[0]

    assert [term.text for term in best.terms] == ["v"]
    assert best.factors[0] == pytest.approx(-0.05 * plant["A"], rel=0.1)


def test_what_it_remembers_begins_once(plant):
    """A clock runs through the logs of both balances, and a free run takes it from the first of them."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=3.0, sample_time=0.004), centre=True)
    grammar = Grammar.of(plant, InjectionCase.of(plant, log, {}).signals, "flows")
    term = Term("P * memory", frozenset({"P", "time"}), memory=clock())
    file = definition_of(LawFit(grammar, (term,), (1e-13,), (1e-14,), 0.5), list(plant.parameters))
    begin = Begin.of(file, grammar)
    (states,) = begin.states

    assert grammar.begins == (0, len(log)) and grammar.starts == (log.time[0],)
    assert LawFile.model_validate(file.model_dump(by_alias=True)).range.keys() == {"P"}
    assert states["c_m_1"][len(log) - 2] == pytest.approx(log.time[-2] - log.time[0])
