"""MPC: the LQR where no limit is active, exact where one is, safe where there is no solution."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from linear_loop import MPC, load, run, still

from ehsa_ctrl import InputError, run_closed_loop
from ehsa_ctrl.design.qp import FAILED, INFEASIBLE, LIMIT, NO_BOUND, QP_SOLVERS, SOLVED, QpSolution
from ehsa_ctrl.design.state_space.mpc_problem import Limits, MpcProblem, condense, motion_ahead
from ehsa_ctrl.design.state_space.mpc_statement import MpcStatement

T = 0.004


@pytest.fixture
def mpc(system, tmp_path):
    return load(MPC, system, tmp_path).law


def with_limits(law, *, current=None, **limits):
    """The same MPC with other limits; none where none is given."""
    current = current or law.problem.current_limit
    problem = replace(law.problem, limits=Limits.model_construct(**limits), current_limit=current)
    return replace(law, problem=problem, feedback=replace(law.feedback, current_limit=current))


def states(law, count, seed=0, size=1.0):
    """Parameters of problems (see MpcProblem.parameters): random states, disturbances and motions, many of them beyond
    the limits."""
    rng = np.random.default_rng(seed)
    n, d = law.model.E.shape
    for _ in range(count):
        state = size * rng.standard_normal(n) * np.array([2.0, 3.0, 0.5, 1.5])[:n]
        disturbance = rng.standard_normal(d) * np.array([0.5, 0.5, 1.0])[:d]
        motion = rng.standard_normal(3) * np.array([0.005, 0.05, 0.5])
        given = rng.uniform(-1, 1) * law.problem.current_limit
        later = np.empty(3 * (law.horizon + 1))
        motion_ahead(motion, T, law.horizon, later)
        yield np.r_[state, disturbance, later, rng.standard_normal(), 0.3 * rng.standard_normal(), given]


def current_by(law, p):
    """First current by the law's own solver, and its solution."""
    c, one = law.condensed, np.r_[p, 1.0]
    shift = c.T @ one
    zeros = np.zeros(len(c.F)), np.zeros(len(shift))
    solution = law.qp.solve(c.F @ one, c.lower + shift, c.upper + shift, *zeros)
    assert solution.status == SOLVED
    return solution.x[: law.horizon] + plan_of(law, p), solution


def plan_of(law, p):
    """Gamma w along the horizon."""
    n, d = law.model.E.shape
    motion = p[n + d : -3].reshape(-1, 3)[: law.horizon]
    return law.problem.target.Gamma @ np.hstack([motion, np.tile(p[n : n + d], (law.horizon, 1))]).T


@pytest.mark.parametrize("rate", [None, "200 A/s"])
def test_without_active_limits_it_is_the_lqr(tmp_path, system, rate):
    """With limits out of reach the first current is the regulator's to 1e-8 A, with a weight on the rate as well."""
    text = MPC
    if rate:
        text = text.replace('current = "1 A"', f'current = "1 A"\ncurrent_rate = "{rate}"', 1)
    law = with_limits(load(text, system, tmp_path).law, current=1e5, speed=1e6, pressure=1e10, stroke=1e3)
    lqr = replace(law.feedback, current_limit=1e5)
    rng = np.random.default_rng(2)
    a, b = law.initial_memory(), lqr.initial_memory()
    for _ in range(60):
        reference = rng.standard_normal(3) * [1e-3, 0.02, 0.3]
        measured = rng.standard_normal(5) * [20, 1e5, 1e5, 1e-3, 0]
        extra = 0.2 * rng.standard_normal()
        got = law.function(reference, measured, a, law.settings(), extra, 0.0)
        wanted = lqr.function(reference, measured, b, lqr.settings(), extra, 0.0)

        assert got == pytest.approx(wanted, abs=1e-8)
    assert (lqr.regulator.before != 0.0) == bool(rate)


def test_linear_is_the_lqrs(mpc):
    """With no limit active the law is linear: that of its regulator."""
    a, b = mpc.linear(), mpc.feedback.linear()

    np.testing.assert_array_equal(a.A, b.A)
    np.testing.assert_array_equal(a.D, b.D)


@pytest.mark.slow
def test_daqp_solves_the_problem_as_cvxpy_states_it(mpc):
    """Whole plans of random states, most with active limits, against the problem with states as unknowns."""
    law = with_limits(mpc, current_rate=600.0, speed=250.0, pressure=30e5, stroke=0.03)
    statement, active = MpcStatement(law.problem), 0
    options = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}
    for p in states(law, 25):
        got, solution = current_by(law, p)
        active += np.count_nonzero(solution.y) > 0

        wanted = statement.solve(p, **options)
        assert got[0] == pytest.approx(wanted[0], abs=1e-6 * law.problem.current_limit)
        np.testing.assert_allclose(got, wanted, atol=1e-5 * law.problem.current_limit)
    assert active > 15


def test_the_solution_has_its_certificate(mpc):
    """Karush, Kuhn, Tucker: multipliers balance the gradient, have their signs, and act at active limits alone."""
    c = mpc.condensed
    for p in states(mpc, 60, seed=3):
        shift = c.T @ np.r_[p, 1.0]
        _, s = current_by(mpc, p)
        rows = np.vstack([np.eye(len(c.F)), c.G])
        seen = rows @ s.x
        slack_up, slack_low = c.upper + shift - seen, seen - c.lower - shift
        size = 1 + np.max(np.abs(c.F @ np.r_[p, 1.0]))

        assert np.max(np.abs(c.H @ s.x + c.F @ np.r_[p, 1.0] + rows.T @ s.y)) < 1e-8 * size
        assert min(slack_up.min(), slack_low.min()) > -1e-7
        assert np.max(np.abs(slack_up[s.y > 0]), initial=0) < 1e-7
        assert np.max(np.abs(slack_low[s.y < 0]), initial=0) < 1e-7


def test_osqp_agrees(mpc):
    """OSQP at its tolerance of 1e-6, polished, gives DAQP's plans, to the limits' own size of a millionth."""
    law = replace(mpc, solver="osqp", iteration_limit=1000)
    for p in states(mpc, 15, seed=5, size=0.5):
        np.testing.assert_allclose(current_by(law, p)[0], current_by(mpc, p)[0], atol=6e-6)


def test_scaled_and_unscaled_states_give_one_plan(system, mpc):
    """The scaling of the states does not matter: a model in SI units gives the same currents."""
    from ehsa_ctrl.design.kinds.lqr import Weights, cost_of
    from ehsa_ctrl.design.state_space.model import design_model
    from ehsa_ctrl.design.state_space.regulator import design_regulator, solve_target

    model = design_model(system, T, scaled=False)
    cost = cost_of(model, Weights(position="0.5 mm"))
    regulator = design_regulator(model, cost)
    problem = MpcProblem(model, solve_target(model), cost, regulator, 20, 6.0, mpc.problem.limits)
    plain = replace(mpc, problem=problem)
    for p in states(mpc, 20, seed=7):
        q = p.copy()
        q[:4] *= mpc.model.scale
        np.testing.assert_allclose(current_by(plain, q)[0], current_by(mpc, p)[0], atol=1e-5)


@pytest.fixture(params=sorted(QP_SOLVERS))
def kind(request):
    return QP_SOLVERS[request.param]


def small(kind, iteration_limit=1000):
    """minimise (x - 3)^2 + (y + 1)^2 within a box and with x + y bounded."""
    solver = kind.make(2.0 * np.eye(2), np.array([[1.0, 1.0]]), iteration_limit, None)
    return solver, np.array([-6.0, 2.0])


def solve(solver, f, lower, upper):
    return solver.solve(f, np.array(lower, float), np.array(upper, float), np.zeros(2), np.zeros(3))


def test_every_solver_solves_a_problem_known_by_hand(kind):
    """x at its bound 1, y free; then the sum active, where both share what is missing."""
    solver, f = small(kind)
    a = solve(solver, f, [-1, -9, -NO_BOUND], [1, 9, NO_BOUND])
    b = solve(solver, f, [-9, -9, 4], [9, 9, NO_BOUND])

    np.testing.assert_allclose(a.x, [1, -1], atol=1e-5)
    np.testing.assert_allclose(b.x, [4, 0], atol=1e-5)
    assert a.status == b.status == SOLVED
    assert a.y[0] == pytest.approx(4.0, abs=1e-3) and b.y[2] == pytest.approx(-2.0, abs=1e-3)


@pytest.mark.parametrize("lower", [[-1, -1, 3], [2, -1, -NO_BOUND]])
def test_no_solver_is_spoilt_by_a_problem_without_solution(kind, lower):
    """Rules that contradict each other, or crossed bounds, are reported; the next problem is solved as if alone."""
    solver, f = small(kind)
    wrong = solve(solver, f, lower, [1, 1, NO_BOUND])
    after = solve(solver, f, [-1, -9, -NO_BOUND], [1, 9, NO_BOUND])

    assert wrong.status == INFEASIBLE
    assert after.status == SOLVED
    np.testing.assert_allclose(after.x, [1, -1], atol=1e-5)


def test_no_solver_takes_what_is_no_number(kind):
    """A gradient or bounds of nan are a failure without a call of the solver."""
    solver, f = small(kind)
    status = solve(solver, np.array([np.nan, 1.0]), [-1, -1, -1], [1, 1, 1]).status

    assert status == FAILED
    assert solve(solver, f, [-1, np.nan, -1], [1, 1, 1]).status != SOLVED
    np.testing.assert_allclose(solve(solver, f, [-1, -9, -NO_BOUND], [1, 9, NO_BOUND]).x, [1, -1], atol=1e-5)


def test_a_warm_start_is_used(mpc):
    """From its own solution DAQP has nothing left to do."""
    c = mpc.condensed
    p = np.r_[next(states(mpc, 1, seed=3)), 1.0]
    shift = c.T @ p
    bounds = c.lower + shift, c.upper + shift
    cold = mpc.qp.solve(c.F @ p, *bounds, np.zeros(len(c.F)), np.zeros(len(shift)))
    warm = mpc.qp.solve(c.F @ p, *bounds, cold.x, cold.y)

    assert np.count_nonzero(cold.y) > 3
    assert warm.iterations < cold.iterations
    np.testing.assert_allclose(warm.x, cold.x, atol=1e-9)


def test_limits_are_kept(mpc):
    """A jump of 60 mm on the linear plant: current, its rate, speed and pressure stay within limits that all bind."""
    law = with_limits(mpc, current=4.0, current_rate=150.0, speed=250.0, pressure=11e5, stroke=0.095)
    limits = law.problem.limits
    position, current, memory = run(law, still(400, 0.06))
    seen = {name: memory[:, law.traces[f"estimate_{name}"]] for name in ("omega", "dP")}

    assert np.max(np.abs(current)) <= 4.0 + 1e-9
    assert np.max(np.abs(np.diff(current, prepend=0.0))) <= 150.0 * T + 1e-9
    assert np.max(np.abs(seen["omega"])) <= limits.speed * (1 + 1e-6)
    assert np.max(np.abs(seen["dP"])) <= limits.pressure * (1 + 1e-6)
    assert np.max(np.abs(seen["omega"])) > 0.99 * limits.speed or np.max(np.abs(seen["dP"])) > 0.99 * limits.pressure
    assert abs(position[-1] - 0.06) < 1e-7
    assert set(memory[:, law.traces["solver_status"]]) == {0.0}


def test_a_target_beyond_the_stroke_stops_at_it(mpc):
    """Asked for 60 mm with 50 mm of stroke, the rod goes to 50 mm and stays, with a plan every sample."""
    law = with_limits(mpc, stroke=0.05)
    position, _, memory = run(law, still(500, 0.06))

    assert np.max(position) < 0.0502
    assert position[-1] == pytest.approx(0.05, abs=3e-4)
    assert np.all(memory[:, law.traces["solver_reason"]] == 0.0)


def test_a_rod_that_already_is_too_fast_is_slowed_down(mpc):
    """A start at five times the speed limit is no failure: the violation is reported and soon ends."""
    law = with_limits(mpc, speed=100.0)
    steady = law.problem.target.Pi[:, 1] * law.model.scale
    start = steady * 500.0 / steady[law.model.states.index("omega")]
    _, _, memory = run(law, still(200), start=start)
    status, speed = memory[:, law.traces["solver_status"]], memory[:, law.traces["estimate_omega"]]

    assert status[1] == 1.0 and memory[1, law.traces["limit_passed"]] > 0.3
    assert np.max(np.abs(speed[20:])) < 101.0 and np.all(status[60:] == 0.0)


def test_a_plan_goes_on_within_its_own_speed():
    """Braking ends at standstill at the end of its parabola; an acceleration is not extrapolated."""
    braked, motion = np.empty((31, 3)), np.empty((31, 3))
    motion_ahead(np.array([0.0, 0.1, -2.0]), T, 30, braked.reshape(-1))
    motion_ahead(np.array([0.0, -0.1, -2.0]), T, 30, motion.reshape(-1))

    assert braked[-1, 0] == pytest.approx(0.1**2 / 4, rel=0.02) and np.all(braked[13:, 1:] == 0.0)
    np.testing.assert_allclose(motion[1:, 1], -0.1)
    np.testing.assert_allclose(motion[:, 0], -0.1 * T * np.arange(31), atol=1e-15)
    np.testing.assert_array_equal(motion[0], [0.0, -0.1, -2.0])


def test_no_error_stands(mpc):
    """A constant load and friction leave no steady-state error, without any further setting."""
    position, _, memory = run(mpc, still(1500, 0.004), load=1500.0, friction=-0.8)

    assert abs(position[-1] - 0.004) < 1e-9
    assert memory[-1, mpc.traces["estimate_load"]] == pytest.approx(1500.0, rel=1e-5)


def test_the_start_has_no_kick(mpc):
    """Where it rests, at any position and pressure, the first currents are none."""
    memory = mpc.initial_memory()
    for _ in range(3):
        measured = np.array([0.0, 27e5, 14e5, 0.031, 0.0])

        assert abs(mpc.function(np.array([0.031, 0, 0]), measured, memory, mpc.settings(), 0.0, 0.0)) < 1e-6


class Failing:
    """A solver that gives up at chosen samples."""

    def __init__(self, solver, when, status=FAILED):
        self.solver, self.when, self.status, self.count = solver, when, status, 0

    def solve(self, f, lower, upper, x, y):
        self.count += 1
        if self.count - 1 in self.when:
            return QpSolution(self.status, np.full_like(x, np.nan), np.full_like(y, np.nan), 7)
        return self.solver.solve(f, lower, upper, x, y)


@pytest.mark.parametrize("status", [FAILED, INFEASIBLE, LIMIT])
def test_a_sample_without_solution_is_bridged(mpc, status):
    """First by the plan before, then by the regulator within the limits; the status says which and why."""
    law = replace(mpc)
    law.__dict__["qp"] = Failing(mpc.qp, {20, 40, 41, 42}, status)
    position, current, memory = run(law, still(400, 0.03))
    sound, expected, _ = run(mpc, still(400, 0.03))
    trace = memory[:, law.traces["solver_status"]]

    np.testing.assert_array_equal(trace[[19, 20, 21, 40, 41, 42]], [0, 2, 0, 2, 3, 3])
    assert set(trace[43:]) <= {0.0, 1.0}
    assert np.all(memory[[20, 40, 41, 42], law.traces["solver_reason"]] == status)
    # On the plant that was planned with, the plan's next current is what the next plan would have begun with.
    assert current[20] == pytest.approx(expected[20], abs=0.02)
    assert np.isfinite(memory).all() and np.max(np.abs(current)) <= 6.0
    assert np.max(np.abs(np.diff(current, prepend=0.0))) <= law.problem.limits.current_rate * T + 1e-9
    assert abs(position[-1] - sound[-1]) < 1e-7


def test_without_any_solution_the_regulator_holds(mpc):
    """A solver that never answers leaves the LQR within the limits: slower, but the target is reached."""
    law = replace(mpc)
    law.__dict__["qp"] = Failing(mpc.qp, range(10**6))
    position, _, memory = run(law, still(600, 0.01), load=500.0)

    assert set(memory[:, law.traces["solver_status"]]) == {3.0}
    assert abs(position[-1] - 0.01) < 1e-5


def test_a_limit_of_iterations_counts_as_too_late(mpc):
    """One iteration is not enough for a jump; the loop goes on without a plan and ends at its target."""
    law = replace(mpc, iteration_limit=2)
    position, current, memory = run(law, still(500, 0.03))
    reasons = memory[:, law.traces["solver_reason"]]

    assert np.any(reasons == 2.0) and set(reasons) <= {0.0, 2.0}
    assert np.isfinite(current).all() and abs(position[-1] - 0.03) < 1e-6


def test_a_missed_deadline_is_seen(mpc):
    """No machine solves it in a nanosecond: every sample is late, and says so."""
    law = replace(mpc, deadline=1e-9)
    _, current, memory = run(law, still(50, 0.01))

    assert set(memory[:, law.traces["solver_reason"]]) <= {2.0, 4.0}
    assert set(memory[:, law.traces["solver_status"]]) == {3.0}
    assert np.isfinite(current).all()


def test_a_lost_reading_does_not_poison(mpc):
    """Readings that are no numbers for 30 samples; the position is held again after."""

    def spoil(k, measured):
        if 300 <= k < 330:
            measured[k % 4] = np.nan

    position, current, memory = run(mpc, still(1000, 0.003), load=500.0, spoil=spoil)

    assert np.isfinite(current).all() and np.isfinite(memory).all()
    assert abs(position[-1] - 0.003) < 1e-6


def test_a_run_does_not_depend_on_the_run_before(plant, system, tmp_path):
    """One controller used twice, and a copy from another process: the same currents to the bit."""
    controller = load(MPC, system, tmp_path)
    reference = still(120, 0.01)
    first = run_closed_loop(plant, controller, reference)
    second = run_closed_loop(plant, controller, reference)
    sent = run_closed_loop(plant, pickle.loads(pickle.dumps(controller)), reference)

    assert np.array_equal(first.asked, second.asked) and np.array_equal(first.asked, sent.asked)
    assert np.array_equal(first.traces["solver_iterations"], second.traces["solver_iterations"])
    assert np.all(first.traces["solver_time"] > 0)


def test_the_horizon_is_in_the_size(mpc):
    """20 currents and a share for each of three soft limits; 20 rates and twice 20 rows for each soft limit."""
    c = condense(mpc.problem)

    assert c.H.shape == (23, 23) and c.G.shape == (20 + 6 * 20, 23)
    assert np.min(np.linalg.eigvalsh(c.H)) > 0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('speed = "350 rad/s"', 'speed = "-350 rad/s"', "expected a value greater than 0"),
        ('stroke = "95 mm"', 'stroke = "0 mm"', "expected a value greater than 0"),
        ("horizon = 20", "horizon = 1", "horizon"),
        ("horizon = 20", "horizon = 20.5", "horizon"),
        ('name = "daqp"', 'name = "dakp"', "did you mean 'daqp'"),
        ('name = "daqp"', 'name = "daqp"\ndeadline = "9 ms"', "at most sample_time"),
        ('offset_free = "disturbance"', 'offset_free = "integral"', 'is for kind = "lqr"'),
        ("[weights]", '[trajectory]\nspeed = "0.2 m/s"\nacceleration = "1 m/s2"\n[weights]', "needs a speed of 5"),
        ('current_limit = "6 A"', 'current_limit = "-1 A"', "current_limit"),
    ],
)
def test_wrong_files_are_sentences(tmp_path, system, old, new, says):
    """The error names the file, the given and the expected value."""
    assert old in MPC

    with pytest.raises(InputError, match=says) as caught:
        load(MPC.replace(old, new), system, tmp_path)
    assert "mine.toml" in str(caught.value)
