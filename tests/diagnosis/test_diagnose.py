"""The diagnosis of logs whose truth is known: labelled ones of another bench, and bad ones."""

import json
from dataclasses import replace

import pytest

import ehsa_ctrl
from ehsa_ctrl import InputError, load_plant, read_plant_log
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.hypothesis_model import with_every_effect
from ehsa_ctrl.diagnosis.signals import gap, scored_signals, signal_noise
from ehsa_ctrl.identification.comparison import replay


def labelled(folder, name):
    """Believed plant, log and the ids of the causes."""
    nominal = json.loads((folder / f"{name}.json").read_text())
    plant = load_plant("ehsa", model=nominal["model"], settings={"load.stiffness": nominal["spring_stiffness"]})
    truth = [(e["id"], e["channel"]) for e in json.loads((folder / "key.json").read_text())[name]["effects"]]
    return plant, read_plant_log(folder / f"{name}.csv", plant), truth


def bench(**settings):
    """A short log of the package's own bench."""
    plant = load_plant("ehsa", settings={"load.stiffness": 5e4, **settings})
    log, _ = ehsa_ctrl.record(
        plant, *ehsa_ctrl.excitation("noise", amplitude=3, duration=6, sample_time=0.004), centre=True
    )
    return log


@pytest.mark.slow
@pytest.mark.parametrize("name", ["L02", "L09", "L11"])
def test_the_cause_is_named(shared_logs, name):
    """One of the force balance, one of a sensor, and a pair; nothing beside them."""
    plant, log, truth = labelled(shared_logs, name)
    found = ehsa_ctrl.diagnose(plant, log)
    causes = {(c.id, c.channel): c for c in found.effects}

    assert set(causes) == set(truth)
    assert all(cause.probability > 0.5 for cause in causes.values())
    assert found.gap["with_effects"]["total"] < 0.7 * found.gap["nominal"]["total"]
    assert found.where[0][0] in {cause.place for cause in causes.values()}
    assert sum(share for _, share in found.where) == pytest.approx(1.0)
    assert sum(cause.gap_closed for cause in causes.values()) == pytest.approx(
        1.0 - found.gap["with_effects"]["total"] / found.gap["nominal"]["total"]
    )


@pytest.mark.slow
def test_air_is_measured_whatever_its_exponent():
    """Adiabatic: with the exponent that is usually assumed the share would come out a quarter off. Where the pressures
    swing enough to tell; at twenty bar share and exponent trade places."""
    exponent = 1.4
    plant = load_plant("ehsa", settings={"load.stiffness": "50 kN/m", "P_0": "8 bar"})
    rig = with_every_effect(plant).set(air_fraction=0.02, n_air=exponent, beta=1.01 * plant["beta"])
    time, current = ehsa_ctrl.excitation("noise", amplitude=3, duration=8, seed=2)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=3, centre=True)

    (cause,) = ehsa_ctrl.diagnose(plant, log).effects

    assert cause.id == "entrained_air"
    assert cause.parameters["air_fraction"].value == pytest.approx(0.02, rel=0.1)
    assert cause.parameters["n_air"].value == pytest.approx(exponent, abs=0.15)


@pytest.mark.slow
def test_a_log_without_pressures_is_diagnosed_too():
    """What no sensor shows is known where the log begins, and nothing is guessed in its middle. No balance says where
    the gap lies; the cause does."""
    plant = load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
    rig = with_every_effect(plant).set(tau_I=0.006)
    time, current = ehsa_ctrl.excitation("noise", amplitude=3, duration=8, seed=2)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=3, centre=True)
    log = replace(log, channels={c: v for c, v in log.channels.items() if c not in ("force", "p1", "p2")})

    found = ehsa_ctrl.diagnose(plant, log)

    assert "drive_lag" in {name for cause in found.effects for name in (cause.id, *cause.ambiguous_with)}
    assert found.where[0][0] == "drive" and found.where[0][1] > 0.9
    assert found.gap["with_effects"]["total"] < 0.1 * found.gap["nominal"]["total"]


@pytest.mark.slow
def test_the_improved_plant_runs_as_the_diagnosis_says(shared_logs):
    """A free run of the corrected plant over the whole log closes the gap as the engine with all effects did."""
    plant, log, _ = labelled(shared_logs, "L01")
    found = ehsa_ctrl.diagnose(plant, log)
    run = replay(found.improved, log)
    signals, dt = plant.structure.system.scored, log.sample_time
    measured, noise = scored_signals(signals, log.channels, dt), signal_noise(signals, found.noise_sd, dt)
    left = gap(measured, scored_signals(signals, run.simulated, dt), noise)
    free_run = gap(measured, scored_signals(signals, found.simulated["with_effects"], dt), noise)

    assert found.improved.structure.effects == ("pump_torque_loss",)
    assert left["total"] < 0.4 * found.whole["total"]
    assert left["total"] == pytest.approx(free_run["total"], abs=0.01)


@pytest.mark.slow
def test_what_the_catalogue_lacks_is_not_named(shared_logs):
    """An effect outside it: no cause is listed, the place is."""
    plant, log, _ = labelled(shared_logs, "L03")
    found = ehsa_ctrl.diagnose(plant, log.segment(None, log.time[0] + 10.0))

    assert found.verdict == "outside_catalogue"
    assert not found.effects and "outside_catalogue" in found.improved.title
    assert not set(found.improved.structure.effects) - set(plant.structure.effects)
    assert found.where[0][1] > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["L04", "L13"])
def test_no_gap_is_no_gap(shared_logs, name):
    """Parameters that are a little off move no signal by the threshold: nothing is searched."""
    plant, log, _ = labelled(shared_logs, name)
    found = ehsa_ctrl.diagnose(plant, log)

    assert (found.verdict, found.effects, found.where) == ("no_gap", (), ())
    assert json.dumps(found.to_dict(), default=float)


def test_a_log_that_is_plainly_wrong_is_refused():
    """A sign or a unit is no effect: the sentence says which channel and what to write."""
    plant, log = load_plant("ehsa", settings={"load.stiffness": 5e4}), bench()
    swapped = replace(log, channels={**log.channels, "speed": -log["speed"]})
    in_bar = replace(log, channels={**log.channels, "p1": log["p1"] * 1e-5})

    with pytest.raises(InputError, match="speed"):
        ehsa_ctrl.diagnose(plant, swapped)
    with pytest.raises(InputError, match="bar"):
        ehsa_ctrl.diagnose(plant, in_bar)


def test_other_mistakes_are_sentences():
    """Too short, a threshold that is none, a plant of another system, no current."""
    plant, log = load_plant("ehsa", settings={"load.stiffness": 5e4}), bench()
    short = Log(log.time[:500], {name: values[:500] for name, values in log.channels.items()})
    without = replace(log, channels={n: v for n, v in log.channels.items() if n != "current"})

    with pytest.raises(InputError, match="lasts 2 s; a diagnosis needs at least 3 s"):
        ehsa_ctrl.diagnose(plant, short)
    with pytest.raises(InputError, match="threshold = 3; expected a share"):
        ehsa_ctrl.diagnose(plant, log, threshold=3.0)
    with pytest.raises(InputError, match="has no channel drive_force"):
        ehsa_ctrl.diagnose(load_plant("emps"), log)
    with pytest.raises(InputError, match="has no channel current"):
        ehsa_ctrl.diagnose(plant, without)


def test_held_out_data_without_the_gap_is_said_to_be_so():
    """Where the last third shows nothing of it, the sentence speaks of the whole log instead of a share of nothing."""
    from types import SimpleNamespace

    from ehsa_ctrl.diagnosis.verdict_text import verdict_sentence

    def sentence(held):
        gaps = {"nominal": {"p1": held, "total": held}, "with_effects": {"p1": 0.002, "total": 0.002}}
        return verdict_sentence(
            SimpleNamespace(
                whole={"p1": 0.119, "total": 0.1}, threshold=0.03, verdict="effect", gap=gaps, where=(),
                effects=[SimpleNamespace(name="anti_cavitation", ambiguous_with=())],
                whole_with_effects={"p1": 0.004, "total": 0.003},
            )
        )  # fmt: skip

    assert "over the whole log it falls from 11.9 to 0.4 %" in sentence(0.0016)
    assert "closes 98 % of the total gap there" in sentence(0.1)
