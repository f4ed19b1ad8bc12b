"""`run` and `design` for a carriage under a drive force: the linear model is a mass with viscous friction."""

import re
import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.plant.conditions import linear_model

PID = {
    "kind": "pid",
    "sample_time": 1e-3,
    "current_limit": 150.0,
    "design": {"crossover": 35.0, "phase_margin": 1.05, "integral_ratio": 0.1, "filter_ratio": 8.0},
}
LQR = {"kind": "lqr", "sample_time": 1e-3, "current_limit": 150.0, "weights": {"position": 1e-3, "current": 50.0}}
MPC = {**LQR, "kind": "mpc", "horizon": 40, "limits": {"current_rate": 2e4}}
ADRC = {"kind": "adrc", "sample_time": 1e-3, "current_limit": 150.0, "adrc": {"bandwidth": 30.0}}
CASCADE = {
    "kind": "cascade", "sample_time": 1e-3, "current_limit": 150.0,
    "speed": {"crossover": 130.0, "phase_margin": 1.13},
    "position": {"crossover": 30.0, "phase_margin": 1.05, "velocity_limit": 0.5},
}  # fmt: skip
SLIDING = {
    "kind": "sliding_mode", "sample_time": 1e-3, "current_limit": 150.0,
    "sliding_mode": {"bandwidth": 30.0, "disturbance": 30.0},
}  # fmt: skip
CYCLE = {"period": 3.0, "cutoff": 10.0}
REPETITIVE = {
    "kind": "repetitive", "sample_time": 1e-3, "current_limit": 150.0, "cycle": CYCLE,
    "base": {key: CASCADE[key] for key in ("kind", "speed", "position")},
}  # fmt: skip
#: A second load of 20 kg from 100 mm on.
SCHEDULE = {"variable": "position", "points": [{"at": "0 mm"}, {"at": "200 mm", "mass": 20.0}]}
SCHEDULED = [
    {**PID, "kind": "scheduled_pid", "schedule": SCHEDULE},
    {**LQR, "kind": "scheduled_lqr", "schedule": SCHEDULE},
    {**MPC, "kind": "scheduled_mpc", "schedule": SCHEDULE},
]
SCENARIO = {
    "title": "A move of the carriage",
    "why": "Its controller is designed on its own linear model.",
    "plant": "emps",
    "duration": 3.0,
    "reference": {"kind": "trapezoid", "times": [0.2], "positions": [0.2], "velocity": 0.2, "acceleration": 1.0},
    "limits": {"MaxError": {"max": 0.02}, "SteadyStateError": {"max": 1e-4}},
}


def test_the_linear_model_is_a_mass_with_viscous_friction():
    plant = ehsa_ctrl.load_plant("emps", model="linear")
    model = linear_model(plant)
    M, Fv = plant["M"], plant["Fv"]

    assert model.state_labels == ["v", "x"]
    assert np.allclose(model.A, [[-Fv / M, 0.0], [1.0, 0.0]], atol=1e-12)
    assert model.B[0, 0] == pytest.approx(1.0 / M)


@pytest.mark.parametrize(
    "controller", [PID, LQR, MPC, ADRC, CASCADE, SLIDING, REPETITIVE, *SCHEDULED], ids=lambda one: one["kind"]
)
def test_without_dry_friction_the_nonlinear_carriage_does_as_predicted(controller):
    """And with it, the loop needs more force and loses some accuracy."""
    free = ehsa_ctrl.run(SCENARIO, controller=controller, settings={"Fc": 0.0})
    rubbing = ehsa_ctrl.run(SCENARIO, controller=controller)

    paths = [loop.trajectory["x"] for loop in (free.linear, free.nonlinear)]
    assert np.max(np.abs(paths[0] - paths[1])) < 1e-5
    assert rubbing.passed, rubbing
    assert rubbing.metrics["Energy"][1] > free.metrics["Energy"][1] > 0.0
    # A and N are not mixed.
    assert np.isnan(rubbing.metrics["CurrentRMS"]).all()


def test_files_of_a_run_are_those_of_the_carriage(tmp_path, monkeypatch):
    """Design, run, baseline and page by the command line, from an empty project."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "controllers").mkdir()
    words = ["design", "emps", "--kind", "pid", "--bandwidth", "35 rad/s", "--phase-margin", "60 deg"]

    refused = CliRunner().invoke(app, words)
    designed = CliRunner().invoke(app, [*words, "--current-limit", "150 N", "-o", "controllers/carriage.toml"])
    (tmp_path / "move.toml").write_text(
        'schema = 1\ntitle = "Move"\nwhy = "Test."\nplant = "emps"\ncontroller = "carriage"\nduration = "3 s"\n'
        '[reference]\nkind = "trapezoid"\ntimes = ["0.2 s"]\npositions = ["200 mm"]\nvelocity = "200 mm/s"\n'
        'acceleration = "1 m/s2"\n'
    )
    recorded = CliRunner().invoke(app, ["run", "move.toml", "--update-baselines", "--reason", "first"])
    again = CliRunner().invoke(app, ["run", "move.toml", "--out", "out"])

    assert "--current-limit '100 N'" in str(refused.exception)
    assert designed.exit_code == recorded.exit_code == again.exit_code == 0, again.output
    header = (tmp_path / "out" / "move-carriage.csv").read_text().splitlines()[0].split(",")
    assert {"t", "drive_force", "position"} <= set(header) and "current" not in header
    assert "differs" not in again.output


def test_a_shipped_lqr_for_a_drive_in_newtons(tmp_path, monkeypatch):
    """What it has in A keeps its ratio to the largest drive: 1 A of 6 A is 25 N of 150 N. A and N are not mixed."""
    monkeypatch.chdir(tmp_path)
    words = ["design", "emps", "--kind", "lqr", "--current-limit", "150 N"]

    CliRunner().invoke(app, [*words, "-o", "found.toml"], catch_exceptions=False)
    mixed = CliRunner().invoke(app, [*words, "--weight", "current=1 A"])
    lax = CliRunner().invoke(app, [*words, "--weight", "current=50 N", "-o", "lax.toml"])

    found = tomllib.loads((tmp_path / "found.toml").read_text())
    assert found["weights"]["current"] == "25 N"
    assert found["observer"]["current"] == "2.5 N" and found["observer"]["friction"] == "12.5 N"
    assert "[weights] current = '1 A', but the drive of this plant is in N" in str(mixed.exception)
    assert lax.exit_code == 0 and tomllib.loads((tmp_path / "lax.toml").read_text())["weights"]["current"] == "50 N"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("pid", r"k_p = \S+ N/m, k_i = \S+ N/\(m s\), k_d = \S+ N s/m, .*\|F_M\| <= 150 N,"),
        ("mpc", r"\|F_M\| <= 150 N, \|F_M rate\| <= 15000 N/s; without them .*\|F_M\| <= 150 N,"),
        ("cascade", r"k_w = \S+ N s/m, k_iw = \S+ N/m, T_f = .*\|F_M\| <= 150 N,"),
        ("adrc", r"on the position, b_0 = \S+ m/\(s2 N\), \|F_M\| <= 150 N,"),
        ("sliding_mode", r"k = \S+ N at rest, b_0 = \S+ m/\(s2 N\), .*\|F_M\| <= 150 N,"),
        ("repetitive", r"around position over the rod's speed, .*k_w = \S+ N s/m, .*\|F_M\| <= 150 N,"),
    ],
)
def test_a_design_for_a_drive_in_newtons_speaks_in_newtons(kind, words, tmp_path, monkeypatch):
    """And no limit of the shipped actuator's shaft, pressures or stroke holds for a carriage."""
    monkeypatch.chdir(tmp_path)
    line = ["design", "emps", "--kind", kind, "--current-limit", "150 N", "-o", "found.toml"]
    cascade = {"cascade": "position", "repetitive": "base.position"}.get(kind)
    line += ["--spec", f"{cascade}.velocity_limit=0.5 m/s"] if cascade else []

    shown = CliRunner().invoke(app, line, catch_exceptions=False).output

    text = (tmp_path / "found.toml").read_text()
    assert re.search(words, shown)
    assert not re.search(r" A\b| A/", shown + text)
    assert set(tomllib.loads(text).get("limits", {})) <= {"current_rate"}


def test_a_cascade_without_a_shaft_has_the_margins_that_were_asked_for():
    """By python-control's own sampling and feedback; the speed is the filtered difference of the position."""
    import control

    plant = ehsa_ctrl.load_plant("emps", model="linear")
    law = ehsa_ctrl.load_controller(CASCADE, linear_model(plant)).law
    T_s, z = 1e-3, control.tf("z")
    z.dt = T_s
    x = control.sample_system(control.tf([1.0], [plant["M"], plant["Fv"], 0.0]), T_s, "zoh")
    speed = x * (z - 1) / ((law.T_f + T_s) * z - law.T_f)
    inner = law.k_w + law.k_iw * T_s / (z - 1)

    at = np.exp(130j * T_s)
    assert complex(inner(at) * speed(at)) == pytest.approx(-np.exp(1.13j), rel=1e-6)
    at = np.exp(30j * T_s)
    outer = law.k_x * inner(at) * x(at) / (1 + inner(at) * speed(at))
    assert abs(outer) == pytest.approx(1.0, rel=1e-6)
    assert np.pi + np.angle(outer) >= 1.05


def test_the_rod_speed_of_a_cascade_is_the_filtered_difference_of_its_position():
    """Step by step, with limits that act, against the law written out; compiled and in Python to the bit."""
    plant = ehsa_ctrl.load_plant("emps")
    controller = ehsa_ctrl.load_controller(CASCADE, linear_model(ehsa_ctrl.load_plant("emps", model="linear")))
    law, T_s = controller.law, 1e-3
    x = 0.1 + np.cumsum(np.random.default_rng(3).normal(0.0, 1e-5, 300))
    target = np.where(np.arange(300) < 50, 0.2, 0.1)
    memory, currents = law.initial_memory(), []
    for r, position in zip(target, x, strict=True):
        readings = np.array([7.0, 7.0, 7.0, position, 7.0])
        currents.append(law.function(np.array([r, 1e-3, 0.0, 0.0]), readings, memory, law.settings(), 1.0, 0.0))

    v, last, integral, expected = 0.0, x[0], 0.0, []
    for r, position in zip(target, x, strict=True):
        v, last = (law.T_f * v + position - last) / (law.T_f + T_s), position
        wanted_speed = min(max(1e-3 + law.k_x * (r - position), -0.5), 0.5)
        wanted = law.k_w * (wanted_speed - v) + integral + 1.0
        expected.append(min(max(wanted, -150.0), 150.0))
        back = min(law.k_iw / law.k_w, 1.0 / T_s)
        integral += T_s * (law.k_iw * (wanted_speed - v) + back * (expected[-1] - wanted))
    assert np.allclose(currents, expected, rtol=1e-9)
    assert 0 < np.count_nonzero(np.abs(currents) == 150.0) < 300

    reference = np.zeros((300, 3))
    reference[5:, 0] = 0.1
    plain, fast = (ehsa_ctrl.run_closed_loop(plant, controller, reference, compiled=way) for way in (False, True))
    np.testing.assert_array_equal(plain.asked, fast.asked)


def test_the_rod_speed_of_a_sliding_mode_is_the_filtered_difference_of_its_position():
    """Its drive is that of the law with a shaft whose speed is the position filtered by scipy; compiled to the bit."""
    from scipy.signal import lfilter

    from ehsa_ctrl.design.kinds.sliding_mode import sliding_mode_law

    plant = ehsa_ctrl.load_plant("emps")
    controller = ehsa_ctrl.load_controller(SLIDING, linear_model(ehsa_ctrl.load_plant("emps", model="linear")))
    law, T_s = controller.law, 1e-3
    x = np.cumsum(np.random.default_rng(3).normal(0.0, 1e-5, 300))
    v = lfilter(
        [1.0 / (law.T_f + T_s), -1.0 / (law.T_f + T_s)], [1.0, -law.T_f / (law.T_f + T_s)], np.r_[0.0, x - x[0]]
    )
    target = np.where(np.arange(300) < 50, 0.1, 1e-3)
    memory, expected = law.initial_memory(), np.zeros(4)
    drives = np.zeros((2, 300))
    for k in range(300):
        reference = np.array([target[k], 1e-3, 0.0, 0.0])
        seen = [np.array([speed, 0.0, 0.0, x[k], 0.0]) for speed in (7.0, v[1 + k])]
        drives[0, k] = law.function(reference, seen[0], memory, law.settings(), 1.0, 0.0)
        drives[1, k] = sliding_mode_law(reference, seen[1], expected, law.settings()[1:], 1.0, 0.0)

    assert law.n == 1.0 and 0 < np.count_nonzero(np.abs(drives[0]) == 150.0) < 300
    np.testing.assert_allclose(drives[0], drives[1], rtol=1e-9)

    path = np.zeros((300, 3))
    path[5:, 0] = 0.1
    plain, fast = (ehsa_ctrl.run_closed_loop(plant, controller, path, compiled=way) for way in (False, True))
    np.testing.assert_array_equal(plain.asked, fast.asked)


@pytest.mark.parametrize("base", [CASCADE, PID, ADRC, SLIDING], ids=lambda one: one["kind"])
def test_a_repetitive_controller_learns_the_cycle_of_a_carriage(base):
    """The error of the last of six cycles is less than a third of that of the first, friction included."""
    inner = {key: item for key, item in base.items() if key not in ("sample_time", "current_limit")}
    cycles = {
        **SCENARIO,
        "duration": 12.0,
        "reference": {"kind": "sine", "amplitude": 0.1, "frequency": 0.5},
        "limits": {},
    }
    law = {**REPETITIVE, "base": inner, "cycle": {"period": 2.0, "cutoff": 10.0, "limit": 0.02}}
    error = ehsa_ctrl.run(cycles, controller=law).nonlinear["error"]
    first, last = (float(np.sqrt(np.mean(error[part] ** 2))) for part in (slice(2000), slice(-2000, None)))

    assert last < first / 3.0


def test_a_carriage_learns_and_is_drawn_at_random():
    """The other commands of a closed loop speak in N, too."""
    learnt = ehsa_ctrl.learn_reference(SCENARIO, controller=CASCADE, trials=2)
    campaign = ehsa_ctrl.monte_carlo(SCENARIO, controller=CASCADE, runs=4)

    assert learnt.trials[2].rms < 0.6 * learnt.trials[0].rms
    assert re.search(r"RMS drive\n.* \d+\.\d+ N\n", str(learnt)) and not re.search(r" A\b", str(learnt))
    assert campaign.probability == 1.0 and {"M", "Fc", "Fv"} <= set(campaign.worst.parameters)


def test_a_law_of_ones_own_drives_a_carriage():
    """It states its largest force; with a linear model its text has the unit of the drive, and A is refused."""
    import control

    model = linear_model(ehsa_ctrl.load_plant("emps", model="linear"))
    lead = control.tf([3000.0, 4e4], [0.003, 1.0], name="lead")
    law = ehsa_ctrl.load_controller(lead, model, sample_time=1e-3, current_limit="150 N")

    assert ehsa_ctrl.run(SCENARIO, controller=law).passed is False
    assert "|F_M| <= 150 N" in str(law)
    assert ehsa_ctrl.robust_margins({"nominal": model}, lead).stable
    with pytest.raises(InputError, match="'6 A', but"):
        ehsa_ctrl.load_controller(lead, model, sample_time=1e-3, current_limit="6 A")
    with pytest.raises(InputError, match=r"no largest drive for a law of your own; give it, .*current_limit='100 N'"):
        ehsa_ctrl.run(SCENARIO, controller=lambda t, y, r: 0.0)


def test_the_force_of_a_motion_is_that_of_the_balance():
    """A constant drive of preload + coulomb + viscous v ends at the speed v."""
    plant = ehsa_ctrl.load_plant("emps")
    needed, v = ehsa_ctrl.motion_current(plant), 0.05
    force = needed["preload"] + needed["coulomb"] + needed["viscous"] * v
    run = ehsa_ctrl.simulate(plant, np.full(8000, force))

    assert needed["inertia"] == plant["M"] and needed["static"] == needed["coulomb"]
    assert run["v"][-1] == pytest.approx(v, rel=1e-3)


def test_friction_is_fed_forward_in_newtons(tmp_path, monkeypatch):
    """`design` takes the coefficients from the carriage, and its error on the way falls to less than half."""
    monkeypatch.chdir(tmp_path)
    line = ["design", "emps", "--kind", "pid", "--base", "pid_friction", "--current-limit", "150 N", "-o", "found.toml"]
    CliRunner().invoke(app, line, catch_exceptions=False)
    found = tomllib.loads((tmp_path / "found.toml").read_text())
    errors = [
        ehsa_ctrl.run(SCENARIO, controller={**found, **change}).metrics["RMSError"][1]
        for change in ({}, {"feedforward": {}})
    ]

    assert found["feedforward"]["inertia"] == "95.1 N s2/m" and found["feedforward"]["coulomb"] == "20.4 N"
    assert "load" not in found["feedforward"]
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"current_limit": "6 A"}, r"current_limit = '6 A', but the drive of this plant is in N"),
        ({"feedforward": {"coulomb": "1 A"}}, r"\[feedforward\] coulomb = '1 A', but"),
        ({"feedforward": {"inertia": "1 A s2/m"}}, r"write it in N s2/m"),
        ({"dither": {"amplitude": "1 A", "frequency": 50.0}}, r"\[dither\] amplitude = '1 A', but"),
        (
            {"design": None, "gains": {"k_p": "390 A/m"}},
            r"\[gains\] k_p = '390 A/m', but .* write it in N/m",
        ),
    ],
)
def test_a_number_in_amperes_is_refused_for_a_drive_in_newtons(change, sentence):
    law = {key: item for key, item in {**PID, **change}.items() if item is not None}

    with pytest.raises(InputError, match=sentence):
        ehsa_ctrl.run(SCENARIO, controller=law)
    with pytest.raises(InputError, match=r"'150 N', but the drive of this plant is in A"):
        ehsa_ctrl.load_controller({**PID, "current_limit": "150 N"}, ehsa_ctrl.three_state("ehsa"))


def test_files_of_a_carriage_have_newtons(tmp_path):
    """A controller's limit is no rating of the EHSA in A, and a fault of the drive is in the drive's unit."""
    text = (
        'schema = 1\ntitle = "Move"\nwhy = "Test."\nplant = "emps"\ncontroller = "carriage.toml"\nduration = "1 s"\n'
        '[reference]\nkind = "steps"\ntimes = ["0.2 s"]\npositions = ["20 mm"]\n'
        '[[fault]]\nkind = "current_limit"\ncurrent = "50 N"\nstart = "0.5 s"\n'
    )
    head = 'schema = 1\ntitle = "PID"\nkind = "pid"\nsample_time = "1 ms"\ncurrent_limit = "150 N"\n'
    (tmp_path / "carriage.toml").write_text(head + '[design]\ncrossover = "35 rad/s"\nphase_margin = "60 deg"\n')
    (tmp_path / "good.toml").write_text(text)
    (tmp_path / "wrong.toml").write_text(text.replace("50 N", "3 A"))

    assert np.max(np.abs(ehsa_ctrl.run(tmp_path / "good.toml").nonlinear.trajectory["F_M"][-400:])) <= 50.0
    with pytest.raises(InputError, match="'3 A', but the drive of this plant is in N"):
        ehsa_ctrl.run(tmp_path / "wrong.toml")
    with pytest.raises(InputError, match="'150 N', but the drive of this plant is in A"):
        ehsa_ctrl.run("steps_spring", controller=tmp_path / "carriage.toml")


def test_a_controller_in_newtons_is_checked_on_the_carriage(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = ["design", "emps", "--kind", "sliding_mode", "--current-limit", "150 N", "-o", "found.toml"]
    CliRunner().invoke(app, line, catch_exceptions=False)

    checked = CliRunner().invoke(app, ["check", "found.toml"])
    reviewed = CliRunner().invoke(app, ["analyse", "emps", "--controller", "found.toml", "--review"])
    template = CliRunner().invoke(app, ["new", "controller", "mine", "--kind", "pid", "--plant", "emps"])

    assert checked.exit_code == 0 and reviewed.exit_code == 0
    assert re.search(r"breakaway +20.4 N, limit 150 N", reviewed.output) and not re.search(r" m?A\b", reviewed.output)
    assert "ehsa-ctrl design emps --kind pid --current-limit '100 N' -o mine.toml" in str(template.exception)


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("scheduled_pid", 'has no pressures, so that no level is measured; take variable = "position"'),
        ("scheduled_lqr", 'has no pressures, so that no level is measured; take variable = "position"'),
        ("force", "no load cell and no pressures: a force controller has nothing to measure the force"),
        ("impedance", "take a position controller such as pid or cascade, or a plant with pump and load cell"),
    ],
)
def test_what_a_carriage_does_not_measure_is_no_variable_of_its_law(kind, sentence):
    shown = CliRunner().invoke(app, ["design", "emps", "--kind", kind, "--current-limit", "150 N"])

    assert sentence in str(shown.exception)


def test_a_carriage_has_no_load_cell_to_schedule_over():
    law = {**SCHEDULED[0], "schedule": {"variable": "load", "points": [{"at": "0 N"}, {"at": "50 N", "mass": 20.0}]}}

    with pytest.raises(InputError, match="no load cell, so that no load is measured"):
        ehsa_ctrl.run(SCENARIO, controller=law)


def test_a_scheduled_pid_has_the_gains_of_its_point():
    """At 200 mm those of a PID that is designed for 20 kg more."""
    plant = ehsa_ctrl.load_plant("emps", model="linear")
    scheduled = ehsa_ctrl.load_controller(SCHEDULED[0], linear_model(plant)).law
    heavier = ehsa_ctrl.load_controller(PID, linear_model(plant.set(M=plant["M"] + 20.0))).law

    assert scheduled.at(0.2).gains.k_p == pytest.approx(heavier.gains.k_p, rel=1e-9)
    assert "N/m" in ehsa_ctrl.load_controller(SCHEDULED[0], linear_model(plant)).law_words


@pytest.mark.parametrize(
    ("position", "sentence"),
    [
        ({"speed_limit": 400.0}, "has no shaft: expected .position. velocity_limit in m/s"),
        ({"speed_limit": 400.0, "velocity_limit": 0.5}, "and no speed_limit"),
        ({}, "such as --spec position.velocity_limit='0.5 m/s'"),
    ],
)
def test_a_cascade_without_a_shaft_has_a_limit_in_metres_per_second(position, sentence):
    outer = {"crossover": 30.0, "phase_margin": 1.05, **position}
    model = linear_model(ehsa_ctrl.load_plant("emps", model="linear"))

    with pytest.raises(InputError, match=sentence):
        ehsa_ctrl.load_controller({**CASCADE, "position": outer}, model)


def test_a_limit_of_what_a_carriage_lacks_is_refused():
    line = ["design", "emps", "--kind", "mpc", "--current-limit", "150 N"]

    speed = CliRunner().invoke(app, [*line, "--limit", "speed=100 rad/s"])
    rate = CliRunner().invoke(app, [*line, "--limit", "current_rate=100 A/s"])

    assert "the model has no speed; it has position" in str(speed.exception)
    assert "[limits] current_rate = '100 A/s', but" in str(rate.exception)
    assert "write it in N/s" in str(rate.exception)


def test_no_controller_is_designed_for_a_servo_with_its_own():
    refused = CliRunner().invoke(app, ["design", "xl330_pendulum", "--kind", "lqr"])

    assert "its position loop is the firmware's" in str(refused.exception)


def test_a_fault_in_amperes_of_a_scenario_in_python_is_refused():
    """A dictionary, and a shipped scenario with changed keys; a number is in the SI unit of the drive."""
    fault = {"kind": "current_limit", "current": "3 A", "start": 0.5}
    changed = ehsa_ctrl.load_scenario("carriage_moves", fault=[fault])

    sentence = r"scenario own: \[\[fault\]\]: current = '3 A', but the drive of this plant is in N"
    with pytest.raises(InputError, match=sentence):
        ehsa_ctrl.run({**SCENARIO, "fault": [fault]}, controller=PID)
    with pytest.raises(InputError, match="current = '3 A', but the drive of this plant is in N"):
        ehsa_ctrl.run(changed)
    for current in ("50 N", 50.0):
        limited = ehsa_ctrl.run({**SCENARIO, "fault": [{**fault, "current": current}]}, controller=PID)
        assert np.max(np.abs(limited.nonlinear.trajectory.current[600:])) <= 50.0


def test_all_scenarios_are_those_of_the_drive_that_was_given():
    """A controller or a plant in A leaves out the carriage, one in N the others; without either all are run."""
    from ehsa_ctrl.scenario.prepare import with_drive_of

    names = list(ehsa_ctrl.scenarios)

    assert with_drive_of(names, None, []) == names
    assert with_drive_of(names, None, ["carriage_pid"]) == ["carriage_moves"] == with_drive_of(names, "emps", [])
    for given in (("ehsa", []), (None, ["pid_position", "lqr_friction"])):
        assert with_drive_of(names, *given) == [name for name in names if name != "carriage_moves"]
    assert with_drive_of(names, "ehsa", ["carriage_pid"]) == []


def test_exported_code_of_a_carriage_is_checked_over_its_own_scenario():
    """Words of 32 bits are within half a percent of the largest force there."""
    from ehsa_ctrl.design.export import NUMBERS, check_code, export_controller
    from ehsa_ctrl.scenario.recorded_runs import recorded_runs
    from ehsa_ctrl.simulation.exercise import exercise_controller

    plant = ehsa_ctrl.load_plant("emps")
    law = ehsa_ctrl.load_controller("carriage_pid", linear_model(ehsa_ctrl.load_plant("emps", model="linear")))
    runs, _ = recorded_runs(ehsa_ctrl.scenarios.values(), law, plant)
    reference, measured, _ = exercise_controller(plant, law, law.current_limit, 0)
    ranges = [(run.reference, run.measured) for run in runs]
    number = NUMBERS["q31"]
    check = check_code(export_controller(law, reference, measured, number=number, runs=ranges), law, number, runs)

    assert {run.name for run in runs} == {"carriage_moves"} <= set(check.runs)
    assert check.runs["carriage_moves"].error < 0.005 * 150.0
