"""Changes of rigs: found, dated and named in made-up fleets; false discoveries as rare as asked."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl.fleet import changes as module
from ehsa_ctrl.fleet.changes import ChangeTest, Names, scan
from ehsa_ctrl.fleet.null import false_discovery_rates, largest_null, scatter
from ehsa_ctrl.fleet.outliers import robust_variance

from .scores import NAMES, SCALE, fleet_of, made_up


def scans_of(fleet):
    names = Names.of(score for scores in fleet.values() for score in scores)
    rigs = [names.rig(rig, 7.0 * np.arange(len(scores)), scores) for rig, scores in fleet.items()]
    return [scan(rig, names) for rig in rigs], names


def changes(scans, names):
    test = ChangeTest.of(scans, names)
    return [test.change(one) for one in scans]


def test_one_parameter_has_the_closed_form():
    """Two groups of logs of equal information: a t-test with known variance."""
    random = np.random.default_rng(1)
    scores = [made_up([0.0, 0.0, 0.1 * log], random) for log in range(4)]
    for score in scores:
        score.information[:] = np.diag([1e9, 1e9, 50.0])
        score.score[:] = score.information @ (np.array([0.0, 0.0, 0.3]) * random.standard_normal(3))
    (found,), names = scans_of({"rig": scores})

    estimates = np.array([score.score[2] / 50.0 for score in scores])
    row, column = list(names.causes).index("leak"), found.times.index(2)
    difference = estimates[2:].mean() - estimates[:2].mean()

    assert found.size["leak"][column, 0] == pytest.approx(difference, rel=5e-3)
    assert found.variance["leak"][column, 0] == pytest.approx(1 / 50.0, rel=5e-3)
    assert found.statistic[row, column] == pytest.approx(difference**2 * 50.0, rel=1e-2)


def test_a_step_is_found_dated_and_named():
    """In a fleet of rigs that differ, of which two changed."""
    random = np.random.default_rng(2)
    step = {3: (2, [0.0, 0.0, 6.0]), 17: (4, [-0.3, 0.0, 0.0])}
    scans, names = scans_of(fleet_of(random, changed=step))

    found = changes(scans, names)
    q = false_discovery_rates([one.p for one in found])

    assert set(np.flatnonzero(q <= 0.05)) >= {3, 17}
    assert (found[3].cause, found[3].first, found[3].same) == ("leak", 2, ())
    assert (found[17].cause, found[17].first) == ("torque_constant", 4)
    assert found[3].size[0] * SCALE[2] == pytest.approx(6.0, abs=5.0 * found[3].sd[0] * SCALE[2])


def test_two_steps_in_one_rig_are_told_apart():
    """K_T after the second log, a leak after the sixth; in a rig with one step, or with none, no other is found."""
    random = np.random.default_rng(12)
    fleet = fleet_of(random, logs=9, changed={5: (4, [0.0, 0.0, 6.0])})
    fleet["rig 0"] = [made_up([-0.3 * (log >= 2), 0.0, 6.0 * (log >= 6)], random) for log in range(9)]
    scans, names = scans_of(fleet)
    test = ChangeTest.of(scans, names)
    found = {
        number: test.steps(names.rig("", 7.0 * np.arange(9), fleet[f"rig {number}"]), limit=1e-3)
        for number in (0, 5, 8)
    }  # fmt: skip

    assert [(one.first, one.cause) for one in found[0]] == [(2, "torque_constant"), (6, "leak")]
    assert found[0][0].size[0] * SCALE[0] == pytest.approx(-0.3, abs=5.0 * found[0][0].sd[0] * SCALE[0])
    assert found[0][1].size[0] * SCALE[2] == pytest.approx(6.0, abs=5.0 * found[0][1].sd[0] * SCALE[2])
    assert [(one.first, one.cause) for one in found[5]] == [(4, "leak")]
    assert found[8] == []


def test_a_drift_is_no_step():
    """A parameter that moves evenly over nine logs."""
    random = np.random.default_rng(3)
    fleet = fleet_of(random, logs=9)
    fleet["rig 0"] = [made_up([0.0, 0.0, 1.0 * log], random) for log in range(9)]
    scans, names = scans_of(fleet)

    found = changes(scans, names)[0]

    assert (found.cause, found.first) == ("leak", -1)
    assert found.size[0] * SCALE[2] == pytest.approx(8.0, abs=5.0 * found.sd[0] * SCALE[2])


def test_what_the_rig_always_had_is_no_change():
    """An effect of the same size in all of its logs."""
    random = np.random.default_rng(4)
    fleet = fleet_of(random)
    fleet["rig 5"] = [made_up([0.0, 0.0, 20.0], random) for _ in range(5)]
    scans, names = scans_of(fleet)

    assert changes(scans, names)[5].p > 0.01


def test_a_rig_with_one_log_has_no_change():
    """Nor stops it the others."""
    random = np.random.default_rng(5)
    fleet = fleet_of(random, rigs=25, changed={2: (3, [0.0, 0.0, 6.0])})
    fleet["rig 0"] = fleet["rig 0"][:1]
    scans, names = scans_of(fleet)
    found = changes(scans, names)

    assert found[0] is None and found[2].cause == "leak"


def test_noise_that_is_larger_than_assumed_finds_nothing():
    """All scores scatter three times as much as their information says: the fleet itself shows it."""
    flagged = 0
    for seed in range(6):
        random = np.random.default_rng(100 + seed)
        fleet = fleet_of(random)
        for scores in fleet.values():
            for score in scores:
                score.score[:] += 3.0 * np.linalg.cholesky(score.information) @ random.standard_normal(3)
        scans, names = scans_of(fleet)
        null = largest_null([one.statistic for one in scans], np.ones(3))
        assert np.all(null.factor > 4.0)
        flagged += int(np.sum(false_discovery_rates([one.p for one in changes(scans, names)]) <= 0.05))

    assert flagged <= 2


def test_the_procedure_is_benjamini_and_hochbergs():
    """Their own definition: the largest k with p_(k) <= k q / m."""
    p = np.random.default_rng(6).uniform(size=40) ** 3
    by_hand = np.zeros(40, dtype=bool)
    order = np.argsort(p)
    below = np.flatnonzero(p[order] <= 0.05 * np.arange(1, 41) / 40)
    by_hand[order[: below[-1] + 1]] = True

    assert np.array_equal(false_discovery_rates(p) <= 0.05, by_hand)
    assert false_discovery_rates([]).size == 0


def test_the_variance_between_units_ignores_an_outlier():
    """Paule and Mandel's equation with the median: close to the true variance, with and without it."""
    random = np.random.default_rng(8)
    values = 2.0 * random.standard_normal(400)

    clean = robust_variance(values, np.full(400, 1e-3))
    spoiled = robust_variance(np.append(values, [1e3, -1e3]), np.full(402, 1e-3))

    assert clean == pytest.approx(4.0, rel=0.3) and spoiled == pytest.approx(clean, rel=0.1)
    assert robust_variance(0.1 * values, np.full(400, 4.0)) == 0.0


def test_logs_with_other_names_are_joined():
    """A log that lacks a channel, and with it a parameter, says nothing of that parameter."""
    random = np.random.default_rng(9)
    whole = made_up([0.0, 0.0, 1.0], random)
    part = made_up([0.0, 0.0, 1.0], random)
    keep = [0, 2]
    part = replace(
        part, names=("K_T", "e"), nominal=1, scale=2.0 * SCALE[keep], score=2.0 * part.score[keep],
        information=4.0 * part.information[np.ix_(keep, keep)], causes={"torque_constant": ("K_T",), "leak": ("e",)},
    )  # fmt: skip
    names = Names.of([whole, part])
    rig = names.rig("rig", [0.0, 1.0], [whole, part])

    assert names.names == NAMES and names.nominal == 2
    assert rig.information[1, 1, 1] == 0.0
    assert rig.information[1][np.ix_(keep, keep)] == pytest.approx(part.information / 4.0)
    assert rig.score[1, keep] == pytest.approx(part.score / 2.0)


def test_the_scatter_between_logs_is_that_of_the_scores():
    """Three times the variance that each log states."""
    random = np.random.default_rng(10)
    statistics = [3.0 * random.chisquare(1.0, size=(5, 4)) for _ in range(400)]

    assert scatter(statistics) == pytest.approx(3.0, rel=0.2)
    assert scatter([0.2 * one for one in statistics]) == 1.0
    assert scatter([]) == 1.0


@pytest.mark.parametrize("drift", [True, False])
def test_a_rig_of_many_logs_is_scanned_in_blocks(monkeypatch, drift):
    """Blocks of three steps give what weighted sums over all logs give; the drift comes last."""
    random = np.random.default_rng(6)
    logs = [made_up([0.0, 0.0, 1.0 * (log > 4)], random) for log in range(11)]
    names = Names.of(logs)
    rig = names.rig("rig", np.arange(11.0) ** 1.5, logs)
    whole = scan(rig, names, drift=drift)
    weights = [np.arange(11) >= first for first in range(1, 11)]
    weights += [(rig.days - rig.days.mean()) / (rig.days[-1] - rig.days[0])] * drift
    monkeypatch.setattr(module, "BLOCK", 3)
    found = list(module._profiles(rig, len(whole.times)))
    parts = scan(rig, names, drift=drift)

    assert sorted(k for part, *_ in found for k in range(part.start, part.stop)) == list(range(len(weights)))
    for part, once, twice, moved in found:
        for k, own in enumerate(range(part.start, part.stop)):
            w = np.asarray(weights[own], dtype=float)
            assert once[k] == pytest.approx(sum(a * H for a, H in zip(w, rig.information, strict=True)))
            assert twice[k] == pytest.approx(sum(a**2 * H for a, H in zip(w, rig.information, strict=True)))
            assert moved[k] == pytest.approx(w @ rig.score)
    assert parts.statistic == pytest.approx(whole.statistic) and parts.times == whole.times


@pytest.mark.parametrize(("first", "last"), [(0, 11), (4, 9)])
def test_information_that_is_read_anew_gives_the_same(monkeypatch, first, last):
    """A rig of too many logs for memory, and a part of it, are scanned as one in memory; its logs are not kept."""
    random = np.random.default_rng(7)
    logs = [made_up([0.0, 0.0, 1.0 * (log > 4)], random) for log in range(11)]
    names = Names.of(logs)
    kept = names.rig("rig", np.arange(11.0) ** 1.5, logs).part(first, last)
    monkeypatch.setattr(module, "MOST_IN_MEMORY", 10)
    monkeypatch.setattr(module, "BLOCK", 3)

    stored = names.rig("rig", np.arange(11.0) ** 1.5, logs).part(first, last)

    assert isinstance(stored.information, module.StoredInformation) and isinstance(kept.information, np.ndarray)
    assert np.array_equal(np.asarray(stored.information), kept.information)
    assert stored.total == pytest.approx(kept.information.sum(axis=0))
    assert scan(stored, names).statistic == pytest.approx(scan(kept, names).statistic)
