"""Oil that warms up: with the time or with the heat, the same oil in the end, and the heat is the work done."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.physics.effects.viscosity_warmup import heat_of, thinning

HELD = np.full(1250, 1.6)


@pytest.fixture
def cold(plant):
    """The plant with oil that warms up."""
    return plant.with_effects("viscosity_warmup", drop=0.3, tau_w=0.5)


def test_closed_form():
    """1 - 1/e of the drop is lost after one constant, of time or of heat; the other one does not count then."""
    share = 0.3 * (1.0 - np.exp(-1.0))

    assert thinning(10.0, 5e3, 0.3, 10.0, np.inf) == pytest.approx(share, rel=1e-12)
    assert thinning(99.0, 2e3, 0.3, 10.0, 2e3) == pytest.approx(share, rel=1e-12)
    assert thinning(0.0, 0.0, 0.3, 10.0, 2e3) == 0.0


def test_oil_that_warms_up_does_not_thicken(cold):
    """Less torque with running time has another cause, such as a motor that heats up."""
    with pytest.raises(InputError, match=r"drop = -0\.1 1: must be at least 0"):
        cold.set(drop=-0.1)


@pytest.mark.parametrize("E_w", [np.inf, 20.0])
def test_warm_oil_is_oil_of_less_viscosity(plant, cold, E_w):
    """Long after the constant, the speed is that of a plant with 0.7 of the viscous friction."""
    warm = ehsa_ctrl.simulate(cold.set(E_w=E_w), HELD)
    thin = ehsa_ctrl.simulate(plant.set(B_FM=0.7 * plant["B_FM"], B_FR=0.7 * plant["B_FR"]), HELD)

    assert warm["omega"][-1] == pytest.approx(thin["omega"][-1], rel=2e-3)


def test_the_heat_is_the_work_of_the_motor(cold):
    """First law: at rest again, without a load, K_T I omega has become heat of friction; leakage takes 0.2 %."""
    current = np.concatenate([2.0 * np.sin(np.linspace(0.0, 8.0 * np.pi, 1000)), np.zeros(250)])
    run = ehsa_ctrl.simulate(cold.set(drop=0.3, E_w=500.0), current)
    # The current is held over each sample; the mean speed of a sample is not quite that of its ends.
    work = cold["K_T"] * np.sum(current[:-1] * 0.5 * (run["omega"][1:] + run["omega"][:-1])) * 0.004

    assert np.all(np.diff(run["E_run"]) >= 0.0)
    assert run["omega"][-1] == 0.0
    assert run["E_run"][-1] == pytest.approx(work, rel=0.01)


def test_the_time_alone_needs_no_heat(cold):
    """With an infinite heat constant the heat is not integrated, and the effect is that of the time."""
    assert not ehsa_ctrl.simulate(cold, HELD)["E_run"].any()


def test_the_heat_of_a_log_is_that_of_its_run(plant, cold):
    """Read off the measured speed with nominal friction, for runs that begin in the middle of a log."""
    current = 2.0 * np.sin(np.linspace(0.0, 8.0 * np.pi, 1000))
    run = ehsa_ctrl.simulate(cold.set(drop=1e-9, E_w=1e3), current)
    log = Log(run.time, {"current": current, "speed": run["omega"]})

    assert heat_of(log, plant.values)[-1] == pytest.approx(run["E_run"][-1], rel=0.03)
    assert not heat_of(Log(run.time, {"current": current}), plant.values).any()
