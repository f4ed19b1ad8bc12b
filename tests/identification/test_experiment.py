"""Design of experiments: limits are kept, and predicted standard deviations agree with simulated logs."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pandas
import pytest
from scipy import stats

from ehsa_ctrl import InputError, design_experiment, excitation, forecast, load_plant, read_log, record, simulate
from ehsa_ctrl.identification.gauss_newton import fit
from ehsa_ctrl.identification.input_limits import LimitUse, limit_shares, variations
from ehsa_ctrl.identification.input_search import InputSearch, rank
from ehsa_ctrl.identification.input_shapes import PACES, joined, single_shapes
from ehsa_ctrl.identification.parameters import free_parameters
from ehsa_ctrl.identification.predicted_accuracy import check_accuracy
from ehsa_ctrl.identification.shooting import shooting_windows
from ehsa_ctrl.simulation.limits import reached


@pytest.fixture(scope="module")
def proposal():
    """A multisine of 10 s for the paper's plant."""
    return design_experiment(load_plant("ehsa"), duration=10.0, kind="multisine", draws=4, rehearsals=4)


def with_limits(plant, **values):
    """The same plant with other limits, SI units."""
    changed = {name: replace(plant.limits[name], value=value) for name, value in values.items()}
    return replace(plant, limits={**plant.limits, **changed})


def test_a_stroke_is_said_as_the_distance_from_the_middle():
    """Half of a stroke of 200 mm lies to either side, so that a rod at 43 mm is on 43 % of its way to 100 mm."""
    use = LimitUse("stroke", "m", allowed=0.2, reached=0.086, worst=0.12, share=0.43, worst_share=0.6)

    assert str(use) == ("stroke (distance from mid-stroke) 43 mm (43 % of the way to 100), at worst 60 mm (60 %)")


def test_the_limits_are_kept_on_the_plant_and_its_variations(plant, proposal):
    """The proposed current leaves the margin on the nominal plant, and the plain limits on every variation."""
    run = simulate(plant, proposal.current)
    used = limit_shares(plant, reached(plant, run.current, run.states, run.extremes))

    assert not proposal.centre and run.exceeded == ()
    assert max(used.values()) <= 1 - proposal.margin + 1e-3
    others = variations(plant, free_parameters(plant), proposal.spread, 4, proposal.seed)
    assert len(others) == 4
    for other in others:
        assert simulate(other, proposal.current).exceeded == ()


def test_the_current_as_a_file_is_what_the_run_had(proposal, tmp_path):
    """current.csv gives the same trajectory on the nominal plant, to within the file's digits."""
    log = read_log(proposal.write(tmp_path / "current.csv"), ["current"])
    run = simulate(proposal.plant, log["current"], sample_time=log.sample_time)

    assert np.max(np.abs(run["x"] - proposal.run["x"])) < 1e-5
    assert np.max(np.abs(run["omega"] - proposal.run["omega"])) < 1.0


def test_all_parameters_of_the_paper_are_determined(proposal):
    """Each of the eleven within 5 % in ten seconds, and the criterion is no less than the worst of them."""
    relative = proposal.forecast.relative

    assert len(relative) == 11 and max(relative.values()) < 0.05
    assert max(relative.values()) <= proposal.calibration * proposal.chosen.score
    assert proposal.calibration == max(1.0, proposal.check.ratio)
    assert proposal.undetermined == {}
    assert [c.rank for c in proposal.candidates] == sorted(c.rank for c in proposal.candidates)


def test_the_check_fails_a_prediction_that_is_too_small(plant, proposal):
    """The same logs contradict a third of the predicted sd."""
    assert proposal.check.passed and 0.6 < proposal.check.ratio < 1.4
    boast = replace(
        proposal.forecast, fit=replace(proposal.forecast.fit, information=9 * proposal.forecast.fit.information)
    )
    found = check_accuracy(boast, free_parameters(plant), proposal.current, logs=2, jobs=2)

    assert not found.passed and found.ratio > 1.8
    assert "more than it predicts" in str(found)


def test_the_predicted_sd_is_scaled_by_the_check(plant, proposal):
    """Errors 1.2 times the linear theory's make every sd 1.2 times as large; smaller errors change nothing."""
    own = proposal.chosen.forecast
    larger, smaller = (
        replace(proposal, checks={0: replace(proposal.check, ratio=ratio)}, chosen=proposal.candidates[0])
        for ratio in (1.2, 0.8)
    )

    np.testing.assert_allclose(larger.forecast.uncertainty.sd, 1.2 * larger.chosen.forecast.uncertainty.sd)
    assert larger.forecast["M"].sd == pytest.approx(1.2 * larger.chosen.forecast["M"].sd)
    np.testing.assert_allclose(smaller.forecast.uncertainty.sd, smaller.chosen.forecast.uncertainty.sd)
    assert own["M"].value == plant["M"]


@pytest.mark.slow
def test_the_amplitude_that_is_found_is_a_minimum(plant):
    """Over the screening time no amplitude of a fine grid tells ten per cent more than the best that was tried."""
    search = InputSearch(plant, free_parameters(plant), 8.0, None, "worst", 0.15, 0.3, 0, 0, 1, None)
    shape = next(single_shapes("sine", 0, 1))
    trials = search.screen(shape, plant)

    amplitudes = np.linspace(0.3, 1.0, 15) * max(trial.amplitude for trial in trials)
    runs = (search._accuracy(search.runs.run(search.short, shape.current(search.short, a))) for a in amplitudes)
    grid = [rank(here.fit.information, here.sizes, "worst") for here in runs if here is not None]

    assert min(trial.rank for trial in trials)[0] == 0 and len(trials) > 3
    assert min(trial.rank for trial in trials)[1] < 1.1 * min(grid)[1]


@pytest.mark.slow
def test_the_predicted_sd_agrees_with_simulated_logs(proposal):
    """32 logs of the bench, each estimated: squared errors over predicted variances are chi-square, pooled and each."""
    plant, names = proposal.plant, [e.name for e in proposal.forecast.estimates]
    parameters = free_parameters(plant)
    truth = np.array([plant[name] for name in names])

    def estimate(seed):
        log, _ = record(plant, proposal.time, proposal.current, seed=seed)
        return fit(plant, shooting_windows(plant, log, None), parameters, drive_errors=True).values

    with ThreadPoolExecutor(2) as pool:
        values = np.array(list(pool.map(estimate, range(100, 132))))
    covariance = proposal.forecast.uncertainty.covariance
    errors = (values - truth) @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    # Whitened by the whole covariance the errors are independent, so that all of them can be pooled.
    low, high = stats.chi2.ppf([0.0005, 0.9995], errors.size)

    assert low < np.sum(errors**2) < high
    each = np.sum(((values - truth) / proposal.forecast.uncertainty.sd) ** 2, axis=0)
    low, high = stats.chi2.ppf([0.00005, 0.99995], len(values))
    assert np.all((low < each) & (each < high))


def test_twice_the_time_tells_more(plant):
    """Every sd falls when the same steps go on for twice as long."""
    short, long = (forecast(plant, *excitation("steps", amplitude=1.5, duration=T)) for T in (4.0, 8.0))

    for name in short.relative:
        assert long[name].sd < short[name].sd


def test_no_current_tells_nothing(plant):
    """At rest nothing is determined."""
    found = forecast(plant, np.arange(501) * 0.004, np.zeros(501))

    assert set(found.undetermined) == set(plant.free)
    assert "not identifiable from this input" in str(found)


def test_parameters_that_trade_places_are_named(linear):
    """Of the linear plant only V/beta shows."""
    found = forecast(linear, *excitation("noise", duration=4.0), free=["beta"])

    assert found.undetermined == {"V": ("beta",), "beta": ("V",)}


def test_more_noise_gives_larger_sd(plant):
    """All sensors and the drive twice as noisy: every sd doubles."""
    noisy = replace(
        plant, sensors={k: replace(s, noise=2 * s.noise, step=2 * s.step) for k, s in plant.sensors.items()}
    )
    time, current = excitation("multisine", amplitude=2.0, duration=4.0)
    once, twice = forecast(plant, time, current), forecast(noisy, time, current)

    np.testing.assert_allclose(twice.uncertainty.sd, 2 * once.uncertainty.sd, rtol=1e-6)


def test_information_adds_over_two_parts(plant):
    """A pair is a little better than the two halves apart, which do not share their initial states."""
    noise, sine = next(single_shapes("noise", 0, 1)), next(single_shapes("sine", 0, 1))
    shape, amplitude = joined(noise, 2.0, sine, 1.5)
    time = 0.004 * np.arange(2000)
    whole = forecast(plant, time, shape.current(time, amplitude)).fit.information
    parts = sum(
        forecast(plant, time[:1000], s.current(time[:1000], a)).fit.information for s, a in ((noise, 2.0), (sine, 1.5))
    )

    np.testing.assert_allclose(np.diag(whole), np.diag(parts), rtol=0.5)


def test_a_lone_shape_is_the_excitation_of_its_name():
    """Pace 1 and the same seed: what `ehsa-ctrl simulate --excitation` would apply."""
    for kind in PACES:
        shape = next(single_shapes(kind, 5, 1))
        time, current = excitation(kind, amplitude=1.2, duration=3.0, seed=5)

        np.testing.assert_array_equal(shape.current(time, 1.2), current)


def test_criteria_of_a_known_covariance():
    """Independent sd of 1 and 4 %: worst 4 %, mean axis 2 %; what nothing shows is counted."""
    sizes = np.array([2.0, 5.0])
    information = np.diag(1.0 / (sizes * [0.01, 0.04]) ** 2)

    assert rank(information, sizes, "worst") == (0, pytest.approx(0.04))
    assert rank(information, sizes, "D") == (0, pytest.approx(0.02))
    assert rank(np.diag([information[0, 0], 0.0]), sizes, "worst") == (1, pytest.approx(0.01))


def test_shares_count_from_rest(plant):
    """Pressures from P_0 = 20 bar: 10 bar is half of the way down, 115 bar half of the way up."""
    limited = replace(plant, limits={name: plant.limits[name] for name in ("pressure_min", "pressure_max", "stroke")})

    assert limit_shares(limited, {"pressure_min": 10e5, "pressure_max": 115e5, "stroke": 0.05}) == {
        "pressure_min": pytest.approx(0.5),
        "pressure_max": pytest.approx(0.5),
        "stroke": pytest.approx(0.25),
    }


def test_a_tighter_limit_gives_a_smaller_input(plant, proposal):
    """Half of the pump's speed costs precision, and is kept."""
    slow = design_experiment(
        with_limits(plant, pump_speed=0.4 * plant.limits["pump_speed"].value),
        duration=10.0,
        kind="multisine",
        draws=4,
        rehearsals=0,
    )

    assert np.max(np.abs(slow.run["omega"])) < np.max(np.abs(proposal.run["omega"]))
    assert slow.run.exceeded == ()


def test_a_cap_on_the_current_is_kept(plant):
    """--amplitude is the largest current that is asked for, the loop's part included."""
    found = design_experiment(plant, duration=4.0, kind="noise", amplitude=1.8, draws=2, rehearsals=0)

    assert np.max(np.abs(found.current)) <= 1.8 + 1e-9


def test_the_linear_plant_has_a_proposal(linear):
    """Its six parameters, with the volume of the uncertainty as criterion."""
    found = design_experiment(linear, duration=4.0, kind="steps", criterion="D", draws=2, rehearsals=0)

    assert set(found.forecast.relative) == {"J_M", "B_FM", "V", "K_L", "M", "B_FR"}
    assert found.chosen.score < 0.05


@pytest.mark.slow
def test_the_best_is_at_least_as_good_as_each_kind(plant):
    """All kinds and pairs of them: the paper's noise is among the candidates and not better than what is chosen."""
    best = design_experiment(plant, duration=6.0, draws=2, rehearsals=0)
    kinds = {c.shape.kind for c in best.candidates}

    assert {"noise", "multisine", "steps", "sine"} <= kinds and any(", then " in kind for kind in kinds)
    assert any(c.words.startswith("noise 0.2-15 Hz, ") and len(c.shape.parts) == 1 for c in best.candidates)
    assert best.chosen.rank == min(c.rank for c in best.candidates)
    assert len(best.to_pandas()) == len(best.candidates)


@pytest.mark.parametrize(
    ("change", "arguments", "says"),
    [
        (None, {"kind": "nois"}, "did you mean 'noise'"),
        (None, {"duration": 0.1}, "expected 1 to 600 s"),
        (None, {"criterion": "A"}, "no criterion 'A'"),
        (None, {"margin": 1.0}, "margin = 1; expected"),
        (None, {"spread": -0.1}, "spread = -0.1; expected"),
        (None, {"amplitude": 0.0}, "amplitude = 0 A; expected more than 0"),
        (None, {"amplitude": 0.3}, "no input of no more than 0.3 A moves shaft and rod"),
        (None, {"free": ["x_0"]}, "x_0: no input shows it in speed, p1, p2, position"),
        (lambda p: with_limits(p, stroke=0.0), {}, "above all the limit stroke = 0 mm, moves shaft and rod"),
        (lambda p: with_limits(p, pressure_max=15e5), {}, "pressure_max = 15 bar less a margin of 15 % is passed"),
        (
            lambda p: p.set(F_pre=50e3),
            {},
            "the limit stroke = 200 mm less a margin of 15 % is passed without any input",
        ),
        (lambda p: p.set(F_0=5e3), {}, "less friction does not hold the load"),
        (lambda p: replace(p, limits={}), {}, r"has no \[limits\], so any input is allowed; give an amplitude"),
        (
            lambda p: replace(p, sensors={**p.sensors, "p1": replace(p.sensors["p1"], noise=0.0)}),
            {},
            r"gives no noise of p1",
        ),
    ],
)
def test_what_no_input_can_do_is_a_sentence(plant, change, arguments, says):
    """What was wrong, and what to do."""
    given = plant if change is None else change(plant)

    with pytest.raises(InputError, match=says):
        design_experiment(given, **{"duration": 2.0, "kind": "sine", "rehearsals": 0, **arguments})


def test_a_prescribed_motion_is_refused():
    """It would have to be designed beside the current."""
    with pytest.raises(InputError, match="mbari_pto: the motion of its rod is prescribed"):
        design_experiment(load_plant("mbari_pto"))


def test_an_input_for_a_carriage(tmp_path):
    """In the unit and channel of its drive. The velocity, whose sensor has no noise, is not logged. Estimates from
    simulated logs scatter as predicted."""
    found = design_experiment(load_plant("emps"), kind="sine", duration=4.0, amplitude=100.0, rehearsals=2, draws=2)

    assert not found.undetermined and found.check.passed and found.check.ratio < 2.0
    assert np.max(np.abs(found.current)) <= 100.0 + 50.0 and " N" in found.chosen.words
    table = pandas.read_csv(found.write(tmp_path / "input.csv"))
    assert list(table) == ["t", "drive_force"]


def test_an_input_for_a_servo():
    """Its goal in rad, without a loop around the arm; K_T and R alone can't be told apart with voltage drive, as only
    K_T / R and K_T^2 / R act."""
    found = design_experiment(
        load_plant("xl330_pendulum"), kind="sine", duration=3.0, amplitude=1.0, rehearsals=0, draws=0
    )

    assert not found.centre and " rad" in found.chosen.words
    assert found.forecast.relative["J_M"] < 0.2
