"""The scheduled MPC: the scheduled LQR where no limit is active, an MPC at each point, within hard limits between."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError

POINTS = [
    {"at": "2 bar", "second_at": "0 mm", "bulk_modulus": 0.13},
    {"at": "2 bar", "second_at": "50 mm", "bulk_modulus": 0.13, "stiffness": "50 kN/m"},
    {"at": "20 bar", "second_at": "0 mm"},
    {"at": "20 bar", "second_at": "50 mm", "stiffness": "50 kN/m"},
]
GRID = {"variable": "level", "second_variable": "position", "filter_time": "0 s", "points": POINTS}
MPC = {
    "kind": "scheduled_mpc", "current_limit": "6 A", "sample_time": "4 ms", "weights": {"position": "0.5 mm"},
    "horizon": 10, "schedule": GRID, "limits": {"current_rate": "600 A/s", "speed": "450 rad/s"},
}  # fmt: skip
NO_LIMITS = {"limits": {}, "current_limit": "1 MA"}


@pytest.fixture(scope="module")
def model():
    return ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))


def law_of(model, **content):
    return ehsa_ctrl.load_controller(MPC | content, model).law


def readings(samples, size=1.0, seed=4):
    """Reference and readings with a level and a position that wander over the table and beyond its ends."""
    rng = np.random.default_rng(seed)
    level = 1.1e6 + 1.2e6 * np.sin(np.arange(samples) / 7.0)
    measured = np.column_stack([np.zeros(samples), level, level, 0.025 + 0.04 * np.sin(np.arange(samples) / 11.0)])
    measured += rng.normal(size=measured.shape) * size * np.array([20.0, 1e5, 1e5, 1e-3])
    reference = np.column_stack([measured[:, 3] + size * 2e-3 * rng.normal(size=samples), np.zeros((samples, 2))])
    return reference, np.column_stack([measured, np.zeros(samples)])


def run(law, reference, measured):
    """Currents (N,) and solver status (N,)."""
    memory, numbers = law.initial_memory(), law.settings()
    status = law.traces.get("solver_status", 0)
    rows = [
        (law.function(r, y, memory, numbers, 0.0, 0.0), memory[status])
        for r, y in zip(reference, measured, strict=True)
    ]
    return np.array(rows).T


def test_without_an_active_limit_it_is_the_scheduled_lqr(model):
    """At the points, between them and beyond the ends: the plans are interpolated as the gains are."""
    law = law_of(model, **NO_LIMITS)
    lqr = {key: value for key, value in MPC.items() if key not in ("horizon", "limits")} | {"kind": "scheduled_lqr"}
    other = ehsa_ctrl.load_controller(lqr | {"current_limit": "1 MA"}, model).law
    inputs = readings(150)

    expected = run(other, *inputs)[0]
    assert np.ptp(expected) > 5.0
    np.testing.assert_allclose(run(law, *inputs)[0], expected, atol=1e-9 * np.max(np.abs(expected)))


def test_equal_points_are_the_mpc(model):
    """Also where its limits are active, whatever the weights of the points."""
    even = [{"at": point["at"], "second_at": point["second_at"]} for point in POINTS]
    fixed = {key: value for key, value in MPC.items() if key != "schedule"} | {"kind": "mpc"}
    inputs = readings(150, size=3.0)
    inputs[1][80:90, 0] += 500.0  # too fast for the soft limit of the speed

    expected, status = run(ehsa_ctrl.load_controller(fixed, model).law, *inputs)
    assert np.count_nonzero(np.abs(expected) == 6.0) > 10 and np.count_nonzero(status) >= 3
    np.testing.assert_allclose(run(law_of(model, schedule=GRID | {"points": even}), *inputs)[0], expected, atol=1e-7)


def test_hard_limits_hold_between_the_points(model):
    """The current and its rate, in samples with and without a solution."""
    inputs = readings(200, size=3.0)
    for law in (law_of(model), law_of(model, solver={"iteration_limit": 3})):
        currents, status = run(law, *inputs)

        assert np.max(np.abs(currents)) == 6.0
        assert np.max(np.abs(np.diff(currents, prepend=0.0))) < 2.4 + 1e-6
    assert {2.0, 3.0} <= set(status)


def test_the_current_does_not_jump_where_the_points_change(model):
    """A level a millionth below and above that of a point, and both ends of the table: from one memory, one current."""
    points = [{"at": f"{p} bar", "bulk_modulus": k} for p, k in ((2, 0.13), (6, 0.48), (20, 1.0))]
    law = law_of(model, schedule={"variable": "level", "filter_time": "0 s", "points": points})
    reference, measured = readings(30)
    memory, numbers = law.initial_memory(), law.settings()
    for r, y in zip(reference, measured, strict=True):
        for level in (2e5, 6e5, 20e5):
            near = []
            for factor in (1 - 1e-6, 1 + 1e-6):
                y[1:3] = level * factor
                near.append(law.function(r, y, memory.copy(), numbers, 0.0, 0.0))
            assert near[0] == pytest.approx(near[1], abs=1e-4)
        law.function(r, y, memory, numbers, 0.0, 0.0)


def test_another_process_creates_its_own_solvers(model):
    law = law_of(model)
    inputs = readings(20)

    np.testing.assert_array_equal(run(pickle.loads(pickle.dumps(law)), *inputs), run(law, *inputs))


def test_a_late_solution_is_not_used(model):
    """All points of a sample count towards the deadline."""
    law = law_of(model)
    late = replace(law, laws=tuple(replace(one, deadline=1e-9) for one in law.laws))

    assert set(run(late, *readings(20))[1]) == {3.0}


def test_margins_are_those_of_the_regulator(model):
    controller = ehsa_ctrl.load_controller("mpc_scheduled", model)
    assert len(controller.law.loops) == 6 + 3 + 4
    lqr = replace(controller, law=controller.law.regulator)

    assert ehsa_ctrl.analyse_loop(model, controller).Ms == ehsa_ctrl.analyse_loop(model, lqr).Ms
    assert ehsa_ctrl.review(model, controller)["schedule"].verdict == "good"


def test_a_limit_that_a_point_can_not_keep_is_said(model):
    """Soft oil against a stiff spring needs more speed than the plant has."""
    trajectory = {"speed": "0.15 m/s", "acceleration": "2 m/s2"}
    points = [{"at": "0 mm"}, {"at": "80 mm", "bulk_modulus": 0.036, "stiffness": "200 kN/m"}]

    with pytest.raises(InputError, match=r"\[schedule\] at 80 mm: \[trajectory\] speed = 0.15 m/s needs a speed of"):
        law_of(model, trajectory=trajectory, schedule={"variable": "position", "points": points})
    with pytest.raises(InputError, match='problem: is for a controller of kind = "mpc"'):
        ehsa_ctrl.load_controller("mpc_scheduled", model, problem=lambda m: 0)
