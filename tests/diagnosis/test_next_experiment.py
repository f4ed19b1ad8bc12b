"""The proposed experiment: limits by the bench itself, the promise by refits on logs of it, alike ones by equal plants.

The search works with any plant, so that most tests do without the slow engine of all effects.
"""

import shlex

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.core.log_reader import read_log
from ehsa_ctrl.diagnosis.excitation_library import library_inputs
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel
from ehsa_ctrl.diagnosis.model_discrimination import CandidateModels
from ehsa_ctrl.diagnosis.next_experiment import next_experiment
from ehsa_ctrl.diagnosis.objective import NominalParameters, Objective, ResidualScale
from ehsa_ctrl.diagnosis.refit import refit
from ehsa_ctrl.physics.effects import EFFECTS, CandidateEffect, FreeNumber
from ehsa_ctrl.simulation.bench import record
from ehsa_ctrl.simulation.excitation import excitation

NOISE = {"speed": 0.5, "p1": 15e3, "p2": 15e3, "position": 1e-5}
SECONDS = 6.0


def nominal_of(plant, names=("J_M", "K_L", "B_FR", "A_FR", "M")):
    """Parameters that may be wrong by a few per cent."""
    nominal = np.array([plant[name] for name in names])
    return NominalParameters(tuple(names), nominal, 0.03 * nominal, 0.1 * nominal)


def proposed(plant, hypotheses, **more):
    more = {"noise": NOISE, "nominal": nominal_of(plant), "seconds": SECONDS, **more}
    return next_experiment(plant, hypotheses, **more)


def test_inputs_stay_within_their_amplitude_and_begin_at_rest():
    """Every input of the library peaks at no more than its amplitude, uses most of it, and starts from zero."""
    time = 0.004 * np.arange(6001)

    for one in library_inputs():
        current = one.current(time, 2.0)

        assert current.shape == time.shape, one.words
        assert 1.5 < np.max(np.abs(current)) <= 2.0 + 1e-9, one.words
        assert current[0] == 0.0, one.words


def test_inputs_of_the_command_line_are_those_it_writes():
    time, _ = excitation("noise", duration=8.0)

    for one in library_inputs(seed=3):
        if one.excitation is not None:
            _, same = excitation(one.excitation, amplitude=1.7, duration=8.0, seed=3)
            np.testing.assert_array_equal(one.current(time, 1.7), same)


def test_a_band_holds_its_frequencies_alone():
    """Nearly all of the power of a multisine lies in the band that its words name."""
    time = 0.004 * np.arange(6000)
    bands = [one for one in library_inputs() if "multisine of 1-5" in one.words]
    assert len(bands) == 1

    power = np.abs(np.fft.rfft(bands[0].current(time, 1.0))) ** 2
    frequency = np.fft.rfftfreq(time.size, 0.004)

    assert power[(frequency > 0.95) & (frequency < 5.05)].sum() > 0.98 * power.sum()


def test_the_slow_loop_is_that_of_the_bench(plant):
    """The current with the loop's part is what the bench applies with its loop on, but for its steps of 0.1 s."""
    time = plant.sample_time * np.arange(2001)
    one_input = next(one for one in library_inputs() if "extending" in one.words)
    models = CandidateModels.of(plant, {"one": {}, "other": {"K_L": 8e-13}}, NOISE, nominal_of(plant))

    trial = models.trial(one_input, 1.5, {}, time, centre=True)

    _, bench = record(plant, time, one_input.current(time, 1.5), sensor_noise=False, centre=True)
    added = bench.current - one_input.current(time, 1.5)
    assert np.max(np.abs(added)) > 0.3
    error = trial.outputs.model.log["current"] - bench.current
    assert np.max(np.abs(error)) < 0.15 * np.max(np.abs(added))


@pytest.mark.parametrize("what", ["noise", "slow triangle", "sine at 2", "extending"])
def test_every_input_is_as_large_as_the_limits_allow(plant, what):
    """The bench passes no limit at the amplitude that is found for an input, whichever candidate is true, and passes
    one at half as much again."""
    candidates = {"one": {"A_FR": 700.0}, "other": {"K_L": 8e-13}}
    models = CandidateModels.of(plant, candidates, NOISE, nominal_of(plant))
    one_input = next(one for one in library_inputs() if what in one.words)
    time = plant.sample_time * np.arange(1001)

    largest, _ = models.largest_amplitude(one_input, {}, time)
    trial = models.trial(one_input, largest, {}, time)

    def passed(amplitude):
        runs = [record(plant.set(**v), time, one_input.current(time, amplitude))[1] for v in candidates.values()]
        return [limit for run in runs for limit in run.exceeded]

    assert not passed(trial.amplitude)
    assert passed(1.5 * trial.amplitude)


def test_what_a_nominal_parameter_makes_up_is_no_distance(plant):
    """Candidates that differ by 0.8 prior deviations of a nominal parameter are that far apart, large as it looks."""
    nominal = NominalParameters(
        ("K_T",), np.array([plant["K_T"]]), np.array([0.02 * plant["K_T"]]), np.array([0.05 * plant["K_T"]])
    )
    models = CandidateModels.of(plant, {"one": {}, "other": {"K_T": 1.016 * plant["K_T"]}}, NOISE, nominal)
    time = plant.sample_time * np.arange(1001)

    outputs = models.trial(library_inputs()[0], 2.0, {}, time).outputs

    assert outputs.largest_distances[0] > 5.0
    # The derivative is that at the one, and friction is not linear in all it does.
    assert models.distances(outputs)[0] == pytest.approx(0.8, rel=0.1)


def test_equal_candidates_give_none(plant):
    """Candidates that are the same plant under two names are not told apart by anything."""
    assert proposed(plant, {"one": {"K_L": 8e-13}, "other": {"K_L": 8e-13}}, spring_possible=False) is None


def test_an_equal_pair_is_named_and_the_rest_told_apart(plant):
    """Two of three candidates are equal: the experiment is for the third, and says so."""
    nominal = plant.set(K_S=50e3)
    leaks = {"K_L": 12e-13}

    found = proposed(nominal, {"leak": leaks, "wear": leaks, "drag": {"B_FR": 12e3}}, spring_possible=False)

    assert found.alike == (("leak", "wear"),)
    assert found.distance["leak", "wear"] == 0.0
    assert found.worst > 5.0
    assert "separates leak and wear" in found.words


@pytest.fixture(scope="module")
def loaded():
    """A proposal for the unloaded plant, with what it is for."""
    plant = ehsa_ctrl.load_plant("ehsa")
    candidates = {"leak": {"K_L": 12e-13}, "drag": {"B_FR": 11e3, "A_FR": 900.0}, "offset": {"bias.p1": 4e4}}
    return plant, candidates, proposed(plant, candidates)


def test_every_candidate_keeps_the_limits(loaded):
    """The bench finds no limit passed, between samples either, whichever candidate is true."""
    plant, candidates, found = loaded
    time = plant.sample_time * np.arange(found.current.size)
    nominal = plant.set(**({"K_S": found.load["stiffness"]} if found.load else {}))

    for values in candidates.values():
        true = nominal.set(**{n: v for n, v in values.items() if "." not in n})
        _, run = record(true, time, found.current, centre=found.centre)

        assert not run.exceeded
        assert not run.stopped


@pytest.mark.slow
def test_the_command_makes_the_experiment(loaded, tmp_path):
    """The command runs as it stands once the input is written, and applies the proposed current."""
    _, _, found = loaded
    found.write(tmp_path / "next_experiment.csv")

    result = CliRunner().invoke(app, shlex.split(found.command_in(tmp_path))[1:])

    assert result.exit_code == 0, result.output
    log = read_log(tmp_path / "next" / "log.csv", ["current"])
    # The sensor of the current has 5 mA of noise, and the loop adds its own.
    assert np.std(log["current"] - found.current) < (0.5 if found.centre else 0.01)


def test_words_name_what_to_do(loaded):
    _, _, found = loaded

    assert f"{found.amplitude:.3g} A" in found.words
    assert ("spring" in found.words) == bool(found.load)
    assert found.command in str(found)
    assert set(found.distance) == {("leak", "drag"), ("leak", "offset"), ("drag", "offset")}


def test_a_spring_in_question_is_not_removed(plant):
    """Two values of the spring's stiffness can't be told apart without the spring."""
    nominal = plant.set(K_S=50e3)

    found = proposed(nominal, {"soft": {"K_S": 44e3}, "stiff": {"K_S": 56e3}})

    assert found.load == {}
    assert found.worst > 5.0


@pytest.mark.parametrize(
    ("name", "hypotheses", "noise", "names", "largest"),
    [
        (
            "emps",
            {"friction": {"Fc": 26.0}, "mass": {"M": 114.0}},
            {"position": 1e-6},
            ("M", "Fv"),
            {"drive_force": 60.0, "position": 0.2},
        ),
        (
            "xl330_pendulum",
            {"friction": {"A_FM": 0.03}, "winding": {"R": 4.0}},
            {"angle": 5e-4},
            ("K_T", "J_M"),
            {"goal": 1.0, "angle": 1.2},
        ),
    ],
)
def test_carriage_and_servo_get_an_input_within_what_the_present_log_has_shown(name, hypotheses, noise, names, largest):
    """Their files state no limits: the bench drives the nominal plant no further than the present log did."""
    plant = ehsa_ctrl.load_plant(name)
    system, time = plant.structure.system, 0.004 * np.arange(501)
    wave = np.sin(2.0 * np.pi * time)
    channels = {channel: wave * value for channel, value in largest.items()}
    present = [HypothesisModel(plant, Log(time, {**dict.fromkeys(system.channels, 0.0 * time), **channels}))]

    found = next_experiment(
        plant, hypotheses, noise=noise, nominal=nominal_of(plant, names), seconds=SECONDS, present=present
    )

    assert found.worst > 5.0 and f"{found.amplitude:.3g} {system.drive_unit}" in found.words
    log, _ = record(
        plant, plant.sample_time * np.arange(found.current.size), found.current, centre=found.centre, sensor_noise=False
    )
    for channel, value in largest.items():
        assert np.max(np.abs(log[channel])) <= 1.001 * value


def test_a_candidate_alone_is_refused(plant):
    with pytest.raises(InputError, match=r"1 candidate\(s\); expected at least two"):
        proposed(plant, {"leak": {"K_L": 8e-13}})


@pytest.mark.slow
def test_leakages_are_told_apart_as_promised():
    """Refits of laminar against orifice leakage on logs of the bench: the proposal keeps its promise, and beats the
    paper's noise."""
    plant = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": 50e3}).with_effects("orifice_leakage")
    candidates = {"internal_leakage": {"K_L": 3.0 * plant["K_L"]}, "orifice_leakage": {"K_t": 6e-10}}
    nominal = nominal_of(plant)
    free = {
        id: (CandidateEffect(EFFECTS[id], (FreeNumber(name, value, scale, 0.0),), ()),)
        for id, name, value, scale in (
            ("internal_leakage", "K_L", plant["K_L"], 3e-13),
            ("orifice_leakage", "K_t", 0.0, 1e-10),
        )
    }

    def lead_of_the_truth(current, true):
        """Root of the deviance by which the true candidate beats the other on a noisy log of this current."""
        rng = np.random.default_rng(5)
        time = plant.sample_time * np.arange(current.size)
        empty = Log(time, {"current": current, **dict.fromkeys(NOISE, np.zeros(time.size))})
        shown = HypothesisModel(plant, empty).run([candidates[true]])[0]
        noisy = {c: v + NOISE[c] * rng.standard_normal(v.size) for c, v in shown.items()}
        log = Log(time, {"current": current, **noisy})
        model = HypothesisModel(plant, log)
        scale = ResidualScale.of(model, NOISE).scale
        objective = Objective(model, ResidualScale({c: s for c, s in scale.items() if c != "position"}), nominal)
        cost = {
            name: refit(objective, free[name], candidates[name], {}, steps=12, renew_after=4).cost
            for name in candidates
        }
        wrong = next(name for name in candidates if name != true)
        return np.sqrt(max(cost[wrong] - cost[true], 0.0))

    found = proposed(plant, candidates, nominal=nominal, seconds=8.0, spring_possible=False)

    promised = found.worst
    usual = excitation("noise", amplitude=1.5, duration=8.0)[1]
    there = [lead_of_the_truth(found.current, true) for true in candidates]
    assert 0.5 * promised < min(there) <= max(there) < 1.5 * promised
    assert min(there) > 3.0 * min(lead_of_the_truth(usual, true) for true in candidates)
    assert promised == max(found.tried.values())
    assert len(found.tried) > 1
