"""Drifts of single parameters: a trend is one, a step is none."""

import numpy as np
import pytest

from ehsa_ctrl.fleet.changes import Names, scan
from ehsa_ctrl.fleet.drifts import drifts
from ehsa_ctrl.fleet.manifest import find_logs

from .scores import fleet_of, made_up


def drifts_of(fleet, plant, tmp_path, stepped=()):
    for rig, scores in fleet.items():
        for number in range(len(scores)):
            path = tmp_path / rig / f"2026-01-{number + 1:02d}.csv"
            path.parent.mkdir(exist_ok=True)
            path.write_text("t\n")
    logs = {rig: [log for log in find_logs([tmp_path]) if log.rig == rig] for rig in fleet}
    names = Names.of(score for scores in fleet.values() for score in scores)
    scans = [scan(names.rig(rig, np.arange(len(s)), s), names.of_parameters()) for rig, s in fleet.items()]
    sized = {one.rig: one for one in scans}
    return drifts([one.statistics for one in scans], names, plant, 0.05, logs, stepped, sized.__getitem__)


def test_a_trend_is_found_with_its_slope(plant, tmp_path):
    """K_T of one rig of thirty falls by 0.05 N m/A a day; in another it steps."""
    random = np.random.default_rng(1)
    fleet = fleet_of(random, rigs=30, logs=8)
    fleet["rig 4"] = [made_up([-0.05 * log, 0.0, 0.0], random) for log in range(8)]
    fleet["rig 9"] = [made_up([-0.4 * (log > 2), 0.0, 0.0], random) for log in range(8)]

    found = drifts_of(fleet, plant, tmp_path, stepped=("rig 9",))

    first = found[0]
    assert (first.rig, first.parameter, first.unit) == ("rig 4", "K_T", "N m/A")
    assert first.slope == pytest.approx(-0.05, abs=5.0 * first.sd)
    assert "rig 9" not in {one.rig for one in found} and len(found) <= 3


def test_two_logs_are_no_trend(plant, tmp_path):
    assert drifts_of(fleet_of(np.random.default_rng(2), rigs=25, logs=2), plant, tmp_path) == ()
