"""Friction of the pump that grows with its load: constant, higher where the oil film does not carry, or with speed."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.physics.effects.pump_torque_loss import friction, loss_share

FORMS = [{"c_f": 0.1}, {"c_f": 0.1, "b_f": 2.0, "w_f": 100.0}, {"c_f": 0.0, "c_w": 5e-4}]


def test_limits_of_the_share():
    """c_f (1 + b_f) at standstill, half of b_f left at w_f; c_w per speed; without both exactly c_f."""
    assert loss_share(0.0, 0.1, 2.0, 40.0, 0.0) == pytest.approx(0.3, rel=1e-14)
    assert loss_share(40.0, 0.1, 2.0, 40.0, 0.0) == pytest.approx(0.2, rel=1e-14)
    assert loss_share(-4e9, 0.1, 2.0, 40.0, 0.0) == pytest.approx(0.1, rel=1e-7)
    assert loss_share(-200.0, 0.0, 0.0, 40.0, 5e-4) == pytest.approx(0.1, rel=1e-14)
    assert loss_share(123.0, 0.07, 0.0, 40.0, 0.0) == 0.07


@pytest.mark.parametrize("omega", [-300.0, -1.0, 2.0, 400.0])
@pytest.mark.parametrize("dP", [-50e5, 80e5])
def test_the_loss_only_brakes(omega, dP):
    """Its power is never negative, whichever side has the pressure."""
    for form in FORMS:
        numbers = {"b_f": 0.0, "w_f": 40.0, "c_w": 0.0, **form}
        torque = friction(0.0, float(np.sign(omega)), omega, 1e5 + dP, 1e5, 6e-7, **numbers)

        assert torque * omega > 0.0


@pytest.mark.parametrize("form", FORMS)
def test_the_steady_torque_balance_closes(plant, form):
    """At a held current, K_T I drives friction (8) and the pressure torque with its loss."""
    rig = plant.with_effects("pump_torque_loss", **form).set(K_S=0.0, tau_FM=1.0)
    end = ehsa_ctrl.simulate(rig, np.full(400, 1.8))
    omega, dP = float(end["omega"][-1]), float(end["dP"][-1])
    share = loss_share(omega, rig["c_f"], rig["b_f"], rig["w_f"], rig["c_w"])

    known = rig["A_FM"] + rig["B_FM"] * omega
    assert rig["K_T"] * 1.8 == pytest.approx(known + (1.0 + share) * rig["D"] * dP, rel=3e-3)
    assert share * rig["D"] * dP > 0.01 * known
