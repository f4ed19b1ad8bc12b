"""The virtual bench, and the logs of a bench that was written apart from this project."""

import json

import numpy as np
import pytest

from ehsa_ctrl import InputError, excitation, load_plant, record, simulate
from ehsa_ctrl.core.log_reader import read_log
from ehsa_ctrl.simulation.excitation import EXCITATIONS


@pytest.mark.parametrize("name", EXCITATIONS)
def test_every_excitation_keeps_its_amplitude_and_seed(name):
    """Starts at 0 s, ends at the duration, stays within the amplitude, and is the same for the same seed."""
    time, current = excitation(name, amplitude=2.0, duration=8.0, seed=3)

    assert time[0] == 0.0 and time[-1] == pytest.approx(8.0) and time.size == 2001
    assert 1.0 < np.max(np.abs(current)) <= 2.0 + 1e-12
    assert np.array_equal(current, excitation(name, amplitude=2.0, duration=8.0, seed=3)[1])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"name": "stepz"}, "did you mean 'steps'"),
        ({"name": "sine", "duration": 0.0}, "at least two samples"),
        ({"name": "sine", "duration": 1e8}, "at most 28800 s"),
        ({"name": "sine", "amplitude": float("nan")}, "finite"),
    ],
)
def test_a_wrong_excitation_is_a_sentence(arguments, says):
    """What is known, what was expected."""
    with pytest.raises(InputError, match=says):
        excitation(**arguments)


def test_the_log_is_the_truth_plus_the_sensors(plant):
    """Noise as wide as the sensor table says, position in steps of 10 um, force as the load cell feels it."""
    time, current = excitation("noise", amplitude=4.0, duration=10.0)
    log, run = record(plant.set(K_S=5e4), time, current, seed=5)

    for channel, signal in (
        ("speed", "omega"),
        ("p1", "P_1"),
        ("p2", "P_2"),
        ("force", "F_cell"),
        ("current", "current"),
    ):
        assert np.std(log[channel] - run[signal]) == pytest.approx(plant.sensors[channel].noise, rel=0.1), channel
    steps = log["position"] / 10e-6
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_the_load_cell_feels_the_loads_inertia_not_the_rods(plant):
    """With a mass behind it the cell reads the spring and m_L v', the rod's own mass does not show."""
    loaded = plant.set(K_S=2e4, m_L=50.0)
    current = 2.0 * np.sin(np.linspace(0, 20, 4001))
    run = simulate(loaded, current, sample_time=5e-4, tolerance=1e-9)
    acceleration = np.gradient(run["v"], run.time)
    smooth = np.abs(np.gradient(acceleration)) < 0.2

    np.testing.assert_allclose((run.cell_force - 2e4 * run["x"])[smooth], (50.0 * acceleration)[smooth], atol=3.0)


def test_centring_keeps_the_rod_in_its_stroke(plant):
    """Noise with an offset drives the rod away; the slow loop brings it back, and the log's current says so."""
    time, current = excitation("noise", amplitude=6.0, duration=24.0, seed=2)
    current = current + 0.3
    _, free = record(plant, time, current)
    log, held = record(plant, time, current, centre=True)

    assert np.max(np.abs(held["x"])) < 0.1 < np.max(np.abs(free["x"]))
    assert np.std(log["current"] - held.current) == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize("name", ["L04", "L13"])
def test_the_other_bench_without_effect_is_reproduced(shared_logs, name):
    """Logs of the independent bench: each signal's gap is what their key says, 1 and 2 %."""
    belief = json.loads((shared_logs / f"{name}.json").read_text())
    gap = json.loads((shared_logs / "key.json").read_text())[name]["gap"]
    log = read_log(shared_logs / f"{name}.csv", ["current", "speed", "p1", "p2", "position"])
    plant = load_plant(belief["plant"], model=belief["model"], settings={"load.stiffness": belief["spring_stiffness"]})
    run = simulate(plant, log["current"], sample_time=log.sample_time)

    def over_20_ms(x):
        return (x[5:] - x[:-5]) / 0.02

    position = np.hypot(20e-6, 10e-6 / np.sqrt(12))
    pairs = {
        "speed": (log["speed"], run["omega"], 0.5),
        "p1": (log["p1"], run["P_1"], 15e3),
        "p2": (log["p2"], run["P_2"], 15e3),
        "rod_velocity": (over_20_ms(log["position"]), over_20_ms(run["x"]), np.sqrt(2) * position / 0.02),
    }
    for signal, (measured, simulated, noise) in pairs.items():
        ours = np.sqrt(max(np.mean((measured - simulated) ** 2) - noise**2, 0.0)) / np.std(measured)

        assert ours < gap[signal] + 0.003, signal
