"""Diagnoses of changed rigs: kept in the record, decisive for the name, and for whether a change matters."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.diagnosis.diagnosis import Cause
from ehsa_ctrl.fleet import rig_diagnosis as module
from ehsa_ctrl.fleet.result import Fleet, FleetRig
from ehsa_ctrl.fleet.store import Store


@pytest.fixture
def fleet(tmp_path, monkeypatch):
    """Three changed rigs and one that did not; a diagnosis that says what the file's content asks for."""
    done = []

    def diagnose(plant, log, *, jobs, check):
        done.append(log.stem)
        if log.stem == "wrong":
            raise InputError("the log is wrong")
        causes = (Cause("sensor_bias", "p1", "sensor", 0.9, {}, ("sensor_bias (p2)",)),) if log.stem == "bias" else ()
        gap = {"nominal": {"total": 0.1}, "with_effects": {"total": 0.01}}
        verdict = "ambiguous" if causes else "no_gap"
        return SimpleNamespace(verdict=verdict, effects=causes, gap=gap, improved_gap=gap["with_effects"])

    monkeypatch.setattr(module, "diagnose", diagnose)
    monkeypatch.setattr(module, "read_plant_log", lambda path, plant: path)
    rigs = []
    for name in ("bias", "small", "wrong"):
        (tmp_path / f"{name}.csv").write_text(name)
        rigs.append(
            FleetRig(f"rig/{name}", (), True, "step", "leak", ("x",), "score", file=str(tmp_path / f"{name}.csv"))
        )
    return Fleet("ehsa", 0.05, (*rigs, FleetRig("still", ())), (), (), ()), done


def test_the_diagnosis_decides(fleet, plant, tmp_path):
    """It names the cause, or finds no gap that matters; a log that it can't use leaves the score test's name."""
    found, done = fleet
    store, kept = Store(tmp_path / "store", plant), []

    result = module.diagnose_changed(
        found, dict.fromkeys([rig.name for rig in found.rigs], plant), store, keep=lambda folder, _: kept.append(folder)
    )

    bias, small, wrong, still = result.rigs
    assert (bias.cause, bias.same, bias.by) == ("sensor_bias (p1)", ("sensor_bias (p2)",), "diagnosis")
    assert (
        not small.changed and small.diagnosis.verdict == "no_gap" and "rig/small: significant, but" in result.notes[0]
    )
    assert wrong.cause == "leak" and wrong.diagnosis.error == "the log is wrong"
    assert still.diagnosis is None
    assert kept == ["diagnoses/rig_bias", "diagnoses/rig_small"]

    again = module.diagnose_changed(found, dict.fromkeys([rig.name for rig in found.rigs], plant), store)
    assert done == ["bias", "small", "wrong"]
    assert again.rigs[0] == replace(bias, diagnosis=again.rigs[0].diagnosis)

    moved = dict.fromkeys([rig.name for rig in found.rigs], plant.set(K_T=1.3))
    module.diagnose_changed(found, moved, store)
    assert len(done) == 6


def test_a_damaged_record_is_a_sentence(fleet, plant, tmp_path):
    found, _ = fleet
    store = Store(tmp_path / "store", plant)
    plants = dict.fromkeys([rig.name for rig in found.rigs], plant)
    module.diagnose_changed(found, plants, store)
    record = tmp_path / "store" / "diagnoses.jsonl"
    record.write_text(record.read_text() + "{}\n")

    with pytest.raises(InputError, match=r"diagnoses.jsonl: line 5 is not a diagnosis; correct or delete it"):
        module.diagnose_changed(found, plants, store)
