"""What a law remembers: angles, lags, hysteresis, the running time, and where a part of a log begins."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from law_cases import TIME, case, with_memories
from scipy.signal import lsim, lti

import ehsa_ctrl as e
from ehsa_ctrl.core.expression import Expression
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel
from ehsa_ctrl.diagnosis.law.begin import Begin
from ehsa_ctrl.diagnosis.law.free_run import FreeRunLaw, definition_of, with_effect
from ehsa_ctrl.diagnosis.law.grammar import Grammar, Term, _beyond_ringing
from ehsa_ctrl.diagnosis.law.inputs import with_combined
from ehsa_ctrl.diagnosis.law.law_fit import LawFit
from ehsa_ctrl.diagnosis.law.memory import (
    FORGETS,
    clock,
    lag,
    late_direction,
    over_time,
    resonance,
    slip,
    turn,
)
from ehsa_ctrl.diagnosis.law.memory_terms import _friction
from ehsa_ctrl.diagnosis.law.regression import find_sums, with_whole_orders
from ehsa_ctrl.diagnosis.law.shapes import shaped
from ehsa_ctrl.diagnosis.law.sum_problem import SumTarget, all_terms, explained_by
from ehsa_ctrl.diagnosis.place_sets import InjectionCase
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.regimes import Windows
from ehsa_ctrl.diagnosis.signals import estimate_noise
from ehsa_ctrl.diagnosis.validation_segment import initial_state, part_of_log
from ehsa_ctrl.physics.effects import EFFECTS, LawFile, effect_of


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


def test_a_wave_of_a_nearly_whole_order_is_tried_with_the_whole_one(plant):
    """After 2000 rad an order of 2.9985 is 3 rad behind. Another order, as of a geared pump, stays as it is."""
    grammar = Grammar.of(plant, InjectionCase.of(plant, rippled(plant)[1], {}).signals, "displacement")

    def law(order):
        term = next(one for one in grammar.terms() if one.shapes["order"] == 3.0)
        return LawFit(grammar, (replace(term, shapes={**term.shapes, "order": order}),), (1e-7,), (1e-9,), 0.9)

    whole = law(2.9985).with_whole_orders
    file = definition_of(whole, [])

    assert whole.terms[0].text == "sin(3 * memory + at)" and set(whole.terms[0].shapes) == {"at"}
    assert file.expression == "c_1 * sin(3 * c_m_1 + c_at_1)" and set(file.parameters) == {"c_1", "c_at_1"}
    np.testing.assert_allclose(whole.values, law(3.0).values, rtol=1e-12)
    assert law(1.002).with_whole_orders.terms[0].text == "sin(memory + at)"
    assert law(2.6).with_whole_orders is None and whole.with_whole_orders is None


def test_a_wave_of_a_whole_order_comes_in_the_phase_that_fits_it(plant):
    """The phase of an order that is 0.5 % off fits in the middle of the log, and is 2 rad off where that begins."""
    log = rippled(plant)[1]
    one = InjectionCase.of(plant, log, {})
    grammar = Grammar.of(plant, one.signals, "displacement")
    windows = Windows(with_combined(one.unknown.values)["displacement"], 0.004)
    nuisance = np.zeros((windows.values.size, 0))
    problem = all_terms(grammar, windows, nuisance)
    best = find_sums(problem)[0]
    term = best.terms[0]
    shapes = {"order": 1.99, "at": term.shapes["at"] - 2.0}
    off = replace(best, terms=(replace(term, shapes=shapes),))

    first, whole = with_whole_orders(problem.target, [off])

    assert first is off and whole.terms[0].text == "sin(2 * memory + at)" and whole.is_wave
    assert whole.explained == pytest.approx(best.explained, abs=0.02)
    assert explained_by(off.with_whole_orders, windows, nuisance) < 0.5 * whole.explained
    assert np.sign(whole.factors[0]) * np.exp(1j * whole.terms[0].shapes["at"]) == pytest.approx(
        np.sign(best.factors[0]) * np.exp(1j * term.shapes["at"]), abs=0.2
    )


def test_windows_begin_with_the_states_of_a_law(plant):
    """At the angle of the log in the middle of it: the true wave closes what it makes there."""
    rig, log = rippled(plant)
    effect = EFFECTS["ripple"]
    nominal = plant.set(B_FM=1.02 * plant["B_FM"])
    prepared = prepare_logs(nominal, [log], None, 0.03, check=True)
    segments = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True)
    case = InjectionCase.of(nominal, log, {})
    begin = Begin.of(effect.law.definition, Grammar.of(nominal, case.signals, "displacement"))
    held_out = segments.windows(prepared)[1]
    with_wave = begin.on_windows([with_effect(one, effect, Begin()) for one in held_out])

    without, with_law = (with_wave[0].gap({"c_1": size})["total"] for size in (0.0, rig["c_1"]))

    assert len(with_wave[0].records) == 2
    # A new plant for each window took most of the time of a search for a law.
    assert with_wave[0].records[0].model.plant is with_wave[0].records[1].model.plant
    turns = begin.states[0]["turns"]
    for record in with_wave[0].records:
        at = int(round(record.model.log.time[0] / log.sample_time))
        assert record.model.start["turns"] == turns[at]
    assert with_law < 0.2 * without
    # Of a second log for validation the beginning is not known.
    assert begin.on_windows([*held_out, *held_out]) is None


def test_a_displacement_that_ripples_comes_back_and_keeps_the_power(plant):
    """The law has its size, and adds flow and torque of one displacement."""
    rig, log = rippled(plant)
    size, changes = rig["c_1"], EFFECTS["ripple"].changes
    flow, torque = changes["Q_P"], changes["T_P"]
    one = InjectionCase.of(plant, log, {})
    grammar = Grammar.of(plant, one.signals, "displacement")
    windows = Windows(with_combined(one.unknown.values)["displacement"], 0.004)

    best = find_sums(all_terms(grammar, windows, np.zeros((windows.values.size, 0))))[0]

    assert best.terms[0].text == "sin(order * memory + at)"
    assert best.factors[0] == pytest.approx(size, rel=0.1)
    assert best.terms[0].shapes["order"] == pytest.approx(2.0, abs=0.01)
    # Without any other variable, it is drawn over the angle.
    assert grammar.variables == () and grammar.shown(best.terms[0]).text == "angle"
    # Its flow changes the sign with the speed: the mean over both directions hides the wave.
    assert (grammar.direction_of(best.terms) == grammar.known["omega"]).all()
    assert best.values.shape == (log.time.size - 1,)
    # Power into the oil and from the shaft: (P_1 - P_2) times the flow is omega times the torque.
    a = {"c_1": size, "turns": 0.3, "omega": 120.0, "P_1": 4e5, "P_2": 1e5}
    given = [{n: a[n] for n in inspect.signature(f).parameters if n in a} for f in (flow, torque)]
    assert 3e5 * flow(0.0, **given[0]) == pytest.approx(120.0 * torque(0.0, **given[1]))


@pytest.mark.parametrize(("angle", "speed"), [(0.0, 30.0), (2.0, 0.0), (-0.7, -20.0)])
def test_the_angle_at_the_start_of_a_part_is_corrected(plant, angle, speed):
    """By the run-in: angle (rad) and speed (rad/s) there off at first, the scored run is hardly worse."""
    rig, log = rippled(plant)
    part = part_of_log(rig, HypothesisModel(rig, log), estimate_noise(log), [slice(1500, 2500)])
    start = part.model.start
    start = {**start, "omega": start["omega"] + speed, "turns": start["turns"] + angle}
    off = replace(part, model=replace(part.model, start=start))

    assert off.gap(off.model.run([{}])[0])["total"] > 0.05
    assert off.gap(off.simulate({}))["total"] < 0.02


def test_an_angle_is_not_held_over_a_sample():
    """Speed from rest to 300 rad/s: held over samples of 4 ms the angle would be 0.6 rad short."""
    speed = 300.0 * np.linspace(0.0, 1.0, 251)[:-1]

    angle = turn("omega").course({"omega": speed}, {}, 0.004, (0,))["memory"]

    assert angle[-1] == pytest.approx(0.5 * 300.0 * (249 / 250) ** 2, rel=1e-6)


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


def test_friction_that_forgets_begins_at_zero_with_each_reversal():
    """Reversal after 0.1 s of tau = 0.3 s: the rest goes FORGETS times as fast,
    and the other direction begins at zero."""
    t = 0.0005 * np.arange(1000)
    known = {"d": np.where(t < 0.1, 1.0, np.where(t < 0.4, -1.0, 0.0))}
    late = late_direction("d", forgets=True)[1].course(known, {"tau": 0.3}, 0.0005, [0])["memory"]
    before = 1.0 - np.exp(-0.1 / 0.3)
    rate = (1.0 + FORGETS) / 0.3
    over = np.log1p((1.0 + FORGETS) * before) / rate
    left = np.where(t < 0.1 + over, (before * (1.0 + FORGETS) + 1.0) * np.exp(-rate * (t - 0.1)) - 1.0, 0.0)
    fresh = np.exp(-(np.minimum(t, 0.4) - 0.1 - over) / 0.3) - 1.0

    assert late == pytest.approx(
        np.where(t <= 0.1, 1.0 - np.exp(-t / 0.3), np.where(t < 0.1 + over, left / (1.0 + FORGETS), fresh)), abs=1e-9
    )


def test_friction_may_have_settled_before_the_log_begins():
    """It lacks nothing in the direction of the first motion then, and later no more than after any reversal."""
    d = np.repeat([-1.0, 1.0, -1.0], 400)
    for forgets in (False, True):
        text, of = late_direction("d", forgets=forgets, begins=-1.0)
        state = of.course({"d": d}, {"tau": 0.05}, 0.001, [0])
        settled = Expression.parse(text).values({"d": d, **state})
        text, of = late_direction("d", forgets=forgets)
        just_reversed = Expression.parse(text).values({"d": d, **of.course({"d": d}, {"tau": 0.05}, 0.001, [0])})

        assert settled[:400] == pytest.approx(0.0, abs=1e-12)
        assert just_reversed[0] == -1.0
        assert settled[400:] == pytest.approx(just_reversed[400:], abs=0.01)


def test_friction_that_begins_anew_at_a_reversal_comes_back(plant):
    """Half of the friction with 0.3 s of motion after each reversal, in a log of short moves; the noise at the
    standstill between them is no motion."""
    rod = plant.structure.system.all_contacts[1]
    term = next(t for t in _friction(rod, {"d_R": TIME}) if "abs" in t.text)
    file = LawFile.model_validate(
        {
            "schema": 1, "status": "proposed", "summary": "late", "adds_to": "force",
            "expression": f"c_1 * {term.text}",
            "parameters": {"c_1": {"value": -230.0, "unit": "N", "neutral": 0.0}, "tau": {"value": 0.3, "unit": "s"}},
            "states": {"memory": {"rate": term.memory.rates["memory"], "unit": "1", "scale": 1.0}},
        }
    )  # fmt: skip
    EFFECTS.keep("late_friction", effect_of("late_friction", file, "a test"))
    time = TIME[:3000]
    current = 2.5 * np.where(time % 1.0 < 0.25, np.where(time // 1.0 % 3 == 1, -1.0, 1.0), 0.0)
    log = e.record(plant.with_effects("late_friction", c_1=-230.0), time, current)[0]
    one = InjectionCase.of(plant, log, estimate_noise(log))
    grammar, windows = Grammar.of(plant, one.signals, "force"), Windows(one.unknown.values["force"], 0.004)

    def left_and_factor(given):
        known = Term(term.text, frozenset(), {"tau": 0.3}, {"tau": "s"}, term.memory)
        column = windows.of(given.values(known)[:, None])
        (factor,), *_ = np.linalg.lstsq(column, windows.values, rcond=None)
        return np.std(windows.values - factor * column[:, 0]) / np.std(windows.values), factor

    left, factor = left_and_factor(grammar)
    assert left < 0.12 and factor == pytest.approx(-230.0, rel=0.05)
    assert left_and_factor(replace(grammar, slides=1.0))[0] > 3.0 * left


def test_a_resonance_between_two_points_of_the_grid_comes_back(plant):
    """Of the drive, hardly damped: 46 rad/s at 0.13."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=12.0, sample_time=0.004))
    grammar = Grammar.of(plant, InjectionCase.of(plant, log, {}).signals, "torque")
    current = grammar.known["current"]
    natural, damping = 46.0, 0.13
    system = lti([natural**2], [1.0, 2.0 * damping * natural, natural**2])
    # The mean over each sample of what follows a current that is held: ten times the samples, then their means.
    _, follows, _ = lsim(system, np.repeat(current, 10), 0.0004 * np.arange(10 * current.size), interp=False)
    windows = Windows(1.2 * (follows.reshape(-1, 10).mean(axis=1) - current), 0.004)

    best = find_sums(all_terms(grammar, windows, np.zeros((windows.values.size, 0))))[0]

    assert [term.text for term in best.terms] == ["(memory - current)"]
    assert best.factors[0] == pytest.approx(1.2, rel=0.02)
    assert best.terms[0].shapes == pytest.approx({"frequency": natural, "damping": damping}, rel=0.05)
    assert grammar.factor_unit(best.terms[0]) == "N m A-1"


def test_a_stop_is_no_reversal():
    """What the fit of the direction makes of it, a few percent with the other sign, against a slow motion."""
    stop, slow = np.zeros(60), np.zeros(60)
    stop[:20], stop[20:23], slow[20:] = 0.05, -0.002, -0.002

    assert _beyond_ringing(stop).tolist() == [True] * 20 + [False] * 40
    assert _beyond_ringing(slow)[20:].all()


def test_the_mean_of_a_memory_over_a_sample():
    """Fast lags and a resonance, driven by steps: the mean of a run with 200 times shorter samples."""
    steps = np.repeat(np.random.default_rng(0).standard_normal(20), 4)
    for memory, shapes in (
        (lag("u", "1", 1.0), {"tau": 0.003}),
        (resonance("u", "1", 1.0), {"frequency": 100.0, "damping": 0.2}),
        (late_direction("sign(u)", forgets=True)[1], {"tau": 0.03}),
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
    best = find_sums(all_terms(*with_memories(case(unknown), *memories)))[0]

    assert text in best.terms[0].text and best.terms[0].memory is not None
    assert best.terms[0].shapes[shape] == pytest.approx(expected, rel=0.1)


def test_a_law_with_a_memory_is_an_effect(plant):
    """Its definition has the state, its rate and units that fit; a run has the state."""
    problem = with_memories(case(lambda x, v, d: 150.0 * d * (TIME[:-1] > 9.3)), *over_time({"d_R": ()}, 24.0))
    found = find_sums(all_terms(*problem))
    definition = definition_of(found[0], list(plant.parameters))
    EFFECTS.keep("late_jam", effect_of("late_jam", definition, "a test"))
    run = e.simulate(plant.with_effects("late_jam"), np.full(250, 2.0))

    assert definition.states["c_m_1"].rate == "1" and "d_R" in definition.expression
    assert run["c_m_1"][-1] == pytest.approx(0.004 * 249)


def test_a_step_in_time_does_not_leave_the_log(plant):
    """Friction that was half there 6 s before the log began: the location stays in it, and has bounds, at 0 s too."""
    problem = with_memories(
        case(lambda x, v, d: 75.0 * d * (1 + np.tanh((TIME[:-1] + 6.0) / 8.0))), *over_time({"d_R": ()}, 24.0)
    )
    grammar = problem[0]
    step = next(one for one in grammar.memories if "tanh" in one.text)
    term = Term(step.text, frozenset(step.on), step.shapes, step.units, step.memory)
    (found,) = shaped(SumTarget(*problem), [term])

    assert 0.0 < found.shapes["at"] < term.shapes["at"]
    for at in (found.shapes["at"], 0.0):
        one = replace(found, shapes=found.shapes | {"at": at})
        own = definition_of(LawFit(grammar, (one,), (150.0,), (3.0,), 0.7), list(plant.parameters)).parameters["c_at_1"]
        assert own.bounds[0] == 0.0 <= own.value < own.bounds[1]


@pytest.mark.parametrize(("share", "ends"), [(0.6, False), (0.4, True)])
def test_an_end_value_that_the_log_does_not_reach_is_tried_in_proportion_to_time(share, ends):
    """With the same slope at the start; where the log lasts more than two time constants, its end value shows."""
    grammar = with_memories(case(lambda x, v, d: 0.0 * x), *over_time({"v": ("v",)}, 24.0))[0]
    found = next(one for one in grammar.memories if "exp" in one.text)
    term = Term(found.text, frozenset(found.on), {"tau": 24.0}, found.units, found.memory)
    law = LawFit(grammar, (term,), (300.0,), (3.0,), 0.7)
    definition = definition_of(law, [])
    own = definition.parameters["c_tau_1"]
    tau = share * TIME[-1]
    parameters = definition.parameters | {"c_tau_1": own.model_copy(update={"value": tau})}
    refitted = FreeRunLaw(law, definition.model_copy(update={"parameters": parameters}), Begin(), None, {}, None)
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
