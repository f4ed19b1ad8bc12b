"""What fleet.json holds of a large fleet."""

import numpy as np

from ehsa_ctrl.fleet.result import MOST_SERIES, Fleet, FleetRig, LogLine


def test_a_large_fleet_has_the_logs_and_series_of_the_rigs_that_the_page_shows():
    """Changed rigs first, then those unlike the fleet, then by name; the store has all."""
    log = LogLine("a.csv", "a.csv", "2026-01-01T00:00:00+00:00", "name", (2.0, 0.9))
    rigs = [FleetRig(f"rig {k:03d}", (log,), series={"K_T": np.array([[0.1, 0.01]])}) for k in range(MOST_SERIES)]
    rigs += [
        FleetRig("x unlike", (log,), unlike="air", series={"K_T": np.array([[0.2, 0.01]])}),
        FleetRig("y changed", (log,), changed=True, p=1e-9, series={"K_T": np.array([[0.3, 0.01]])}),
    ]
    whole = Fleet("ehsa", 0.05, tuple(rigs), (), (), ()).to_dict()
    content = whole["rigs"]
    without = [rig["name"] for rig in content if not rig["series"]]

    assert [rig["name"] for rig in content] == [rig.name for rig in rigs]
    assert without == [f"rig {MOST_SERIES - 2}", f"rig {MOST_SERIES - 1}"]
    assert [rig["name"] for rig in content if not rig["logs"]] == without and whole["counts"]["logs"] == len(rigs)
    assert content[-1]["series"] == {"K_T": [[0.3, 0.01]]}
