"""Systems other than the EHSA: their files, equations and simulations."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl.core.catalogue import plants
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import CHANNELS
from ehsa_ctrl.diagnosis.unknown_inputs import UNITS
from ehsa_ctrl.physics.effects import EFFECTS, PLACES
from ehsa_ctrl.physics.friction import LAWS
from ehsa_ctrl.plant.arrays import array_evaluator, needs
from ehsa_ctrl.plant.linear import four_state
from ehsa_ctrl.plant.linearise import linearise, operating_point
from ehsa_ctrl.plant.load import load_plant
from ehsa_ctrl.plant.plain import evaluator
from ehsa_ctrl.plant.structure import Structure
from ehsa_ctrl.plant.system import ScoredSignal
from ehsa_ctrl.plant.systems import SYSTEMS
from ehsa_ctrl.plant.systems.pendulum import DUTY_PER_RADIAN, GRAVITY
from ehsa_ctrl.simulation.bench import _Centring
from ehsa_ctrl.simulation.closed_loop import run_closed_loop
from ehsa_ctrl.simulation.engine import simulate, simulate_batch
from ehsa_ctrl.simulation.reference import simulate_reference
from ehsa_ctrl.simulation.sensitivity import sensitivities
from ehsa_ctrl.simulation.sensors import Sensors


@pytest.fixture
def emps():
    return load_plant("emps")


@pytest.fixture
def take_off():
    return load_plant("mbari_pto")


def edited(tmp_path, name, old, new):
    text = plants[name].read_text()
    assert old in text
    path = tmp_path / "edited.toml"
    path.write_text(text.replace(old, new))
    return path


def test_symbols_are_those_of_the_system(emps):
    """Friction of the carriage has the benchmark's names; a contact without names of its own has the paper's."""
    assert set(emps.parameters) == {"M", "offset", "x_0", "Fc", "Fv"}
    assert SYSTEMS["ehsa"].contacts[0].symbol("A") == "A_FM"


def test_a_structure_may_lack_a_contact_and_chambers():
    """The public Structure checks its arguments and accepts None where a system has no such part."""
    import ehsa_ctrl

    structure = ehsa_ctrl.Structure(None, "coulomb", None, system_name="positioning")

    assert structure == load_plant("emps").structure


@pytest.mark.parametrize(
    ("name", "old", "new", "says"),
    [
        ("emps", 'system = "positioning"', 'system = "position"', "did you mean 'positioning'"),
        ("emps", 'rod_friction = "coulomb"', "", "rod_friction is missing; known: .*coulomb"),
        (
            "emps",
            'rod_friction = "coulomb"',
            'rod_friction = "coulomb"\nchambers = "stroke"',
            "has no chambers; leave it out",
        ),
        (
            "emps",
            'rod_friction = "coulomb"',
            'rod_friction = "coulomb"\nshaft_friction = "none"',
            "shaft_friction = 'none'.*leave it out",
        ),
        (
            "emps",
            "[log]",
            '[limits]\npump_speed = { value = 1, unit = "rpm", source = "assumed" }\n[log]',
            "does not apply",
        ),
        ("emps", "[sensors.position]", "[sensors.p1]", "unknown channel.*known: .*drive_force"),
        ("emps", "[log]", '[load]\nmass = { value = 1, unit = "kg", source = "assumed" }\n[log]', "unknown parameter"),
        ("mbari_pto", '"relief_valve"', '"end_stop"', "'end_stop' changes F_net, which the system 'driven_rod'"),
        ("mbari_pto", 'rod_friction = "coulomb"', 'rod_friction = "lugre"', "inner state"),
        ("mbari_pto", 'chambers = "constant"', 'chambers = "stroke"', "chambers = 'stroke' is not known"),
    ],
)
def test_what_a_system_does_not_have_is_one_sentence(tmp_path, name, old, new, says):
    """A contact, volume, limit, sensor, load or effect that the system does not have."""
    path = edited(tmp_path, name, old, new)

    with pytest.raises(InputError, match=says) as caught:
        load_plant(path)

    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def equations_of(system):
    """Equations of a system with Coulomb friction and the first form of its chambers, from its declaration alone."""
    contacts = {contact.name for contact in system.all_contacts}
    laws = ("coulomb" if name in contacts else None for name in ("shaft", "rod"))
    return Structure(*laws, next(iter(system.chamber_forms), None), (), system.name).equations


def random_values(system, equations):
    """Parameters, states, inputs and directions (50,) at random."""
    rng = np.random.default_rng(4)
    values = {name: rng.uniform(0.5, 1.5) for name in equations.parameter_names}
    values |= {state.name: state.scale * rng.normal(size=50) for state in equations.states}
    values |= {name: rng.normal(size=50) for name in equations.inputs}
    return values | {contact.direction: np.sign(values[contact.velocity]) for contact in system.all_contacts}


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_a_declaration_is_complete(name):
    """Places, effects, symbols, units and signals that a system declares exist."""
    system = SYSTEMS[name]
    equations = equations_of(system)
    symbols = {*equations.parameter_names, *(kind.name for kind in system.parameters)}
    units = {state.name: state.unit for state in system.states}
    unknown = {one: balance.unit for balance in system.balances for one in balance.unknown_inputs}

    assert set(system.places) <= set(PLACES)
    assert {one: UNITS[one] for one in unknown if one in UNITS} == {o: u for o, u in unknown.items() if o in UNITS}
    for balance in system.balances:
        assert all(symbol in symbols | set(equations.signals) for e in balance.entries for symbol in e.capacity)
    assert {effect for effects in system.missing_effects for effect in effects} <= set(EFFECTS)
    assert {system.own(contact.constant) for contact in system.contacts if contact.constant} <= symbols
    assert set(system.start.values()) <= symbols and set(system.start) <= set(units)
    assert all(CHANNELS[channel].unit == units[state] for channel, state in system.outputs.items())
    assert len({one.name for one in system.scored}) == len(system.scored) > 0


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_balances_vanish_at_the_rates_of_the_equations(name):
    """Balances and simulation share the physics: with the model's own rates the residuals vanish."""
    system = SYSTEMS[name]
    equations = equations_of(system)
    known = random_values(system, equations)
    known |= {"m_L": 0.0}  # behind the load cell nothing moves, so that cell and F_EXT agree
    model = array_evaluator(equations, [*equations.rates, *equations.signals])(known)
    known |= {f"{state.name}_rate": model[rate] for state, rate in zip(equations.states, equations.rates, strict=True)}
    if system.cell is not None:
        known["force_measured"] = model[system.cell]

    checked = 0
    for balance, residuals in zip(system.balances, equations.residuals, strict=True):
        for residual, term in zip(residuals, balance.terms, strict=True):
            if not needs(equations, residual) <= set(known):
                continue
            found = array_evaluator(equations, [residual, term])(known)
            assert np.max(np.abs(found[residual])) <= 1e-9 * max(np.max(np.abs(found[term])), 1.0), residual
            checked += 1
    assert checked >= 1


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_an_unknown_input_changes_what_its_balance_says(name):
    """What enters at an input leaves the residual of its balance, divided by its capacity, and no other one."""
    system = SYSTEMS[name]
    equations = equations_of(system)
    known = random_values(system, equations)
    entries = {one: entry for one, entry in system.entries.items() if entry.target in system.inputs}
    model = array_evaluator(equations, equations.rates)(known)
    known |= {f"{state.name}_rate": model[rate] for state, rate in zip(equations.states, equations.rates, strict=True)}
    residual_of = {
        one: residual
        for balance, residuals in zip(system.balances, equations.residuals, strict=True)
        for one, residual in zip(balance.unknown_inputs, residuals, strict=True)
    }
    for one, entry in entries.items():
        scale = known[entry.capacity[0]] if entry.capacity else 1.0
        pushed = known | {entry.target: known[entry.target] + 0.3 / scale}
        residual = residual_of[one]
        before, after = (array_evaluator(equations, [residual])(values)[residual] for values in (known, pushed))

        assert np.abs(after - before) == pytest.approx(0.3 * np.ones(50), rel=1e-6), one


def test_a_name_that_a_system_lacks_is_an_error():
    """A declaration that names what is not there is refused when its file is read."""
    carriage = SYSTEMS["positioning"]

    for changes, says in (
        ({"outputs": {"position": "y"}}, "outputs: unknown state 'y'"),
        ({"drives": {"F_X": "drive_force"}}, "drives: unknown input 'F_X'"),
        ({"outputs": {"tilt": "x"}, "scored": ()}, "units: missing channel 'tilt'"),
        ({"units": {"position": "mm"}}, "channel position in mm; expected m"),
        ({"scored": (ScoredSignal("heat", "heat"),)}, "scored: unknown output 'heat'"),
        (
            {"balances": (replace(carriage.balances[0], entries=2 * carriage.balances[0].entries),)},
            "2 entries for 1 res",
        ),
    ):
        with pytest.raises(TypeError, match=says):
            replace(carriage, **changes)


@pytest.mark.parametrize("law", sorted(LAWS))
def test_records_at_once_are_what_the_functions_give_one_by_one(law):
    """The array evaluation and the plain one agree, with every friction law and every effect."""
    fitting = []
    for name, effect in EFFECTS.items():
        if effect.wired:
            with contextlib.suppress(InputError):  # it asks for a symbol that this law does not have
                Structure(law, law, effects=(name,))
                fitting.append(name)
    equations = Structure(law, law, effects=tuple(fitting)).equations
    parameters = dict.fromkeys(equations.parameter_names, 0.5)
    rng = np.random.default_rng(1)
    names = [*(state.name for state in equations.states), *equations.inputs]
    values = {name: 0.01 * rng.normal(size=20) for name in names}
    values |= {direction: np.sign(rng.normal(size=20)) for direction in equations.directions}

    at_once = array_evaluator(equations, equations.rates)({**parameters, **values})

    plain = evaluator(equations, parameters)
    for k in range(20):
        one = plain(**{name: float(value[k]) for name, value in values.items()})
        for rate in equations.rates:
            assert np.broadcast_to(at_once[rate], 20)[k] == pytest.approx(one[rate], rel=1e-12, abs=1e-15)


def test_a_carriage_slides_and_stops_as_the_closed_form_says(emps):
    """M dv/dt = -Fv v - (Fc + offset): an exponential to a stop at M/Fv ln(1 + Fv v0/(Fc + offset)), then it sticks."""
    M, Fv, F = emps["M"], emps["Fv"], emps["Fc"] + emps["offset"]
    v0, tau = 0.1, M / Fv
    stop = tau * np.log(1 + Fv * v0 / F)
    x_stop = tau * v0 - F / Fv * stop

    run = simulate(emps, np.zeros(1000), start=np.array([v0, 0.0]))

    t = run.time
    moving = t < stop
    expected = (v0 + F / Fv) * np.exp(-t / tau) - F / Fv
    np.testing.assert_allclose(run["v"][moving], expected[moving], atol=1e-7)
    assert (run["v"][~moving] == 0.0).all() and run.sticks("rod")[~moving].all()
    assert run["x"][-1] == pytest.approx(x_stop, rel=1e-6)


def test_a_driven_rod_turns_the_shaft_at_the_ratio_of_areas(take_off):
    """At constant rod speed without leakage and valves: omega = A v / D and D dP = K_T I - friction."""
    plant = take_off.with_structure(Structure("coulomb", "coulomb", "constant", (), "driven_rod")).set(K_L=0.0)
    v, current = 0.2, -6.0

    run = simulate(plant, np.full(4000, current), force=np.full(4000, v), hold="first_order", sample_time=0.01)

    omega = plant["A"] * v / plant["D"]
    friction = plant["A_FM"] + plant["B_FM"] * omega
    assert run["omega"][-1] == pytest.approx(omega, rel=1e-4)
    assert run["dP"][-1] == pytest.approx((plant["K_T"] * current - friction) / plant["D"], rel=1e-4)
    np.testing.assert_array_equal(run["v"], v)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["emps", "mbari_pto"])
def test_engine_and_reference_agree(name):
    """Another integrator on the plain functions: same states, same sticking, as for the EHSA."""
    plant = load_plant(name)
    t = 0.004 * np.arange(150)
    first = (60.0 if name == "emps" else 4.0) * np.sin(2 * np.pi * 3 * t)
    second = (10.0 if name == "emps" else 0.05) * np.cos(2 * np.pi * 2 * t)

    run = simulate(plant, first, force=second, hold="first_order", sample_time=0.004, tolerance=1e-8)
    reference = simulate_reference(plant, first, force=second, hold="first_order", sample_time=0.004)

    scale = [state.scale for state in plant.structure.equations.states]
    np.testing.assert_allclose(run.states / scale, reference.states / scale, atol=2e-5)
    assert np.mean(run.modes != reference.modes) < 0.02
    assert run.modes.shape == (150, 1)


def test_what_a_run_of_another_system_says(emps, take_off):
    """Signals by the system's own names, tables, summaries, sensors and batches."""
    carriage = simulate(emps, np.full(20, 50.0))
    rod = simulate(take_off, np.zeros(20), force=np.full(20, 0.01), hold="first_order")

    assert list(carriage.to_pandas()) == ["time", "F_M", "F_D", "v", "x", "rod"]
    assert list(rod.to_pandas()) == ["time", "current", "v", "omega", "P_1", "P_2", "shaft"]
    assert "rod sticks" in str(carriage) and "shaft sticks" in str(rod)
    assert set(Sensors.of(emps).log(carriage)) == {"position", "velocity", "drive_force"}
    assert set(Sensors.of(take_off).log(rod)) == {"current", "velocity", "speed", "p1", "p2"}
    assert np.isnan(carriage.pressure_level_drift) and np.isfinite(rod.pressure_level_drift)
    with pytest.raises(InputError, match=r"'F_cell' is not a state of the system 'positioning'; .*known: v, x"):
        carriage["F_cell"]
    batch = simulate_batch(emps, np.stack([emps.vector, emps.set(x_0=0.1).vector]), np.full(20, 50.0))
    assert batch.states[1, 0, 1] == 0.1 and (batch.status == 0).all()


def test_limits_are_watched_where_the_system_has_them(take_off):
    """Drawing out the rod of a take-off whose check valves are shut lets its pressure fall through the limit."""
    shut = take_off.set(K_check=0.0)

    run = simulate(shut, np.full(100, -20.0), force=np.full(100, 0.3), hold="first_order")

    assert [exceedance.limit for exceedance in run.exceeded] == ["pressure_min"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["emps", "mbari_pto"])
def test_derivatives_of_a_run(name):
    """The engine's derivatives by parameters are those of differences of two runs; the take-off without its valves."""
    plant = load_plant(name)
    plant = plant.with_structure(replace(plant.structure, effects=()))
    first = (60.0 if name == "emps" else 4.0) * np.sin(np.arange(100) / 20)
    symbols = ["M", "Fv"] if name == "emps" else ["D", "J_M", "B_FM"]
    how = {"force": np.full(100, 0.02), "sample_time": 0.004, "tolerance": 1e-9, "hold": "first_order"}

    found = sensitivities(plant, symbols, first, **how)

    for column, symbol in enumerate(symbols):
        step = 1e-5 * plant[symbol]
        above = simulate(plant.set(**{symbol: plant[symbol] + step}), first, **how).states
        below = simulate(plant.set(**{symbol: plant[symbol] - step}), first, **how).states
        difference = (above - below) / (2 * step)
        scale = np.max(np.abs(difference), axis=0)
        np.testing.assert_allclose(found.values[:, :, column] / scale, difference / scale, atol=5e-3)


@pytest.mark.slow
def test_a_controller_gets_what_there_is(emps):
    """A closed loop around a carriage: its position is measured; channels that it lacks read zero."""
    loop = run_closed_loop(emps, _Centring(0.004, 20.0, 1.0), np.tile([40.0, 0.0, 0.0], (200, 1)))

    assert loop.trajectory["F_M"][0] == 40.0 and loop.trajectory["x"][-1] > 0.01
    np.testing.assert_array_equal(loop.measured[:, 3], loop.trajectory["x"])
    assert not loop.measured[:, [0, 1, 2, 4]].any()


def test_the_paper_linear_models_are_for_the_actuator(emps):
    """(6) and (7) are for the EHSA; another system is refused. Its figure shows inputs and states."""
    labels = {axes.get_ylabel() for axes in simulate(emps, np.full(3, 50.0)).plot().axes}
    assert {"F_M\n(N)", "v\n(mm/s)", "x\n(mm)"} <= labels
    with pytest.raises(InputError, match="'positioning' system"):
        four_state(emps)


def test_a_sliding_carriage_is_linearised(emps):
    """M v' = F_M - F_D - Fv v: a pole at -Fv / M, an integrator, and 1 / M from either force."""
    system, p = linearise(emps), emps.values

    np.testing.assert_allclose(np.sort(system.poles()), [-p["Fv"] / p["M"], 0.0], rtol=1e-9)
    np.testing.assert_allclose(system.B, [[1.0 / p["M"], -1.0 / p["M"]], [0.0, 0.0]])
    assert system.input_labels == ["F_M", "F_D"] and system.output_labels == ["v", "x"]


def test_a_servo_is_linearised_with_its_position_loop():
    """J theta'' = -(K_T^2 / R + B_FM) theta' - (K_T U_0 kp c / R + m g l cos(theta + offset)) theta."""
    servo = load_plant("xl330_pendulum")
    p, c = servo.values, DUTY_PER_RADIAN
    inertia = p["J_M"] + p["m"] * p["l"] ** 2
    damping = (p["K_T"] ** 2 / p["R"] + p["B_FM"]) / inertia
    stiffness = (p["K_T"] * p["U_0"] * p["kp"] * c / p["R"] + p["m"] * GRAVITY * p["l"] * np.cos(p["offset"])) / inertia

    np.testing.assert_allclose(np.poly(linearise(servo).A), [1.0, damping, stiffness], rtol=1e-9)


def test_a_prescribed_rod_is_an_input_of_the_linear_model():
    """At v the shaft turns at A v / D without leakage; the second input is v, and moves oil by A beta / V."""
    pto = load_plant("mbari_pto")
    point, system, p = operating_point(pto, velocity=-0.1), linearise(pto, velocity=-0.1), pto.values

    assert point.inputs["v"] == -0.1 and point.inputs["current"] == 0.0
    assert point.states["omega"] == pytest.approx(-0.1 * p["A"] / p["D"], rel=1e-2)
    np.testing.assert_allclose(system.B[1:, 1], [-p["A"] * p["beta"] / p["V"], p["A"] * p["beta"] / p["V"]])
