"""Rigs unlike their fleet: one that always leaked is found, no other is."""

import numpy as np

from ehsa_ctrl.fleet.changes import Names
from ehsa_ctrl.fleet.null import false_discovery_rates
from ehsa_ctrl.fleet.outliers import outliers
from ehsa_ctrl.fleet.random_effects import random_effects

from .scores import fleet_of, made_up


def found_in(fleet):
    names = Names.of(score for scores in fleet.values() for score in scores)
    rigs = [names.rig(rig, np.arange(len(scores)), scores) for rig, scores in fleet.items()]
    score, information = (
        np.array([getattr(rig, name).sum(axis=0) for rig in rigs]) for name in ("score", "information")
    )
    of_plant = random_effects(score[:, :2], information[:, :2, :2])
    return outliers(iter(rigs), names, of_plant)


def test_a_rig_that_always_leaked_is_unlike_the_others():
    """All rigs have some of the effect, so that its mean is not zero; one has much more."""
    random = np.random.default_rng(1)
    fleet = fleet_of(random)
    for rig in fleet:
        fleet[rig] = [made_up([0.0, 0.0, 8.0 if rig == "rig 7" else 1.0], random) for _ in range(5)]

    found = found_in(fleet)

    q = false_discovery_rates([one.p for one in found])
    assert [one.rig for one, value in zip(found, q, strict=True) if value <= 0.05 and one.rig == "rig 7"] == ["rig 7"]
    assert found[7].cause == "leak" and 3.0 < found[7].size[0] < 4.0
    assert np.sum(q <= 0.05) <= 2


def test_few_rigs_are_no_fleet_to_compare_with():
    assert found_in(fleet_of(np.random.default_rng(2), rigs=5)) == [None] * 5
