"""Each third of a long log held out in turn: the causes close the gap everywhere, or in some thirds only."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.folds import LONG, Fold, folds_of, folds_sentence, uneven_folds
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.refit import refit_until_converged
from ehsa_ctrl.diagnosis.signals import largest

THRESHOLD, SAMPLE_TIME = 0.03, 0.005
RIG = ehsa_ctrl.load_plant("emps")
#: The nominal plant's mass is 30 % too small.
NOMINAL = RIG.set(M=RIG["M"] / 1.3)


def record(seconds, rigs):
    """A log of equal parts, each of a rig that starts and ends at rest."""
    time = np.arange(0.0, seconds / len(rigs), SAMPLE_TIME)
    envelope = np.minimum(1.0, np.minimum(time, np.maximum(time[-1] - 1.0 - time, 0.0)))
    force = envelope * (70.0 * np.sin(2.0 * np.pi * 0.8 * time) + 25.0 * np.sin(2.0 * np.pi * 2.1 * time))
    runs = [ehsa_ctrl.simulate(rig, force, hold="first_order", sample_time=SAMPLE_TIME)["x"] for rig in rigs]
    ends = np.cumsum([0.0, *(run[-1] for run in runs[:-1])])
    position = np.concatenate([run + end for run, end in zip(runs, ends, strict=True)])
    position += 1e-6 * np.random.default_rng(0).standard_normal(position.size)
    channels = {"drive_force": np.tile(force, len(rigs)), "position": position}
    return ehsa_ctrl.Log(SAMPLE_TIME * np.arange(position.size), channels)


def folds(log, validate=None):
    """The folds of a diagnosis that names the payload mass, its fit, and its held-out segment."""
    prepared = prepare_logs(NOMINAL, [log], validate, THRESHOLD, check=True)
    segments = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True)
    objective, sensitivities = objective_of(segments.training, THRESHOLD)
    mass = next(c for c in candidate_effects(segments.training.model) if c.id == "payload_mass")
    fit = refit_until_converged(objective, (mass,), {"M": NOMINAL["M"]}, sensitivities)
    return folds_of(prepared, segments, objective, fit, Pool()), fit, segments


def test_a_cause_that_acts_throughout_closes_the_gap_in_every_third():
    """The gap with the causes in the third that the diagnosis held out is that of its own fit."""
    found, fit, segments = folds(record(1.1 * LONG, [RIG] * 3))

    assert [one.part for one in found] == ["the last third", "the first third", "the middle third"]
    assert all(largest(one.gap["nominal"]) > THRESHOLD for one in found)
    assert all(largest(one.gap["with_effects"]) < 0.5 * THRESHOLD for one in found)
    assert found[0].gap["with_effects"] == segments.held_out.gap(fit.values)
    assert uneven_folds(found, THRESHOLD) == []


def test_friction_that_changes_after_the_first_third_is_said():
    """Fitted to the other two thirds, the causes leave a gap in the first alone."""
    rig = RIG.set(Fv=2.0 * RIG["Fv"])

    found, _, _ = folds(record(1.1 * LONG, [rig, RIG, RIG]))

    (words,) = uneven_folds(found, THRESHOLD)
    assert "% in the first third, and less than the threshold in the other parts" in words


def test_a_third_that_rests_is_no_fold():
    log = record(1.1 * LONG, [RIG] * 3)
    edge = 2 * len(log) // 3
    still = {name: np.where(np.arange(len(log)) < edge, v, v[edge]) for name, v in log.channels.items()}
    still["drive_force"] = np.where(np.arange(len(log)) < edge, log["drive_force"], 0.0)
    found, _, _ = folds(ehsa_ctrl.Log(log.time, still))

    assert "the last third" not in [one.part for one in found]


@pytest.mark.parametrize(("seconds", "validated"), [(0.9 * LONG, False), (1.1 * LONG, True)])
def test_a_short_log_and_one_with_a_validation_log_have_no_folds(seconds, validated):
    log = record(seconds, [RIG] * 3)

    found, _, _ = folds(log, record(20.0, [RIG]) if validated else None)

    assert found == ()


def test_the_sentence_names_each_third():
    gap = {"nominal": {"speed": 0.2, "total": 0.1}, "with_effects": {"speed": 0.01, "total": 0.1}}

    words = folds_sentence([Fold("the last third", gap), Fold("the first third", gap)])

    assert words.endswith("falls from 20 to 1 % in the last third and from 20 to 1 % in the first third")
    assert folds_sentence(()) == ""
