"""Places of a gap: truths are plants whose balance was changed by hand, logged without a model of any effect."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.gap_attribution import attribute_gap
from ehsa_ctrl.diagnosis.injection import simulate_injections
from ehsa_ctrl.diagnosis.signals import estimate_noise
from ehsa_ctrl.diagnosis.unknown_inputs import balance_signals, unknown_inputs
from ehsa_ctrl.plant.system import ScoredSignal
from ehsa_ctrl.simulation.engine import simulate
from ehsa_ctrl.simulation.threads import sharing_threads

DT = 0.004
NOISE = {"speed": 0.3, "p1": 8e3, "p2": 8e3, "position": 1e-5}


def drive(seconds=10.0, seed=1):
    """Steps and a sweep that keep the rod within its stroke."""
    t = DT * np.arange(int(seconds / DT))
    steps = np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, t.size // 50 + 1), 50)[: t.size]
    steps *= np.sign(np.sin(2.0 * np.pi * 0.5 * t)) * np.sign(steps)
    return 1.4 * np.sin(2.0 * np.pi * (0.4 + 0.1 * t) * t) + 0.6 * steps


def logged(plant, current, force=None, seed=2):
    """What the sensors show of a plant that is driven by this current."""
    rng = np.random.default_rng(seed)
    run = simulate(plant, current, force=force, sample_time=DT)
    outputs = plant.structure.system.outputs
    shown = {c: run[s] + NOISE[c] * rng.standard_normal(current.size) for c, s in outputs.items()}
    return Log(DT * np.arange(current.size), shown)


def with_current(log, current):
    return replace(log, channels={**log.channels, "current": current})


def found(plant, log):
    return attribute_gap(plant, log, estimate_noise(log))


@pytest.fixture(scope="module")
def nominal():
    return ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": 50e3})


def test_unknown_inputs_of_the_true_plant_vanish(nominal):
    """Without noise every balance of the plant that made a log closes within a hundredth of its leading term."""
    current = drive(4.0)
    run = simulate(nominal, current, sample_time=DT)
    shown = {c: run[s] for c, s in nominal.structure.system.outputs.items()}
    log = Log(DT * np.arange(current.size), {**shown, "current": current})

    w = unknown_inputs(nominal, balance_signals(nominal, log, current, {})).values

    leading = {
        "torque": nominal["K_T"] * current,
        "flow_1": nominal["D"] * shown["speed"],
        "force": nominal["A"] * (shown["p1"] - shown["p2"]),
    }
    for name, term in leading.items():
        assert np.nanmedian(np.abs(w[name])) < 0.01 * np.std(term)


def test_a_flow_put_in_moves_the_pressure_as_oil_does(nominal):
    """Oil pushed into chamber 1 of a resting, sticking rod raises its pressure by beta volume / V."""
    samples, flow = 51, 1e-9
    zero = np.zeros(samples)
    softness = {"flow_1": np.full(samples - 1, nominal["V_10"] / nominal["beta"])}

    run = simulate_injections(
        nominal.set(K_L=0.0), zero, nominal.rest, DT, [{"flow_1": np.full(samples - 1, flow)}], softness
    )[0]

    rise = flow * DT * (samples - 1) * nominal["beta"] / nominal["V_10"]
    assert run["p1"][-1] - nominal["P_0"] == pytest.approx(rise, rel=1e-6)
    assert run["p2"][-1] == pytest.approx(nominal["P_0"], rel=1e-9)


def test_a_constant_force_is_found_with_its_size(nominal):
    """400 N on the rod that the nominal plant lacks: force, constant, 400 N."""
    current = drive()
    log = with_current(logged(nominal, current, force=np.full(current.size, 400.0)), current)

    where = found(nominal, log)

    assert where.place == "force"
    assert sum(share for _, share in where.shares) == pytest.approx(1.0)
    assert np.nanmedian(where.unknown["force"]) == pytest.approx(400.0, abs=20.0)
    assert "constant" in where.regimes[0].words
    assert where.explained > 0.9


def test_more_friction_of_the_rod_goes_with_the_sign_of_its_speed(nominal):
    """250 N more Coulomb friction is a force error of 250 N with the sign of the rod's speed."""
    current = drive()
    log = with_current(logged(nominal.set(A_FR=nominal["A_FR"] + 250.0), current), current)

    where = found(nominal, log)

    assert where.place == "force"
    regime = where.regimes[0]
    assert "sign of the rod's speed" in regime.against
    assert regime.mean[-1] == pytest.approx(250.0, rel=0.1)
    assert regime.mean[0] == pytest.approx(-250.0, rel=0.1)


def test_threads_give_the_same(nominal):
    """A leak and a force, so that torques, forces and flows are injected."""
    current = drive(4.0)
    rig = nominal.set(K_L=10.0 * nominal["K_L"])
    log = with_current(logged(rig, current, force=np.full(current.size, 200.0)), current)

    one = attribute_gap(nominal, log, estimate_noise(log))
    with sharing_threads(2):
        two = attribute_gap(nominal, log, estimate_noise(log))

    assert one.to_dict() == two.to_dict() and one.over_time == two.over_time


@pytest.mark.slow
def test_a_late_current_is_the_drives_and_a_weak_one_the_motors(nominal):
    """A current that acts 8 ms late is found as such; a smaller torque constant is a torque along the current."""
    current = drive()
    asked = np.append(current[2:], [0.0, 0.0])
    late = found(nominal, with_current(logged(nominal, current), asked))
    weak = found(nominal, with_current(logged(nominal.set(K_T=0.9 * nominal["K_T"]), current), current))

    assert late.place == "drive"
    assert "delay of the current of 8 ms" in late.regimes[0].words
    assert weak.place == "torque"
    assert "the current" in weak.regimes[0].against


def test_a_leak_is_a_flow_along_the_pressure_difference(nominal):
    """Three litres a minute at 100 bar more leakage: flow, in proportion to the pressure difference."""
    current = drive()
    log = with_current(logged(nominal.set(K_L=nominal["K_L"] + 5e-12), current), current)

    where = found(nominal, log)

    assert where.place == "flow"
    regime = next(r for r in where.regimes if r.balance == "flow_1" and "pressure difference" in r.against)
    assert np.polyfit(regime.bins, regime.mean, 1)[0] == pytest.approx(-5e-12, rel=0.15)


def test_a_shifted_pressure_sensor_is_a_sensor(nominal):
    """One channel alone contradicts the rest: the sensor's place, with the channel and its bias."""
    current = drive()
    log = with_current(logged(nominal, current), current)
    log = replace(log, channels={**log.channels, "p2": log["p2"] + 60e3})

    where = found(nominal, log)

    assert where.place == "sensor"
    assert where.sensor is not None and where.sensor.startswith("p2 with bias 6")


def test_a_log_without_pressures_says_what_it_can_not_tell(nominal):
    """Torque, flow and force can't be told apart then; their shares are alike and the sentence says why."""
    current = drive(6.0)
    log = with_current(logged(nominal, current, force=np.full(current.size, 400.0)), current)
    log = replace(log, channels={c: v for c, v in log.channels.items() if c not in ("p1", "p2")})

    where = found(nominal, log)

    assert dict(where.shares)["torque"] == pytest.approx(dict(where.shares)["force"])
    assert "without p1, p2" in where.untold[0]
    assert np.isnan(where.unknown["force"]).all()


def test_the_linear_model_lacks_friction(linear):
    """Held against a plant with dry friction the linear model lacks torque and force, not a sensor."""
    current = drive()
    true = ehsa_ctrl.load_plant("ehsa")
    log = with_current(logged(true, current), current)

    shares = dict(found(linear, log).shares)

    assert shares["torque"] + shares["force"] > 0.7


def test_a_run_that_stands_still_tells_no_scale():
    """A log in the wrong unit may leave the plant at rest: no sensor explains that, and nothing fails."""
    from ehsa_ctrl.diagnosis.sensor_error import _fit_sensor

    shown = np.sin(np.arange(500) * 0.01)

    left, sensor = _fit_sensor(ScoredSignal("speed", "speed"), shown, np.zeros(500), 0.004)

    assert left == np.inf
    assert (sensor.scale, sensor.bias) == (1.0, 0.0)
