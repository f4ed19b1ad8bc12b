"""The engine against closed forms and invariants: no test here knows what it gave yesterday."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete

from ehsa_ctrl import InputError, SimulationError, Structure, four_state, simulate, simulate_batch, simulate_reference
from ehsa_ctrl.simulation.engine import initial_carry, initial_modes, run_open_loop
from ehsa_ctrl.simulation.plant_code import plant_code

#: So small that the other side of the pump or the piston is not felt.
NOTHING = 1e-14


def test_a_mass_falls(linear):
    """A rod without oil and friction under a constant force: x = F t^2 / 2 M, exactly."""
    free = linear.set(A=NOTHING, D=NOTHING, B_FR=0.0, F_0=-100.0)
    run = simulate(free, np.zeros(251))

    np.testing.assert_allclose(run["x"], 100.0 / (2 * free["M"]) * run.time**2, rtol=1e-9, atol=1e-12)


def test_the_linear_plant_is_its_matrix_exponential(linear):
    """Held current and joined current, against the exact discretisation of (6)."""
    loaded = linear.set(K_S=5e4)
    system = four_state(loaded)
    rng = np.random.default_rng(3)
    current = rng.standard_normal(200)
    for hold, method in (("zero_order", "zoh"), ("first_order", "foh")):
        run = simulate(loaded, current, hold=hold, tolerance=1e-9)
        a, b, c, d, _ = cont2discrete((system.A, system.B[:, :1], np.eye(5), np.zeros((5, 1))), 0.004, method)
        state, expected = np.linalg.solve(c, -d[:, 0] * current[0]), []
        for u in current:
            expected.append(c @ state + d[:, 0] * u)
            state = a @ state + b[:, 0] * u
        expected = np.array(expected) + loaded.rest

        assert np.max(np.abs(run.states - expected) / [100, 5e5, 5e5, 0.05, 0.02]) < 1e-8


def test_speed_decays_with_the_slow_pole(linear):
    """Along the slow eigenvector everything decays as exp(-8.92 t)."""
    system = four_state(linear)
    values, vectors = np.linalg.eig(system.A)
    slow = int(np.argmin(np.abs(values + 8.925)))
    start = linear.rest + 100.0 / np.real(vectors[0, slow]) * np.real(vectors[:, slow])
    run = simulate(linear, np.zeros(51), start=start, tolerance=1e-9)

    assert run["omega"][-1] == pytest.approx(100.0 * np.exp(np.real(values[slow]) * 0.2), rel=1e-7)
    np.testing.assert_allclose(
        run.states[-1] - linear.rest, expm(system.A * 0.2) @ (start - linear.rest), rtol=1e-6, atol=1e-5
    )


def test_coast_down_stops_at_the_closed_form_and_stays(plant):
    """Coulomb and viscous friction stop a free shaft after J/B ln(1 + B w0 / A); then the speed is exactly zero."""
    free = plant.set(D=NOTHING, C_FM=0.0)
    p = free.values
    start = free.rest
    start[0] = 200.0
    stop = p["J_M"] / p["B_FM"] * np.log1p(p["B_FM"] * 200.0 / p["A_FM"])
    run = simulate(free, np.zeros(51), start=start, tolerance=1e-9)
    before = run.time < stop
    expected = (200.0 + p["A_FM"] / p["B_FM"]) * np.exp(-p["B_FM"] / p["J_M"] * run.time) - p["A_FM"] / p["B_FM"]

    np.testing.assert_allclose(run["omega"][before], expected[before], rtol=1e-7)
    assert np.all(run["omega"][~before] == 0.0)
    assert run.sticks("shaft")[~before].all() and not run.sticks("shaft")[before].any()


def test_the_shaft_breaks_away_at_its_static_torque(plant):
    """On a slow ramp nothing moves before K_T I = A_FM + C_FM, and the shaft moves right after."""
    threshold = (plant["A_FM"] + plant["C_FM"]) / plant["K_T"]
    current = np.linspace(0.0, 1.5, 2501)
    run = simulate(plant, current)
    first = np.flatnonzero(run["omega"])[0]

    assert np.all(run["omega"][:first] == 0.0)
    assert current[first - 1] == pytest.approx(threshold, abs=2 * (current[1] - current[0]))


def test_the_rod_breaks_away_at_its_static_force(plant):
    """On the same ramp the rod stays put until A dP reaches A_FR + C_FR."""
    run = simulate(plant, np.linspace(0.0, 1.5, 2501), tolerance=1e-8)
    first = np.flatnonzero(run["v"])[0]
    force = plant["A"] * run["dP"]

    assert np.all(run["x"][:first] == 0.0)
    assert np.all(force[:first] <= plant["A_FR"] + plant["C_FR"])
    assert force[first - 1] == pytest.approx(plant["A_FR"] + plant["C_FR"], rel=0.01)


def test_friction_holds_a_compressed_spring_without_creep(plant):
    """At 10 mm the spring pushes with 500 N, less than A_FR + C_FR: the rod stays there to the last bit."""
    loaded = plant.set(K_S=5e4)
    start = loaded.rest
    start[4] = 0.01
    run = simulate(loaded, np.zeros(2501), start=start)

    assert np.all(run["x"] == 0.01)
    assert np.all(run["v"] == 0.0)
    assert run.sticks("rod").all()


def test_a_spring_beyond_friction_is_held_by_the_shaft(plant):
    """At 30 mm the spring moves the rod until the oil, shut in by the sticking shaft, carries the rest; no leakage."""
    loaded = plant.set(K_S=5e4, K_L=0.0)
    start = loaded.rest
    start[4] = 0.03
    run = simulate(loaded, np.zeros(501), start=start, tolerance=1e-8)
    still = run.sticks("rod")

    assert run["x"][-1] < 0.03
    assert still[-100:].all() and np.ptp(run["x"][-100:]) == 0.0
    assert np.all(run["omega"] == 0.0)
    net = loaded["A"] * run["dP"][-1] - loaded["K_S"] * run["x"][-1]
    assert abs(net) <= loaded["A_FR"] + loaded["C_FR"]


@pytest.mark.slow
@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_the_default_tolerance_is_good_to_1e_5(plant, hold):
    """Every state within 1e-5 of its range of the event-driven reference, modes the same at every sample."""
    time = 0.004 * np.arange(126)
    current = 1.5 * np.sin(4 * np.pi * time) if hold == "first_order" else np.where(time % 0.25 < 0.125, 1.6, -1.6)
    loaded = plant.set(K_S=5e4)
    run = simulate(loaded, current, hold=hold)
    reference = simulate_reference(loaded, current, hold=hold)
    size = np.max(np.abs(reference.states - reference.states[0]), axis=0)

    assert np.max(np.abs(run.states - reference.states) / size) < 1e-5
    assert np.array_equal(run.modes, reference.modes)


def test_the_error_falls_with_the_tolerance(plant):
    """Ten times less tolerance, clearly less error: from 1e-4 to 1e-9 by at least 10^3."""
    current = 2.0 * np.sin(np.linspace(0, 12, 401))
    truth = simulate(plant, current, tolerance=1e-12).states
    size = np.max(np.abs(truth - truth[0]), axis=0)
    errors = [np.max(np.abs(simulate(plant, current, tolerance=t).states - truth) / size) for t in (1e-4, 1e-6, 1e-9)]

    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert errors[0] > 1e3 * errors[2]


def test_energy_is_balanced_along_a_run(plant):
    """Work of the motor = stored energy + friction + leakage, with the term that (12)'s volume balance leaves over."""
    loaded = plant.set(K_S=5e4)
    p = loaded.values
    dt = 1e-4
    current = 1.8 * np.sin(2 * np.pi * 2 * dt * np.arange(5001))
    run = simulate(loaded, current, hold="first_order", sample_time=dt, tolerance=1e-10)
    omega, P_1, P_2, v, x = run.states.T
    V_1, V_2 = p["V_10"] + p["A"] * x, p["V_20"] - p["A"] * x
    stored = 0.5 * (p["J_M"] * omega**2 + p["M"] * v**2 + p["K_S"] * x**2)
    stored += (V_1 * P_1**2 + V_2 * P_2**2) / (2 * p["beta"])
    shaft, rod = run.modes.T

    def friction(symbol, speed, mode):
        a, b, c, tau = (p[f"{name}_{symbol}"] for name in ("A", "B", "C", "tau"))
        return mode * (a + c * np.exp(-np.abs(speed) / tau)) + b * speed

    power = p["K_T"] * current * omega - friction("FM", omega, shaft) * omega - friction("FR", v, rod) * v
    power += -p["K_L"] * (P_1 - P_2) ** 2 + p["A"] * v * (P_1**2 - P_2**2) / (2 * p["beta"])
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * dt)])

    np.testing.assert_allclose(stored - stored[0], work, atol=2e-5 * np.ptp(stored))


def test_pressure_sum_is_constant_where_volumes_are(linear):
    """With V_1 = V_2 = V what one chamber loses the other gains."""
    run = simulate(linear, np.random.default_rng(0).standard_normal(500))

    np.testing.assert_allclose(run["P_1"] + run["P_2"], 2 * linear["P_0"], rtol=1e-10)


def test_volume_balance_lifts_the_pressure_level_and_mass_balance_does_not(plant):
    """(12) moves volume, not mass: hard work lifts the level; with oil that carries its density it stays."""
    current = 1.5 * np.sin(2 * np.pi * 2 * 0.004 * np.arange(2501))
    printed = simulate(plant, current)
    conserving = simulate(plant.with_effects("mass_conserving"), current, tolerance=1e-9)
    p = plant.values
    mass = np.exp(conserving["P_1"] / p["beta"]) * (p["V_10"] + p["A"] * conserving["x"])
    mass += np.exp(conserving["P_2"] / p["beta"]) * (p["V_20"] - p["A"] * conserving["x"])

    assert 0.5e5 < printed.pressure_level_drift < 5e5
    np.testing.assert_allclose(mass, mass[0], rtol=1e-11)
    assert abs(conserving.pressure_level_drift) < 0.3 * printed.pressure_level_drift


@pytest.mark.slow
@pytest.mark.parametrize(
    ("structure", "values"),
    [
        (Structure("coulomb", "karnopp"), {"v_band_FR": 1e-3}),
        (Structure("stribeck_squared", "lugre"), {"sigma_0_FR": 1e7, "sigma_1_FR": 1e4}),
        (
            Structure("none", "viscous", "stroke", ("end_stop", "relief_valve", "anti_cavitation", "mass_conserving")),
            {"x_stop": 0.005, "P_crack": 2.6e6, "P_open": 1.6e6},
        ),
    ],
    ids=["coulomb+karnopp", "squared+lugre", "all effects"],
)
def test_every_law_and_effect_runs_as_the_reference_does(plant, structure, values):
    """The compiled text and the physics functions called one by one give the same motion."""
    loaded = plant.with_structure(structure, **values).set(K_S=2e4)
    current = 2.5 * np.sin(np.linspace(0, 9, 101))
    run = simulate(loaded, current, tolerance=1e-9)
    reference = simulate_reference(loaded, current, method="LSODA", rtol=1e-9)
    size = np.max(np.abs(reference.states - reference.states[0]), axis=0)

    assert np.max(np.abs(run.states - reference.states) / size) < 2e-5


@pytest.mark.slow
def test_end_stops_stop_and_valves_open(plant):
    """Full current ends at the stop, the pump turning against its relief valve, the other chamber not empty."""
    real = plant.with_effects("end_stop", "relief_valve", "anti_cavitation", P_crack=30e5, K_relief=1e-6, x_stop=0.02)
    run = simulate(real, np.full(500, 3.0))

    assert run["x"].max() == pytest.approx(0.02, abs=5e-4)
    assert run["P_1"][-1] < 40e5
    assert plant["D"] * run["omega"][-1] > 1e-4
    assert run["P_2"].min() > -0.5e5
    assert run["v"][-1] == 0.0


def test_limits_are_watched(plant):
    """A run beyond the stroke and the pump's speed says so, with the time; a gentle one says nothing."""
    hard, gentle = simulate(plant, np.full(501, 3.0)), simulate(plant, np.full(51, 1.3))

    assert {"pump_speed", "stroke"} <= {exceedance.limit for exceedance in hard.exceeded}
    assert "stroke" in " ".join(map(str, hard.exceeded))
    assert gentle.exceeded == ()


def test_a_batch_is_the_single_runs(plant):
    """Rows of a batch, on one thread or two, are bit for bit what each run gives alone."""
    current = 1.5 * np.sin(np.linspace(0, 20, 301))
    rng = np.random.default_rng(1)
    rows = plant.vector * rng.uniform(0.9, 1.1, (8, plant.vector.size))
    names = plant.structure.equations.parameter_names
    two = simulate_batch(plant, rows, current, jobs=2)
    one = simulate_batch(plant, rows, current, jobs=1)

    assert np.array_equal(one.states, two.states)
    alone = simulate(plant.set(**dict(zip(names, rows[5], strict=True))), current, tolerance=1e-4)
    assert np.array_equal(alone.states, two.states[5])


def test_an_impulse_is_a_new_start_from_the_changed_state(plant):
    """The samples up to an impulse show the state before it; the rest is a run from the state after it."""
    current, at, samples = 1.5 * np.sin(np.linspace(0, 8, 201)), 80, 201
    impulses = np.zeros((1, samples, plant.rest.size))
    impulses[0, at] = [0.0, 1e5, -2e5, 0.0, 1e-3]
    y, dt = plant.rest[None, :].copy(), plant.sample_time
    modes, states, status = initial_modes(plant, y), np.empty((1, samples, y.size)), np.zeros(1, dtype=np.int64)
    run_open_loop(
        plant_code(plant.structure.equations), plant.vector[None, :], y, modes, initial_carry(plant, 1, dt), current,
        np.zeros(samples), False, dt, 1e-9, states, np.zeros((1, samples, 2), dtype=np.int8), np.empty((1, samples)),
        np.stack([y, y], axis=1), status=status, impulses=impulses,
    )  # fmt: skip

    before = simulate(plant, current[: at + 1], tolerance=1e-9)
    after = simulate(plant, current[at:], start=before.states[-1] + impulses[0, at], tolerance=1e-9)

    assert status[0] == 0
    assert np.array_equal(states[0, : at + 1], before.states)
    assert states[0, at + 1 :] == pytest.approx(after.states[1:], rel=1e-6, abs=1e-9)


def test_a_failed_run_does_not_stop_a_batch(plant):
    """A parameter that is no number makes one run fail with a status; the others are there."""
    rows = np.tile(plant.vector, (3, 1))
    rows[1, plant.structure.equations.parameter_names.index("V_20")] = np.nan
    batch = simulate_batch(plant, rows, np.full(500, 2.0))

    assert batch.status[0] == batch.status[2] == 0 != batch.status[1]
    assert np.isnan(batch.states[1, -1]).all() and np.isfinite(batch.states[[0, 2]]).all()


def test_a_failed_run_says_when_and_why(plant):
    """One sentence with the time, no array of nan."""
    with pytest.raises(SimulationError, match=r"ehsa: stopped at 0\.\d+ s: the step length"):
        simulate(plant.set(V_20=1e-5), np.full(500, 2.0))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"current": [0.0, np.nan, 1.0]}, "current is nan at sample 1"),
        ({"current": [1.0]}, "at least two samples"),
        ({"current": [[1.0, 2.0]]}, "shape"),
        ({"current": [0.0, 0.0], "force": [0.0]}, "force has shape"),
        ({"current": [0.0, 0.0], "hold": "second_order"}, "expected 'zero_order' or 'first_order'"),
        ({"current": [0.0, 0.0], "tolerance": 0.0}, "tolerance"),
        ({"current": [0.0, 0.0], "start": [0.0]}, "the plant has 5 states"),
    ],
)
def test_wrong_input_is_a_sentence(plant, arguments, says):
    """What was got, what was expected."""
    with pytest.raises(InputError, match=says):
        simulate(plant, **arguments)
