"""What changed between two logs: what both show is no cause, what the second alone shows is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis import changed as module
from ehsa_ctrl.diagnosis.changed import Change, what_changed
from ehsa_ctrl.diagnosis.diagnosis import MODELS, Cause, Diagnosis
from ehsa_ctrl.diagnosis.hypothesis_model import effects_with_parameters, with_every_effect

DT = 0.004
TIME = DT * np.arange(500)
GAPS = {"speed": 0.1, "p1": 0.1, "p2": 0.1, "rod_velocity": 0.1, "total": 0.1}


def log():
    wave = np.sin(6.0 * TIME)
    return Log(TIME, {"current": 2.0 * wave, "speed": 90.0 * wave, "p1": 2e6 + 1e5 * wave, "position": 0.01 * wave})


def diagnosis(plant, verdict="effect", causes=("internal_leakage",), values=None, improved=None):
    """One made by hand."""
    return Diagnosis(
        plant=plant, log=log(), threshold=0.03, verdict=verdict, where=(),
        effects=tuple(Cause(name, None, "flow", 1.0, {}) for name in causes), gap=dict.fromkeys(MODELS, GAPS),
        whole=GAPS, held_out="nothing", noise_sd={}, values={"with_effects": values or {}}, simulated={},
        improved=improved,
    )  # fmt: skip


def record(rig, seed, seconds=6.0):
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=seconds, seed=1)
    return ehsa_ctrl.record(rig, time, current, seed=seed, centre=True)[0]


@pytest.mark.slow
def test_what_both_logs_show_is_no_change(plant):
    """Rod friction is off in both logs, leakage in the second alone: leakage is what changed, and its size is found.

    Against the nominal plant the second log shows the friction too."""
    nominal = plant.set(K_S=50e3)
    worn = nominal.set(A_FR=1.5 * nominal["A_FR"])
    leaking = worn.set(K_L=6.0 * nominal["K_L"])

    found = what_changed(nominal, record(worn, 1), record(leaking, 2), jobs=1)

    assert "rod_friction" in {name for cause in found.before.effects for name in (cause.id, *cause.ambiguous_with)}
    assert [cause.id for cause in found.new] == ["internal_leakage"]
    assert found.new[0].parameters["K_L"].value == pytest.approx(leaking["K_L"], rel=0.1)
    assert found.sentence.startswith("Changed between the logs: internal_leakage.")
    assert found.to_dict()["before"]["verdict"] == found.before.verdict


@pytest.mark.slow
def test_nothing_changed(plant):
    """Two logs of a rig with numbers that are a little off, and no gap: it is refitted, and the second has no gap."""
    nominal = plant.set(K_S=50e3)
    rig = nominal.set(B_FR=1.05 * nominal["B_FR"], J_M=0.97 * nominal["J_M"])

    found = what_changed(nominal, record(rig, 1), record(rig, 2), jobs=1)

    assert found.before.verdict == found.after.verdict == "no_gap"
    assert found.sentence.startswith("No relevant change")
    assert found.rig.structure == nominal.structure
    assert abs(found.rig["J_M"] / rig["J_M"] - 1.0) < abs(nominal["J_M"] / rig["J_M"] - 1.0)


def test_the_second_log_is_held_against_the_first_ones_plant(plant, monkeypatch):
    """With the causes that the first shows; what is told of progress says which log it is about."""
    improved, seen, told = plant.set(K_L=4e-12), [], []

    def diagnose(nominal, log, *, threshold, jobs, watch, check, without):
        seen.append((nominal["K_L"], log))
        watch("pairs", 1, 2)
        return diagnosis(nominal, improved=improved if len(seen) == 1 else None)

    monkeypatch.setattr(module, "diagnose", diagnose)
    first, second = log(), log()

    what_changed(plant, first, second, watch=lambda *arguments: told.append(arguments))

    assert seen == [(plant["K_L"], first), (4e-12, second)]
    assert told == [("before: pairs", 1, 2), ("after: pairs", 1, 2)]


def test_what_is_said(plant):
    """Verdicts of the second log as changes."""
    explained = diagnosis(plant, causes=("presliding",), improved=plant)
    unexplained = diagnosis(plant, verdict="outside_catalogue", causes=())

    def said(first=explained, **second):
        return Change(first, diagnosis(plant, **second), plant, "it was so").sentence

    assert said(verdict="no_gap", causes=()) == "No relevant change between the logs. Earlier log: it was so."
    assert said(causes=("backlash", "end_stop")).startswith("Changed between the logs: backlash and end_stop.")
    unknown = {"verdict": "outside_catalogue", "causes": ()}
    assert said(**unknown).startswith("Something changed between the logs. No effect")
    assert said(unexplained, **unknown).startswith("A change can't be determined: no cause was found for either")


@pytest.mark.slow
def test_bristles_that_were_found_stay(plant):
    """A rod that yields before it slides is a gap; the plant that the diagnosis gives yields too, so that a second log
    has none."""
    nominal = plant.set(K_S=50e3)
    bristles = {"sigma_0_FR": 2e6, "sigma_1_FR": float(np.sqrt(2e6 * nominal["M"]))}
    rig = nominal.with_structure(replace(nominal.structure, rod_friction="lugre"), **bristles)

    found = what_changed(nominal, record(rig, 1), record(rig, 2), jobs=1)

    assert "presliding" in {name for cause in found.before.effects for name in (cause.id, *cause.ambiguous_with)}
    assert found.after.verdict == "no_gap"


def test_one_log_is_no_change(plant):
    same = replace(log(), path=Path("a.csv"))
    with pytest.raises(InputError, match=r"a\.csv: is given as both the earlier and the later log"):
        what_changed(plant, same, replace(same))


def test_a_plant_with_effects_shares_the_engine_of_all_effects(plant):
    """Whatever effects it has already, in whatever order: the compiled text is the same."""
    late = plant.with_effects("line_pressure_drop", "current_offset", I_0=0.1)
    early = plant.with_effects("current_offset", I_0=0.1)

    assert with_every_effect(late).structure == with_every_effect(early).structure == with_every_effect(plant).structure
    assert set(with_every_effect(plant).structure.effects) == set(effects_with_parameters())
    assert with_every_effect(late)["I_0"] == 0.1
