"""The engine of all effects: what a plant says of its sensors is no gap; a setting is what the plant would be."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.acting_model import ActingModel
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel, with_every_effect
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses, Pool
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.records import Record, Segment
from ehsa_ctrl.diagnosis.refit import refit
from ehsa_ctrl.physics.effects import EFFECTS, CandidateEffect, FreeNumber
from ehsa_ctrl.plant.plant import Sensor

#: Errors of sensors, by channel.
WRONG = {
    "current": {"scale": 1.1, "bias": 0.2, "filter": 0.006},
    "p1": {"scale": 1.2, "bias": 3e4, "filter": 0.003},
    "speed": {"delay": 0.008},
}

#: Noise of the sensors, SI units.
NOISE = {"speed": 0.5, "p1": 15e3, "p2": 15e3, "position": 2e-5, "force": 10.0}


@pytest.fixture
def rig(plant):
    """A plant that moves against a spring, with sensors without noise."""
    plant = plant.set(K_S=50e3)
    quiet = {c: replace(s, noise=0.0, step=0.0) for c, s in plant.sensors.items()}
    return replace(plant, sensors={"current": Sensor("current", "A"), **quiet})


def wrong(plant):
    """The plant with sensors that are known to be wrong."""
    changed = {c: replace(plant.sensors[c], **errors) for c, errors in WRONG.items()}
    return replace(plant, sensors={**plant.sensors, **changed})


def record(rig):
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=3.0, seed=1)
    return ehsa_ctrl.record(rig, time, current, sensor_noise=False)[0]


def whole(plant, log):
    """A log as the segment of a search."""
    return Segment((Record(HypothesisModel(with_every_effect(plant), log), NOISE),), "the log")


def worst(log, shown):
    """The largest error of a channel over its spread."""
    return max(float(np.max(np.abs(shown[c] - log[c])) / np.std(log[c])) for c in shown)


def test_sensor_settings_of_the_plant_are_applied(rig):
    """Bias, scale, filter and delay of the current too: a free run shows what the log has."""
    log = record(wrong(rig))

    with_sensors = HypothesisModel(with_every_effect(wrong(rig)), log).run([{}])[0]
    unaware = HypothesisModel(with_every_effect(rig), log).run([{}])[0]

    assert worst(log, with_sensors) < 2e-3
    assert worst(log, unaware) > 0.1


def test_a_setting_of_a_sensor_is_a_sensor_of_the_plant(rig):
    """To the last bit, with values that are set in the plant or tried on top of it."""
    log = record(wrong(rig))
    errors = {f"{word}.{c}": v for c, words in WRONG.items() if c != "current" for word, v in words.items()}
    current = wrong(rig).sensors["current"]
    rig = replace(rig, sensors={**rig.sensors, "current": replace(current, filter=0.0)})

    stated = HypothesisModel(with_every_effect(wrong(rig)), log).run([{}])[0]
    tried = HypothesisModel(with_every_effect(rig), log).run(
        [{**errors, "filter.current": WRONG["current"]["filter"]}]
    )[0]

    for channel, values in stated.items():
        np.testing.assert_array_equal(values, tried[channel])


@pytest.mark.parametrize("stiffness", [0.0, 5.0, 50.0])
def test_a_spring_next_to_none_is_asked_as_none_is(plant, stiffness):
    """50 for 50 kN/m: a tenth of itself would be no step that anything feels."""
    from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects

    nominal = plant.set(K_S=stiffness)
    log = record(replace(nominal, sensors={"current": Sensor("current", "A"), **plant.sensors}))
    spring = next(
        s for s in candidate_effects(HypothesisModel(with_every_effect(nominal), log)) if s.id == "load_spring"
    )

    assert spring.free[0].scale == 2e3


def test_a_start_in_motion_is_as_the_nominal_sensors_give_it(rig):
    """A sensor setting of a hypothesis changes the state that was read from that sensor, and nothing else does."""
    log = record(rig)
    plant = with_every_effect(wrong(rig))
    model = HypothesisModel(plant, log, {"P_1": 2e6, "P_2": 1.9e6, "omega": 10.0})

    def level(**values):
        acting = ActingModel(plant, None)
        return acting.start(values, model.start, plant.sensors, 0.0, ())[acting.positions["P_1"]]

    assert level() == pytest.approx(2e6, rel=1e-12)
    assert level(**{"bias.p1": 4e4}) == pytest.approx((1.2 * 2e6 + 3e4 - 4e4) / 1.2, rel=1e-12)
    assert level(**{"scale.p1": 1.0}) == pytest.approx(1.2 * 2e6, rel=1e-12)


def test_a_late_drive_follows_every_number_of_its_sensor(rig):
    """Settings with one delay and another bias are different runs; equal settings are one run."""
    log = record(rig)
    late = {"delay.current": 4e-3}
    model = HypothesisModel(with_every_effect(rig), log)

    first, biased, again = model.run([late, late | {"bias.current": 0.5}, dict(late)])
    alone = HypothesisModel(with_every_effect(rig), log).run([late | {"bias.current": 0.5}])[0]

    np.testing.assert_array_equal(first["speed"], again["speed"])
    np.testing.assert_array_equal(biased["speed"], alone["speed"])
    assert np.max(np.abs(biased["speed"] - first["speed"])) > 1.0


@pytest.mark.parametrize(
    "first",
    [p for effect in EFFECTS.values() for p in effect.parameters[:1] if p.negligible],
    ids=lambda first: first.name,
)
def test_a_negligible_effect_is_not_simulated(rig, first):
    """Its equations are stiff there; just above, it acts and changes no signal by more than the noise of its sensor."""
    log = record(rig)
    model = HypothesisModel(with_every_effect(rig), log)
    nominal, below, above = model.run([{}, *({first.name: f * first.negligible} for f in (1e-3, 1.01))])

    for channel, values in nominal.items():
        np.testing.assert_array_equal(below[channel], values)
        assert np.sqrt(np.mean((above[channel] - values) ** 2)) < NOISE[channel]
    assert any(np.any(above[channel] != values) for channel, values in nominal.items())


def test_a_second_parameter_does_not_make_a_negligible_effect_act(rig):
    """A lag of second order without a time constant is no lag."""
    model = HypothesisModel(with_every_effect(rig), record(rig))
    nominal, short = model.run([{}, {"tau_I": 1e-6, "b_I": 1.0}])

    np.testing.assert_array_equal(short["speed"], nominal["speed"])


def test_a_run_with_the_acting_effects_alone_is_that_with_all(rig):
    """To the last bit, for an effect with states, one without, a law of the rod, and effects of the plant itself."""
    log = record(rig)
    own = rig.with_effects("windage", k_w=1e-6)
    every = with_every_effect(own)
    model = HypothesisModel(every, log, plants_by_law={"lugre": with_every_effect(own, "lugre")})
    acting = {"tau_I": 2e-3, "P_crack": 25e5, "drop": 0.3}

    found, expected = model.run([acting])[0], HypothesisModel(every.set(**acting), log).run([{}])[0]
    run = ehsa_ctrl.simulate_batch(
        every.set(**acting), every.set(**acting).vector[None], log["current"], tolerance=1e-5
    )
    elastic = model.run([{"softness_FR": 1e-7}])[0]

    for channel, state in every.structure.system.outputs.items():
        np.testing.assert_array_equal(found[channel], expected[channel])
        np.testing.assert_array_equal(found[channel], run.states[0, :, every.structure.equations.index(state)])
    assert worst(log, elastic) > 1e-3


def test_a_fixed_number_keeps_its_start(rig):
    """The order of a ripple to the last bit, while its amplitude moves."""
    log = record(rig.with_effects("torque_ripple", T_c=0.05, n_c=4.0, phi_c=0.3))
    objective, sensitivities = objective_of(whole(rig, log), 0.03)
    free = FreeNumber("T_c", 0.0, 0.03, 0.0), FreeNumber("n_c", 3.0, 1e-6, 1.0, 200.0, fixed=True)
    ripple = CandidateEffect(EFFECTS["torque_ripple"], free, ((0.03, 4.0),))

    fit = refit(objective, (ripple,), {"T_c": 0.03, "n_c": 4.0}, sensitivities)

    assert fit.values["n_c"] == 4.0
    assert fit.values["T_c"] != 0.03


def test_a_number_beside_an_infinite_one_is_searched_from_its_start(rig):
    """A valve that never opens has no level: the start of the refit is finite and near the truth."""
    log = record(rig.with_effects("relief_valve", P_crack=24e5))
    objective, sensitivities = objective_of(whole(rig, log), 0.03)
    free = FreeNumber("P_crack", np.inf, 1e5), FreeNumber("P_open_range", 1e6, 1e5, 1e5, 1e7)
    candidate = CandidateEffect(EFFECTS["relief_valve"], free, ((25e5, 1e6),))
    hypotheses = Hypotheses.initial(objective, (candidate,), sensitivities, Pool())

    (gain,) = hypotheses.screening().gains(hypotheses.nominal)

    assert gain.start({})["P_crack"] == pytest.approx(24e5, abs=3e5)
