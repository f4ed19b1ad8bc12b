"""Sums of terms that explain an unknown input: closed forms come back with their numbers, and chance does not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from law_cases import TIME, case

import ehsa_ctrl as e
from ehsa_ctrl.diagnosis.law import regression, shapes
from ehsa_ctrl.diagnosis.law.grammar import Grammar, LawVariable, Term
from ehsa_ctrl.diagnosis.law.law_fit import LawFit
from ehsa_ctrl.diagnosis.law.memory import slip
from ehsa_ctrl.diagnosis.law.regression import find_sums, placebo
from ehsa_ctrl.diagnosis.law.sum_problem import PENALTY, SumProblem, SumTarget, all_terms, evidence
from ehsa_ctrl.diagnosis.place_sets import InjectionCase
from ehsa_ctrl.diagnosis.regimes import Windows


@pytest.mark.parametrize(
    ("unknown", "terms", "factors"),
    [
        (lambda x, v, d: 3e3 * v * np.abs(v), ["v * abs(v)"], [3e3]),
        (lambda x, v, d: 4e5 * v**3, ["v**3"], [4e5]),
        (lambda x, v, d: 20.0 * d + 200.0 * v, ["d_R", "v"], [20.0, 200.0]),
        (lambda x, v, d: 5e4 * x, ["x"], [5e4]),
        (lambda x, v, d: 2e6 * v * x**2, ["v * x**2"], [2e6]),
    ],
)
def test_a_closed_form_comes_back(unknown, terms, factors):
    """The right terms with their factors, within 5 %."""
    best = find_sums(all_terms(*case(unknown)))[0]

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
    best = find_sums(all_terms(*case(unknown)))[0]

    assert best.terms[0].text == text
    assert best.terms[0].shapes["at"] == pytest.approx(at, abs=1e-3)
    assert width is None or best.terms[0].shapes["width"] == pytest.approx(width, rel=0.1)


def test_a_bump_that_leaves_the_data_ends_its_sum(monkeypatch):
    """At 19 of its widths from the data it is almost zero, and the square of its factor overflows: no standard
    deviation is infinite, which no effect's file can have."""
    monkeypatch.setattr(shapes, "shaped", lambda target, terms: [far(one) for one in terms])

    def far(term):
        if term.text != "exp(-((x - at) / width)**2)":
            return term
        left.append(replace(term, shapes={"at": 0.042 + 19.05 * 0.006, "width": 0.006}))
        return left[-1]

    left = []
    found = find_sums(all_terms(*case(lambda x, v, d: 300.0 * np.exp(-(((x - 0.008) / 0.006) ** 2)))))

    assert left
    assert np.isfinite([value for one in found for value in (*one.factors, *one.sd)]).all()


def test_a_small_constant_beside_friction_comes_back():
    """18 N beside 200 N of friction: less than the smallest gain of a term, but most of what friction leaves."""
    best = find_sums(all_terms(*case(lambda x, v, d: 200.0 * d + 18.0)))[0]

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
    best = find_sums(all_terms(*case(lambda x, v, d: 80.0 * np.sin(2.0 * np.pi * x / 0.02 + 0.4))))[0]

    assert best.terms[0].text == "sin(x / width + at)"
    assert 2.0 * np.pi * best.terms[0].shapes["width"] == pytest.approx(0.02, rel=0.02)


def test_what_a_sum_leaves_is_that_of_ridge_regression_on_each_half():
    """With errors of three nominal parameters as further columns, fitted on one half and tested on the other."""
    random = np.random.default_rng(0)
    windows = Windows(np.convolve(random.standard_normal(6000), np.ones(20) / 20.0, "same"), 0.004)
    P = 0.3 * random.standard_normal((windows.values.size, 3))
    columns = [scale * random.standard_normal(windows.values.size) for scale in np.logspace(-4, 3, 8)]
    target = SumTarget(Grammar("force", (), {}, {}), windows, P)
    problem = SumProblem.of_columns(target, [Term(f"z_{i}", frozenset()) for i in range(8)], columns)

    def left(y, chosen):
        found = 0.0
        Z = np.column_stack([P, problem.C[:, chosen]])
        prior = np.diag([problem.target.prior] * 3 + [problem.ridge] * len(chosen))
        for test in (0, 1):
            fit, other = windows.fold != test, windows.fold == test
            b = np.linalg.solve(Z[fit].T @ Z[fit] + prior, Z[fit].T @ y[fit])
            found += float(np.sum((y[other] - Z[other] @ b) ** 2))
        return found

    for of, y in ((problem, windows.values), (problem.reversed(), windows.values[::-1])):
        for chosen in ([], [2], [5, 1, 7]):
            assert of.left(chosen) == pytest.approx(left(y, chosen), rel=1e-9)
            assert of.lefts(chosen, [0, 3]) == pytest.approx([left(y, [*chosen, i]) for i in (0, 3)], rel=1e-9)
            assert of.explained(chosen, [3])[0] == pytest.approx(of.share([*chosen, 3]), abs=1e-12)
    assert of.share([5, 1]) == pytest.approx(1.0 - left(y, [5, 1]) / left(y, []) - 2 * PENALTY)


@pytest.mark.parametrize("step", [0.179, 0.788])
def test_the_steps_of_a_drive_come_back(plant, step):
    """A torque of 1.2 N m/A times what a drive that sets 0.179 A or 0.788 A at a time leaves of the current."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=12.0, sample_time=0.004), centre=True)
    signals = InjectionCase.of(plant, log, {}).signals
    grammar = Grammar.of(plant, signals, "torque")
    current = grammar.known["current"]
    values = 1.2 * (step * np.round(current / step) - current)
    windows = Windows(values + 0.03 * np.random.default_rng(0).standard_normal(values.size), 0.004)

    best = find_sums(all_terms(grammar, windows, np.zeros((windows.values.size, 0))))[0]

    assert best.terms[0].text == "(width * round(current / width) - current)"
    assert best.factors[0] == pytest.approx(1.2, rel=0.05)
    assert best.terms[0].shapes["width"] == pytest.approx(step, rel=0.01)


def test_each_family_of_a_variable_is_tried_alone():
    """A brake that drags at a low current explained 0.54 of a torque, and steps of the drive 0.63. Of sums, and within
    a family, the better one is tried.
    """
    current = frozenset({"current"})
    brake, steps = Term("d_M * (at - abs(current))", current), Term("width * round(current / width)", current)
    coarse = replace(steps, shapes={"width": 0.7})
    problem = SimpleNamespace(terms=[brake, steps, coarse])

    kept = regression._varied(problem, [(0.54, (0,)), (0.63, (1,)), (0.2, (2,)), (0.8, (0, 1)), (0.7, (0, 2))])

    assert kept[:3] == [(0.8, (0, 1)), (0.7, (0, 2)), (0.63, (1,))]
    assert (0.54, (0,)) in kept and (0.2, (2,)) not in kept


def test_steps_of_any_size_are_near_to_a_term_of_the_grid():
    """Steps of a drive that lie between two terms: the nearer one explains most of what they leave of the current."""
    current = np.linspace(-2.5, 2.5, 20001)

    def steps(width):
        return width * np.round(current / width) - current

    known, units = {"current": current}, {"current": "A"}
    grammar = Grammar("torque", (LawVariable("current", "A", current),), known, units)
    widths = [term.shapes["width"] for term in grammar.terms() if "round" in term.text]
    for count in np.random.default_rng(0).uniform(3.5, 95.0, 30):
        true = steps(5.0 / count)
        near = [steps(width) for width in widths if abs(width * count / 5.0 - 1.0) < 0.1]
        assert max((one @ true) ** 2 / (one @ one) for one in near) > 0.8 * (true @ true)


def test_a_brake_that_switches_at_once_comes_back():
    """0.5 N m below 1 A, on a rig that stands still for four fifths of the log, at less current. In motion the current
    is near to that most of the time. Gates of the grid must explain most of it already: they compete with other terms
    before their shapes are fitted."""
    random = np.random.default_rng(3)
    moves = np.repeat(random.random(120) < 0.2, 200)
    slow = np.convolve(random.standard_normal(moves.size), np.hanning(80) / 40.0, "same")
    fast = np.arange(moves.size) % 200 < 20
    current = np.where(moves, 1.01 + 0.02 * slow / np.std(slow) + 2.0 * fast, 0.3 + 0.1 * slow)
    omega = np.where(moves, 20.0 + slow, 0.0)
    known = {"current": current, "omega": omega, "d_M": np.ones(moves.size)}
    variables = LawVariable("omega", "rad/s", omega, speed=True), LawVariable("current", "A", current, effort=True)
    units = {"current": "A", "omega": "rad/s", "d_M": "1"}
    grammar = Grammar("torque", variables, known, units, "d_M", omega, 0.9, 1.0 * moves, -1.0)
    values = np.where(np.abs(current) < 1.0, -0.5, 0.0) + 0.02 * random.standard_normal(moves.size)
    windows = Windows(np.where(moves, values, np.nan), 0.004)
    nuisance = np.zeros((windows.values.size, 0))
    gates = [term for term in grammar.terms() if "tanh((at - abs(current))" in term.text]
    problem = SumProblem.of(SumTarget(grammar, windows, nuisance), gates)

    assert problem.explained((), range(len(gates))).max() > 0.7
    best = find_sums(all_terms(grammar, windows, nuisance))[0]
    assert best.terms[0].text == "d_M * 0.5 * (1 + tanh((at - abs(current)) / width))" and best.explained > 0.9
    assert best.terms[0].shapes["at"] == pytest.approx(1.0, abs=0.01) and best.terms[0].shapes["width"] < 0.02
    assert best.factors[0] == pytest.approx(-0.5, rel=0.05)


def test_friction_that_drives_the_motion_is_no_law():
    """A negative Coulomb level on a frictionless rod would move it by itself."""
    found = find_sums(all_terms(*case(lambda x, v, d: -20.0 * d - 200.0 * v)))

    assert all("d_R" not in term.text and "v" not in term.variables for one in found for term in one.terms)


def test_chance_explains_nothing():
    """White noise has no law, and a law reversed in time explains less than the law by far."""
    noise = all_terms(*case(lambda x, v, d: np.random.default_rng(1).standard_normal(x.size)))
    bump = all_terms(*case(lambda x, v, d: 300.0 * np.exp(-(((x - 0.008) / 0.006) ** 2))))

    assert find_sums(noise) == []
    assert placebo(bump) < 0.3 < find_sums(bump)[0].explained - 0.5


def test_a_constant_is_not_taken_for_chance():
    """It is the same in reversed time, and a law all the same; a placebo is what a term explains beyond it."""
    of = case(lambda x, v, d: 280.0 + 3000.0 * np.abs(v) + 40.0 * np.sin(40.0 * TIME[:-1] ** 2))
    problem = all_terms(*of)
    best = find_sums(problem)[0]

    assert {"1", "abs(v)"} >= {term.text for term in best.terms} and best.explained > 0.9
    assert placebo(problem) < 0.1


def test_a_variable_that_explains_everything_hides_no_other():
    """The pressures balance the force on a rod: the law in the speed is found beside that of the pressure."""
    grammar, windows, nuisance = case(lambda x, v, d: 280.0 * d + 3e4 * v * np.abs(v))
    force = 280.0 * grammar.known["d_R"] + 3e4 * grammar.known["v"] * np.abs(grammar.known["v"])
    pressure = LawVariable("P", "Pa", force / 2.5e-3)
    grammar = replace(
        grammar, variables=(*grammar.variables, pressure), known={**grammar.known, "P": pressure.values},
        units={**grammar.units, "P": "Pa"},
    )  # fmt: skip
    found = [{term.text for term in one.terms} for one in find_sums(all_terms(grammar, windows, nuisance))]

    assert found[0] <= {"P", "d_R * abs(P)"} and {"d_R", "v * abs(v)"} in found


def test_a_wrong_nominal_parameter_is_no_law():
    """What follows the change by a nominal parameter is explained by that parameter."""
    grammar, windows, _ = case(lambda x, v, d: 5e4 * x)
    nuisance = windows.of((1e5 * grammar.known["x"])[:, None])

    assert find_sums(all_terms(grammar, windows, nuisance)) == []


def test_no_product_with_what_drives_the_rod(plant):
    """The pressures balance any friction, so that their product with another variable would explain it."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=4.0, sample_time=0.004))
    signals = InjectionCase.of(plant, log, {}).signals
    products = {
        name: [t.text for t in Grammar.of(plant, signals, name).terms() if len(t.variables) == 2 and not t.memory]
        for name in ("force", "torque", "pump_flow")
    }

    assert "v * x**2" in products["force"] and not any("P_1" in text for text in products["force"])
    assert "(P_1 - P_2) * abs(omega)" in products["pump_flow"]
    assert any("P_1" in text for text in products["torque"])
