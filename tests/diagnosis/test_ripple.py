"""A torque ripple: read off the balance, and followed by the shaft's measured angle."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel, with_every_effect
from ehsa_ctrl.physics.effects._shaft_angle import ANGLE, over_samples, strongest_orders, two_waves, with_angle

DT = 0.004
RIPPLE = {"T_c": 0.06, "n_c": 3.0, "phi_c": 1.0}
SECOND = {"a_c2": 0.7, "n_c2": 5.0, "phi_c2": -1.5}

CURRENT = 1.6 * np.sin(np.linspace(0.0, 6.0, 251))


def logged(rig, amplitude, seconds=12.0):
    """What true sensors show of a slow sine of current."""
    current = amplitude * np.sin(2 * np.pi * 0.5 * np.arange(int(seconds / DT)) * DT)
    run = ehsa_ctrl.simulate(rig, current)
    channels = {"speed": run["omega"], "p1": run["P_1"], "p2": run["P_2"], "position": run["x"]}
    return Log(run.time, {"current": current, **channels})


@pytest.mark.parametrize("amplitude", [1.6, 3.0])
def test_order_size_and_phase_are_read_off_the_balance(plant, amplitude):
    """However fast the shaft turns: 3 A take it to 400 rad/s, five periods in a sample."""
    log = logged(plant.with_effects("torque_ripple", **RIPPLE), amplitude)

    first, *_ = strongest_orders(plant.values, log)

    assert first[0] == 3.0
    assert first[1] == pytest.approx(0.06, rel=0.1)
    assert first[2] == pytest.approx(1.0, abs=0.15)


def test_two_waves_are_read_off_the_balance_together(plant):
    """Orders 3 and 5, the second with 0.7 times the amplitude; a plain ripple, or none, has no second order."""
    log = logged(plant.with_effects("torque_ripple", **RIPPLE, **SECOND), 1.6)

    (n, size, phase), (n_2, size_2, phase_2) = two_waves(plant.values, log)

    assert (n, n_2) == (3.0, 5.0)
    assert (size, size_2) == pytest.approx((0.06, 0.042), rel=0.1)
    assert (phase, phase_2) == pytest.approx((1.0, -1.5), abs=0.15)
    assert not two_waves(plant.values, logged(plant, 1.6))


def test_a_second_wave_of_the_same_order_and_phase_adds_its_amplitude(plant):
    """The limit in closed form: T_c (1 + a_c2); with a_c2 = 0 the second order and phase change no bit."""
    one = ehsa_ctrl.simulate(plant.with_effects("torque_ripple", **{**RIPPLE, "T_c": 0.09}), CURRENT)
    same = {"a_c2": 0.5, "n_c2": RIPPLE["n_c"], "phi_c2": RIPPLE["phi_c"]}
    two = ehsa_ctrl.simulate(plant.with_effects("torque_ripple", **RIPPLE, **same), CURRENT)
    plain = ehsa_ctrl.simulate(plant.with_effects("torque_ripple", **RIPPLE), CURRENT)
    neutral = ehsa_ctrl.simulate(plant.with_effects("torque_ripple", **RIPPLE, **{**SECOND, "a_c2": 0.0}), CURRENT)

    np.testing.assert_allclose(two["omega"], one["omega"], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(neutral.states, plain.states)


def test_a_second_order_decides_between_the_turns_that_the_first_leaves_open(plant):
    """A third of a turn changes nothing for an order of three; the order of five tells where the shaft stood."""
    rig = plant.with_effects("torque_ripple", **RIPPLE, **SECOND)
    log = logged(rig, 1.6)
    angle = 2.0 * np.pi / 3.0
    turned = {
        "phi_c": RIPPLE["phi_c"] + 3.0 * angle - 2.0 * np.pi,
        "phi_c2": SECOND["phi_c2"] + 5.0 * angle - 2.0 * np.pi,
    }
    nominal = rig.set(**turned)

    moved = with_angle(nominal.values, log)[ANGLE][0] - with_angle(rig.values, log)[ANGLE][0]

    assert np.mod(-moved, 2.0 * np.pi) == pytest.approx(angle, abs=0.05)


def test_a_mean_over_a_sample_is_the_integral():
    """Against a fine sum, at a speed that is constant within each sample."""
    omega = np.repeat([5.0, 100.0, 400.0, -300.0], 1)
    angle = np.concatenate([[0.2], 0.2 + np.cumsum(omega * DT)])
    log = Log(DT * np.arange(5), {ANGLE: angle})

    got = over_samples(log, 7.0, 0.4)

    for k, speed in enumerate(omega):
        fine = angle[k] + speed * (np.arange(20000) + 0.5) * DT / 20000
        assert got[k] == pytest.approx(np.mean(np.sin(7.0 * fine + 0.4)), abs=1e-8)


def test_the_angle_keeps_the_phase_of_a_plain_ripple(plant):
    """A speed sensor that is 0.05 rad/s off walks 0.6 rad away in 12 s; without a ripple nothing puts that right."""
    rig = plant.with_effects("torque_ripple", **{**RIPPLE, "T_c": 0.2})
    true, smooth = logged(rig, 1.6), logged(plant, 1.6)

    def end(log):
        biased = replace(log, channels={**log.channels, "speed": log["speed"] + 0.05})
        return (with_angle(plant.values, biased)[ANGLE] - with_angle(plant.values, log)[ANGLE])[-1]

    assert end(smooth) == pytest.approx(0.6, abs=0.01)
    # Half a window at either end is not seen.
    assert abs(end(true)) < 0.15


def test_a_run_with_a_wrong_number_keeps_the_ripple_in_phase(plant):
    """Friction that is 5 % off takes the simulated shaft turns away from the measured one, and its ripple with it; the
    ripple that follows the measured angle is as right as the rest."""
    rig = plant.with_effects("torque_ripple", **RIPPLE)
    wrong = {"B_FM": 1.05 * plant["B_FM"]}
    log, smooth = logged(rig, 1.6), logged(plant, 1.6)

    def error(log, setting):
        run = HypothesisModel(with_every_effect(plant), log).run([setting])[0]
        return float(np.std(run["p1"] - log["p1"]))

    least = error(smooth, wrong)
    assert error(with_angle(plant.values, log), {**RIPPLE, **wrong}) < 2.0 * least
    assert error(log, {**RIPPLE, **wrong}) > 5.0 * least


def test_a_ripple_of_the_nominal_plant_is_followed_too(plant):
    """A run that is given the ripple and a run of a plant that has it are one run."""
    rig = plant.with_effects("torque_ripple", **RIPPLE)
    log = with_angle(plant.values, logged(rig, 1.6))

    given = HypothesisModel(with_every_effect(plant), log).run([RIPPLE])[0]
    nominal = HypothesisModel(with_every_effect(rig), log).run([{}])[0]

    for channel, signal in given.items():
        np.testing.assert_array_equal(nominal[channel], signal, err_msg=channel)


def test_a_plant_that_has_the_ripple_has_no_gap(plant):
    """The improved plant is nominal: what followed the measured angle in the fit follows it in the check, however
    the shaft stood when the log began."""
    rig = plant.with_effects("torque_ripple", T_c=0.3, n_c=4.0, phi_c=-2.0)
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=12.0, seed=2)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=3, centre=True)

    found = ehsa_ctrl.diagnose(rig.set(phi_c=0.7), log)

    assert found.verdict == "no_gap"
    assert any("measured shaft angle" in sentence for sentence in found.findings)


@pytest.mark.slow
def test_a_ripple_is_found_with_a_log_of_its_own_to_check(plant):
    """Each log is followed by its own angle; how the shaft stood when each began nobody knows."""
    logs = []
    for seed, phase in ((2, -2.0), (5, 0.5)):
        rig = plant.with_effects("torque_ripple", T_c=0.5, n_c=4.0, phi_c=phase)
        time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=12.0, seed=seed)
        logs.append(ehsa_ctrl.record(rig, time, current, seed=seed + 1, centre=True)[0])

    found = ehsa_ctrl.diagnose(plant, logs[0], validate=logs[1])

    assert [cause.id for cause in found.effects] == ["torque_ripple"]
    assert found.effects[0].parameters["T_c"].value == pytest.approx(0.5, rel=0.05)
    assert found.gap["with_effects"]["total"] < 0.3 * found.gap["nominal"]["total"]


@pytest.mark.slow
def test_a_ripple_is_named_with_its_size(plant):
    """Of four periods a turn and most of the shaft's Coulomb friction, under noise: free runs lose its phase within a
    second. What that means for a run of the improved plant is said."""
    rig = plant.with_effects("torque_ripple", T_c=0.5, n_c=4.0, phi_c=-2.0)
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=12.0, seed=2)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=3, centre=True)

    found = ehsa_ctrl.diagnose(plant, log)

    assert [cause.id for cause in found.effects] == ["torque_ripple"]
    assert found.effects[0].parameters["T_c"].value == pytest.approx(0.5, rel=0.05)
    assert found.gap["with_effects"]["total"] < 0.3 * found.gap["nominal"]["total"]
    assert any("measured shaft angle" in sentence for sentence in found.findings)


@pytest.mark.slow
def test_two_waves_are_named_as_one_ripple(plant):
    """Of neither harmonic order; both amplitudes and orders are reported."""
    rig = plant.with_effects("torque_ripple", **{**RIPPLE, "T_c": 0.3}, **SECOND)
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=12.0, seed=2)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=3, centre=True)

    found = ehsa_ctrl.diagnose(plant, log)

    assert [cause.id for cause in found.effects] == ["torque_ripple"]
    numbers = {name: one.value for name, one in found.effects[0].parameters.items()}
    assert (numbers["n_c"], numbers["n_c2"]) == pytest.approx((3.0, 5.0), abs=1e-3)
    assert numbers["T_c"] == pytest.approx(0.3, rel=0.05)
    assert numbers["a_c2"] == pytest.approx(0.7, rel=0.1)
