"""Figures of an identification: right numbers at the right place, legible, the same each time."""

import dataclasses

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.identification.identification import FreeRuns
from ehsa_ctrl.identification.uncertainty import ParameterCovariance
from ehsa_ctrl.report.figures import (
    correlation_figure,
    identification_figure,
    parameters_figure,
    replay_figure,
    residuals_figure,
    to_svg,
)
from ehsa_ctrl.report.figures.estimates import COLOURS, VERDICTS
from ehsa_ctrl.report.signals import channel_display, most_active_part
from ehsa_ctrl.report.style import ROLES

from .reading import axes_of, whole_and_detail, words_are_apart

pytestmark = pytest.mark.slow

FIGURES = (identification_figure, parameters_figure, correlation_figure, residuals_figure)


@pytest.fixture(params=["fitting", "failing", "vague"])
def any_of(request):
    """Each kind of identification."""
    return request.getfixturevalue(request.param)


def labelled(ax, role):
    (found,) = [line for line in ax.lines if line.get_label() == ROLES[role]["label"]]
    return found


@pytest.mark.parametrize("make", FIGURES)
def test_nothing_is_clipped_and_no_words_meet(any_of, make):
    """All words lie on the sheet and none overlap."""
    words_are_apart(make(any_of))


@pytest.mark.parametrize("make", FIGURES)
def test_the_same_identification_is_the_same_text(fitting, make):
    """Drawn twice, the SVGs agree to the letter."""
    assert to_svg(make(fitting)) == to_svg(make(fitting))


def test_the_result_plots_itself(fitting):
    """`plot()` of an identification and of a replay are these figures."""
    assert to_svg(fitting.plot()) == to_svg(identification_figure(fitting))
    assert to_svg(fitting.train.after[0].plot()) == to_svg(replay_figure(fitting.train.after))


def test_before_and_after_are_the_free_runs_of_the_held_out_log(fitting):
    """Every sample of measured, before and after in shown units on the left, some of the same on the right."""
    (before,), (after,) = fitting.validation.before, fitting.validation.after
    wholes, details = whole_and_detail(identification_figure(fitting))

    assert list(wholes) == ["current", "speed", "pressure P₁", "pressure P₂", "position"]
    for ax in (wholes["position"], details["position"]):
        part = np.searchsorted(after.log.time, labelled(ax, "after").get_xdata())
        np.testing.assert_allclose(labelled(ax, "measured").get_ydata(), 1e3 * after.log["position"][part])
        np.testing.assert_allclose(labelled(ax, "after").get_ydata(), 1e3 * after.simulated["position"][part])
        np.testing.assert_allclose(labelled(ax, "before").get_ydata(), 1e3 * before.simulated["position"][part])
    assert labelled(wholes["position"], "after").get_xdata().size == len(after.log)
    assert np.ptp(labelled(details["position"], "after").get_xdata()) == pytest.approx(1.0, abs=0.01)


def test_the_fit_stands_beside_its_channel(fitting):
    """Before and after, as scored, beside each output and not beside the drive."""
    _, details = whole_and_detail(identification_figure(fitting))
    (before,), (after,) = fitting.validation.before, fitting.validation.after

    (words,) = [text.get_text() for text in details["speed"].texts]
    assert words == f"fit\nbefore {before.fit_percent['speed']:.1f} %\nafter {after.fit_percent['speed']:.1f} %"
    assert not details["current"].texts


def test_without_a_held_out_log_the_used_one_is_shown(vague):
    """The title says which it was."""
    title = identification_figure(vague).get_suptitle()

    assert "used to identify" in title and "noise" in title


def test_another_log_is_asked_for_by_its_number(fitting):
    """The second of two logs; one that is not there is refused."""
    reach = fitting.validation
    twice = dataclasses.replace(
        fitting, validation=FreeRuns(reach.after + fitting.train.after, reach.before + fitting.train.before)
    )

    assert "noise" in identification_figure(twice, 1).get_suptitle()
    with pytest.raises(InputError, match="index 2; expected 0 to 1"):
        identification_figure(twice, 2)


def test_a_run_that_drifts_away_does_not_flatten_the_others(fitting):
    """A position that is a metre off before leaves its panel; what was measured still fills a third of it."""
    (before,) = fitting.validation.before
    far = dataclasses.replace(before, simulated=dict(before.simulated) | {"position": np.full(len(before.log), 1.0)})
    drifted = dataclasses.replace(fitting, validation=FreeRuns(fitting.validation.after, (far,)))
    wholes, _ = whole_and_detail(identification_figure(drifted))

    assert np.ptp(1e3 * before.log["position"]) > 0.3 * np.ptp(wholes["position"].get_ylim())


def test_a_run_that_ended_early_has_no_fit(fitting):
    """Its line ends where it did, and a dash stands for its fit."""
    (after,) = fitting.validation.after
    cut = {name: np.where(np.arange(values.size) < 100, values, np.nan) for name, values in after.simulated.items()}
    ended = dataclasses.replace(
        after, simulated=cut, stopped="it ended", fit_percent=dict.fromkeys(after.fit_percent, np.nan)
    )
    figure = identification_figure(
        dataclasses.replace(fitting, validation=FreeRuns((ended,), fitting.validation.before))
    )
    _, details = whole_and_detail(figure)

    assert details["speed"].texts[0].get_text().endswith("after –")
    to_svg(figure)


def test_the_detail_is_where_the_drive_varies_most():
    """A second of unrest in ten of calm is found; a log that is all calm has a detail too."""
    time = 0.01 * np.arange(1000)
    burst = np.where((time >= 6.0) & (time < 7.0), np.sin(40 * time), 0.0)

    assert abs(most_active_part(Log(time, {"current": burst}), "current").start - 600) <= 1
    assert most_active_part(Log(time, {"current": np.full(1000, 2.0)}), "current").stop <= 1000
    assert most_active_part(Log(time[:40], {"current": burst[:40]}), "current") == slice(0, 40)


def test_a_detail_of_a_replay_is_a_part_of_it(fitting):
    """The same panels over a second."""
    whole, detail = (replay_figure(fitting.validation.after, detail=part) for part in (False, True))

    assert [ax.get_ylabel() for ax in whole.axes] == [ax.get_ylabel() for ax in detail.axes]
    assert np.ptp(detail.axes[-1].get_xlim()) == pytest.approx(1.0, abs=0.01)


def test_channels_are_shown_in_the_units_of_the_bench():
    """Speeds in rpm, pressures in bar, positions in mm; a current as it is."""
    assert channel_display("speed").label == "speed (rpm)" and channel_display("p1").label == "pressure P₁ (bar)"
    assert channel_display("position").scale == pytest.approx(1e-3) and channel_display("current").scale == 1.0


def test_starts_and_intervals_stand_where_they_belong(fitting):
    """The start in % of the identified value, the interval about zero, the standard deviation in % on the right."""
    figure = parameters_figure(fitting)
    left, right = axes_of(figure, "deviation"), axes_of(figure, "spread")
    starts = [line for line in left.lines if line.get_marker() == "D"]
    bars = [line for line in left.lines if line.get_linewidth() == 3.5]
    spreads = [line for line in right.lines if line.get_marker() == VERDICTS["well determined"]["marker"]]

    for row, estimate in enumerate(fitting.estimates):
        off = 100 * (estimate.start / estimate.value - 1)
        half = 100 * 1.96 * estimate.relative_sd
        assert (starts[row].get_xdata()[0], starts[row].get_ydata()[0]) == (pytest.approx(off), row)
        np.testing.assert_allclose(bars[row].get_xdata(), [-half, half], rtol=1e-3)
        assert spreads[row].get_xdata()[0] == pytest.approx(100 * estimate.relative_sd)
    assert [label.get_text() for label in left.get_yticklabels()] == [e.name for e in fitting.estimates]


def test_verdicts_differ_in_colour_and_shape(vague):
    """What the logs don't tell has another mark, an interval that runs out of the panel, and says so in words."""
    figure = parameters_figure(vague)
    left, right = axes_of(figure, "deviation"), axes_of(figure, "spread")
    marks = [line.get_marker() for line in right.lines if line.get_marker() not in ("None", None)]
    bars = [line.get_xdata() for line in left.lines if line.get_linewidth() == 3.5]

    assert marks == ["X", "^", "o", "o"]
    assert bars[0][0] < left.get_xlim()[0] and bars[0][1] > left.get_xlim()[1]
    assert right.texts[0].get_text() == "unbounded"
    assert "(at lower bound)" in left.get_yticklabels()[1].get_text()
    assert len({how["marker"] for how in VERDICTS.values()}) == len({how["color"] for how in VERDICTS.values()}) == 3


def test_correlations_are_written_in_their_cells(vague):
    """Two decimals below the diagonal, a frame around a strong one, a dash where nothing is known."""
    ax = axes_of(correlation_figure(vague), "cells")
    words = {text.get_position(): text.get_text() for text in ax.texts}
    frames = [patch for patch in ax.patches if not patch.get_fill()]
    matrix = vague.uncertainty.correlation

    assert words[(0.5, 1.5)] == words[(0.5, 3.5)] == "–"
    assert words[(1.5, 2.5)] == "−0.95"
    assert words[(2.5, 3.5)] == f"{matrix[3, 2]:.2f}".replace("-", "−")
    assert len(words) == 6
    assert [(round(frame.get_x()), round(frame.get_y())) for frame in frames] == [(1, 2)]


def test_balances_have_no_correlation_to_show(fitting):
    """They are solved one by one: zeros would be a lie."""
    ax = axes_of(correlation_figure(dataclasses.replace(fitting, method="balances")), "cells")

    assert {text.get_text() for text in ax.texts} == {"–"}


def test_correlations_of_both_signs_are_equally_dark_in_grey():
    """In black and white the colour says how strong it is, the number which way."""

    def grey(value):
        return np.dot(to_rgb(COLOURS(value)), [0.299, 0.587, 0.114])

    greys = [grey(0.5 + 0.5 * strength) for strength in (0.0, 0.3, 0.6, 1.0)]

    assert greys == sorted(greys, reverse=True)
    for strength in (0.3, 0.6, 1.0):
        assert grey(0.5 + 0.5 * strength) == pytest.approx(grey(0.5 - 0.5 * strength), abs=0.03)


def test_residuals_outside_the_band_are_marked(failing):
    """As many broad lines as lags lie outside; above each panel is whether it passed and the largest."""
    figure, tests = residuals_figure(failing), failing.residual_tests

    assert any(not test.passed for test in tests)
    for test in tests:
        ax = axes_of(figure, f"{test.channel} {test.against}")
        inside, outside = ax.collections[-2:]
        assert len(outside.get_segments()) == round(test.outside * test.values.size)
        assert len(inside.get_segments()) + len(outside.get_segments()) == test.values.size
        assert ax.texts[0].get_text() == f"{'✓' if test.passed else '✗'} {test.largest:.2g}"
        assert ax.get_ylim()[1] > test.largest


def test_the_correlation_with_itself_begins_at_a_lag_of_one(failing):
    """At none it is always 1 and says nothing."""
    first = axes_of(residuals_figure(failing), f"{failing.residual_tests[0].channel} itself")
    lags = sorted(segment[0, 0] for part in first.collections[-2:] for segment in part.get_segments())

    assert lags[0] == 1 and lags[-1] == failing.residual_tests[0].values.size


@pytest.mark.parametrize(
    ("make", "changes", "words"),
    [
        (parameters_figure, {"estimates": ()}, "without parameters"),
        (correlation_figure, {"uncertainty": ParameterCovariance((), np.zeros((0, 0)), "noise")}, "without parameters"),
        (residuals_figure, {"residual_tests": ()}, "without residual tests"),
    ],
)
def test_nothing_to_draw_is_said_in_a_sentence(fitting, make, changes, words):
    """The error says what was missing."""
    with pytest.raises(InputError, match=words):
        make(dataclasses.replace(fitting, **changes))
