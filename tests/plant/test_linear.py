"""The linear models against closed forms and the figures of the paper's parameters."""

from dataclasses import replace

import control
import numpy as np
import pytest

from ehsa_ctrl import InputError, four_state, linearise, load_plant, three_state, to_iosystem
from ehsa_ctrl.core.pressure_difference import reduce_to_difference
from ehsa_ctrl.plant.linearise import operating_point


def test_poles_of_the_linear_set(linear):
    """-8.9 and -293 +- 328i rad/s: a slow mechanical mode and the hydraulic one at 70 Hz, damping 0.67."""
    poles = np.sort_complex(three_state(linear, position=False).poles())

    np.testing.assert_allclose(poles[-1], -8.925, rtol=1e-3)
    np.testing.assert_allclose(poles[0], -293.3 - 327.8j, rtol=1e-3)


def test_hydraulic_frequency_is_the_textbook_formula(linear):
    """Without friction and leakage the mode has w^2 = 2 beta/V (A^2/M + D^2/J), and nothing damps it."""
    free = linear.set(B_FM=0.0, B_FR=0.0, K_L=0.0)
    p = free.values
    expected = np.sqrt(2 * p["beta"] / p["V"] * (p["A"] ** 2 / p["M"] + p["D"] ** 2 / p["J_M"]))

    fast = [pole for pole in three_state(free, position=False).poles() if abs(pole) > 1]

    np.testing.assert_allclose(np.abs(fast), expected, rtol=1e-9)
    np.testing.assert_allclose(np.real(fast), 0.0, atol=1e-6 * expected)


def test_dc_gains_per_newton_metre(linear):
    """308.4 rad/s, 7.55 bar and 118.8 mm/s per N m; -45.9 mm/s and 3.63 bar per kN of load."""
    gains = three_state(linear, position=False).dcgain()

    np.testing.assert_allclose(gains[:, 0] / linear["K_T"], [308.4, 7.55e5, 0.1188], rtol=1e-3)
    np.testing.assert_allclose(1e3 * gains[1:, 1], [3.63e5, -0.0459], rtol=2e-3)


def test_dc_gain_balances_torque_flow_and_force(linear):
    """At steady speed the three balances of (7) close: an independent check of every entry of the matrices."""
    omega, dP, v = three_state(linear, position=False).dcgain()[:, 0]
    p = linear.values

    assert p["K_T"] == pytest.approx(p["B_FM"] * omega + p["D"] * dP)
    assert p["D"] * omega == pytest.approx(p["A"] * v + p["K_L"] * dP)
    assert p["A"] * dP == pytest.approx(p["B_FR"] * v)


def test_six_and_seven_agree_on_what_the_input_reaches(linear):
    """From the current to speed, pressure difference and rod speed, (6) and (7) are one system."""
    s = 1j * np.array([0.1, 10.0, 400.0])
    six, seven = four_state(linear)(s), three_state(linear)(s)

    np.testing.assert_allclose(six[0, 0], seven[0, 0], rtol=1e-9)
    np.testing.assert_allclose(six[1, 0] - six[2, 0], seven[1, 0], rtol=1e-9)
    np.testing.assert_allclose(six[3, 0], seven[2, 0], rtol=1e-9)


def test_six_has_a_mode_that_no_input_reaches(linear):
    """P_1 + P_2 is uncontrollable: the controllability matrix of (6) lacks a rank."""
    system = four_state(linear)
    scale = np.diag([1e2, 1e5, 1e5, 1e-1, 1e-2])
    a, b = np.linalg.solve(scale, system.A @ scale) / 300, np.linalg.solve(scale, system.B)

    assert np.linalg.matrix_rank(control.ctrb(a, b), tol=1e-9) == 4


@pytest.mark.parametrize("velocity", [0.0, 0.1, -0.3])
def test_linearising_the_linear_plant_gives_six(linear, velocity):
    """The wired equations and the explicit matrices are the same model at any operating point."""
    loaded = linear.set(K_S=5e4, m_L=20.0)
    a, b = linearise(loaded, velocity=velocity), four_state(loaded)

    np.testing.assert_allclose(a.A, b.A, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.B, b.B, rtol=1e-9, atol=1e-12)


def test_linearising_and_reducing_gives_seven(linear):
    """Dropping the mode of P_1 + P_2 from (6) leaves (7)."""
    a, b = reduce_to_difference(linearise(linear, velocity=0.1)), three_state(linear)

    np.testing.assert_allclose(a.A, b.A, rtol=1e-9, atol=1e-6)


def test_nonlinear_set_while_sliding_fast(plant):
    """Far above the Stribeck speed the nonlinear set has the poles of its viscous part: -8.2, -276 +- 341i."""
    poles = linearise(plant, velocity=0.3).poles()
    fast = poles[np.abs(poles) > 1]

    np.testing.assert_allclose(np.sort_complex(fast), [-276.2 - 341.2j, -276.2 + 341.2j, -8.231], rtol=1e-3)


def test_sliding_slowly_is_unstable(plant):
    """Below C_FR/B_FR Stribeck friction falls with speed faster than viscous friction grows: stick-slip."""
    assert linearise(plant, velocity=0.003).poles().real.max() > 10
    assert linearise(plant, velocity=0.3).poles().real.max() < 1e-6


def test_position_changes_the_hydraulic_mode(plant):
    """The volumes V_10 + A x and V_20 - A x: off centre the stiffness of both chambers together grows."""
    p = plant.values

    def stiffness(x):
        a = linearise(plant, position=x, velocity=0.3).A
        return -(a[1, 3] - a[2, 3]) / p["A"] / p["beta"]

    for x in (-0.1, 0.0, 0.1):
        assert stiffness(x) == pytest.approx(1 / (p["V_10"] + p["A"] * x) + 1 / (p["V_20"] - p["A"] * x))


def test_python_control_linearises_to_the_same(plant):
    """control.linearize on the NonlinearIOSystem, by differences, agrees with the exact derivatives."""
    point = operating_point(plant, velocity=0.1, position=0.02)
    system = to_iosystem(plant)
    theirs = control.linearize(system, list(point.states.values()), list(point.inputs.values()))
    ours = linearise(plant, velocity=0.1, position=0.02)

    scale = np.array([100.0, 5e5, 5e5, 0.05, 0.02])
    np.testing.assert_allclose(theirs.A * scale / scale[:, None], ours.A * scale / scale[:, None], rtol=2e-3, atol=0.5)


def test_at_rest_there_is_no_linear_model_of_a_plant_that_sticks(plant):
    """The message gives the remedy."""
    with pytest.raises(InputError, match="sticks at rest"):
        linearise(plant, velocity=0.0)


def test_seven_is_refused_for_a_plant_with_dry_friction(plant):
    """(7) has no dry friction, so a plant with it is refused."""
    with pytest.raises(InputError, match="model='linear'"):
        three_state(plant)


def test_seven_of_a_linear_set_that_got_friction_is_its_viscous_part(linear):
    """The matrices are those of the viscous part, which the name states."""
    structure = replace(linear.structure, shaft_friction="stribeck", effects=("current_offset",))
    rig = linear.with_structure(structure, A_FM=0.7, C_FM=0.1, tau_FM=10.0)

    for model in (three_state, four_state):
        np.testing.assert_array_equal(model(rig).A, model(linear).A)
        assert "viscous part" in model(rig).name and "linear of" not in model(linear).name


def test_a_spring_needs_the_position():
    """Without the position as a state the spring has nothing to act on."""
    loaded = load_plant("ehsa", model="linear", settings={"load.stiffness": "50 kN/m"})

    with pytest.raises(InputError, match="position"):
        three_state(loaded, position=False)
