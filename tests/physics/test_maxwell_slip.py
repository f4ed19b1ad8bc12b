"""Friction as sliders behind springs: never a source of work, exact at rest, and (8) at constant speed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ehsa_ctrl
from ehsa_ctrl.physics.effects.maxwell_slip import RIGID, friction, limit, net_force, spring, sticking
from ehsa_ctrl.physics.effects.position_dependent_friction import COEFFICIENTS
from ehsa_ctrl.physics.effects.position_dependent_friction import friction as at_a_place

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


@given(v=st.floats(0.0, 1.0), d=st.sampled_from([-1.0, 1.0]), h=st.floats(-0.95, 2.0), first=st.booleans())
def test_a_looser_place_does_not_push(v, d, h, first):
    """The rigid slider resists the motion wherever friction is lower than the sliders hold, in whatever order both act;
    where it is not lower, it has what the place adds."""
    v, curve = d * v, 854.0 + 213.0 * np.exp(-v / 0.007)
    place = dict.fromkeys(("x", "x_h", "n_h", "h_FR2", "x_h2", "x_a", *COEFFICIENTS), 0.0)

    def spot(F_FR):
        return at_a_place(F_FR, d, A_FR=854.0, h_FR=h, w_h=0.01, x_b=0.1, **place)

    def slide(F_FR):
        return friction(F_FR, d, v, **LAW)

    force = spot(slide(d * curve)) if first else slide(spot(d * curve))

    assert d * force > 0.0
    if h >= 0.0:
        assert d * force == pytest.approx(RIGID * curve + h * 854.0, rel=1e-9)


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
