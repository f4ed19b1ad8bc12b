"""A rod that creeps to rest: below the Stribeck speed every error grows, so the engine's own have to be small there."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import load_controller, run_closed_loop, simulate, simulate_reference, three_state
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.physics.effects import EFFECTS, LawFile, effect_of
from ehsa_ctrl.simulation.sensors import Sensors

TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)

#: um; below it errors are of the order of what is left of the run at 1e-12.
FLOOR = 2e-3


@pytest.fixture
def pid(linear):
    return load_controller("pid_position", three_state(linear))


def random_case(plant, pid, seed):
    """A function of the tolerance that runs constant currents, ramps to rest, holds, or closed loops, by seed."""
    rng = np.random.default_rng(seed)
    loaded = plant.set(K_S=rng.uniform(0.0, 2e5))
    dt = rng.choice([0.0005, 0.001, 0.002, 0.004, 0.008, 0.02])
    time = dt * np.arange(int(2.0 / dt))
    top = rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 3.0)
    at, over, level = rng.uniform(0.1, 0.6), rng.uniform(0.05, 1.2), rng.uniform(0.0, 1.0)
    kind = seed % 4
    if kind == 3:
        reference = np.zeros((500, 3))
        for jump in np.sort(rng.integers(0, 400, 3)):
            reference[jump:, 0] = rng.uniform(-0.02, 0.02)
        # Noisy, as every bench is. A converter's step would turn an error of 1e-12 m into one of a whole step.
        sensors = Sensors.of(plant, seed=seed)
        sensors = replace(sensors, by_channel={c: replace(s, step=0.0) for c, s in sensors.by_channel.items()})
        return (
            lambda loaded, tolerance: (
                run_closed_loop(
                    loaded, pid, reference, sensors=sensors, tolerance=tolerance, raise_on_failure=False
                ).trajectory
            ),
            loaded,
        )
    ramp = np.clip(1.0 - (time - at) / over, 0.0, 1.0)
    current = top * (np.ones(time.size), ramp, np.where(time < at, 1.0, level))[kind]
    return lambda loaded, tolerance: simulate(
        loaded, current, sample_time=dt, tolerance=tolerance, raise_on_failure=False
    ), loaded


def apart(a, b):
    """Largest distance of the rods of two runs [um]."""
    n = min(len(a), len(b))
    return 1e6 * np.max(np.abs(a["x"][:n] - b["x"][:n]))


def test_a_constant_current_against_a_spring_ends_where_it_should(plant):
    """The README's own run: 1.5 A against 50 kN/m, which once was 37 um off at the default tolerance."""
    loaded = plant.set(K_S=5e4)
    truth = simulate(loaded, np.full(500, 1.5), tolerance=1e-12)

    assert apart(simulate(loaded, np.full(500, 1.5)), truth) < 0.01


@pytest.mark.slow
def test_a_slow_stop_is_that_of_an_independent_integrator(plant):
    """SciPy's DOP853 with events gives the same stop, and the same slip after it."""
    loaded = plant.set(K_S=1e5)
    current = np.full(160, 1.2)
    run, reference = simulate(loaded, current), simulate_reference(loaded, current, rtol=1e-11)

    assert np.count_nonzero(np.diff(run.modes[:, 1] != 0)) >= 2
    assert 1e6 * np.max(np.abs(run["x"] - reference.states[:, 4])) < 0.1
    assert np.array_equal(run.modes, reference.modes)


def test_five_hundred_slow_stops(plant, pid):
    """The rod is within 0.5 um at the default tolerance, and less tolerance is never worse by more than a factor 3.

    Apart from runs that no arithmetic with 16 digits decides: a change of K_T in the twelfth digit moves their rod.
    """
    undecided, errors = 0, []
    for seed in range(500):
        run, loaded = random_case(plant, pid, seed)
        truth = run(loaded, 1e-12)
        found = [apart(run(loaded, tolerance), truth) for tolerance in TOLERANCES]
        if found[2] > 0.5 or any(b > 3.0 * a + FLOOR for a, b in zip(found[:-1], found[1:], strict=True)):
            nudged = run(loaded.set(K_T=loaded["K_T"] * (1.0 + 1e-12)), 1e-12)
            if apart(nudged, truth) > FLOOR:
                undecided += 1
                continue
        errors.append(found)
    errors = np.array(errors)
    worse = errors[:, 1:] > 3.0 * errors[:, :-1] + FLOOR

    assert undecided <= 10
    assert errors[:, 2].max() < 0.5
    assert not worse.any()


@pytest.mark.parametrize("current", [2.47, 2.475, 2.48])
def test_a_slip_between_the_ends_of_a_step_is_not_missed(plant, current):
    """The pressure passes for a moment what holds the rod, within one sample: the slip of 20 um is there."""
    loaded = plant.set(K_S=1.718e5)
    run, truth = (simulate(loaded, np.full(110, current), tolerance=tolerance) for tolerance in (1e-6, 1e-12))

    assert np.array_equal(run.modes, truth.modes)
    assert apart(run, truth) < 0.01


@pytest.mark.parametrize("rate", [300.0, 3e4])
def test_friction_that_rises_faster_than_the_force_lets_the_rod_creep(plant, rate):
    """Sliding friction that rises by 1e5 N/s holds a rod at once that a slower ramp of the force has freed. In the
    limit of slips of no length it slides for rate / 1e5 of the time, so that friction and force stay equal: Filippov,
    "Differential Equations with Discontinuous Righthand Sides", 1988. Once, the run ended there with an error.
    """
    rising = 1e5
    definition = {
        "schema": 1,
        "status": "proposed",
        "summary": "friction that rises while the rod slides",
        "adds_to": "force",
        "expression": "c_rise * d_R * m_slid",
        "parameters": {"c_rise": {"value": rising, "neutral": 0.0, "unit": "N s-1"}},
        "states": {"m_slid": {"rate": "abs(d_R)", "unit": "s", "scale": 0.01}},
    }
    EFFECTS.keep("rising_friction", effect_of("rising_friction", validate(definition, LawFile, "a test"), "a test"))
    rig = plant.set(C_FR=0.0).with_effects("rising_friction")
    dt = rig.sample_time
    force = -rate * dt * np.arange(int(2000.0 / rate / dt))
    run = simulate(rig, np.zeros(force.size), force=force, hold="first_order")

    moved = -force > rig["A_FR"]
    excess = -force[moved] - rig["A_FR"]
    assert np.all(run["m_slid"][~moved] == 0.0)
    # A rest may last a hundredth of a sample, and the chambers hold some mN at displacements of a picometre.
    assert np.max(np.abs(rising * run["m_slid"][moved] - excess)) < 0.05 * rate * dt + 0.1
    assert np.max(np.abs(run["x"])) < 1e-7
