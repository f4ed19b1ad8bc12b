"""Effects in the engine: neutral to the bit, felt where they say, the same in both paths."""

import numpy as np
import pytest

from ehsa_ctrl import (
    InputError,
    load_controller,
    load_plant,
    run_closed_loop,
    simulate,
    simulate_reference,
    three_state,
)
from ehsa_ctrl.physics.effects import EFFECTS, with_extended
from ehsa_ctrl.simulation.plant_code import plant_code

#: One structure with all of them: one text to compile, and neutral effects prove that they are neutral together too.
WIRED = [name for name, effect in EFFECTS.items() if effect.wired and effect.parameters]
#: Sizes at which those act that are typically out of reach.
REACHED = {"end_stop": 0.02, "relief_valve": 24e5, "anti_cavitation": 19e5}
#: Further forms of their laws.
FORMS = {
    "a_c2": 0.5, "E_w": 50.0, "b_f": 1.0, "c_w": 1e-4, "I_knee": 1.5, "x_cushion": 0.005, "P_diss": 20e5, "P_hyst": 1e5,
    "c_FR2": 0.2, "c_FR5": -0.1, "b_I": 0.6,
    "n_h": 60.0, "x_h": 4e-3, "w_h": 2e-3, "h_FR2": 0.3, "x_h2": -4e-3,
}  # fmt: skip
CURRENT = 2.0 * np.sin(np.linspace(0, 20, 1001))


def sizes(name):
    """First parameter of an effect, and of one that it extends, at a size that is felt."""
    firsts = {one: EFFECTS[one].parameters[0] for one in with_extended([name])}
    return {first.name: REACHED.get(one, first.typical) for one, first in firsts.items()}


@pytest.fixture(scope="module")
def every(loaded):
    """The loaded plant with every effect, all neutral."""
    neutral = {parameter.name: parameter.neutral for name in WIRED for parameter in EFFECTS[name].parameters}
    return loaded.with_effects(*WIRED, **neutral)


@pytest.fixture(scope="module")
def loaded():
    """The plant with a spring, so that everything at the rod is felt."""
    return load_plant("ehsa").set(K_S=5e4)


@pytest.mark.slow
def test_neutral_effects_change_no_bit(every, loaded):
    """With all of them at their neutral values every sample is the same number."""
    run = simulate(every, CURRENT)

    assert np.array_equal(run.states[:, :5], simulate(loaded, CURRENT).states)
    assert not run.states[:, 5:].any()


@pytest.mark.slow
@pytest.mark.parametrize("name", WIRED)
def test_an_effect_is_felt(every, loaded, name):
    """Each one, at its typical size, moves a signal by more than half a per cent of its spread."""
    extended = EFFECTS[name].extends
    without = every.set(**sizes(extended)) if extended in WIRED else loaded
    run, base = simulate(every.set(**sizes(name)), CURRENT), simulate(without, CURRENT)
    change = run.states[:, :5] - base.states[:, :5]
    moved = np.sqrt(np.mean(change**2, axis=0)) / np.std(base.states[:, :5], axis=0)

    assert np.max(moved) > 0.005


@pytest.mark.slow
def test_compiled_and_plain_agree_with_every_effect_on(every):
    """Nothing of an effect is lost between its function and the engine."""
    on = {key: value for name in WIRED if name != "drive_delay" for key, value in sizes(name).items()}
    plant = every.set(**{**on, **FORMS, "x_stop": 0.05})
    current = 2.5 * np.sin(np.linspace(0, 6, 76))
    run = simulate(plant, current, tolerance=1e-9)
    reference = simulate_reference(plant, current, method="LSODA", rtol=1e-9)
    size = np.max(np.abs(reference.states - reference.states[0]), axis=0)

    assert np.max(np.abs(run.states - reference.states) / size) < 5e-5


def test_every_effect_says_what_it_is():
    """Fields that lists, diagnoses and reports read; parameters within their bounds."""
    for effect in EFFECTS.values():
        kinds = [effect.wired, bool(effect.symbols), effect.sensor is not None, effect.rod_friction is not None]

        assert any(kinds), effect.name
        assert effect.summary and effect.fingerprint
        for parameter in effect.parameters:
            assert parameter.lower <= parameter.typical <= parameter.upper
            assert parameter.lower <= parameter.neutral <= parameter.upper


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("torque_constant", "set K_T instead"),
        ("sensor_bias", "set bias.CHANNEL instead"),
        ("presliding", 'set rod_friction = "lugre" instead'),
    ],
)
def test_an_effect_that_is_no_equation_says_what_to_write(plant, name, says):
    """A plant's effects = [...] takes equations alone."""
    with pytest.raises(InputError, match=says):
        plant.with_effects(name)


def test_a_dead_time_shifts_the_run(plant):
    """12 ms are three samples to the last bit; 5 ms equal a run at 1 ms with the current shifted by five samples."""
    late = plant.with_effects("drive_delay", T_d=0.0)
    base = simulate(plant, CURRENT)
    fine = np.concatenate([np.full(5, CURRENT[0]), np.repeat(CURRENT, 4)[:-5]])
    shifted = simulate(plant, fine, sample_time=0.001)

    assert np.array_equal(simulate(late, CURRENT).states, base.states)
    assert np.array_equal(simulate(late.set(T_d=0.012), CURRENT).states[3:], base.states[:-3])
    np.testing.assert_allclose(
        simulate(late.set(T_d=0.005), CURRENT).states,
        shifted.states[::4],
        atol=2e-6 * np.ptp(base.states, axis=0).max(),
    )


def test_a_dead_time_in_the_loop_is_a_lag(plant, linear):
    """8 ms in the drive and two samples of lag are the same loop."""
    late = plant.with_effects("drive_delay", T_d=0.008)
    pid = load_controller("pid_position", three_state(linear))
    reference = np.zeros((300, 3))
    reference[20:, 0] = 0.005
    a = run_closed_loop(late, pid, reference)
    b = run_closed_loop(plant, pid, reference, lag=2)

    assert np.array_equal(a.trajectory.states, b.trajectory.states)


def test_derivatives_by_a_dead_time_are_refused_with_a_way_out(plant):
    """The sentence says what does the same."""
    with pytest.raises(InputError, match=r"estimate delay\.CHANNEL instead"):
        plant_code(plant.with_effects("drive_delay").structure.equations, sensitivities=True)


@pytest.mark.slow
def test_closed_forms_of_the_drive(every):
    """A lag ends where the current does, along an exponential; an offset is a higher current."""
    steady = simulate(every.set(K_S=0.0, tau_I=0.02), np.full(500, 1.5))
    offset = simulate(every.set(K_S=0.0, I_0=0.2), np.full(500, 1.3))
    base = simulate(every.set(K_S=0.0), np.full(500, 1.5))

    assert steady["omega"][-1] == pytest.approx(base["omega"][-1], rel=1e-6)
    assert np.max(np.abs(offset.states - base.states)[:, :5] / np.ptp(base.states[:, :5], axis=0)) < 1e-9
    np.testing.assert_allclose(steady["I_A"], 1.5 * (1 - np.exp(-steady.time / 0.02)), atol=1e-5)


@pytest.mark.slow
def test_a_dead_band_is_a_lower_current(every):
    """Beyond the band a held current acts less by it, either way; within the band nothing does."""
    free = every.set(K_S=0.0)
    for sign in (1.0, -1.0):
        banded = simulate(free.set(I_db=0.3), np.full(300, sign * 1.8))
        base = simulate(free, np.full(300, sign * 1.5))
        np.testing.assert_allclose(banded.states[:, :5], base.states[:, :5], rtol=1e-9, atol=1e-9)

    assert not simulate(free.set(I_db=0.9), np.full(300, 0.89))["omega"].any()


@pytest.mark.slow
def test_a_lag_does_not_swallow_an_offset(every):
    """With both, the run ends where the offset alone takes it."""
    free = every.set(K_S=0.0, I_0=0.2)
    both = simulate(free.set(tau_I=0.02), np.full(500, 1.3))

    assert both["omega"][-1] == pytest.approx(simulate(free, np.full(500, 1.3))["omega"][-1], rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("symbol", "size", "displaced", "drag"),
    [
        ("k_w", 3e-6, lambda omega, dP: 1.0, lambda omega: 3e-6 * omega**2),
        ("w_d", 20.0, lambda omega, dP: (omega - 20.0) / omega, lambda omega: 0.0),
        ("k_f", 0.3, lambda omega, dP: 1.0 - 0.3 * (omega / 471.2) ** 2, lambda omega: 0.0),
        ("k_D", 2e-7, lambda omega, dP: 1.0 - 2e-7 * dP, lambda omega: 0.0),
    ],
)
def test_steady_balances_hold_with_what_the_pump_loses(every, symbol, size, displaced, drag):
    """At a held current the flow balance and the torque balance close with the effect's term, and not without it."""
    plant = every.set(K_S=0.0, **{symbol: size})
    end = simulate(plant, np.full(400, 1.6))
    omega, v, dP = (float(end[name][-1]) for name in ("omega", "v", "dP"))
    share = displaced(omega, dP)
    # A dead zone loses flow alone; the shaft turns against the whole pressure.
    felt = 1.0 if symbol == "w_d" else share
    flow = plant["A"] * v + plant["K_L"] * dP
    torque = plant["K_T"] * 1.6 - plant["A_FM"] - plant["B_FM"] * omega

    # The volumes still change a little with the stroke.
    assert flow == pytest.approx(plant["D"] * omega * share, rel=3e-3)
    assert torque == pytest.approx(plant["D"] * dP * felt + drag(omega), rel=3e-3)
    assert abs(share - 1.0) > 0.02 or drag(omega) > 0.02 * torque
