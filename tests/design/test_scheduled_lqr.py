"""The scheduled LQR, and schedules of two variables."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.analysis.operating_point import operating_point
from ehsa_ctrl.design.controller import SampledController
from ehsa_ctrl.design.review import review
from ehsa_ctrl.design.stages.scheduling import Schedule

GRID = {
    "variable": "level", "second_variable": "position", "filter_time": "0 s",
    "points": [{"at": f"{p} bar", "second_at": f"{x} mm"} for p in (2, 6, 20) for x in (-50, 50)],
}  # fmt: skip


@pytest.fixture
def model(linear):
    return ehsa_ctrl.three_state(linear)


def controller(model, **content):
    base = {"kind": "scheduled_lqr", "current_limit": "6 A", "sample_time": "4 ms", "weights": {"position": "0.5 mm"}}
    return ehsa_ctrl.load_controller(base | content, model)


def run(law, rows):
    """Currents for rows of r, speed, p1, p2, y."""
    memory, numbers = law.initial_memory(), law.settings()
    return [law.function(np.array([r[0], 0, 0]), np.array([*r[1:], 0.0]), memory, numbers, 0.0, 0.0) for r in rows]


def readings(samples):
    noise = np.random.default_rng(4).normal(0, [0.0, 2.0, 1e5, 1e5, 1e-4], (samples, 5))
    noise[:, 2:4] += 1e6
    noise[10:, 0] = 2e-3
    return noise


def test_a_bilinear_function_is_interpolated_exactly_and_stays_beyond_the_ends():
    schedule = Schedule.model_validate(GRID)
    axes = [(p * 1e5, x * 1e-3) for p in (2, 6, 20) for x in (-50, 50)]

    def plane(p, x):
        return np.array([1.0, 2.0 + 1e-5 * p, 3.0 * x, 4e-5 * p * x])

    rows = [plane(*at) for at in axes]

    assert schedule.row_at(rows, 4.3e5, 0.013) == pytest.approx(plane(4.3e5, 0.013) * [1, 1, 1, 1], rel=1e-12)
    assert schedule.row_at(rows, 1e5, -0.09) == pytest.approx(plane(2e5, -0.05), rel=1e-12)
    assert schedule.row_at(rows, 9e6, 0.09) == pytest.approx(plane(20e5, 0.05), rel=1e-12)
    assert schedule.row_at(rows, 4.3e5, 0.0)[0] == 1.0


@pytest.mark.parametrize("offset_free", [{}, {"offset_free": "integral", "integral": "0.1 mm s"}])
def test_a_schedule_with_equal_points_is_the_fixed_law(model, offset_free):
    """To the bit: no rounding of the interpolation reaches the sizes and indices among the settings."""
    weights = {"position": "0.5 mm", **{k: v for k, v in offset_free.items() if k == "integral"}}
    given = {"weights": weights, **{k: v for k, v in offset_free.items() if k != "integral"}}
    fixed = ehsa_ctrl.load_controller("lqr_position", model, **given)
    table = ehsa_ctrl.load_controller("lqr_position", model, kind="scheduled_lqr", schedule=GRID, **given)

    assert run(table.law, readings(200)) == run(fixed.law, readings(200))


def test_where_the_oil_softens_the_schedule_is_stable_and_a_fixed_law_is_not(model):
    """At 0.5 bar air leaves 3.6 % of the oil's stiffness."""
    fixed, table = (ehsa_ctrl.load_controller(name, model) for name in ("lqr_position", "lqr_scheduled"))
    soft = operating_point(model, bulk_modulus=0.036)
    there = SampledController("there", "lqr", 0.004, 6.0, table.law.at(0.5e5))

    assert analyse_loop(soft, there).Ms < 1.35
    assert not analyse_loop(soft, fixed).stable
    assert review(model, table)["schedule"].verdict == "good"
    assert len(table.law.loops) == 8 + 4 + 6


POINTS = GRID["points"]


@pytest.mark.parametrize(
    ("schedule", "sentence"),
    [
        ({"points": POINTS[:-1]}, "5 points are no grid in order: expected all 2 values of second_at"),
        ({"points": [POINTS[0], POINTS[2], POINTS[1], POINTS[3]]}, "are no grid in order"),
        ({"points": POINTS[:2], "second_nominal": "0 mm"}, "a grid of two variables needs at least two values of each"),
        ({"points": [{"at": "2 bar"}, {"at": "6 bar"}]}, "the point at 2 bar has no second_at, the schedule a second"),
        ({"second_variable": "level"}, "second_variable = 'level' is the variable itself"),
        ({"second_variable": "load"}, "load: unit 'mm' does not fit"),
        ({"second_nominal": "20 bar"}, "position: unit 'bar' does not fit"),
    ],
)
def test_a_wrong_grid_is_one_sentence(model, schedule, sentence):
    with pytest.raises(InputError, match=sentence) as raised:
        controller(model, schedule=GRID | schedule)

    assert "\n" not in str(raised.value)


def test_a_point_that_can_not_be_designed_is_named(model):
    """A mass of minus the rod's own, and gains that the soft oil between two stiff points does not bear."""
    points = [{"at": "0 mm"}, {"at": "50 mm", "bulk_modulus": 1e-4}]

    with pytest.raises(InputError, match=r"\[schedule\] .*50 mm"):
        controller(model, schedule={"variable": "position", "points": points}, weights={"position": "1 um"})
