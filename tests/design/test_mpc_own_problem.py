"""An MPC with cost and constraints stated in cvxpy: same loop, status, fallback and export as the shipped one."""

import cvxpy as cp
import numpy as np
import pytest

import ehsa_ctrl as e

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


def restated(law):
    """The shipped problem in the terms of the user's."""
    limits, penalty = law.problem.limits, law.problem.penalty

    def state(m):
        slack = cp.Variable(3, nonneg=True)
        rules = [
            cp.abs(m.speed) / limits.speed <= 1 + slack[0],
            cp.abs(m.pressure) / limits.pressure <= 1 + slack[1],
            cp.abs(m.position) / limits.stroke <= 1 + slack[2],
        ]
        return m.cost + penalty * (cp.sum(slack) + 0.5 * cp.sum_squares(slack)), rules

    return state


def test_the_shipped_problem_in_cvxpy_gives_the_shipped_moves(linear, model, shipped):
    """Currents, limits active and not, agree to the exact solver's tolerance; so do status and number of unknowns."""
    own = without_trajectory(model, problem=restated(shipped.law))
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


@pytest.mark.slow
def test_a_solution_is_that_of_cvxpygen(model, shipped, tmp_path, monkeypatch):
    """The C code that cvxpygen writes for the same problem finds the same currents, with limits active."""
    cpg = pytest.importorskip("cvxpygen.cpg")
    from ehsa_ctrl.design.qp import QP_SOLVERS
    from ehsa_ctrl.design.state_space.mpc_own_problem import complete_problem
    from ehsa_ctrl.design.state_space.mpc_terms import MpcTerms

    def gentle(m):
        over = cp.Variable(nonneg=True)
        return m.cost + 0.2 * cp.sum_squares(m.current) + 1e3 * over, [cp.abs(m.speed) <= 100 + over]

    terms = MpcTerms(shipped.law.problem)
    problem = complete_problem(shipped.law, terms, gentle)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    cpg.generate_code(problem, code_dir="generated", solver="OSQP")
    own = without_trajectory(model, problem=gentle).law.own
    solver = QP_SOLVERS["osqp"].make(own.H, own.G, 4000, None)
    rng, largest = np.random.default_rng(1), 0.0
    for _ in range(10):
        p = 0.02 * rng.normal(size=shipped.law.problem.parameters)
        terms.parameter.value = p
        problem.solve(method="CPG", eps_abs=1e-9, eps_rel=1e-9, max_iter=20000)
        given = np.append(p, 1.0)
        found = solver.solve(
            own.F @ given,
            own.lower + own.T @ given,
            own.upper + own.T @ given,
            np.zeros(len(own.F)),
            np.zeros(own.lower.size),
        )
        largest = max(largest, float(np.max(np.abs(terms.speed.value))))

        assert problem.status == "solved" and found.status == 0
        np.testing.assert_allclose(found.x[: terms.horizon], terms.effort.value, rtol=0, atol=1e-5)
    assert largest > 99.9


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


def test_a_sample_without_solution_takes_the_fallback(linear, model):
    """A hard limit that the start violates: the run goes on, and the status tells."""
    own = without_trajectory(model, problem=lambda m: (m.cost, [m.position <= 0.01, m.position >= -0.01]))
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
        "mpc_position", model, problem=lambda m: m.cost + 1e-2 * cp.sum_squares(m.current), label="own"
    )
    reference = np.column_stack([np.full(60, 0.01), np.zeros((60, 2))])
    measured = np.random.default_rng(0).normal(size=(60, 5)) * [1.0, 1e4, 1e4, 1e-4, 1.0]
    deployment = export_controller(own, reference, measured)

    assert deployment.vector.distance < 1e-3
    assert deployment.vector.fallbacks == 0
    flat = e.load_controller("mpc_position", model, problem=lambda m: m.cost + cp.norm1(m.current_change), label="flat")
    with pytest.raises(e.InputError, match="flat: has unknowns without a quadratic cost"):
        export_controller(flat, reference, measured)


def test_what_an_own_problem_lacks_is_said(model):
    """No margins; the text names solver and size; a run reports no loop analysis."""
    own = e.load_controller("mpc_position", model, problem=lambda m: m.cost)

    assert "a cost and constraints of your own (20 unknowns" in str(own) and "by daqp" in str(own)
    assert e.run("steps_spring", controller=own).loop is None
    with pytest.raises(e.InputError, match="has no linear law to analyse"):
        e.analyse_loop(model, own)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (lambda m: None, r"problem: returned None; expected a cost, or \(cost, constraints\)"),
        (lambda m: (m.cost, [True]), "one of the constraints is True"),
        (lambda m: m.position, "scalar cost"),
        (lambda m: -cp.sum_squares(m.position), "is not convex"),
        (lambda m: cp.exp(m.position[0]), "is no quadratic programme"),
        (lambda m: (m.cost, [m.current[0] == cp.Variable(integer=True)]), "has an integer or boolean variable"),
        (lambda m: m.cost * cp.Parameter(nonneg=True, name="q"), "has the parameter q of its own"),
        (lambda m: cp.sum(cp.multiply(m.reference, m.position)), "multiplied by another one that changes"),
        (lambda m: (m.cost, [m.position >= 1.0]), "has no solution at rest"),
    ],
)
def test_wrong_problems_are_one_sentence(model, state, words):
    """What was found and what was expected."""
    with pytest.raises(e.InputError, match=words) as caught:
        e.load_controller("mpc_position", model, problem=state)

    assert "\n" not in str(caught.value)


def test_a_problem_without_an_mpc_is_one_sentence(model):
    with pytest.raises(e.InputError, match='is for a controller of kind = "mpc"'):
        e.load_controller("lqr_position", model, problem=lambda m: m.cost)
