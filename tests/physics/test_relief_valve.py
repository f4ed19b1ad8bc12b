"""Relief valves to the tank that close at a lower pressure than they open."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel, with_every_effect
from ehsa_ctrl.physics.effects import EFFECTS, CandidateEffect, FreeNumber
from ehsa_ctrl.physics.effects.relief_hysteresis import P_LATCH, latch

CRACK, HYST, TAU = 25e5, 2e5, 3e-3


def test_the_latch():
    """Opens above P_crack, closes below P_crack - P_hyst, stays as it is in between; none without hysteresis."""
    assert latch(CRACK + P_LATCH, 0.0, CRACK, HYST, TAU) == 1.0 / TAU
    assert latch(CRACK - HYST - P_LATCH, 1.0, CRACK, HYST, TAU) == pytest.approx(-1.0 / TAU, rel=1e-12)
    assert latch(CRACK + 0.5 * P_LATCH, 0.0, CRACK, HYST, TAU) == pytest.approx(0.5 / TAU, rel=1e-12)
    assert latch(CRACK - 0.5 * HYST, 1.0, CRACK, HYST, TAU) == latch(CRACK - 0.5 * HYST, 0.0, CRACK, HYST, TAU) == 0.0
    assert latch(CRACK + 1e5, 0.0, CRACK, 0.0, TAU) == latch(CRACK, 0.0, np.inf, HYST, TAU) == 0.0


def test_an_open_valve_stays_open_until_the_lower_pressure(plant):
    """Its state is 1 at every sample between the two pressures that follows an opening, and the run leaks more."""
    loaded = plant.set(K_S=5e4)
    current = 3.5 * np.sin(np.linspace(0.0, 12.0, 1501))
    static = loaded.with_effects("relief_valve", P_crack=24e5, K_relief=2e-8)
    latching = static.with_effects("relief_hysteresis", P_hyst=HYST)
    run = ehsa_ctrl.simulate(latching, current)
    lag = int(round(5.0 * TAU / 0.004))
    is_open, expected = False, []
    for pressure in run["P_1"]:
        is_open = pressure > 24e5 - HYST and (is_open or pressure > 24e5)
        expected.append(is_open)
    settled = [k for k in range(lag, len(expected)) if len({*expected[k - lag : k + 1]}) == 1]
    between = [k for k in settled if 24e5 - HYST < run["P_1"][k] < 24e5 and expected[k]]

    np.testing.assert_allclose(run["S_1"][between], 1.0, atol=0.05)
    assert len(between) > 5
    log = Log(run.time, {"p1": run["P_1"]})
    along, other = (state.along(log, latching.values) for state in EFFECTS["relief_hysteresis"].states)
    np.testing.assert_array_equal(along[settled], np.array(expected, float)[settled])
    assert not other.any()
    assert np.max(np.abs(run["P_1"] - ehsa_ctrl.simulate(static, current)["P_1"])) > 0.2 * HYST


def test_only_a_valve_with_hysteresis_has_states(plant):
    """The effect brings the valve along; without it, a sentence names both."""
    valve = plant.with_effects("relief_valve", P_crack=24e5)
    latching = plant.with_effects("relief_hysteresis", P_crack=24e5)

    assert len(valve.structure.equations.states) == 5
    assert latching.structure.effects == ("relief_valve", "relief_hysteresis")
    assert [state.name for state in latching.structure.equations.states[5:]] == ["S_1", "S_2"]
    with pytest.raises(InputError, match="'relief_hysteresis' extends 'relief_valve', which is missing; name both"):
        replace(plant.structure, effects=("relief_hysteresis",))


def test_a_shape_beside_an_infinite_number_has_a_start_of_its_own():
    """No secant leads from a valve that never opens to one with another lag."""
    crack, lag = FreeNumber("P_crack", np.inf, 1e5), FreeNumber("tau_relief", TAU, 1e-3)
    spot = FreeNumber("h_FR", 0.0, 0.1), FreeNumber("x_h", 0.0, 0.01)

    assert not CandidateEffect(EFFECTS["relief_valve"], (crack, lag), ((CRACK, TAU),)).shaped
    assert CandidateEffect(EFFECTS["position_dependent_friction"], spot, ((0.1, 0.0),)).shaped


@pytest.mark.parametrize(("own", "largest"), [(1e-7, 1e-5), (1e-4, 1e-4)])
def test_a_gain_is_searched_up_to_a_wide_bore_or_that_of_the_plant(plant, own, largest):
    """With a hundred times that, a simulation takes a hundred times as long, and the pressure is the same."""
    valved = plant.with_effects("relief_valve", K_relief=own)
    time, current = ehsa_ctrl.excitation("noise", amplitude=3, duration=2)
    log, _ = ehsa_ctrl.record(valved, time, current, centre=True)
    free = [
        number
        for candidate in candidate_effects(HypothesisModel(with_every_effect(valved), log))
        for number in candidate.free
        if number.name == "K_relief"
    ]

    assert free and {(number.nominal, number.lower, number.upper) for number in free} == {(own, 0.0, largest)}
