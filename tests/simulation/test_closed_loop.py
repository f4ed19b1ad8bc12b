"""The sampled loop: compiled and plain controllers, sensors, delays, faults of sensors and drive."""

import signal
import time
from dataclasses import dataclass, replace

import numba
import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl import InputError, SimulationError, load_controller, run_closed_loop, simulate, three_state
from ehsa_ctrl.plant.plant import Sensor
from ehsa_ctrl.simulation.faults import DriveLimit, Faults, SensorFault
from ehsa_ctrl.simulation.sensors import Sensors


@pytest.fixture
def pid(linear):
    return load_controller("pid_position", three_state(linear))


def steps(samples=400):
    reference = np.zeros((samples, 3))
    reference[20:, 0] = 0.005
    return reference


def test_plain_and_compiled_controller_are_one(plant, pid):
    """The same text, run in Python and compiled, with noise and quantised sensors: equal to the last bit."""
    sensors = Sensors.of(plant, seed=4)
    loaded = plant.set(K_S=5e4)
    a = run_closed_loop(loaded, pid, steps(), sensors=sensors, lag=1)
    b = run_closed_loop(loaded, pid, steps(), sensors=sensors, lag=1, compiled=False)

    assert np.array_equal(a.trajectory.states, b.trajectory.states)
    assert np.array_equal(a.asked, b.asked) and np.array_equal(a.measured, b.measured)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer's signal")
def test_an_interrupt_arrives_as_itself(plant, pid):
    """Ctrl-C at 40 moments of runs so short that starting them is most of the work."""
    short = steps(3)
    run_closed_loop(plant, pid, short)

    def run_until_interrupted(after):
        signal.setitimer(signal.ITIMER_REAL, after)
        end = time.monotonic() + 30.0
        while time.monotonic() < end:
            run_closed_loop(plant, pid, short)

    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        for k in range(40):
            with pytest.raises(KeyboardInterrupt):
                run_until_interrupted(0.005 + 1.7e-4 * k)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_the_linear_loop_is_the_discrete_one(linear, pid):
    """Without limit and noise, the loop on the linear plant is the product of two discrete systems."""
    from scipy.signal import cont2discrete

    from ehsa_ctrl import four_state

    free = replace(pid, law=replace(pid.law, current_limit=1e9))
    run = run_closed_loop(linear, free, steps(), tolerance=1e-10)
    system = four_state(linear)
    a, b, *_ = cont2discrete((system.A, system.B[:, :1], np.eye(5), np.zeros((5, 1))), 0.004)
    memory, state, positions = free.initial_memory(), np.zeros(5), []
    for row in steps():
        positions.append(state[4])
        u = free.step(row, np.array([0, 0, 0, state[4], 0.0]), memory)
        state = a @ state + b[:, 0] * u

    np.testing.assert_allclose(run.trajectory["x"], positions, atol=1e-10)


@dataclass(frozen=True)
class Given:
    """A controller that plays a current back and remembers what it was shown."""

    current: np.ndarray
    name: str = "given"
    sample_time: float = 0.004
    compiled: object = None
    traces = {"samples": 0}

    def settings(self):
        return np.zeros(1)

    def initial_memory(self):
        return np.zeros(1)

    def step(self, reference, measured, memory):
        memory[0] += 1
        return float(self.current[int(memory[0]) - 1])


def test_a_played_back_current_is_an_open_loop_run(plant):
    """A plain Python controller that ignores its inputs gives what `simulate` gives, to the last bit."""
    from ehsa_ctrl import simulate

    current = 1.7 * np.sin(np.linspace(0, 9, 200))
    loop = run_closed_loop(plant, Given(current), np.zeros((200, 3)))

    assert np.array_equal(loop.trajectory.states, simulate(plant, current).states)
    assert np.array_equal(loop.trajectory.cell_force, simulate(plant, current).cell_force)


def _undefined(reference, measured, memory, settings):
    return undefined_thing  # noqa: F821


@pytest.mark.parametrize(
    ("step", "why"),
    [
        (lambda *_: 0.0, "function is no function of numba.njit"),
        (numba.njit(lambda reference, measured, memory: 0.0), "4 argument types given, but function takes 3"),
        (numba.njit(lambda reference, measured, memory, settings: "1 A"), "No conversion from Literal"),
        (numba.njit(lambda reference, measured, memory, settings: None), "none"),
        (numba.njit(_undefined), "undefined_thing"),
        (numba.njit("int64(float64[::1], float64[::1], float64[::1], float64[::1])")(lambda r, m, s, p: 1), "int64"),
    ],
    ids=["plain", "three", "text", "none", "undefined", "whole"],
)
def test_a_compiled_step_that_can_t_be_used_is_one_sentence(plant, step, why):
    """The sentence says why."""
    with pytest.raises(
        InputError, match=f"given: compiled can't be used [(].*{why}.*[)]; expected a function"
    ) as caught:
        run_closed_loop(plant, Given(np.zeros(5), compiled=step), np.zeros((5, 3)))

    assert "\n" not in str(caught.value) and "\x1b" not in str(caught.value)


def test_a_compiled_step_may_return_a_whole_number(plant):
    """It is a current in amperes."""
    step = numba.njit(lambda reference, measured, memory, settings: 1)

    loop = run_closed_loop(plant, Given(np.zeros(5), compiled=step), np.zeros((5, 3)))

    assert loop.asked.tolist() == [1.0] * 5


def test_what_a_compiled_step_raises_arrives(plant):
    """An exception within the compiled loop is raised with its words."""

    @numba.njit
    def step(reference, measured, memory, settings):
        if memory[0] > 2:
            raise ValueError("no current any more")
        memory[0] += 1
        return 0.0

    with pytest.raises(ValueError, match="no current any more"):
        run_closed_loop(plant, Given(np.zeros(9), compiled=step), np.zeros((9, 3)))


@pytest.mark.parametrize(
    ("returned", "what"),
    [
        (np.zeros(1, dtype=np.float32), "an array (1,) of float32"),
        (np.zeros((1, 1)), "an array (1, 1) of float64"),
        ([0.0], "list"),
    ],
)
@pytest.mark.parametrize("of", ["settings", "initial_memory"])
def test_a_controller_of_ones_own_that_returns_no_floats_is_refused(plant, monkeypatch, of, returned, what):
    """The engine reads the numbers in place."""
    monkeypatch.setattr(Given, of, lambda self: returned)

    with pytest.raises(InputError) as caught:
        run_closed_loop(plant, Given(np.zeros(9)), np.zeros((9, 3)))

    assert str(caught.value) == f"controller given: {of}() returns {what}; expected an array (k,) of float64"


def test_a_lag_moves_the_current_by_whole_samples(plant):
    """With a lag of 3 the motor sees each current 12 ms late, and nothing before."""
    from ehsa_ctrl import simulate

    current = 1.7 * np.cos(np.linspace(0, 9, 200))
    loop = run_closed_loop(plant, Given(current), np.zeros((200, 3)), lag=3)
    late = np.concatenate([np.zeros(3), current[:-3]])

    assert np.array_equal(loop.trajectory.states, simulate(plant, late).states)
    assert np.array_equal(loop.trajectory.current, late)


def test_sensors_delay_round_and_add_noise(plant):
    """What the controller sees is the true signal, late, noisy and rounded, each as its sensor says."""
    current = np.full(500, 1.6)
    sensors = Sensors.of(plant, ideal=True)
    table = dict(sensors.by_channel)
    table["position"] = Sensor("position", "m", step=1e-4)
    table["speed"] = Sensor("speed", "rad/s", noise=2.0)
    table["p1"] = Sensor("p1", "Pa", delay=0.006)
    loop = run_closed_loop(plant, Given(current), np.zeros((500, 3)), sensors=Sensors(table, 1))
    speed, p1, _, position, _ = loop.measured.T
    true = loop.trajectory

    np.testing.assert_allclose(position, np.round(true["x"] / 1e-4) * 1e-4, atol=1e-12)
    assert np.std(speed - true["omega"]) == pytest.approx(2.0, rel=0.15)
    np.testing.assert_allclose(p1[10:], np.interp(true.time[10:] - 0.006, true.time, true["P_1"]), rtol=1e-12)


def test_a_filter_in_the_loop_is_the_logs(plant):
    """Sample by sample, the controller sees what the log of the same run shows: filtered, then late."""
    table = dict(Sensors.of(plant, ideal=True).by_channel)
    table["speed"] = Sensor("speed", "rad/s", filter=7e-3, delay=0.006, scale=1.1, bias=2.0)
    table["force"] = Sensor("force", "N", filter=1e-6)
    sensors = Sensors(table)
    loop = run_closed_loop(plant, Given(np.full(300, 1.6)), np.zeros((300, 3)), sensors=sensors)
    true = loop.trajectory

    assert np.ptp(true["omega"]) > 50.0
    np.testing.assert_allclose(loop.measured[:, 0], sensors.measure("speed", true["omega"], 0.004), rtol=1e-12)
    np.testing.assert_allclose(loop.measured[:, 4], sensors.measure("force", true["F_cell"], 0.004), rtol=1e-12)
    assert np.array_equal(loop.measured[:, 1], true["P_1"])


def test_a_channels_noise_does_not_depend_on_the_others(plant):
    """Silencing the speed sensor leaves the position's noise as it was: runs stay comparable."""
    a = Sensors.of(plant, seed=9)
    b = Sensors({**a.by_channel, "speed": Sensor("speed", "rad/s")}, 9)

    assert np.array_equal(a.noise("position", 50), b.noise("position", 50))
    assert not np.array_equal(a.noise("position", 50), Sensors.of(plant, seed=8).noise("position", 50))


def test_a_current_that_is_no_number_stops_the_run(plant):
    """The run ends with the time and the reason."""
    current = np.full(100, 1.0)
    current[40] = np.nan

    with pytest.raises(SimulationError, match=r"with given: stopped at 0\.16 s: the controller returned a current"):
        run_closed_loop(plant, Given(current), np.zeros((100, 3)))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"reference": np.zeros((10, 2))}, r"expected \(samples, 3\)"),
        ({"reference": np.full((10, 3), np.nan)}, "finite"),
        ({"reference": np.zeros((10, 3)), "force": np.zeros(9)}, r"expected \(10,\)"),
        ({"reference": np.zeros((10, 3)), "lag": -1}, "whole number"),
    ],
)
def test_wrong_input_is_a_sentence(plant, pid, arguments, says):
    """What was got, what was expected."""
    reference = arguments.pop("reference")

    with pytest.raises(InputError, match=says):
        run_closed_loop(plant, pid, reference, **arguments)


def test_positions_alone_are_a_reference():
    """With zero velocity and acceleration."""
    plant, controller = ehsa_ctrl.load_plant("ehsa"), "pid_position"
    alone = ehsa_ctrl.run_closed_loop(plant, controller, np.full(50, 0.01))
    full = ehsa_ctrl.run_closed_loop(plant, controller, np.tile([0.01, 0.0, 0.0], (50, 1)))

    assert np.array_equal(alone["x"], full["x"])


def test_no_faults_change_nothing(plant, pid):
    """An empty set of faults is neutral to the bit."""
    a, b = (run_closed_loop(plant, pid, steps(), faults=faults) for faults in (None, Faults()))

    assert np.array_equal(a.trajectory.states, b.trajectory.states)


def test_a_stuck_sensor_stays_and_comes_back(plant, pid):
    """From 0.2 s for 0.1 s the position that the controller gets does not move; before and after it is the truth."""
    loop = run_closed_loop(plant, pid, steps(), faults=Faults([SensorFault("position", "stuck", 0.2, 0.1)]))
    seen, true = loop.measured[:, 3], loop.trajectory["x"]

    assert np.all(seen[50:75] == seen[49]) and np.ptp(true[50:75]) > 1e-6
    np.testing.assert_array_equal(seen[:50], true[:50])
    np.testing.assert_array_equal(seen[75:], true[75:])


def test_a_lost_sensor_ends_in_a_safe_current(plant, pid):
    """The loop goes on with the last value, then with no current; nothing is nan but the reading."""
    loop = run_closed_loop(plant, pid, steps(), faults=Faults([SensorFault("position", "lost", 0.12)]))
    status = loop.traces["status"]

    assert np.isnan(loop.measured[30:, 3]).all() and np.isfinite(loop.asked).all()
    assert set(status[:30]) == {0.0} and np.all(status[30:40] == 1.0) and np.all(status[40:] == 2.0)
    assert not loop.asked[40:].any()


def test_plain_and_compiled_see_the_same_faults(plant, pid):
    """The engine does the faults, whoever does the control."""
    faults = Faults([SensorFault("position", "stuck", 0.2, 0.1)], [DriveLimit(1.2, 0.1)])
    a = run_closed_loop(plant, pid, steps(), faults=faults)
    b = run_closed_loop(plant, pid, steps(), faults=faults, compiled=False)

    assert np.array_equal(a.trajectory.states, b.trajectory.states)
    for name, values in a.traces.items():
        np.testing.assert_array_equal(values, b.traces[name])


def test_the_drive_gives_no_more_than_its_limit(plant, pid):
    """The motor sees the limited current: an open loop run with it gives the same motion."""
    loop = run_closed_loop(plant, pid, steps(), faults=Faults(drive=[DriveLimit(1.2)]))
    acting = np.clip(loop.asked, -1.2, 1.2)

    assert np.max(np.abs(loop.asked)) > 1.2
    np.testing.assert_array_equal(loop.trajectory.current, acting)
    assert np.array_equal(loop.trajectory.states, simulate(plant, acting).states)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (lambda: SensorFault("postion", "stuck", 0.1), "did you mean 'position'"),
        (lambda: SensorFault("position", "dead", 0.1), "lost, stuck"),
        (lambda: SensorFault("position", "lost", -0.1), "at least 0 s"),
        (lambda: DriveLimit(-1.0), "at least 0 A"),
    ],
)
def test_wrong_faults_are_told(fault, words):
    """One sentence each."""
    with pytest.raises(InputError, match=words):
        fault()
