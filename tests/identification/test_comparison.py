"""A log replayed: fit by its definition, and the start by the rule."""

from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl import InputError, excitation, fit_percent, load_plant, read_plant_log, record, replay, simulate
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.identification.comparison import fit_words


@pytest.fixture(scope="module")
def bench():
    """Six seconds of noise at the bench, with the run behind it."""
    plant = load_plant("ehsa")
    time, current = excitation("noise", amplitude=4.0, duration=6.0, seed=1)
    log, run = record(plant, time, current, seed=1)
    return plant, log, run


def test_fit_percent_is_its_definition():
    """100 for the signal itself, 0 for its mean, 50 for half of it about the mean, nan for a constant."""
    y = np.array([1.0, 2.0, 4.0, 9.0])

    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(4, 4.0)) == pytest.approx(0.0)
    assert fit_percent(y, 4.0 + 0.5 * (y - 4.0)) == pytest.approx(50.0)
    assert np.isnan(fit_percent(np.full(4, 0.1), y))


def test_a_fit_is_called_good_from_90_percent_and_poor_below_70():
    """In words, the worst first; a channel without a fit is left out."""
    assert fit_words({"speed": 90.0, "p1": 56.0, "p2": 70.0, "position": np.nan, "force": -3.0}) == (
        "poor in p1 and force; fair in p2; good in speed"
    )
    assert fit_words({"speed": np.nan}) == ""


def test_the_right_plant_leaves_the_sensors_noise(bench):
    """The residual is as wide as the sensor table says."""
    plant, log, _ = bench
    again = replay(plant, log)

    assert again.start.words == "at rest, as the plant"
    np.testing.assert_array_equal(again.start.state, plant.rest)
    for channel in ("speed", "p1", "p2"):
        assert np.std(again.residual(channel)) < 1.6 * plant.sensors[channel].sd, channel
        expected = 100 * (
            1 - np.linalg.norm(again.residual(channel)) / np.linalg.norm(log[channel] - log[channel].mean())
        )
        assert again.fit_percent[channel] == pytest.approx(expected)
    with pytest.raises(InputError, match="no residual of 'force'"):
        again.residual("force")


def test_a_sensors_scale_bias_and_delay_are_in_the_simulated_channel(bench):
    """Simulated is what the sensor would show, without its noise."""
    plant, log, _ = bench
    sensors = dict(plant.sensors) | {"p1": replace(plant.sensors["p1"], scale=2.0, bias=1e5, delay=0.008)}

    plain, other = replay(plant, log), replay(replace(plant, sensors=sensors), log)

    np.testing.assert_allclose(other.simulated["p1"][2:], 2.0 * plain.simulated["p1"][:-2] + 1e5, rtol=1e-9)


def test_a_segment_in_motion_starts_from_the_second_before_it(bench):
    """The state is near the true one, and changes of what is scored don't move it."""
    plant, log, run = bench
    moving = int(np.argmax(np.abs(run["omega"][500:1000]))) + 500
    piece = log.segment(log.time[moving])
    start = replay(plant, piece).start
    doctored = replace(piece, channels={**piece.channels, "p1": piece["p1"] + 1e6, "speed": piece["speed"] + 50.0})

    assert start.words == "in motion, from the 1 s before it"
    scale = np.array([state.scale for state in plant.structure.equations.states])
    assert np.max(np.abs(start.state - run.states[moving]) / scale) < 0.1
    np.testing.assert_array_equal(replay(plant, doctored).start.state, start.state)


def test_without_anything_before_it_the_first_samples_say_the_state(bench):
    """Smoothed; coarser than a second of simulation, but near."""
    plant, log, run = bench
    moving = int(np.argmax(np.abs(run["omega"][500:1000]))) + 500
    piece = replace(log.segment(log.time[moving]), before=None)
    start = replay(plant, piece).start

    assert start.words == "in motion, from its first samples"
    scale = np.array([state.scale for state in plant.structure.equations.states])
    assert np.max(np.abs(start.state - run.states[moving]) / scale) < 1.0


def test_rest_at_another_level_is_where_the_log_is(plant):
    """The rod rests 30 mm out with other pressures: held there by friction."""
    state = plant.rest + np.array([0.0, 3e5, 1e5, 0.0, 0.03])
    current = np.concatenate([np.zeros(50), np.full(100, 2.0)])
    run = simulate(plant, current, start=state)
    channels = {"current": current, "speed": run["omega"], "p1": run["P_1"], "p2": run["P_2"], "position": run["x"]}

    start = replay(plant, Log(run.time, channels)).start

    assert start.words.startswith("at rest, with p1, p2, position")
    np.testing.assert_allclose(start.state[[0, 3]], 0.0, atol=0.0)
    np.testing.assert_allclose(start.state, state, atol=plant.sensors["p1"].sd)
    assert start.state[4] == pytest.approx(0.03, abs=plant.sensors["position"].sd)


def test_one_pressure_that_is_off_alone_is_its_sensors(bench):
    """Oil that leaves one chamber goes to the other, so that the plant's rest stands."""
    plant, log, _ = bench
    biased = replace(log, channels={**log.channels, "p1": log["p1"] + 1e5})

    assert replay(plant, biased).start.words == "at rest, as the plant"


def test_a_run_that_leaves_the_equations_has_no_fit(plant):
    """What there is is shown; the fits are nan and the sentence says why."""
    time = 0.004 * np.arange(3000)
    log = Log(time, {"current": np.full(3000, 8.0), "speed": np.sin(time), "position": np.cos(time)})
    run = replay(plant, log)

    assert "stopped at" in run.stopped and run.stopped in str(run)
    assert all(np.isnan(percent) for percent in run.fit_percent.values())
    assert np.isnan(run.simulated["speed"][-1])


def test_a_log_without_pressures_is_fitted_in_what_it_has(bench, tmp_path):
    """The missing channels are named, and simulated all the same."""
    plant, log, _ = bench
    log.to_pandas().drop(columns=["p1", "p2", "force"]).to_csv(tmp_path / "log.csv", index=False)
    part = read_plant_log(tmp_path / "log.csv", plant)
    again = replay(plant, part)

    assert part.missing == ("p1", "p2", "force")
    assert set(again.fit_percent) == {"speed", "position"}
    assert again.simulated["p1"].shape == (len(log),)
    assert list(again.to_pandas().columns)[:4] == ["t", "current", "speed_measured", "speed_simulated"]


def test_a_replay_shows_itself(bench):
    """A table as text and in a notebook, and a figure with a panel a channel."""
    plant, log, _ = bench
    again = replay(plant, log)

    assert "position" in str(again) and "at rest" in str(again)
    assert again._repr_html_().startswith("<pre>")
    assert len([ax for ax in again.plot().axes if ax.get_ylabel()]) == 5
    assert again.provenance["ehsa_ctrl"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,speed\n" + "".join(f"{0.004 * k},1\n" for k in range(50)), "no column 'current'"),
        (
            "t,current\n" + "".join(f"{0.004 * k},1\n" for k in range(50)),
            "none of the channels speed, p1, p2, position",
        ),
        (
            "t,current,speed\n" + "".join(f"{4 * k},1,2\n" for k in range(50)),
            r"probably in ms: write t = .*scale = 0.001",
        ),
        ("t,current,speed\n0,1,2\n0.004,1,2\n", "has 2 rows of data; expected at least 25"),
    ],
)
def test_a_log_that_is_of_no_use_is_a_sentence(plant, tmp_path, text, says):
    """A drive, an output, seconds, enough samples."""
    (tmp_path / "log.csv").write_text(text)

    with pytest.raises(InputError, match=says):
        read_plant_log(tmp_path / "log.csv", plant)
