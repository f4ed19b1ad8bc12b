"""What fleet.json holds of a large fleet."""

import numpy as np

from ehsa_ctrl.fleet.result import MOST_SERIES, Fleet, FleetRig


def test_a_large_fleet_has_the_series_of_the_rigs_that_the_page_shows():
    """Changed rigs first, then those unlike the fleet, then by name; the store has all."""
    rigs = [FleetRig(f"rig {k:03d}", (), series={"K_T": np.array([[0.1, 0.01]])}) for k in range(MOST_SERIES)]
    rigs += [
        FleetRig("x unlike", (), unlike="air", series={"K_T": np.array([[0.2, 0.01]])}),
        FleetRig("y changed", (), changed=True, p=1e-9, series={"K_T": np.array([[0.3, 0.01]])}),
    ]
    content = Fleet("ehsa", 0.05, tuple(rigs), (), (), ()).to_dict()["rigs"]
    without = [rig["name"] for rig in content if not rig["series"]]

    assert [rig["name"] for rig in content] == [rig.name for rig in rigs]
    assert without == [f"rig {MOST_SERIES - 2}", f"rig {MOST_SERIES - 1}"]
    assert content[-1]["series"] == {"K_T": [[0.3, 0.01]]}
