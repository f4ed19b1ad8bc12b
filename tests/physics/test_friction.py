"""Every law of the friction family, by the contract that the engine relies on."""

import inspect
from math import exp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ehsa_ctrl.physics.friction import LAWS, SYMBOLS

VALUES = {"A": 854.0, "B": 9186.0, "C": 213.0, "tau": 0.007, "v_band": 1e-3, "sigma_0": 1e7, "sigma_1": 1e3}
SPEED = st.floats(1e-9, 2.0)


def effort(law, speed, direction, **changed):
    """Friction of a law at steady sliding."""
    values = {**VALUES, **changed}
    arguments = {"speed": speed, "direction": direction, **values}
    if law.state_rate is not None:
        g = values["A"] + values["C"] * exp(-abs(speed) / values["tau"])
        arguments |= {"z": direction * g / values["sigma_0"], "z_dot": 0.0}
    needed = inspect.signature(law.effort).parameters
    return law.effort(**{name: arguments[name] for name in needed})


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
class TestEveryLaw:
    @given(speed=SPEED)
    def test_opposes_the_motion(self, law, speed):
        """Friction takes energy while sliding: effort times speed is never negative."""
        assert effort(law, speed, 1.0) * speed >= 0
        assert effort(law, -speed, -1.0) * -speed >= 0

    @given(speed=SPEED)
    def test_is_odd(self, law, speed):
        """Sliding back at the same speed costs the same."""
        assert effort(law, -speed, -1.0) == -effort(law, speed, 1.0)

    def test_uses_known_symbols_only(self, law):
        """Parameters of a law are symbols of the family, so that units and TOML keys follow."""
        needed = set(inspect.signature(law.effort).parameters)

        assert needed <= {"direction", "speed", "z", "z_dot", *SYMBOLS}
        assert set(law.symbols) <= set(SYMBOLS)

    def test_a_law_that_sticks_knows_its_direction(self, law):
        """Sticking needs a breakaway effort, which is the law at speed zero in either direction."""
        assert law.sticks == ("direction" in inspect.signature(law.effort).parameters)
        if law.sticks:
            assert effort(law, 0.0, 1.0) > 0

    def test_says_what_it_is(self, law):
        """Each law has a line for lists, and states its source or equation."""
        assert law.summary
        assert inspect.getdoc(law.effort)


def test_stribeck_is_equation_8():
    """(8) at some speeds, by hand; at rest it is A + C, the paper's breakaway level."""
    law = LAWS["stribeck"]

    assert effort(law, 0.0, 1.0) == VALUES["A"] + VALUES["C"]
    assert effort(law, 0.007, 1.0) == pytest.approx(854 + 9186 * 0.007 + 213 * exp(-1))
    assert effort(law, -0.05, -1.0) == pytest.approx(-(854 + 9186 * 0.05 + 213 * exp(-0.05 / 0.007)))


@given(speed=SPEED)
def test_the_laws_nest(speed):
    """Stribeck without its static part is Coulomb, Coulomb without its level is viscous, that without B is none."""
    assert effort(LAWS["stribeck"], speed, 1.0, C=0.0) == effort(LAWS["coulomb"], speed, 1.0)
    assert effort(LAWS["stribeck_squared"], speed, 1.0, C=0.0) == effort(LAWS["coulomb"], speed, 1.0)
    assert effort(LAWS["coulomb"], speed, 1.0, A=0.0) == effort(LAWS["viscous"], speed, 1.0)
    assert effort(LAWS["viscous"], speed, 1.0, B=0.0) == effort(LAWS["none"], speed, 1.0)


@given(speed=SPEED)
def test_lugre_slides_like_stribeck(speed):
    """At constant speed the bristles' deflection gives the same curve (8)."""
    assert effort(LAWS["lugre"], speed, 1.0) == pytest.approx(effort(LAWS["stribeck"], speed, 1.0), rel=1e-12)
