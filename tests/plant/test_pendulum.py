"""A servo that swings a pendulum: closed forms of its physics, effects of the catalogue in it, and measured records."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel, with_every_effect
from ehsa_ctrl.diagnosis.scoring import effect_id_by_parameter
from ehsa_ctrl.identification.comparison import replay
from ehsa_ctrl.identification.identify import identify
from ehsa_ctrl.identification.plant_log import read_plant_log
from ehsa_ctrl.identification.preparation import Preparation
from ehsa_ctrl.plant.load import load_plant
from ehsa_ctrl.plant.structure import Structure
from ehsa_ctrl.plant.systems.pendulum import DUTY_PER_RADIAN, GRAVITY
from ehsa_ctrl.simulation.engine import simulate
from ehsa_ctrl.simulation.sensitivity import sensitivities

RECORDS = Path(__file__).parents[3] / "shared" / "data" / "bam"


@pytest.fixture
def servo():
    return load_plant("xl330_pendulum")


def with_law(plant, law, *effects, **values):
    return plant.with_structure(replace(plant.structure, shaft_friction=law, effects=effects), **values)


def free_swing(plant, angle, seconds=5.0, dt=0.002):
    """The released arm from rest at an angle."""
    samples = int(seconds / dt)
    return simulate(
        plant, np.zeros(samples), force=np.ones(samples), start=np.array([0.0, angle]), sample_time=dt, tolerance=1e-9
    )


def inertia(plant):
    return plant["J_M"] + plant["m"] * plant["l"] ** 2


def test_a_small_swing_has_the_frequency_of_a_physical_pendulum(servo):
    """Without friction theta + offset = a cos(w t), w = sqrt(m g l / J), up to the third order of the amplitude."""
    plant = with_law(servo, "none")

    run = free_swing(plant, 0.01 - plant["offset"])

    w = np.sqrt(plant["m"] * GRAVITY * plant["l"] / inertia(plant))
    np.testing.assert_allclose(run["theta"] + plant["offset"], 0.01 * np.cos(w * run.time), atol=1e-5)


def test_a_free_swing_loses_the_work_of_its_friction(servo):
    """Kinetic and potential energy fall by A times the path, B = 0, until the arm sticks where gravity is below A."""
    plant = servo.set(B_FM=0.0)

    run = free_swing(plant, 1.2, seconds=20.0)

    height = 1.0 - np.cos(run["theta"] + plant["offset"])
    energy = 0.5 * inertia(plant) * run["omega"] ** 2 + plant["m"] * GRAVITY * plant["l"] * height
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(run["theta"])))])
    # A sample at a reversal hides a part of the path of the order of (dt omega_dot dt).
    np.testing.assert_allclose(energy[0] - energy, plant["A_FM"] * path, atol=2e-4 * energy[0])
    assert run.sticks("shaft")[-1]
    assert abs(plant["m"] * GRAVITY * plant["l"] * np.sin(run["theta"][-1] + plant["offset"])) <= plant["A_FM"]


@pytest.mark.parametrize(("kp", "goal"), [(100.0, 1.0), (800.0, 1.4)])
def test_it_stalls_where_the_motor_balances_gravity(servo, kp, goal):
    """K_T U_0 duty / (R + R_S duty^2) = m g l sin(theta + offset), with a duty cycle in proportion or at its limit."""
    plant = with_law(servo, "viscous").set(kp=kp, R_S=1.5, B_FM=0.05)

    run = simulate(plant, np.full(4000, goal))

    theta = run["theta"][-1]
    duty = min(kp * DUTY_PER_RADIAN * (goal - theta), 1.0)
    motor = plant["K_T"] * plant["U_0"] * duty / (plant["R"] + plant["R_S"] * duty**2)
    assert motor == pytest.approx(plant["m"] * GRAVITY * plant["l"] * np.sin(theta + plant["offset"]), rel=1e-6)
    assert (duty == 1.0) == (kp == 800.0)


def test_a_given_voltage_or_current_acts_as_the_saturated_loop_does(servo):
    """At full duty cycle the loop is a voltage source; the current that it drives gives the same motion."""
    how = {"sample_time": 0.001, "tolerance": 1e-9}
    names = dict.fromkeys(["K_T", "J_M", "m", "l", "offset", "theta_0", "R", "A_FM", "B_FM"])
    loop = simulate(servo.set(kp=1e6), np.full(400, 3.0), **how)
    by_voltage = servo.with_structure(Structure("coulomb", None, None, (), "pendulum_voltage"))
    by_current = by_voltage.with_structure(Structure("coulomb", None, None, (), "pendulum_current"))

    given = simulate(by_voltage, np.full(400, servo["U_0"]), **how)
    current = (servo["U_0"] - servo["K_T"] * given["omega"]) / servo["R"]
    driven = simulate(by_current, current, hold="first_order", **how)

    assert set(by_voltage.parameters) == set(names)
    np.testing.assert_allclose(given["theta"], loop["theta"], atol=1e-7)
    np.testing.assert_allclose(driven["theta"], loop["theta"], atol=1e-4)


def test_friction_of_a_loaded_gear_holds_what_it_transmits(servo):
    """At rest the motor may differ from gravity by A_FM + kappa |T_G|, T_G their mean, and by no more."""
    kappa = 0.3
    plant = with_law(servo, "coulomb", "load_dependent_friction", kappa=kappa).set(kp=100.0)
    time = 0.005 * np.arange(4000)

    run = simulate(plant, 1.5 * np.sin(0.5 * time))

    # A run begins at rest whatever acts; the contact that sticks at a sample stuck under the goal held up to it.
    held = run.sticks("shaft") & (run.time > 0.0)
    before = np.concatenate([[0.0], run["goal"][:-1]])
    duty = plant["kp"] * DUTY_PER_RADIAN * (before - run["theta"])
    motor = plant["K_T"] * plant["U_0"] * duty / plant["R"]
    load = plant["m"] * GRAVITY * plant["l"] * np.sin(run["theta"] + plant["offset"])
    room = plant["A_FM"] + kappa * 0.5 * np.abs(motor + load)
    difference = np.abs(motor - load)[held]
    assert 0.2 < held.mean() < 0.95
    assert (difference <= room[held] + 1e-9).all()
    assert (difference > plant["A_FM"] + 0.02).any()


def test_effects_of_rod_and_shaft_act_on_the_one_contact(servo):
    """Friction effects of the catalogue fit the gear, each parameter has one id, and no effect is hydraulic."""
    time = 0.005 * np.arange(800)
    log = Log(time, {"goal": np.sin(time), "released": np.zeros(800), "angle": np.sin(time)})

    model = HypothesisModel(with_every_effect(servo), log)
    found = {candidate.id for candidate in candidate_effects(model)}

    assert {"load_dependent_friction", "asymmetric_friction", "motor_friction", "motor_viscous_friction"} <= found
    assert {
        "supply_resistance",
        "winding_resistance",
        "torque_constant",
        "torque_saturation",
        "rotor_inertia",
        "payload_mass",
    } <= found
    assert not {"rod_friction", "rod_viscous_friction", "internal_leakage", "bulk_modulus"} & found
    assert effect_id_by_parameter(servo)["B_FM"] == "motor_viscous_friction"
    assert servo.structure.system.place_of("force") == "torque"
    assert set(servo.structure.system.places) == {"torque", "drive"}


def test_derivatives_do_not_depend_on_how_many_are_asked_for(servo):
    """The run keeps its constants while it is differentiated; every set of parameters gives the same columns."""
    symbols = ["K_T", "R", "J_M", "offset", "A_FM", "B_FM", "m"]
    how = {"start": np.array([1.9, 0.6]), "sample_time": 0.005}
    alone = {one: sensitivities(servo, [one], np.full(20, 0.8), **how).values[:, :, 0] for one in symbols}

    for count in range(2, len(symbols) + 1):
        for names in itertools.combinations(symbols, count):
            together = sensitivities(servo, list(names), np.full(20, 0.8), **how).values
            for column, name in enumerate(names):
                np.testing.assert_allclose(together[:, :, column], alone[name], rtol=1e-9, atol=1e-12)


@pytest.mark.skipif(not RECORDS.is_dir(), reason="the measured records are not here")
def test_published_values_replay_the_published_records_in_closed_loop(servo):
    """The publishers' own fit of Coulomb and viscous friction leaves 54 to 63 mrad on average over records."""
    errors = []
    for path in sorted(RECORDS.glob("kp*.csv")):
        plant = servo.set(kp=float(path.name[2:5]))
        log, _ = Preparation(resample=200.0).apply(read_plant_log(path, plant, uniform=False), plant)
        run = replay(plant, log)
        errors.append(np.mean(np.abs(run.simulated["angle"] - log["angle"])))

    assert len(errors) == 8
    assert 0.054 < np.mean(errors) < 0.063


def recorded(plant, kp, seconds=6.0):
    """A log of a run at a gain, with the angle quantised as the encoder does."""
    time = 0.005 * np.arange(int(seconds / 0.005))
    goal = 1.2 * np.sin(2.0 * time) + 0.4 * np.sin(7.0 * time)
    run = simulate(plant.set(kp=kp), goal, sample_time=0.005)
    step = plant.sensors["angle"].step
    channels = {"goal": goal, "released": np.zeros(time.size), "angle": np.round(run["theta"] / step) * step}
    return Log(time, channels, settings={"kp": kp})


def test_a_setting_of_a_log_holds_for_it_alone(servo):
    """Replays use it, and a parameter that a log sets can't be estimated."""
    log = recorded(servo, 100.0)

    assert replay(servo, log).fit_percent["angle"] > 99.5
    assert replay(servo, replace(log, settings={})).fit_percent["angle"] < 50.0
    with pytest.raises(InputError, match="sets kp, which is to be estimated"):
        identify(servo, [log], free=("kp",))
    with pytest.raises(InputError, match="no parameter 'kq'"):
        replay(servo, replace(log, settings={"kq": 1.0}))


@pytest.mark.slow
def test_records_of_two_gains_determine_supply_and_gear(servo):
    """Together they give what was put in, from the published start."""
    truth = with_law(servo, "coulomb", "load_dependent_friction", kappa=0.3).set(R=3.8, R_S=1.2, B_FM=0.004)
    start = with_law(servo, "coulomb", "load_dependent_friction", kappa=0.1).set(R_S=0.5)

    found = identify(start, [recorded(truth, kp) for kp in (100.0, 800.0)], free=("kappa", "R_S"))

    for name in ("K_T", "R", "J_M", "A_FM", "kappa", "R_S"):
        assert found.plant[name] == pytest.approx(truth[name], rel=0.1), name


@pytest.mark.slow
@pytest.mark.skipif(not RECORDS.is_dir(), reason="the measured records are not here")
def test_load_and_saturation_explain_records_of_another_gain(servo):
    """Identified at kp 800 alone, the servo replays those at kp 100 to 30 mrad; Coulomb and viscous friction do not.
    Identified at both, it replays all of them so."""
    logs = {100.0: [], 800.0: []}
    for path in sorted(RECORDS.glob("kp*.csv")):
        kp = float(path.name[2:5])
        log, _ = Preparation(resample=200.0).apply(read_plant_log(path, servo, uniform=False), servo)
        logs[kp].append(replace(log, settings={"kp": kp}))

    def tested(plant, *free, gains=(800.0,), at=(100.0,)):
        fitted = identify(plant, [log for kp in gains for log in logs[kp]], free=free, starts=4).plant
        runs = [replay(fitted, log) for kp in at for log in logs[kp]]
        return np.mean([np.mean(np.abs(run.simulated["angle"] - run.log["angle"])) for run in runs])

    effects = ("load_dependent_friction", "torque_saturation")
    loaded = with_law(servo, "coulomb", *effects, kappa=0.2, k_sat=0.3)
    assert tested(loaded, "kappa", "k_sat") < 0.030 < tested(servo)
    assert tested(loaded, "kappa", "k_sat", gains=(100.0, 800.0), at=(100.0, 800.0)) < 0.030


def test_a_lag_of_the_current_and_friction_over_the_angle_act_in_the_servo(servo):
    """Absent at their neutral values to the last bit; a slow current loop delays the motor torque by its lag."""
    driven = replace(servo, structure=replace(servo.structure, system_name="pendulum"))
    goal = np.full(400, 0.5)
    base = simulate(driven, goal, sample_time=0.005)
    neutral = driven.with_effects("drive_lag", "position_dependent_friction", tau_I=0.0, h_FR=0.0)
    slow = simulate(neutral.set(tau_I=0.02), goal, sample_time=0.005)
    tight = simulate(neutral.set(h_FR=3.0, x_h=0.2, w_h=0.1), goal, sample_time=0.005)

    assert np.array_equal(simulate(neutral, goal, sample_time=0.005).states[:, :2], base.states)
    late = np.interp([0.05, 0.1], slow["theta"][:60], slow.time[:60]) - np.interp(
        [0.05, 0.1], base["theta"][:60], base.time[:60]
    )
    assert np.all((late > 0.005) & (late < 0.03))
    assert np.max(np.abs(tight["theta"] - base["theta"])) > 0.01


def test_the_gear_warms_up_by_its_own_heat(servo):
    """First law: what a released arm loses of its energy is the heat of the gear's friction, counted once."""
    warm = with_law(servo, "coulomb", "viscosity_warmup", drop=0.3, E_w=1.0)
    start = np.array([0.0, 1.2, 0.0, 0.0])
    run = simulate(warm, np.zeros(2500), force=np.ones(2500), start=start, sample_time=0.002, tolerance=1e-9)
    kinetic = 0.5 * inertia(warm) * run["omega"] ** 2
    potential = warm["m"] * GRAVITY * warm["l"] * (1.0 - np.cos(run["theta"] + warm["offset"]))
    energy = kinetic + potential

    np.testing.assert_allclose(run["E_run"], energy[0] - energy, atol=1e-4 * energy[0])
    assert run["E_run"][-1] > 0.5 * energy[0]
