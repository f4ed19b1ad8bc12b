"""An MPC with cost and constraints stated in cvxpy: same loop, status, fallback and export as the shipped one."""

import sys
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

import ehsa_ctrl as e

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from mpc_own_problem import restated

T_S = 0.004
#: A step of 30 mm with noise-free sensors saturates current, its rate and the speed limit.
REFERENCE = np.full(120, 0.03)


@pytest.fixture(scope="module")
def linear():
    return e.load_plant("ehsa", model="linear")


@pytest.fixture(scope="module")
def model(linear):
    return e.three_state(linear)


@pytest.fixture(scope="module")
def shipped(model):
    return without_trajectory(model)


def without_trajectory(model, **options):
    """mpc_position on raw steps, so that its limits become active."""
    from dataclasses import replace

    return replace(e.load_controller("mpc_position", model, **options), trajectory=None)


def test_the_shipped_problem_in_cvxpy_gives_the_shipped_moves(linear, model, shipped):
    """Currents, limits active and not, agree to the exact solver's tolerance; so do status and number of unknowns."""
    own = without_trajectory(model, problem=restated(shipped.law), compiled=False)
    runs = [e.run_closed_loop(linear, controller, REFERENCE) for controller in (shipped, own)]

    assert np.max(np.abs(runs[0]["asked"])) > 5.99
    assert np.max(runs[0].trajectory["omega"]) > 449.0
    assert own.law.solver == "daqp" and len(own.law.condensed.F) == len(shipped.law.condensed.F)
    assert not runs[1]["solver_status"].any()
    np.testing.assert_allclose(runs[1]["asked"], runs[0]["asked"], rtol=0, atol=1e-7)


def test_a_solution_is_that_of_cvxpy(model, shipped):
    """For random parameters the reduced problem's moves are those that cvxpy's own solver finds."""
    from ehsa_ctrl.design.state_space.mpc_own_problem import canonical_form, complete_problem, condense_form
    from ehsa_ctrl.design.state_space.mpc_terms import MpcTerms

    def state(m):
        worst = cp.Variable()
        cost = cp.sum_squares((m.position - m.reference) / 1e-3) + cp.norm1(m.current_change) + 5 * worst
        return cost + 0.1 * cp.sum_squares(m.current), [cp.max(cp.abs(m.speed)) <= 300 * (1 + worst), worst >= 0]

    law = shipped.law
    terms = MpcTerms(law.problem)
    problem = complete_problem(law, terms, state)
    reduced = condense_form(canonical_form(problem, terms), terms.horizon)
    from ehsa_ctrl.design.qp import QP_SOLVERS

    solver = QP_SOLVERS["osqp"].make(reduced.H, reduced.G, 2000, None)
    rng = np.random.default_rng(2)
    for _ in range(5):
        p = np.zeros(law.problem.parameters)
        n = law.problem.model.A.shape[0]
        p[:n] = 0.1 * rng.normal(size=n)
        p[-1] = rng.uniform(-2.0, 2.0)
        terms.parameter.value = p
        problem.solve(solver=cp.CLARABEL)
        given = np.append(p, 1.0)
        found = solver.solve(
            reduced.F @ given,
            reduced.lower + reduced.T @ given,
            reduced.upper + reduced.T @ given,
            np.zeros(len(reduced.F)),
            np.zeros(reduced.lower.size),
        )

        assert found.status == 0
        np.testing.assert_allclose(found.x[: terms.horizon], terms.effort.value, rtol=0, atol=2e-4)


def with_cone(state, radius):
    """A statement with the currents in a ball [A] as well."""

    def stated(m):
        cost, rules = state(m)
        return cost, [*rules, cp.norm(m.current) <= radius]

    return stated


def test_a_problem_with_a_cone_has_the_moves_of_the_one_without(linear, model, shipped):
    """A ball that no plan leaves changes no current by more than 5 mA of 6 A, the noise of the drive."""
    own = without_trajectory(model, problem=with_cone(restated(shipped.law), 1e3))
    runs = [e.run_closed_loop(linear, controller, REFERENCE) for controller in (shipped, own)]

    assert "by clarabel" in str(own)
    assert not runs[1]["solver_reason"].any()
    np.testing.assert_allclose(runs[1]["asked"], runs[0]["asked"], rtol=0, atol=5e-3)


def test_a_plan_stays_in_its_cone(model, shipped):
    """A ball that plans leave: the plan is on its surface, and is that of cvxpy's own solution."""
    from ehsa_ctrl.design.state_space.mpc_own_problem import complete_problem
    from ehsa_ctrl.design.state_space.mpc_terms import MpcTerms

    state = with_cone(lambda m: (m.cost, []), 4.0)
    own = without_trajectory(model, problem=state).law
    terms = MpcTerms(own.problem)
    problem = complete_problem(shipped.law, terms, state)
    p = np.zeros(own.problem.parameters)
    n, d = own.problem.model.E.shape
    p[n + d : -3 : 3] = 0.02  # reference of 20 mm
    terms.parameter.value = p
    problem.solve(solver=cp.SCS, eps=1e-9, max_iters=200_000)
    given, c = np.append(p, 1.0), own.condensed
    found = own.qp.solve(c.F @ given, c.lower, c.upper + c.T @ given, np.zeros(len(c.F)), np.zeros(c.lower.size))

    assert found.status == 0
    assert np.linalg.norm(terms.current.value) == pytest.approx(4.0, abs=1e-4)
    np.testing.assert_allclose(found.x[: terms.horizon], terms.effort.value, rtol=0, atol=1e-3)


def test_parameters_of_the_user_count_with_their_value(linear, model, shipped):
    """A parameter as weight gives the moves of the number."""

    def state(m):
        weight = cp.Parameter(nonneg=True, name="weight", value=0.3)
        return m.cost + weight * cp.sum_squares(m.current)

    numbers = without_trajectory(model, problem=lambda m: m.cost + 0.3 * cp.sum_squares(m.current), compiled=False)
    own = without_trajectory(model, problem=state, compiled=False)
    runs = [e.run_closed_loop(linear, controller, REFERENCE)["asked"] for controller in (shipped, numbers, own)]

    assert np.max(np.abs(runs[1] - runs[0])) > 0.1
    np.testing.assert_allclose(runs[2], runs[1], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_compiled_by_cvxpygen_it_has_the_same_moves(linear, model, shipped, tmp_path, monkeypatch):
    """The shipped problem in the loop, limits active and not: 0.1 mA; a second run is the first one to the last bit,
    and another process loads the code."""
    import pickle

    pytest.importorskip("cvxpygen")
    monkeypatch.setenv("EHSA_CTRL_CACHE", str(tmp_path))
    own = without_trajectory(model, problem=restated(shipped.law))
    runs = [e.run_closed_loop(linear, controller, REFERENCE) for controller in (shipped, own, own)]
    monkeypatch.setattr("ehsa_ctrl.design.state_space.mpc_compiled._WRITE", "raise SystemExit(1)")
    again = e.run_closed_loop(linear, pickle.loads(pickle.dumps(own)), REFERENCE)

    assert "by osqp, compiled by cvxpygen" in str(own)
    assert np.max(np.abs(runs[0]["asked"])) > 5.99 and not runs[1]["solver_reason"].any()
    np.testing.assert_allclose(runs[1]["asked"], runs[0]["asked"], rtol=0, atol=1e-4)
    assert np.array_equal(runs[1]["asked"], runs[2]["asked"]) and np.array_equal(runs[1]["asked"], again["asked"])


@pytest.mark.slow
def test_a_compiled_problem_without_quadratic_cost_has_the_same_moves(linear, model, tmp_path, monkeypatch):
    """norm1 in the cost: currents of OSQP in Python within 1 mA, with iterations enough for both."""
    pytest.importorskip("cvxpygen")
    monkeypatch.setenv("EHSA_CTRL_CACHE", str(tmp_path))
    options = {"problem": lambda m: m.cost + cp.norm1(m.current_change), "solver": {"iteration_limit": 2000}}
    laws = [e.load_controller("mpc_position", model, compiled=each, **options) for each in (False, True)]
    runs = [e.run_closed_loop(linear, law, REFERENCE) for law in laws]

    assert not any(run["solver_reason"].any() for run in runs)
    np.testing.assert_allclose(runs[1]["asked"], runs[0]["asked"], rtol=0, atol=1e-3)


def test_a_compilation_that_fails_is_one_sentence_and_the_other_solver(model, tmp_path, monkeypatch, caplog):
    """Where cvxpygen is there but no compiler: a warning, and the problem is solved as without; required, an error."""
    from ehsa_ctrl.design.state_space import mpc_compiled, mpc_own_problem

    monkeypatch.setenv("EHSA_CTRL_CACHE", str(tmp_path))
    printed = "CMake Error at x:48:\\n  CMake Error: CMAKE_C_COMPILER not set\\nImportError: no module"
    monkeypatch.setattr(mpc_compiled, "_WRITE", f"print('{printed}'); raise SystemExit(1)")
    for module in (mpc_compiled, mpc_own_problem):
        monkeypatch.setattr(module, "has_cvxpygen", lambda: True)
    own = e.load_controller("mpc_position", model, problem=lambda m: m.cost)

    assert own.law.solver == "daqp" and own.law.external is None
    assert [record.getMessage() for record in caplog.records if record.levelname == "WARNING"] == [
        "problem: cvxpygen could not compile it (CMake Error: CMAKE_C_COMPILER not set); it needs a C compiler and "
        "CMake on the PATH; it is solved without"
    ]
    with pytest.raises(e.InputError, match=r"CMAKE_C_COMPILER not set.*; it needs a C compiler and CMake on the PATH$"):
        e.load_controller("mpc_position", model, problem=lambda m: m.cost, compiled=True)


def test_compiling_needs_cvxpygen(model, tmp_path, monkeypatch):
    """Without it, as required: the sentence says how to get it."""
    from ehsa_ctrl.design.state_space import mpc_compiled

    monkeypatch.setenv("EHSA_CTRL_CACHE", str(tmp_path))
    monkeypatch.setattr(mpc_compiled, "has_cvxpygen", lambda: False)
    with pytest.raises(e.InputError, match=r'pip install "ehsa_ctrl\[cvxpygen\]"'):
        e.load_controller("mpc_position", model, problem=lambda m: m.cost, compiled=True)
    with pytest.raises(e.InputError, match="problem: has cones, which are not compiled"):
        e.load_controller("mpc_position", model, problem=with_cone(lambda m: (m.cost, []), 9.0), compiled=True)
    with pytest.raises(e.InputError, match="compiled: is for an MPC with a problem of your own"):
        e.load_controller("mpc_position", model, compiled=True)


def test_terms_predict_the_model(model, shipped):
    """Signals over the horizon for random currents equal a simulation of the sampled model."""
    from ehsa_ctrl.design.state_space.mpc_terms import MpcTerms

    problem = shipped.law.problem
    terms, design = MpcTerms(problem), problem.model
    rng = np.random.default_rng(0)
    n, d = design.E.shape
    p = rng.normal(size=problem.parameters)
    extra, last = p[-2], p[-1]
    terms.parameter.value, terms.effort.value = p, rng.normal(size=terms.horizon)
    current = terms.current.value
    x, disturbance = p[:n], p[n : n + d]
    speeds, positions = [], []
    for k in range(terms.horizon):
        # The friction compensation acts against friction that the model does not have.
        x = design.A @ x + design.B * (current[k] - extra) + design.E @ disturbance
        speeds.append(design.row("speed") @ x)
        positions.append(design.row("position") @ x)

    motion = p[n + d : -3].reshape(-1, 3)
    # The target is exact for a motion with constant acceleration; a random one is none, so that only x counts.
    assert np.allclose(terms.current_change.value, np.diff(np.r_[last, current]))
    assert np.allclose(terms.reference.value, motion[1:, 0])
    steady = np.zeros(problem.parameters)
    steady[:n], steady[n : n + d] = p[:n], p[n : n + d]
    steady[-2:] = extra, last
    terms.parameter.value = steady
    x, current = p[:n], terms.current.value
    for k in range(terms.horizon):
        x = design.A @ x + design.B * (current[k] - extra) + design.E @ disturbance
        np.testing.assert_allclose(terms.speed.value[k], design.row("speed") @ x, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(terms.position.value[k], design.row("position") @ x, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "limit",
    [
        lambda m: [m.position <= 0.01, m.position >= -0.01],
        lambda m: [cp.norm_inf(m.position) + cp.norm(m.position) <= 0.02],
    ],
    ids=["linear", "cone"],
)
def test_a_sample_without_solution_takes_the_fallback(linear, model, limit):
    """A hard limit that the start violates: the run goes on, and the status tells."""
    own = without_trajectory(model, problem=lambda m: (m.cost, limit(m)), compiled=False)
    start = np.zeros(len(linear.structure.equations.states))
    start[linear.structure.equations.index("x")] = 0.02
    start[linear.structure.equations.index("P_1")] = start[linear.structure.equations.index("P_2")] = linear["P_0"]
    run = e.run_closed_loop(linear, own, np.zeros(200), start=start)

    assert run["solver_status"][0] == 3.0 and run["solver_reason"][0] == 1.0
    assert run["solver_status"][-1] == 0.0 and abs(run["x"][-1]) < 1e-4


def test_an_own_problem_is_exported(model, tmp_path):
    """The C's currents are within its tolerance of Python's, as for the shipped one."""
    from ehsa_ctrl.design.export import export_controller

    own = e.load_controller(
        "mpc_position", model, problem=lambda m: m.cost + 1e-2 * cp.sum_squares(m.current), label="own", compiled=False
    )
    reference = np.column_stack([np.full(60, 0.01), np.zeros((60, 2))])
    measured = np.random.default_rng(0).normal(size=(60, 5)) * [1.0, 1e4, 1e4, 1e-4, 1.0]
    deployment = export_controller(own, reference, measured)

    assert deployment.vector.distance < 1e-3
    assert deployment.vector.fallbacks == 0
    flat, cone = (
        e.load_controller("mpc_position", model, problem=problem, label=label, compiled=compiled)
        for label, problem, compiled in (
            ("flat", lambda m: m.cost + cp.norm1(m.current_change), False),
            ("cone", with_cone(lambda m: (m.cost, []), 9.0), None),
        )
    )
    with pytest.raises(e.InputError, match="flat: has unknowns without a quadratic cost"):
        export_controller(flat, reference, measured)
    with pytest.raises(e.InputError, match="cone: has cones, for which there is no C solver"):
        export_controller(cone, reference, measured)


def test_what_an_own_problem_lacks_is_said(model, tmp_path):
    """No margins; the text names solver and size; a run and its page say the solver and report no loop analysis."""
    own = e.load_controller("mpc_position", model, problem=lambda m: m.cost, compiled=False)
    run = e.run("steps_spring", controller=own)

    assert "a cost and constraints of your own (20 unknowns" in str(own) and "by daqp" in str(own)
    assert run.loop is None
    words = f"olver daqp: 0 of {run.nonlinear.asked.size} samples without a solution"
    assert words in str(run) and words in e.write_report(run, tmp_path).read_text()
    with pytest.raises(e.InputError, match="has no linear law to analyse"):
        e.analyse_loop(model, own)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (lambda m: None, r"problem: returned None; expected a cost, or \(cost, constraints\)"),
        (lambda m: (m.cost, [True]), "one of the constraints is True"),
        (lambda m: m.position, "scalar cost"),
        (lambda m: -cp.sum_squares(m.position), "is not convex"),
        (lambda m: (m.cost, [m.current[0] == cp.Variable(integer=True)]), "has an integer or boolean variable"),
        (lambda m: m.cost * cp.Parameter(nonneg=True, name="q"), "its parameter q has no value"),
        (lambda m: cp.sum(cp.multiply(m.reference, m.position)), "multiplied by another one that changes"),
        (lambda m: (m.cost, [m.position >= 1.0]), "has no solution at rest"),
    ],
)
def test_wrong_problems_are_one_sentence(model, state, words):
    """What was found and what was expected."""
    with pytest.raises(e.InputError, match=words) as caught:
        e.load_controller("mpc_position", model, problem=state, compiled=False)

    assert "\n" not in str(caught.value)


def test_a_problem_without_an_mpc_is_one_sentence(model):
    with pytest.raises(e.InputError, match='is for a controller of kind = "mpc"'):
        e.load_controller("lqr_position", model, problem=lambda m: m.cost)
