"""The law behind an unknown input: closed forms come back with their numbers, chance does not, a rig's law is found."""

import inspect
import json
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace as N

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl as e
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core import registry
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel
from ehsa_ctrl.diagnosis.law import find, regression
from ehsa_ctrl.diagnosis.law.begin import Begin
from ehsa_ctrl.diagnosis.law.find import laws_of_best
from ehsa_ctrl.diagnosis.law.free_run import FreeRunLaw, definition_of
from ehsa_ctrl.diagnosis.law.grammar import Grammar, LawVariable, Term
from ehsa_ctrl.diagnosis.law.held import held_laws
from ehsa_ctrl.diagnosis.law.inputs import with_combined
from ehsa_ctrl.diagnosis.law.memory import clock, lag, over_time, resonance, slip, turn
from ehsa_ctrl.diagnosis.law.regression import LawFit, evidence, find_sums, placebo
from ehsa_ctrl.diagnosis.model_selection import Reference, Selection
from ehsa_ctrl.diagnosis.place_sets import InjectionCase
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, segment_candidates
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.regimes import Windows
from ehsa_ctrl.diagnosis.scoring import ScoredHypothesis
from ehsa_ctrl.diagnosis.signals import estimate_noise
from ehsa_ctrl.diagnosis.validation_segment import initial_state, part_of_log
from ehsa_ctrl.physics.effects import EFFECTS, LawFile, effect_of, law_text, read_law

TIME = 0.004 * np.arange(6001)


def case(unknown, *, position="x", seed=0):
    """Grammar and windows of a force that is this function of x, v and the direction, with 5 % of white noise."""
    x = 0.03 * np.sin(1.3 * TIME) + 0.012 * np.sin(3.1 * TIME + 1.0)
    v = np.gradient(x, TIME)
    known = {"x": x[:-1], "v": v[:-1], "d_R": np.where(v[:-1] < 0.0, -1.0, 1.0)}
    units = {"x": "m", "v": "m/s", "d_R": "1"}
    variables = LawVariable("v", "m/s", known["v"], speed=True), LawVariable("x", "m", known["x"], position=True)
    grammar = Grammar("force", variables, known, units, "d_R", known["v"], 0.0, 1.0)
    values = unknown(known["x"], known["v"], known["d_R"])
    noise = np.random.default_rng(seed).standard_normal(values.size)
    windows = Windows(values + 0.05 * np.std(values) * noise + 0.0, 0.004)
    return grammar, windows, np.zeros((windows.values.size, 0))


@pytest.mark.parametrize(
    ("unknown", "terms", "factors"),
    [
        (lambda x, v, d: 3e3 * v * np.abs(v), ["v * abs(v)"], [3e3]),
        (lambda x, v, d: 4e5 * v**3, ["v**3"], [4e5]),
        (lambda x, v, d: 20.0 * d + 200.0 * v, ["d_R", "v"], [20.0, 200.0]),
        (lambda x, v, d: 5e4 * x, ["x"], [5e4]),
    ],
)
def test_a_closed_form_comes_back(unknown, terms, factors):
    """The right terms with their factors, within 5 %."""
    best = find_sums(*case(unknown))[0]

    assert dict(zip((term.text for term in best.terms), best.factors, strict=True)) == pytest.approx(
        dict(zip(terms, factors, strict=True)), rel=0.05
    )
    assert best.explained > 0.9


@pytest.mark.parametrize(
    ("unknown", "text", "at", "width"),
    [
        (lambda x, v, d: 2e4 * np.maximum(x - 0.01, 0.0), "max(x - at, 0)", 0.01, None),
        (lambda x, v, d: 300.0 * np.exp(-(((x - 0.008) / 0.006) ** 2)), "exp(-((x - at) / width)**2)", 0.008, 0.006),
        (
            lambda x, v, d: 300.0 * np.maximum(1.0 - ((x + 0.005) / 0.01) ** 2, 0.0),
            "max(1 - ((x - at) / width)**2, 0)",
            -0.005,
            0.01,
        ),
        (
            lambda x, v, d: 2e4 * np.sign(x) * np.maximum(np.abs(x) - 0.01, 0.0),
            "sign(x) * max(abs(x) - at, 0)",
            0.01,
            None,
        ),
    ],
)
def test_location_and_width_come_back(unknown, text, at, width):
    """Off the grid of the selection: within a millimetre, and the width within a tenth."""
    best = find_sums(*case(unknown))[0]

    assert best.terms[0].text == text
    assert best.terms[0].shapes["at"] == pytest.approx(at, abs=1e-3)
    assert width is None or best.terms[0].shapes["width"] == pytest.approx(width, rel=0.1)


def test_a_bump_that_leaves_the_data_ends_its_sum(monkeypatch):
    """At 19 of its widths from the data it is almost zero, and the square of its factor overflows: no standard
    deviation is infinite, which no effect's file can have."""
    monkeypatch.setattr(regression, "_shaped", lambda grammar, target, terms: [far(one) for one in terms])

    def far(term):
        if term.text != "exp(-((x - at) / width)**2)":
            return term
        left.append(replace(term, shapes={"at": 0.042 + 19.05 * 0.006, "width": 0.006}))
        return left[-1]

    left = []
    found = find_sums(*case(lambda x, v, d: 300.0 * np.exp(-(((x - 0.008) / 0.006) ** 2))))

    assert left
    assert np.isfinite([value for one in found for value in (*one.factors, *one.sd)]).all()


def test_the_factor_of_a_pressure_is_per_pascal(plant):
    """A leakage has the unit of one, not that of its base units; every unit is that of its term."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=3.0, sample_time=0.004), centre=True)
    grammar = Grammar.of(plant, InjectionCase.of(plant, log, {}).signals, "flow_1")
    found = {one.text: grammar.factor_unit(one) for one in grammar.terms()}

    assert found["P_1"] == "m3 s-1 Pa-1" and found["P_1**3"] == "m3 s-1 Pa-3"
    assert found["omega"] == "m3"


def test_a_small_constant_beside_friction_comes_back():
    """18 N beside 200 N of friction: less than the smallest gain of a term, but most of what friction leaves."""
    best = find_sums(*case(lambda x, v, d: 200.0 * d + 18.0))[0]

    assert [term.text for term in best.terms] == ["d_R", "1"]
    assert best.factors == pytest.approx((200.0, 18.0), rel=0.1)


def test_the_balance_tells_forms_apart():
    """Coulomb and viscous friction against the same with the square of the speed, and against a hysteresis, which has
    a further number and fits as well."""
    grammar, windows, nuisance = case(lambda x, v, d: 20.0 * d + 200.0 * v)
    width = replace(slip("v", "m", 1e-5))
    d, v, square = (Term(text, frozenset({"v"} if "v" in text else ())) for text in ("d_R", "v", "v * abs(v)"))
    late = Term("memory", frozenset({"x"}), {"width": 1e-5}, {"width": "m"}, width)
    right, other, longer = (
        evidence(LawFit(grammar, terms, (1.0, 1.0), (0.0, 0.0), 0.0), windows, nuisance)
        for terms in ((d, v), (d, square), (late, v))
    )

    assert right > other + 3.0
    assert longer + 1.0 < right < longer + 5.0


def test_a_wave_over_the_position_comes_back():
    """sin(x / width): a period of 20 mm."""
    best = find_sums(*case(lambda x, v, d: 80.0 * np.sin(2.0 * np.pi * x / 0.02 + 0.4)))[0]

    assert best.terms[0].text == "sin(x / width + at)"
    assert 2.0 * np.pi * best.terms[0].shapes["width"] == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize("step", [0.179, 0.788])
def test_the_steps_of_a_drive_come_back(plant, step):
    """A torque of 1.2 N m/A times what a drive that sets 0.179 A or 0.788 A at a time leaves of the current."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=12.0, sample_time=0.004), centre=True)
    signals = InjectionCase.of(plant, log, {}).signals
    grammar = Grammar.of(plant, signals, "torque")
    current = grammar.known["current"]
    values = 1.2 * (step * np.round(current / step) - current)
    windows = Windows(values + 0.03 * np.random.default_rng(0).standard_normal(values.size), 0.004)

    best = find_sums(grammar, windows, np.zeros((windows.values.size, 0)))[0]

    assert best.terms[0].text == "(width * round(current / width) - current)"
    assert best.factors[0] == pytest.approx(1.2, rel=0.05)
    assert best.terms[0].shapes["width"] == pytest.approx(step, rel=0.01)


def rippled(plant):
    """The plant with a displacement that ripples by 20 % of D, twice a turn, and a noisy log of it."""
    size = 0.2 * plant["D"]
    file = LawFile.model_validate(
        {
            "schema": 1, "status": "proposed", "summary": "ripple", "adds_to": "displacement",
            "expression": "c_1 * sin(2 * turns)", "parameters": {"c_1": {"value": size, "unit": "m3", "neutral": 0.0}},
            "states": {"turns": {"rate": "omega", "unit": "rad", "scale": 1.0}},
        }
    )  # fmt: skip
    EFFECTS.keep("ripple", effect_of("ripple", file, "a test"))
    rig = plant.with_effects("ripple", c_1=size)
    return rig, e.record(rig, *e.excitation("noise", amplitude=3.0, duration=12.0, sample_time=0.004), centre=True)[0]


def test_a_displacement_that_ripples_comes_back_and_keeps_the_power(plant):
    """The law has its size, and adds flow and torque of one displacement."""
    rig, log = rippled(plant)
    size, changes = rig["c_1"], EFFECTS["ripple"].changes
    flow, torque = changes["Q_P"], changes["T_P"]
    one = InjectionCase.of(plant, log, {})
    grammar = Grammar.of(plant, one.signals, "displacement")
    windows = Windows(with_combined(one.unknown.values)["displacement"], 0.004)

    best = find_sums(grammar, windows, np.zeros((windows.values.size, 0)))[0]

    assert best.terms[0].text == "sin(order * memory + at)"
    assert best.factors[0] == pytest.approx(size, rel=0.1)
    assert best.terms[0].shapes["order"] == pytest.approx(2.0, abs=0.01)
    # Without any other variable, it is drawn over the angle.
    assert grammar.variables == () and grammar.shown(best.terms[0]).text == "angle"
    assert best.values.shape == (log.time.size - 1,)
    # Power into the oil and from the shaft: (P_1 - P_2) times the flow is omega times the torque.
    a = {"c_1": size, "turns": 0.3, "omega": 120.0, "P_1": 4e5, "P_2": 1e5}
    given = [{n: a[n] for n in inspect.signature(f).parameters if n in a} for f in (flow, torque)]
    assert 3e5 * flow(0.0, **given[0]) == pytest.approx(120.0 * torque(0.0, **given[1]))


def test_the_angle_at_the_start_of_a_part_is_corrected(plant):
    """As the position is, by the run-in: the speed there 30 rad/s off at first, the scored run is hardly worse."""
    rig, log = rippled(plant)
    part = part_of_log(rig, HypothesisModel(rig, log), estimate_noise(log), [slice(1500, 2500)])
    start = {**part.model.start, "omega": part.model.start["omega"] + 30.0}
    off = replace(part, model=replace(part.model, start=start))

    assert off.gap(off.simulate({}))["total"] < 0.02


def test_an_angle_is_not_held_over_a_sample():
    """Speed from rest to 300 rad/s: held over samples of 4 ms the angle would be 0.6 rad short."""
    speed = 300.0 * np.linspace(0.0, 1.0, 251)[:-1]

    angle = turn("omega").course({"omega": speed}, {}, 0.004, (0,))["memory"]

    assert angle[-1] == pytest.approx(0.5 * 300.0 * (249 / 250) ** 2, rel=1e-6)


def with_memories(case, *memories):
    """The case with terms that remember, at 250 Hz."""
    grammar, windows, nuisance = case
    return replace(grammar, memories=tuple(memories), sample_time=0.004), windows, nuisance


def test_the_course_of_a_memory_has_its_closed_form():
    """Steps of 1: a lag and a resonance; a hysteresis follows the motion until it slips at its width."""
    known = {"u": np.ones(500), "v": np.full(500, 0.01)}
    t = 0.004 * np.arange(500)
    late = lag("u", "1", 1.0).course(known, {"tau": 0.3}, 0.004, [0])["memory"]
    swing = resonance("u", "1", 1.0).course(known, {"frequency": 20.0, "damping": 0.2}, 0.004, [0])["memory"]
    held = slip("v", "m", 1e-3).course(known, {"width": 2e-3}, 0.004, [0])["memory"]
    damped = 20.0 * np.sqrt(1.0 - 0.2**2)
    ring = np.exp(-4.0 * t) * (np.cos(damped * t) + 4.0 / damped * np.sin(damped * t))

    assert late == pytest.approx(1.0 - np.exp(-t / 0.3), abs=1e-9)
    assert swing == pytest.approx(1.0 - ring, abs=1e-9)
    assert held == pytest.approx(2e-3 * (1.0 - np.exp(-0.01 * t / 2e-3)), abs=1e-12)


def test_the_mean_of_a_memory_over_a_sample():
    """A fast lag and a resonance, driven by steps: the mean of a run with 200 times shorter samples."""
    steps = np.repeat(np.random.default_rng(0).standard_normal(20), 4)
    for memory, shapes in (
        (lag("u", "1", 1.0), {"tau": 0.003}),
        (resonance("u", "1", 1.0), {"frequency": 100.0, "damping": 0.2}),
    ):
        mean = memory.course({"u": steps}, shapes, 0.004, [0], mean=True)["memory"]
        fine = memory.course({"u": np.repeat(steps, 200)}, shapes, 2e-5, [0])["memory"]

        assert mean[:-1] == pytest.approx(fine.reshape(-1, 200).mean(axis=1)[:-1], abs=0.01)


def test_memories_start_anew_with_each_log():
    """Two logs of 250 samples in one array: the clock begins twice."""
    course = clock().course({"u": np.ones(500)}, {}, 0.004, [0, 250])["memory"]

    assert course[:250] == pytest.approx(course[250:]) and course[-1] == pytest.approx(0.004 * 249)


@pytest.mark.parametrize(
    ("unknown", "memories", "text", "shape", "expected"),
    [
        (lambda x, v, d: 40.0 * d * (1 - np.exp(-TIME[:-1] / 7.0)), over_time({"d_R": ()}, 24.0), "exp", "tau", 7.0),
        (lambda x, v, d: 150.0 * d * (TIME[:-1] > 9.3), over_time({"d_R": ()}, 24.0), "tanh", "at", 9.3),
    ],
)
def test_what_grows_with_time_comes_back(unknown, memories, text, shape, expected):
    """A slow change and a sudden one, with their time."""
    best = find_sums(*with_memories(case(unknown), *memories))[0]

    assert text in best.terms[0].text and best.terms[0].memory is not None
    assert best.terms[0].shapes[shape] == pytest.approx(expected, rel=0.1)


def test_a_law_with_a_memory_is_an_effect(plant):
    """Its definition has the state, its rate and units that fit; a run has the state."""
    found = find_sums(
        *with_memories(case(lambda x, v, d: 150.0 * d * (TIME[:-1] > 9.3)), *over_time({"d_R": ()}, 24.0))
    )
    definition = definition_of(found[0], list(plant.parameters))
    EFFECTS.keep("late_jam", effect_of("late_jam", definition, "a test"))
    run = e.simulate(plant.with_effects("late_jam"), np.full(250, 2.0))

    assert definition.states["c_m_1"].rate == "1" and "d_R" in definition.expression
    assert run["c_m_1"][-1] == pytest.approx(0.004 * 249)


def test_friction_that_drives_the_motion_is_no_law():
    """A negative Coulomb level on a frictionless rod would move it by itself."""
    found = find_sums(*case(lambda x, v, d: -20.0 * d - 200.0 * v))

    assert all("d_R" not in term.text and "v" not in term.variables for one in found for term in one.terms)


def test_chance_explains_nothing():
    """White noise has no law, and a law reversed in time explains less than the law by far."""
    noise = case(lambda x, v, d: np.random.default_rng(1).standard_normal(x.size))
    bump = case(lambda x, v, d: 300.0 * np.exp(-(((x - 0.008) / 0.006) ** 2)))

    assert find_sums(*noise) == []
    assert placebo(*bump) < find_sums(*bump)[0].explained - 0.1


def test_a_constant_is_not_taken_for_chance():
    """It is the same in reversed time, and a law all the same; a placebo is what a term explains beyond it."""
    grammar, windows, nuisance = case(lambda x, v, d: 280.0 + 3000.0 * np.abs(v) + 40.0 * np.sin(40.0 * TIME[:-1] ** 2))
    best = find_sums(grammar, windows, nuisance)[0]

    assert {"1", "abs(v)"} >= {term.text for term in best.terms} and best.explained > 0.9
    assert placebo(grammar, windows, nuisance) < 0.1


def test_a_variable_that_explains_everything_hides_no_other():
    """The pressures balance the force on a rod: the law in the speed is found beside that of the pressure."""
    grammar, windows, nuisance = case(lambda x, v, d: 280.0 * d + 3e4 * v * np.abs(v))
    force = 280.0 * grammar.known["d_R"] + 3e4 * grammar.known["v"] * np.abs(grammar.known["v"])
    pressure = LawVariable("P", "Pa", force / 2.5e-3)
    grammar = replace(
        grammar, variables=(*grammar.variables, pressure), known={**grammar.known, "P": pressure.values},
        units={**grammar.units, "P": "Pa"},
    )  # fmt: skip
    found = [{term.text for term in one.terms} for one in find_sums(grammar, windows, nuisance)]

    assert found[0] <= {"P", "d_R * abs(P)"} and {"d_R", "v * abs(v)"} in found


def test_a_wrong_nominal_parameter_is_no_law():
    """What follows the change by a nominal parameter is explained by that parameter."""
    grammar, windows, _ = case(lambda x, v, d: 5e4 * x)
    nuisance = windows.of((1e5 * grammar.known["x"])[:, None])

    assert find_sums(grammar, windows, nuisance) == []


def test_the_definition_is_an_effect_that_the_engine_runs(plant, tmp_path):
    """Its expression has the unit of a force, and the file is read back as it was written."""
    law = find_sums(*case(lambda x, v, d: 150.0 * d + 2e4 * np.maximum(x - 0.01, 0.0)))[0]
    definition = definition_of(law, list(plant.parameters))
    path = tmp_path / "found.toml"
    path.write_text(law_text(definition), encoding="utf-8")
    effect = read_law(path)
    EFFECTS.keep("found", effect)
    run = e.simulate(plant.with_effects("found"), np.full(250, 2.0))

    assert set(effect.changes) == {"F_net", "F_FR"}
    assert definition.range.keys() == {"x"}
    assert run["x"][-1] < e.simulate(plant, np.full(250, 2.0))["x"][-1]
    assert "found" not in list(EFFECTS)


def test_a_law_that_was_not_written_goes_to_another_process(plant):
    """A batch in processes returns plants with laws whose files don't exist yet: the definition goes along."""
    definition = LawFile.model_validate(LEAK)
    EFFECTS.keep("leak_elsewhere", effect_of("leak_elsewhere", definition, "a test"))
    sent = pickle.dumps(plant.with_effects("leak_elsewhere", k_rig=6e-13, P_rig=1.2e6))
    code = (
        "import pickle, sys, numpy as np, ehsa_ctrl as e\n"
        "plant = pickle.load(sys.stdin.buffer)\n"
        "print(e.simulate(plant, np.full(50, 2.0))['P_1'][-1])"
    )
    there = float(subprocess.run([sys.executable, "-c", code], input=sent, capture_output=True, check=True).stdout)

    assert there == e.simulate(pickle.loads(sent), np.full(50, 2.0))["P_1"][-1]
    assert there != e.simulate(plant, np.full(50, 2.0))["P_1"][-1]


LEAK = {
    "schema": 1, "status": "proposed", "summary": "a valve that lets oil out of chamber 1", "adds_to": "flow_1",
    "expression": "-k_rig * max(P_1 - P_rig, 0)",
    "parameters": {
        "k_rig": {"value": 6e-13, "unit": "m3/(s Pa)", "neutral": 0.0}, "P_rig": {"value": 1.2e6, "unit": "Pa"},
    },
}  # fmt: skip


@pytest.mark.slow
def test_a_rig_with_a_law_of_its_own(plant, tmp_path, monkeypatch):
    """A valve on one chamber that the catalogue lacks: place, form, threshold and size, and a file that closes the gap.

    The improved plant, with the effect's file beside it, leaves a tenth of the nominal gap on the same input. Left out
    of the catalogue is what costs time and can't explain this gap, which is one of the flows, or closes half of it.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_PROJECTS", [])
    EFFECTS.keep("rig_leak", effect_of("rig_leak", LawFile.model_validate(LEAK), "the rig"))
    rig = plant.with_effects("rig_leak")
    log, _ = e.record(rig, *e.excitation("noise", amplitude=3.0, duration=9.0, sample_time=0.004), centre=True)
    log.write(tmp_path / "log.csv")
    left_out = [name for name, one in EFFECTS.items() if one.place != "flow"] + ["external_leakage", "relief_valve"]
    without = [word for name in left_out for word in ("--without", name)]
    result = CliRunner().invoke(app, ["diagnose", "log.csv", "--plant", "ehsa", "--out", "out", *without])
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    law = content["law"]

    assert content["verdict"] in ("outside_catalogue", "partly")
    assert law["place"] == "flow_1" and law["variables"] == ["P_1"]
    assert "c_1 * max(P_1 - c_at_1, 0)" in [form["expression"] for form in law["forms"][:3]]
    best = next(form for form in law["forms"] if form["expression"].startswith("c_1 * max"))
    assert best["parameters"]["c_1"]["value"] == pytest.approx(-6e-13, rel=0.15)
    assert best["parameters"]["c_at_1"]["value"] == pytest.approx(1.2e6, rel=0.1)
    assert best["gap_closed"] > 0.9
    assert (tmp_path / "out" / law["proposal"]).is_file()
    assert (tmp_path / "out" / "law.png").is_file()
    assert law["forms"][0]["expression"] in (tmp_path / "out" / "diagnosis.html").read_text()
    assert f"follows a law that the catalogue lacks, which closes {100 * best['gap_closed']:.0f} %" in result.output
    assert content["gap"]["with_law"]["total"] < 0.1 * content["gap"]["with_effects"]["total"]
    improved = e.load_plant(tmp_path / "out" / content["improved"])
    assert improved.structure.effects == (read_law(tmp_path / "out" / law["proposal"]).name,)
    runs = (e.simulate(one, log["current"]) for one in (plant, improved))
    before, after = (np.std(log["p1"] - run["P_1"]) for run in runs)
    assert after < 0.1 * before


@pytest.fixture(scope="module")
def servo():
    """Grammar of a servo's log, whose gear has friction of 0.3 times the torque that it transmits, and its signals."""
    believed = e.load_plant("xl330_pendulum", settings={"kp": 100.0})
    time = 0.005 * np.arange(1201)
    goal = 1.2 * np.sin(1.1 * time) + 0.5 * np.sin(2.9 * time)
    gear = believed.with_effects("load_dependent_friction", kappa=0.3)
    run = e.simulate(gear, goal, sample_time=0.005)
    log = Log(time, {"goal": goal, "released": np.zeros(time.size), "angle": run["theta"]})
    signals = InjectionCase.of(believed, log, {"angle": 4e-4}).signals
    return believed, gear, log, signals, Grammar.of(believed, signals, "torque")


def test_the_torque_of_a_gear_is_a_variable(servo):
    """By the equations of the plant, and its difference from a lag is an acceleration."""
    believed, _, log, signals, grammar = servo
    arm = believed["m"] * 9.80665 * believed["l"] * np.sin(log["angle"] + believed["offset"])
    late = next(term for term in grammar.terms() if "acceleration" in term.variables)

    assert {"T_G", "T_M", "T_L"} <= {one.text for one in grammar.variables}
    assert grammar.known["T_L"] == pytest.approx(arm[:-1])
    assert np.corrcoef(grammar.values(late)[5:], signals["omega_rate"][:-1][5:])[0, 1] > 0.95
    assert grammar.shown(late).unit == "rad/s2"


def test_dry_friction_along_a_torque_has_a_direction(servo):
    """Its mean over both directions says nothing; along the speed the direction is that of the variable."""
    grammar = servo[-1]
    gear = Term("d_M * abs(T_G)", frozenset({"T_G"}))
    coulomb, viscous = Term("d_M", frozenset()), Term("omega", frozenset({"omega"}))

    assert (grammar.direction_of([gear]) == grammar.known["d_M"]).all()
    assert grammar.direction_of([viscous, coulomb]).size == 0
    assert grammar.direction_of([Term("theta", frozenset({"theta"}))]).size == 0


def test_a_standstill_shows_its_friction(servo):
    """Where the nominal servo would move and this one does not: the torque of the gear explains it best."""
    believed, gear, log, signals, grammar = servo
    fitted = np.ones(len(log) - 1, dtype=bool)
    found = held_laws(believed, signals, grammar, fitted)
    best = found[0]
    own = InjectionCase.of(gear, log, {"angle": 4e-4}).signals

    assert best.terms[0].text in ("d_M * abs(T_G)", "d_M * abs(T_M)", "d_M * abs(T_L)")
    assert "d_M * abs(T_G)" in [one.terms[0].text for one in found]
    assert -0.4 < best.factors[0] < -0.1
    assert held_laws(gear, own, Grammar.of(gear, own, "torque"), fitted) == []


def test_a_term_that_a_refit_gives_up_is_left_out(servo):
    """Two of three terms change sign: the third is left, with the values of the refit."""
    grammar = servo[-1]
    shape = Term("d_M * max(abs(T_M) - at, 0)", frozenset({"T_M"}), {"at": 0.02}, {"at": "N m"})
    terms = (Term("theta", frozenset({"theta"})), shape, Term("T_L", frozenset({"T_L"})))
    law = LawFit(grammar, terms, (0.2, -0.5, 0.3), (0.01, 0.01, 0.01), 0.7)
    definition = definition_of(law, [])
    values = {"c_1": -0.1, "c_2": -0.4, "c_at_2": 0.03, "c_3": 0.001}
    own = {n: one.model_copy(update={"value": values[n]}) for n, one in definition.parameters.items()}
    refitted = FreeRunLaw(law, definition.model_copy(update={"parameters": own}), Begin(), None, {})

    assert not refitted.stable
    assert refitted.reduced.terms == (replace(shape, shapes={"at": 0.03}),)
    assert refitted.reduced.factors == (-0.4,)


@pytest.mark.parametrize(("share", "ends"), [(1.0, False), (0.5, True)])
def test_an_end_value_that_the_log_does_not_reach_is_tried_in_proportion_to_time(share, ends):
    """With the same slope at the start; a time constant within its bounds stays."""
    grammar = with_memories(case(lambda x, v, d: 0.0 * x), *over_time({"v": ("v",)}, 24.0))[0]
    found = next(one for one in grammar.memories if "exp" in one.text)
    term = Term(found.text, frozenset(found.on), {"tau": 24.0}, found.units, found.memory)
    law = LawFit(grammar, (term,), (300.0,), (3.0,), 0.7)
    definition = definition_of(law, [])
    own = definition.parameters["c_tau_1"]
    tau = share * own.bounds[1]
    parameters = definition.parameters | {"c_tau_1": own.model_copy(update={"value": tau})}
    refitted = FreeRunLaw(law, definition.model_copy(update={"parameters": parameters}), Begin(), None, {})
    other = refitted.proportional

    if ends:
        assert other is None
        return
    assert other.terms[0].text == "v * memory" and other.terms[0].shapes == {}
    assert other.factors == (pytest.approx(300.0 / tau),) and other.sd == (pytest.approx(3.0 / tau),)
    early = slice(0, 100)
    values = [one.factors[0] * grammar.values(one.terms[0])[early] for one in (refitted.refitted, other)]
    np.testing.assert_allclose(values[1], values[0], rtol=100 * 0.004 / tau, atol=1e-12)
    assert "exp" not in definition_of(other, []).expression


def tried_law(place, base, deviance, gaps, without, deviance_without=0.0):
    """What `laws_of_best` sees of a law in free run. gaps, without: on training and held-out data."""

    def scored(deviance, gaps):
        return N(deviance=deviance, training_gap={"total": gaps[0]}, held_out_gap={"total": gaps[1]})

    law = N(scored=scored(deviance, gaps), stable=True, law=N(grammar=N(name=place)))
    return N(law=law, base=base, without=scored(deviance_without, without))


def test_effects_that_imitate_a_law_are_not_named_beside_it():
    """They leave as little on the training data as the law alone does, and more held-out gap."""
    plain, imitated = (0.02, 0.06), (0.003, 0.05)
    plant, effects = N(fit=N(candidates=())), N(fit=N(candidates=("rod_friction", "hose_wall")))
    alone = tried_law("pump_flow", plant, 5740.0, (0.002, 0.005), plain)
    other = tried_law("pump_flow", plant, 5800.0, (0.002, 0.006), plain)
    elsewhere = tried_law("force", plant, 5900.0, (0.002, 0.009), plain)
    worse = tried_law("force", plant, 5700.0, (0.004, 0.009), plain)
    reference = Reference(6000.0, 16000.0, 0.02, 1.0)

    def best(deviance, gaps=(0.001, 0.005)):
        beside = tried_law("pump_flow", effects, deviance, gaps, imitated)
        return beside, laws_of_best([beside, elsewhere, other, alone, worse], beside.without, reference)

    assert best(5730.0)[1] == [alone, other]
    beside, found = best(5500.0)
    assert found == [beside]
    beside, found = best(5500.0, gaps=(0.0025, 0.005))
    assert found == [alone, other]


def test_a_law_replaces_effects_by_its_deviance_where_its_gaps_are_no_larger():
    """Single slips decide most of what both leave, but the deviance is lower by more than the margin."""
    effects = N(fit=N(candidates=("orifice_leakage", "chamber_volume_variation")))
    last = tried_law("pump_flow", effects, 650.0, (0.014, 0.016), (0.014, 0.016), 657.0).without

    def found(deviance, gaps):
        alone = tried_law("pump_flow", N(fit=N(candidates=())), deviance, gaps, (0.05, 0.056), 1800.0)
        return laws_of_best([alone], last, Reference(259.0, 1886.0, 0.05, 1.0)) == [alone]

    assert found(507.0, (0.0125, 0.0148))
    assert not found(607.0, (0.0125, 0.0148)) and found(607.0, (0.0125, 0.010))
    assert not found(507.0, (0.0125, 0.0165)) and not found(507.0, (0.0145, 0.0148))


def test_an_effect_that_a_term_of_the_law_cancels_does_not_stay_beside_it(monkeypatch):
    """The law has a smaller deviance without it, and a larger one without the other effect."""
    delay, orifice = (N(key=(id, None), names=(id,)) for id in ("sensor_delay", "orifice_leakage"))
    deviances = {"orifice_leakage sensor_delay": 135.0, "sensor_delay": 125.0, "orifice_leakage": 304.0, "": 298.0}
    rest = {"total": 0.06}

    def law(members):
        ids = [name for one in members for name in one.names]
        found = tried_law("pump_flow", None, deviances[" ".join(ids)], (0.007, 0.01), (0.06, 0.11)).law
        return N(**vars(found), others=dict.fromkeys(ids), refitted=members, reduced=None)

    def fit(members):
        return N(candidates=members, without=lambda out, _: tuple(c for c in members if c is not out))

    def refitted(laws, _scoring, base, *_):
        return [law(base.candidates) for _ in laws]

    monkeypatch.setattr(find, "refit", lambda _objective, members, values, *_, **__: fit(members))
    monkeypatch.setattr(find, "refit_laws", refitted)
    scoring = N(objective=None, score=lambda one: N(fit=one, training_gap=rest, held_out_gap=rest, deviance=0.0))
    both = (orifice, delay)
    first = find._Tried(
        law(both), find.LawBase((), fit(both)), N(training_gap=rest, held_out_gap=rest, deviance=0.0), None, 0.0
    )

    found = find._with_fewer_effects(
        [first], first.without, lambda one: find.LawBase((), one), scoring, Reference(0.0, 4000.0, 0.06, 1.0), None
    )

    best = find.laws_of_best(found, first.without, Reference(0.0, 4000.0, 0.06, 1.0))
    assert [one.base.fit.candidates for one in best] == [(delay,)]
    assert [one.base.fit.candidates for one in found] == [both, (delay,), (orifice,), ()]


def selected(law_has, causes=("orifice_leakage", "sensor_delay", "K_T"), own=("sensor_delay", "K_T"), verdict="partly"):
    """What `without_imitators` makes of a selection with two effects and a nominal parameter. law_has: effects beside
    the law. own: what has a gap of its own in the hypothesis without the others."""
    keys = {name: (name, None) for name in ("orifice_leakage", "sensor_delay", "K_T", "law")}
    effects = tuple(N(key=keys[name]) for name in ("orifice_leakage", "sensor_delay"))
    score = {"deviance": 1.0, "training_gap": {}, "held_out_gap": {}}
    chosen = ScoredHypothesis(N(candidates=effects), own_gaps={}, causes=tuple(keys[n] for n in causes), **score)
    beside = tuple(one for one in effects if one.key[0] in law_has)
    without = ScoredHypothesis(N(candidates=beside), own_gaps={keys[n]: {} for n in own}, causes=(), **score)
    law = N(candidates=(*beside, N(key=keys["law"])), proposed=N(beside=tuple(law_has)), without=without)
    before = Selection(verdict, chosen, {}, {}, (), 0.0)
    return before, find.without_imitators(before, law)


def test_causes_stay_where_the_law_needs_all_effects_beside_it():
    """A nominal parameter is a cause that is no candidate: it is not left out."""
    before, after = selected(("orifice_leakage", "sensor_delay"))
    assert after is before


def test_causes_beside_a_law_are_those_of_the_hypothesis_without_the_imitators():
    """The nominal parameter stays; one whose change the smaller hypothesis does not need goes."""
    _, after = selected(("sensor_delay",))
    assert after.verdict == "partly" and after.chosen.causes == (("sensor_delay", None), ("K_T", None))
    assert [one.key[0] for one in after.chosen.fit.candidates] == ["sensor_delay"]
    _, after = selected(("sensor_delay",), own=("sensor_delay",))
    assert after.chosen.causes == (("sensor_delay", None),)


def test_nothing_is_named_where_the_law_needs_no_effect():
    _, after = selected((), own=("K_T",))
    assert after.verdict == "outside_catalogue" and not after.named


def test_causes_that_explained_the_gap_do_so_no_more_where_a_law_replaces_some():
    before, after = selected(("sensor_delay",), verdict="effect")
    assert before.explains and after.verdict == "partly" and after.named


def test_a_selection_that_names_nothing_stays():
    before, after = selected((), verdict="outside_catalogue")
    assert after is before


def test_a_law_is_sought_where_the_catalogue_leaves_much_of_the_deviance():
    """Of 1000 above noise; whatever is left, where the catalogue does not explain the gap."""
    reference = Reference(100.0, 1100.0, 0.05, 1.0)

    def sought(verdict, deviance):
        return find.law_is_sought(Selection(verdict, N(deviance=deviance), {}, {}, (), 0.0), reference)

    assert sought("effect", 300.0) and sought("ambiguous", 300.0) and not sought("effect", 150.0)
    assert sought("outside_catalogue", 150.0) and sought("partly", 150.0) and not sought("underdetermined", 300.0)


BAM = Path(__file__).parents[3] / "shared" / "data" / "bam"
EMPS = Path(__file__).parents[3] / "shared" / "data" / "emps" / "train.csv"
#: Effects of friction beyond the believed one.
FRICTION = (
    "asymmetric_friction", "load_dependent_friction", "maxwell_slip", "position_dependent_friction", "presliding",
    "rod_drag", "windage", "viscosity_warmup",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif(not BAM.is_dir(), reason="the measured records are not here")
def test_a_measured_servo_shows_its_loaded_gear_without_the_catalogue():
    """Believed with Coulomb and viscous friction: dry friction with the gear's torque closes most of the gap of another
    record."""
    plant = e.load_plant("xl330_pendulum", settings={"kp": 100.0})
    logs = [
        e.Preparation(resample=200.0).apply(e.read_plant_log(BAM / f"kp100_{name}.csv", plant, uniform=False), plant)[0]
        for name in ("sin_time_square", "sin_sin")
    ]
    found = e.diagnose(plant, logs[0], validate=logs[1], without=FRICTION, jobs=2)

    assert found.law.place == "torque"
    assert {form.file.expression for form in found.law.forms} & {"c_1 * d_M * abs(T_G)", "c_1 * d_M * abs(T_M)"}
    assert found.gap["with_law"]["total"] < 0.5 * found.gap["nominal"]["total"]


@pytest.mark.slow
@pytest.mark.skipif(not EMPS.is_file(), reason="the measured record is not here")
def test_a_measured_carriage_has_coulomb_and_viscous_friction():
    """Believed without any friction, and without its effects: the published law comes first, within its spread."""
    plant = e.load_plant("emps").set(Fc=0.0, Fv=0.0)
    log = e.Preparation(resample=250.0).apply(e.read_plant_log(EMPS, plant), plant)[0]
    found = e.diagnose(plant, log, without=(*FRICTION, "rod_friction", "rod_viscous_friction"), jobs=2)
    best = found.law.forms[0].file
    factors = {term.partition(" * ")[2]: term[:3] for term in best.expression.split(" + ")}
    values = {factor: best.parameters[name].value for factor, name in factors.items()}

    assert values == pytest.approx({"d_R": 20.4, "v": 203.5}, rel=0.1)
    assert found.gap["with_law"]["total"] < 0.01 * found.gap["nominal"]["total"]


def test_an_effect_that_is_left_out_is_no_candidate(plant):
    """The catalogue without it, and an error for a name that it does not have."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=4.0, sample_time=0.004), centre=True)
    prepared = prepare_logs(plant, [log], None, 0.03, check=True)
    whole = Segment((prepared.logs[0].record,), "the log")
    everything, less = ({c.id for c in segment_candidates(whole, without)} for without in ((), ["relief_valve"]))

    assert everything - less == {"relief_valve"}
    with pytest.raises(e.InputError, match="without = 'relief' is no effect"):
        e.diagnose(plant.set(K_T=1.5), log, without=["relief"])


@pytest.mark.parametrize("place", ["torque", "force", "flow_1", "flows", "pump_flow", "displacement"])
def test_every_term_is_a_law_of_the_plant(plant, place):
    """The grammar of a real log: each term alone, with its factor, has a definition whose units fit the plant."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=3.0, sample_time=0.004), centre=True)
    signals = InjectionCase.of(plant, log, {}).signals
    grammar = Grammar.of(plant, signals, place)
    by_family = {term.family: term for term in grammar.terms()}

    # A pump's flow knows waves and slow memories, its displacement the waves alone; each other place has more.
    fewest = {"pump_flow": 2, "displacement": 0}.get(place, 3)
    assert sum(term.memory is not None for term in by_family.values()) > fewest
    for term in by_family.values():
        definition = definition_of(LawFit(grammar, (term,), (1.0,), (0.1,), 0.5), list(plant.parameters))
        effect = effect_of("one_term", definition, "a test")
        assert effect.law is not None
        effect.law.check(plant.structure.units)


def test_a_part_of_a_log_begins_with_what_the_law_remembers(plant):
    """The clock of a law does not start anew in the held-out last third: 4 s of a log that begins at 0."""
    definition = LawFile.model_validate(
        {
            "schema": 1, "status": "proposed", "summary": "a weaker motor", "adds_to": "torque",
            "expression": "-c_old * current * age",
            "parameters": {"c_old": {"value": 0.01, "unit": "N m/(A s)", "neutral": 0.0}},
            "states": {"age": {"rate": "1", "unit": "s", "scale": 1.0}},
        }
    )  # fmt: skip
    EFFECTS.keep("older", effect_of("older", definition, "a test"))
    rig = plant.with_effects("older")
    log, _ = e.record(rig, *e.excitation("noise", amplitude=3.0, duration=6.0, sample_time=0.004), centre=True)
    model = HypothesisModel(rig, log, initial_state(rig, log))
    part = part_of_log(rig, model, {}, [slice(1000, 1500)]).model
    first = part.log.time[0]

    assert 2.0 < first < 4.0 and part.start is not None
    assert part.start["age"] == pytest.approx(first - log.time[0], abs=1e-9)
