"""Friction as sliders behind springs: never a source of work, exact at rest, and (8) at constant speed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ehsa_ctrl
from ehsa_ctrl.physics.effects.maxwell_slip import RIGID, friction, limit, net_force, spring, sticking
from ehsa_ctrl.plant.arrays import array_evaluator

LAW = {"A_FR": 854.0, "C_FR": 213.0, "tau_FR": 0.007, "s_slip": 1e-7}
HOLDS = {"A_FR": 854.0, "C_FR": 213.0, "s_slip": 1e-7}


@given(v=st.floats(-1.0, 1.0), share=st.sampled_from([1 / 6, 2 / 6, 3 / 6]), part=st.floats(-1.0, 1.0))
def test_a_slider_never_gives_more_than_it_took(v, share, part):
    """Its power is at least the rate of its spring's energy; on the way back and inside, exactly that."""
    most = limit(share, **HOLDS)
    z = part * most
    power = spring(v, z, share, **LAW) * v
    stored = z / (3.0 * LAW["s_slip"]) * v * sticking(v, z, most)

    assert power >= stored - 1e-9
    if v * z < 0.0 or abs(part) < 0.96:
        assert power == pytest.approx(stored, abs=1e-9)


@given(v=st.floats(0.001, 1.0))
def test_at_constant_speed_it_is_the_stribeck_curve(v):
    """All sliders at their limits, and the rigid one."""
    z = [limit(share, **HOLDS) for share in (1 / 6, 2 / 6, 3 / 6)]
    curve = 854.0 + 213.0 * np.exp(-v / 0.007)

    assert [sticking(v, at, at) for at in z] == [0.0, 0.0, 0.0]
    elastic = -net_force(0.0, v, *z, **LAW)
    assert elastic + friction(curve, 1.0, v, **LAW) == pytest.approx(curve, rel=1e-12)
    assert friction(curve, 1.0, v, **LAW) == pytest.approx(RIGID * curve, rel=1e-9)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("effect", "size", "share"),
    [
        ("position_dependent_friction", "h_FR", lambda d: 1.0),
        ("asymmetric_friction", "a_FR", lambda d: d),
    ],
)
@settings(deadline=None)
@given(v=st.floats(0.0, 1.0), d=st.sampled_from([-1.0, 1.0]), percent=st.integers(-90, 90))
def test_less_friction_does_not_push(effect, size, share, order, v, d, percent):
    """The rigid slider resists the motion wherever friction is lower than the sliders hold, in whatever order the plant
    names both; where it is not lower, it has what the other effect adds."""
    plant = ehsa_ctrl.load_plant("ehsa")
    rig = plant.with_effects(*("maxwell_slip", effect)[::order], s_slip=1e-7, **{size: percent / 100})
    # The place of the spot is x = 0.
    known = {**rig.values, "v": d * v, "d_R": d, "x": 0.0}
    signal = rig.structure.equations.signals["F_FR"]
    force = float(array_evaluator(rig.structure.equations, [signal])(known)[signal])
    dry = plant["A_FR"] + plant["C_FR"] * np.exp(-v / plant["tau_FR"])
    more = percent / 100 * share(d)

    assert d * force > 0.0
    if more >= 0.0:
        assert d * force == pytest.approx(RIGID * dry + more * plant["A_FR"] + plant["B_FR"] * v, rel=1e-9)


def test_a_held_rod_stands_still(plant):
    """Below breakaway it yields by the force times the compliance, then its speed is zero to the bit and stays so.

    Without leakage, which would change the pressure.
    """
    rig = plant.set(K_L=0.0).with_effects("maxwell_slip", s_slip=1e-7)
    run = ehsa_ctrl.simulate(rig, np.full(750, 0.8))
    held = plant["A"] * run["dP"][-1]

    assert 200.0 < held < 0.8 * (plant["A_FR"] + plant["C_FR"])
    assert not run["v"][-250:].any() and np.ptp(run["x"][-250:]) == 0.0
    assert held * 1e-7 * 0.8 < run["x"][-1] < 3.0 * held * 1e-7


def test_without_compliance_nothing_changes(plant):
    """To the last bit, and no slider moves."""
    current = 2.0 * np.sin(np.linspace(0.0, 12.0, 501))
    run = ehsa_ctrl.simulate(plant.with_effects("maxwell_slip", s_slip=0.0), current)

    np.testing.assert_array_equal(run.states[:, :5], ehsa_ctrl.simulate(plant, current).states)
    assert not run.states[:, 5:].any()


def test_a_loop_closes_and_remembers():
    """A smaller loop inside a larger one returns to the point where it left: the memory of Maxwell's sliders."""
    z, step = np.zeros(3), 1e-8
    limits = [limit(share, **HOLDS) for share in (1 / 6, 2 / 6, 3 / 6)]

    def move(distance):
        for _ in range(round(abs(distance) / step)):
            way = np.sign(distance) * step
            z[:] = [at + way * sticking(np.sign(way), at, most) for at, most in zip(z, limits, strict=True)]
        return sum(z) / 3e-7

    move(6e-5)
    left = move(-5e-5)
    move(2e-5)

    assert move(-2e-5) == pytest.approx(left, abs=1.0)
