"""A virtual fleet from simulation to result: its change is found, dated and named, and its truth is what it says."""

import json

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.fleet.fleet_plant import fleet_plant
from ehsa_ctrl.fleet.score import log_score
from ehsa_ctrl.fleet.virtual import CHANGES, VirtualRig, virtual_log, virtual_rigs, write_virtual_fleet
from ehsa_ctrl.physics.effects import EFFECTS


def test_the_rigs_are_what_is_asked(plant):
    """Reproducible, spread by some per cent, with as many changes as asked, each of another cause."""
    rigs = virtual_rigs(plant, 40, 5, 12, seed=3)
    again = virtual_rigs(plant, 40, 5, 12, seed=3)

    assert [rig.plant.values for rig in rigs] == [rig.plant.values for rig in again]
    changed = [rig for rig in rigs if rig.change is not None]
    assert len({rig.change.cause for rig in changed}) == 12 and all(1 <= rig.first <= 4 for rig in changed)
    relative = np.array([rig.plant["K_T"] / plant["K_T"] - 1.0 for rig in rigs])
    assert 0.015 < relative.std() < 0.09


@pytest.mark.parametrize("change", CHANGES, ids=[change.cause for change in CHANGES])
def test_every_change_changes_the_plant(plant, change):
    """And is named as a diagnosis names it."""
    found = change.applied(plant)

    assert (found.values, found.structure, found.sensors) != (plant.values, plant.structure, plant.sensors)
    id = change.cause.partition(" ")[0]
    assert id in EFFECTS


@pytest.mark.parametrize("wrong", [(1, 5, 0, 0), (5, 1, 0, 0), (5, 5, 6, 0), (5, 5, 1, -1)])
def test_numbers_that_make_no_fleet_are_a_sentence(plant, wrong):
    with pytest.raises(InputError, match="expected at least two rigs and two logs"):
        virtual_rigs(plant, *wrong)


def test_another_virtual_fleet_is_not_mixed_in(plant, tmp_path):
    (tmp_path / "truth.json").write_text(json.dumps({"settings": {"seed": 5}}))

    with pytest.raises(InputError, match=r"truth.json: is the truth of another virtual fleet; give another folder"):
        write_virtual_fleet(plant, tmp_path, rigs=2, logs=2, changed=0)


@pytest.mark.slow
def test_a_log_shows_what_changed(plant):
    """The score of one log: a leak within a fifth, and that nothing else explains as much of it."""
    change = next(one for one in CHANGES if one.cause == "external_leakage")
    log = virtual_log(VirtualRig("rig", plant, 0, change, 0), 0, 3)

    found = log_score(plant, log)

    n, at = found.nominal, found.names.index("K_e")
    rest = np.arange(n)
    H, g = found.information, found.score
    left = H[at, at] - H[at, rest] @ np.linalg.solve(H[np.ix_(rest, rest)] + np.eye(n), H[rest, at])
    score = g[at] - H[at, rest] @ np.linalg.solve(H[np.ix_(rest, rest)] + np.eye(n), g[rest])
    assert score / left * found.scale[at] == pytest.approx(2e-13, rel=0.2)
    assert found.rms[1] > 1.5
    assert np.all(np.linalg.eigvalsh(H) > -1e-6 * np.linalg.eigvalsh(H)[-1])


@pytest.mark.slow
def test_a_small_fleet_from_simulation_to_result(plant, tmp_path):
    """Three rigs, one of which begins to leak."""
    pytest.importorskip("pyarrow")
    truth = write_virtual_fleet(plant, tmp_path, rigs=3, logs=3, changed=1, seed=5)
    found = e.analyse_fleet(plant, tmp_path / "logs", store=tmp_path, diagnose=False, truth=truth)

    assert found.score() == {"changed": 1, "found": 1, "dated": 1, "named": 1, "false": 0}
    assert found.log_count == 9 and not found.failed
    mean = {one.name: one for one in found.parameters}
    assert abs(mean["A_FM"].mean / plant["A_FM"] - 1.0) < 0.15
    improved = fleet_plant(plant, found)
    assert improved.parameters["A_FM"].spread == max(mean["A_FM"].spread, mean["A_FM"].mean_sd)
