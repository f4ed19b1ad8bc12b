"""The balances of the paper as identities: true at every state, not only along a run."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ehsa_ctrl import load_plant, simulate
from ehsa_ctrl.plant.plain import evaluator

PLANT = load_plant("ehsa", settings={"load.stiffness": 5e4, "load.mass": 12.0})
SIGNALS = evaluator(PLANT.structure.equations, PLANT.values)
STATE = st.fixed_dictionaries(
    {
        "omega": st.floats(-500, 500),
        "P_1": st.floats(0, 2e7),
        "P_2": st.floats(0, 2e7),
        "v": st.floats(-0.3, 0.3),
        "x": st.floats(-0.1, 0.1),
        "current": st.floats(-13, 13),
        "F_D": st.floats(-5e3, 5e3),
    }
)


def sliding(state):
    """All signals at a state, each contact sliding the way it moves."""
    directions = {"d_M": 1.0 if state["omega"] >= 0 else -1.0, "d_R": 1.0 if state["v"] >= 0 else -1.0}
    return SIGNALS(**state, **directions)


@given(STATE)
def test_energy_is_balanced_at_every_state(state):
    """d/dt of kinetic, spring and compression energy = supplied - dissipated + A v (P_1^2 - P_2^2) / (2 beta)."""
    s, p = sliding(state), PLANT.values
    omega, v, dP = s["omega"], s["v"], s["P_1"] - s["P_2"]
    terms = [
        p["J_M"] * omega * s["omega_dot"],
        (p["M"] + p["m_L"]) * v * s["v_dot"],
        p["K_S"] * s["x"] * v,
        s["V_1"] / p["beta"] * s["P_1"] * s["P_1_dot"],
        s["V_2"] / p["beta"] * s["P_2"] * s["P_2_dot"],
        p["A"] * v * (s["P_1"] ** 2 - s["P_2"] ** 2) / (2 * p["beta"]),
        -p["K_T"] * s["current"] * omega,
        s["F_D"] * v,
        s["T_FM"] * omega,
        s["F_FR"] * v,
        p["K_L"] * dP**2,
        -p["A"] * v * (s["P_1"] ** 2 - s["P_2"] ** 2) / (2 * p["beta"]),
    ]

    assert sum(terms) == pytest.approx(0.0, abs=1e-9 * sum(map(abs, terms)) + 1e-12)


@given(STATE)
def test_volume_is_balanced_at_every_state(state):
    """What one chamber takes in, swept or compressed, the other gives: V_1 P_1' + V_2 P_2' = 0."""
    s = sliding(state)
    one, two = s["V_1"] * s["P_1_dot"], s["V_2"] * s["P_2_dot"]

    assert one + two == pytest.approx(0.0, abs=1e-9 * abs(one) + 1e-9)


@given(STATE)
def test_friction_takes_energy_at_every_state(state):
    """T_FM omega and F_FR v are never negative."""
    s = sliding(state)

    assert s["T_FM"] * s["omega"] >= 0
    assert s["F_FR"] * s["v"] >= 0


@settings(deadline=None, max_examples=40)
@given(share=st.floats(-0.999, 0.999), stiffness=st.floats(1e3, 3e5), current=st.floats(-0.7, 0.7))
def test_sticking_is_exact(share, stiffness, current):
    """Any spring force below A_FR + C_FR and any current below breakaway: nothing moves, to the last bit."""
    plant = PLANT.set(K_S=stiffness)
    start = plant.rest
    start[4] = share * (plant["A_FR"] + plant["C_FR"]) / stiffness
    run = simulate(plant, np.full(50, current), start=start)

    assert np.all(run.states == start)
