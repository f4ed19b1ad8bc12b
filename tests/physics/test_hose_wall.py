"""Walls of hoses that follow the pressure late."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.physics.effects import EFFECTS

CURRENT = 2.0 * np.sin(np.linspace(0.0, 12.0, 501))


def test_a_fast_wall_is_a_softer_oil(plant):
    """1 / beta + C_h / V, for volumes that the stroke changes by 1 %."""
    C_h = 1e-12
    fast = plant.with_effects("hose_wall", C_h=C_h, tau_h=1e-3)
    soft = plant.set(beta=1.0 / (1.0 / plant["beta"] + 2.0 * C_h / (plant["V_10"] + plant["V_20"])))
    wall, oil, stiff = (ehsa_ctrl.simulate(rig, CURRENT)["dP"] for rig in (fast, soft, plant))

    assert np.std(wall - oil) < 0.1 * np.std(stiff - oil)


def test_a_slow_wall_is_stiff(plant):
    """Within a run much shorter than its time constant it takes up no oil."""
    slow = ehsa_ctrl.simulate(plant.with_effects("hose_wall", C_h=1e-12, tau_h=1e3), CURRENT)
    base = ehsa_ctrl.simulate(plant, CURRENT)

    assert np.std(slow["dP"] - base["dP"]) < 0.01 * np.std(base["dP"])


def test_the_wall_along_a_log_is_that_of_its_run(plant):
    """A run that begins in the middle of a log starts there; without pressures, at rest."""
    run = ehsa_ctrl.simulate(plant.with_effects("hose_wall", C_h=1e-12, tau_h=0.1), CURRENT)
    log = Log(run.time, {"p1": run["P_1"]})

    wall_1, wall_2 = EFFECTS["hose_wall"].states
    found = wall_1.along(log, plant.values)

    np.testing.assert_allclose(found, run["P_W1"], atol=0.03 * np.max(np.abs(run["P_W1"])))
    assert not wall_2.along(log, plant.values).any()


def test_a_held_pressure_fills_the_wall(plant):
    """In the end P_W is the rise of the pressure."""
    run = ehsa_ctrl.simulate(plant.with_effects("hose_wall", C_h=1e-12, tau_h=0.05), np.full(400, 1.8))

    assert run["P_W1"][-1] == pytest.approx(run["P_1"][-1] - plant["P_0"], rel=0.02)
