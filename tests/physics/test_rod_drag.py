"""Drag of the rod ~ v |v|: a drop in the lines by another name."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.physics.effects import EFFECTS
from ehsa_ctrl.physics.effects.rod_drag import net_force

CURRENT = 2.5 * np.sin(np.linspace(0.0, 12.0, 501))


def test_it_only_brakes():
    """Its power is k_v |v|^3."""
    for v in (-0.2, 0.0, 0.1):
        assert -net_force(0.0, v, 1e4) * v == pytest.approx(1e4 * abs(v) ** 3, rel=1e-14)


def test_it_is_a_turbulent_drop(plant):
    """k_v = 2 A^3 R_turb moves every signal alike, so that a diagnosis names both."""
    R_turb = 2e13
    drag = ehsa_ctrl.simulate(plant.with_effects("rod_drag", k_v=2.0 * plant["A"] ** 3 * R_turb), CURRENT)
    lines = ehsa_ctrl.simulate(plant.with_effects("line_pressure_drop", R_turb=R_turb, R_lam=0.0), CURRENT)
    base = ehsa_ctrl.simulate(plant, CURRENT)
    same = EFFECTS["line_pressure_drop"].equivalent_effects({"R_turb": R_turb, "R_lam": 0.0}, plant.values, 0.1)

    np.testing.assert_allclose(drag.states, lines.states, rtol=1e-6, atol=1e-9)
    assert np.max(np.abs(base["v"])) > 1.1 * np.max(np.abs(drag["v"]))
    assert list(same) == ["rod_drag"]
