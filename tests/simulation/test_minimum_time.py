"""The shortest time, from closed forms; the slip quantum, from what makes it."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.plant.structure import Structure
from ehsa_ctrl.simulation.minimum_time import shortest_time
from ehsa_ctrl.simulation.slip_quantum import slip_quantum


@pytest.fixture
def inertia(plant):
    """No friction, no load, no limit of speed: one inertia."""
    return replace(plant.with_structure(Structure("none", "none", "stroke")), limits={})


def acceleration(plant, current):
    """Of the rod, with the shaft's inertia and its own."""
    travel = plant["D"] / plant["A"]
    return plant["K_T"] * current * travel / (plant["J_M"] + plant["M"] * travel**2)


@pytest.mark.parametrize("way", [1e-3, -2e-2])
def test_an_inertia_takes_twice_the_root_of_distance_over_acceleration(inertia, way):
    """Full on for half of the way, full off for the other: 2 sqrt(d / a)."""
    a = acceleration(inertia, 3.0)

    assert shortest_time(inertia, way, 3.0) == pytest.approx(2 * np.sqrt(abs(way) / a), rel=1e-3)


def test_a_limit_of_speed_makes_a_trapezoid(inertia):
    """d / v + v / a."""
    a, travel = acceleration(inertia, 6.0), inertia["D"] / inertia["A"]
    v = 200.0 * travel

    expected = 50e-3 / v + v / a
    assert shortest_time(inertia, 50e-3, 6.0, speed_limit=200.0) == pytest.approx(expected, rel=2e-3)


def test_a_band_may_be_used_to_its_far_edge(inertia):
    """At rest at d + b, the time is that of passing d - b on the way: T/2 + T/2 - sqrt(2 (2 b) / a)."""
    a, d, b = acceleration(inertia, 3.0), 10e-3, 0.5e-3

    expected = 2 * np.sqrt((d + b) / a) - np.sqrt(2 * 2 * b / a)
    assert shortest_time(inertia, d, 3.0, band=b) == pytest.approx(expected, rel=2e-3)


def test_coulomb_friction_hinders_the_start_and_helps_to_brake(inertia):
    """Accelerations a - f and a + f: T = sqrt(2 d / (a - f) (1 + (a - f) / (a + f)))."""
    rubbing = inertia.with_structure(Structure("none", "coulomb", "stroke"), A_FR=1000.0, B_FR=0.0)
    travel = inertia["D"] / inertia["A"]
    mass = (inertia["J_M"] + inertia["M"] * travel**2) / travel**2
    up, down = acceleration(inertia, 3.0) - 1000.0 / mass, acceleration(inertia, 3.0) + 1000.0 / mass

    v = np.sqrt(2 * 10e-3 * up * down / (up + down))
    assert shortest_time(rubbing, 10e-3, 3.0) == pytest.approx(v / up + v / down, rel=2e-3)


def test_a_current_that_breaks_no_friction_never_gets_there(plant):
    """0.8 A stay below the breakaway of shaft and rod."""
    assert shortest_time(plant, 10e-3, 0.8) == np.inf


def test_no_current_of_the_plant_is_faster(plant):
    """Bang-bang on the plant itself, with the best of many switching times, does not beat the bound."""
    bound = shortest_time(plant, 10e-3, 6.0, band=0.2e-3)
    dt = plant.sample_time
    best = np.inf
    for on in range(2, 12):
        for off in range(1, 12):
            current = np.concatenate([np.full(on, 6.0), np.full(off, -6.0), np.zeros(60)])
            run = ehsa_ctrl.simulate(plant, current)
            outside = np.flatnonzero(np.abs(run["x"] - 10e-3) > 0.2e-3)
            if outside[-1] < len(run) - 1 and not np.any(np.abs(run["omega"]) > plant.limits["pump_speed"].value):
                best = min(best, dt * outside[-1])

    assert best >= bound


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((0.0, 6.0, {}), "distance other than zero"),
        ((1e-2, -1.0, {}), "current limit greater than zero"),
        ((1e-2, 6.0, {"band": 0.1}), "band = 0.1 m"),
    ],
)
def test_what_is_no_move_is_said(plant, arguments, says):
    """One sentence with what was got."""
    distance, current, more = arguments
    with pytest.raises(InputError, match=says):
        shortest_time(plant, distance, current, **more)


def test_the_slip_quantum_is_some_tens_of_micrometres(plant):
    """Whatever the pulse's shape and direction, on the paper's plant about 40 um."""
    found = [slip_quantum(plant), slip_quantum(plant, width=0.1), slip_quantum(plant, width=1.0)]

    assert np.all((np.array(found) > 35e-6) & (np.array(found) < 50e-6))
    assert slip_quantum(plant, direction=-1) == pytest.approx(found[0], rel=1e-3)


def test_the_slip_quantum_grows_with_what_static_friction_exceeds(plant):
    """Twice the excess C_FR, a longer slip; next to none, next to no slip."""
    lengths = [slip_quantum(plant.set(C_FR=excess)) for excess in (1.0, 213.0, 426.0)]

    assert lengths[0] < 0.2 * lengths[1] < lengths[1] < lengths[2]


def test_a_rod_that_friction_cannot_hold_has_no_quantum(linear):
    """Viscous friction alone lets any motion be made small."""
    assert slip_quantum(linear) == 0.0


def test_a_rod_that_nothing_moves_is_said(plant):
    """Friction beyond all reason."""
    with pytest.raises(InputError, match="no pulse up to 1000 A moves the rod"):
        slip_quantum(plant.set(A_FR=1e9))
