"""The benchmark's cases that are nearer to a real rig: PID, logger, laws of other forms, logs that begin in motion."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks" / "withheld"))
import cases
import cycles
import draw
import gap
import laws
from cause import Bench, Conditions
from effect_gap import COARSE, THRESHOLD, EffectGap, simulated_signals
from effects_other_forms import OTHER_FORMS, draw_other_form
from effects_outside import OUTSIDE
from family import RIG_FAMILIES
from plant import simulate
from rig import Rig
from sensors import LOGGER_FAMILIES, NOISE, Sensors

pytestmark = pytest.mark.slow

PID = (300.0, 300.0, 12.0, 0.008, 6.0, 1e-6, 1e-4, 0.8)


def sine(n=500, amplitude=2.2):
    return amplitude * np.sin(2.0 * np.pi * 1.5 * 0.004 * np.arange(n))


# The loop.


def test_the_pid_reaches_its_place_and_keeps_its_limit():
    """After a move the rod stands within a millimetre of where it should be; the current keeps its limit."""
    move = cycles.reference("moves", 1500, 0.02, np.random.default_rng(4))
    wanted = np.concatenate([move, np.full(1000, move[-1])])

    run = simulate(Rig(), wanted, loop="PID", gains=PID)
    hard = simulate(Rig(), wanted, loop="PID", gains=(*PID[:4], 1.5, *PID[5:]))

    assert np.all(run.states[-50:, 3] == 0.0) and abs(run.states[-1, 4] - wanted[-1]) < 1e-3
    assert np.abs(hard.current).max() == 1.5


def test_the_pid_reads_whole_steps_of_its_encoder():
    """A proportional current against a coarse encoder has as many values as the encoder has steps on the way."""
    gains = (600.0, 0.0, 0.0, 0.008, 6.0, 1e-3, 0.0, 0.0)

    run = simulate(Rig(), np.full(200, 0.01), loop="PID", gains=gains)

    seen = 0.01 - run.current / 600.0
    assert np.allclose(seen, np.round(run.states[:-1, 4], 3)) and np.unique(np.round(seen, 9)).size > 3


@pytest.mark.parametrize("shape", cycles.SHAPES)
def test_references_are_smooth_and_stand_still(shape):
    """Within the reach, no jump of more than the fastest move makes in a sample, and with standstill."""
    r = cycles.reference(shape, 6000, 0.03, np.random.default_rng(0))

    assert r.size == 6000 and np.abs(r).max() <= 0.03 + 1e-12
    assert np.abs(np.diff(r)).max() <= 0.13 * 0.004
    assert np.mean(np.diff(r) == 0.0) > 0.05


# Laws of other forms.


def test_laws_of_other_forms_are_what_their_names_say():
    """Closed forms at single points."""
    # Straight up to the knee at 0.5 / k, then 40 % of the slope.
    assert laws.saturated(2.0, 0.2, 3.0) == 2.0
    assert laws.saturated(-4.0, 0.2, 3.0) == pytest.approx(-2.5 - 0.4 * 1.5)
    # Power 0.7, equal to the root at 10 bar.
    assert laws.orifice(1e6, 1e-9, 2.0) == pytest.approx(1e-9 * 1e3)
    assert laws.orifice(-2e6, 1e-9, 2.0) == pytest.approx(-1e-6 * 2.0**0.7)
    # Blasius: power 1.75, equal to the square at 1e-4 m3/s.
    assert laws.turbulent(1e-4, 1.75) == pytest.approx(laws.turbulent(1e-4, 2.0)) == pytest.approx(1e-8)
    assert laws.turbulent(-2e-4, 1.75) == pytest.approx(-1e-8 * 2.0**1.75)
    # Half of the air is dissolved at half of the saturation pressure.
    assert laws.free_air(30e5, 0.02) == pytest.approx(0.01) and laws.free_air(90e5, 0.02) == pytest.approx(0.001)
    # A cushion only brakes.
    assert laws.contact(1e-3, -0.1, 2.0) == pytest.approx(100.0)
    assert laws.contact(1e-3, 0.1, 2.0) == pytest.approx(2e7 * 1e-3 * 0.1 + 100.0)


def test_maxwell_slip_is_elastic_first_and_coulomb_at_last():
    """The full stiffness answers a small motion, the level of all sliders a long one; the way back has hysteresis."""
    force = np.zeros(3)
    laws.maxwell_slip(force, 30.0, 600.0)
    assert force.sum() == pytest.approx(30.0)
    for _ in range(100):
        laws.maxwell_slip(force, 30.0, 600.0)
    assert force.sum() == pytest.approx(600.0)
    laws.maxwell_slip(force, -150.0, 600.0)
    assert force.sum() == pytest.approx(450.0)


def test_neutral_sizes_are_neutral_under_every_law():
    """The number of a law changes nothing without its effect, to the last bit."""
    others = Rig(
        saturation_law=3.0, loss_law=2.0, lag_law=2.0, orifice_law=2.0, air_law=3.0, relief_law=2.0, bump_law=3.0,
        bristle_law=2.0, line_exponent=1.75, stop_law=2.0, warm_law=2.0, ripple_second=5.0, ripple_share=0.5,
    )  # fmt: skip

    assert np.array_equal(simulate(others, sine()).dense, simulate(Rig(), sine()).dense)


def test_an_open_relief_valve_closes_later_than_it_opens():
    """With hysteresis more oil leaves than through a valve that reseats where it cracks; below that none does."""
    peak = simulate(Rig(), sine()).states[:, 1:3].max()
    plain, late = (simulate(Rig(P_crack=0.97 * peak, relief_law=law), sine()).states for law in (0.0, 2.0))
    never = simulate(Rig(P_crack=1.01 * peak, relief_law=2.0), sine()).states

    assert late[:, 1:3].sum() < plain[:, 1:3].sum()
    assert np.array_equal(never, simulate(Rig(), sine()).states)


@pytest.mark.parametrize(
    "rig",
    [
        Rig(bristle=3e-8, bristle_law=2.0, line_exponent=1.75, R_turb=1e12, K_t=5e-9, orifice_law=2.0),
        Rig(tau_I=2e-3, lag_law=2.0, air=0.01, air_law=3.0, x_stop=0.008, stop_law=2.0, c_f=0.1, loss_law=2.0),
    ],
    ids=["Maxwell slip", "cushion"],
)
def test_a_shorter_step_changes_less_than_the_noise(rig):
    """An eighth of the step moves no channel by more than a tenth of its noise, RMS."""
    coarse, fine = simulate(rig, sine()).samples, simulate(rig, sine(), steps=640).samples

    noise = np.array([NOISE[name] for name in ("speed", "p1", "p2", "position", "force")])
    assert np.all(np.sqrt(np.mean((coarse - fine) ** 2, axis=0)) < 0.1 * noise)


@pytest.mark.parametrize("id", OTHER_FORMS)
def test_every_other_form_makes_a_gap(id):
    """Little at the small end of its range, a gap at the large one; no size to compare."""
    current = sine(1500 if id == "viscosity_warmup" else 500)
    conditions = Conditions(np.random.default_rng(1), simulate(Rig(), current).samples, 0.0)
    effect, effect_gap = draw_other_form(conditions, id), EffectGap(Rig(), current)

    small, large = (gap.largest(effect_gap.of_effect(effect, s).alone) for s in (effect.smallest, effect.largest))

    assert effect.id == id and effect.value(Bench(Rig())) == {}
    # Elastic sliders move the rod even at the nominal level.
    assert small < large and large > THRESHOLD and (small < 0.06 or id == "rod_friction")


# Logs.


def test_a_log_that_begins_in_motion_is_the_rest_of_one_from_rest():
    """Simulated through the current before it, the signals are those of the whole run without its beginning."""
    current, bench = sine(800), Bench(Rig(tau_I=0.01))

    whole = simulated_signals(bench, current, COARSE)
    rest = simulated_signals(bench, current[300:], COARSE, current[:300])

    for name in ("speed", "p1", "p2", "rod_velocity"):
        assert np.array_equal(rest[name], whole[name][300:])


def test_a_loggers_channels_come_in_steps():
    """Every value is a whole number of steps, with the noise and steps that the gap takes off."""
    sensors = Sensors.of_a_logger(np.random.default_rng(2))
    log = sensors.log(simulate(Rig(), np.zeros(4000), steps=4), np.random.default_rng(0), force=False)

    for name in ("current", "speed", "position"):
        steps = log[name] / sensors.step[name]
        # Rounded to the decimals of the CSV.
        assert np.abs(steps - np.round(steps)).max() * sensors.step[name] < 1e-4
    floor = gap.noise_of(sensors.noise, sensors.step)
    assert np.std(log["speed"]) == pytest.approx(floor["speed"], rel=0.05)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """One short case of each family."""
    folder = tmp_path_factory.mktemp("rigs")
    patch = pytest.MonkeyPatch()
    patch.setattr(draw, "SAMPLES", 2000)
    for family in RIG_FAMILIES:
        cases.write(draw.draw("tuning", family, 1), family, folder)
    patch.undo()
    return folder, cases.collect_keys(folder)


def test_each_family_is_what_it_says(drawn):
    """Nominal parameters beside an effect; one effect; several; none; one outside. The truth always leaves little."""
    _, key = drawn
    of = {family: [e["id"] for e in case["effects"]] for family, case in key.items()}

    off = key["nominals_off"]
    assert any(e["law"].endswith(" off") for e in off["effects"])
    assert not all(e["law"].endswith(" off") for e in off["effects"])
    assert all(0.05 <= abs(e) <= 0.15 for e in off["parameter_errors"].values())
    assert len(of["rig_loop"]) == 1 and of["other_form"][0] in OTHER_FORMS and len(of["several"]) > 1
    assert of["production"] == [] and of["outside_rig"] == [OUTSIDE]
    for family, case in key.items():
        assert all(max(e["alone"].values()) >= THRESHOLD for e in case["effects"])
        assert max(abs(e) for e in case["parameter_errors"].values()) < 0.006 or family in (
            "nominals_off",
            "production",
        )


def test_a_rigs_log_has_no_load_cell_and_names_its_filters(drawn):
    """The columns of the contract without force; small real filters stand below the threshold."""
    folder, key = drawn
    for family in LOGGER_FAMILIES:
        with (folder / f"{family}.csv").open() as file:
            header = next(csv.reader(file))

        assert header == ["t", "current", "speed", "p1", "p2", "position"] and not key[family]["load_cell"]
        small = {(e["id"], e["channel"]) for e in key[family]["below_threshold"]}
        assert {("sensor_filter", c) for c in ("speed", "p1", "p2")} <= small
