"""Chamber volumes: what of them no log can tell from the bulk modulus."""

import numpy as np
import pytest

from ehsa_ctrl import simulate
from ehsa_ctrl.physics.effects import EFFECTS

SAME = EFFECTS["chamber_volume_variation"].equivalent_effects


def test_a_factor_on_both_volumes_is_one_on_the_bulk_modulus(plant):
    """The same motion and pressures, to the tolerance of the engine; the effect says so of such sizes."""
    current = 2.0 * np.sin(0.02 * np.arange(1500))
    larger = {name: 1.27 * plant[name] for name in ("V_10", "V_20")}
    rig = plant.set(**larger).with_effects("chamber_volume_variation", c_V=0.27)
    volumes, modulus = simulate(rig, current), simulate(plant.set(beta=plant["beta"] / 1.27), current)

    for name in ("omega", "P_1", "P_2", "x"):
        assert np.max(np.abs(volumes[name] - modulus[name])) < 1e-4 * np.ptp(modulus[name])
    assert set(SAME({**larger, "c_V": 0.27}, plant.values, 0.1)) == {"bulk_modulus"}


@pytest.mark.parametrize("changed", [{"V_10": 1.3}, {"V_10": 1.3, "V_20": 0.9}])
def test_volumes_that_change_apart_are_no_bulk_modulus(plant, changed):
    sizes = {name: plant[name] * changed.get(name, 1.0) for name in ("V_10", "V_20")}

    assert SAME(sizes, plant.values, 0.1) == {}


def test_volumes_that_change_with_the_stroke_are_no_bulk_modulus(plant):
    """Where the piston sweeps a tenth of them more within the stroke."""
    slope = 0.3 + 0.13 * plant["V_10"] / (plant["A"] * 0.05)
    sizes = {name: 1.3 * plant[name] for name in ("V_10", "V_20")}

    assert SAME({**sizes, "c_V": slope}, plant.values, 0.1) == {}
