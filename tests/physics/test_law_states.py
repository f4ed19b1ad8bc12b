"""Effects from TOML files with states: the course of a state has a closed form, and a resting state changes no bit."""

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.physics.effects import EFFECTS, LawFile, effect_of, law_text, read_law

CURRENT = np.where(np.sin(3.0 * 0.004 * np.arange(1500)) >= 0.0, 2.0, -2.0)
DROOP = {
    "schema": 1, "status": "proposed", "summary": "torque constant that falls with the heat", "adds_to": "torque",
    "expression": "-c_heat * current * heat",
    "parameters": {
        "c_heat": {"value": 0.01, "unit": "N m/A3", "neutral": 0.0}, "tau_heat": {"value": 3.0, "unit": "s"},
    },
    "states": {"heat": {"rate": "(current**2 - heat) / tau_heat", "unit": "A2", "scale": 4.0}},
}  # fmt: skip


def effect(name="droop_state", **changed):
    found = effect_of(name, validate({**DROOP, **changed}, LawFile, "droop.toml"), "droop.toml")
    EFFECTS.keep(name, found)
    return found


def test_a_lag_has_its_closed_form(plant):
    """The square of a current of +-2 A is 4 A2: heat is 4 (1 - exp(-t / 3 s))."""
    effect()
    run = e.simulate(plant.with_effects("droop_state"), CURRENT)

    assert run["heat"] == pytest.approx(4.0 * (1.0 - np.exp(-0.004 * np.arange(1500) / 3.0)), abs=1e-4)


def test_a_plant_without_it_is_the_same_to_the_last_bit(plant):
    """Neither the torque nor the steps of the engine change while the effect is absent."""
    effect()
    bare, neutral = plant, plant.with_effects("droop_state", c_heat=0.0)
    base, run = (e.simulate(one, CURRENT) for one in (bare, neutral))

    assert np.array_equal(base["omega"], run["omega"]) and np.array_equal(base["P_1"], run["P_1"])
    assert not run["heat"].any()


def test_the_file_comes_back(tmp_path):
    """What is written is read again, states and all."""
    path = tmp_path / "droop.toml"
    law = LawFile.model_validate(DROOP)
    path.write_text(law_text(law), encoding="utf-8")
    found = read_law(path)

    assert found.law is not None and found.law.definition == law
    assert law.variables == ("current",)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"states": {"heat": {"rate": "current**2 - ", "unit": "A2", "scale": 1.0}}}, "is not an expression"),
        ({"states": {"heat": {"rate": "current**2", "unit": "A2", "scale": 0.0}}}, "greater than 0"),
        ({"states": {**DROOP["states"], "cold": {"rate": "1", "unit": "s", "scale": 1.0}}}, "does not use it"),
        ({"states": {**DROOP["states"], "tau_heat": {"rate": "1", "unit": "s", "scale": 1.0}}}, "is a parameter too"),
    ],
)
def test_wrong_states_are_a_sentence(changed, says):
    """Rate, scale, unused names, and names that are taken."""
    with pytest.raises(e.InputError, match=says):
        effect("wrong_state", **changed)


def test_the_unit_of_a_rate_is_checked(plant):
    """A rate is in the unit of its state per second."""
    effect("wrong_rate", states={"heat": {"rate": "(current - heat) / tau_heat", "unit": "A2", "scale": 1.0}})

    with pytest.raises(e.InputError, match=r"rate: '.*current.*' is in A"):
        plant.with_effects("wrong_rate")
