"""Figures of a diagnosis: right numbers at the right place, with units, legible."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.report.figures import (
    candidates_figure,
    diagnosis_figure,
    shrinkage_figure,
    to_svg,
    unknown_inputs_figure,
    where_figure,
)
from ehsa_ctrl.report.figures.diagnosis import LOOKS
from ehsa_ctrl.report.figures.free_runs import DETAIL
from ehsa_ctrl.report.result_figures import diagnosis_figures
from ehsa_ctrl.report.style import ROLES

from . import diagnoses
from .diagnoses import diagnosis, location
from .reading import axes_of, whole_and_detail, words_are_apart

pytestmark = pytest.mark.slow


def bars(ax, look):
    """Widths of the bars that look so, in the order in which they were drawn."""
    from matplotlib.colors import to_rgba

    return [
        patch.get_width()
        for patch in ax.patches
        if patch.get_facecolor() == to_rgba(look["facecolor"]) and patch.get_hatch() == look.get("hatch")
    ]


def role(ax, color):
    (line,) = [line for line in ax.lines if line.get_color() == color]
    return line


@pytest.mark.parametrize("verdict", ["no_gap", "pair", "outside_catalogue"])
def test_nothing_is_clipped_and_no_words_meet(verdict):
    """All words of all figures lie on the sheet and none overlap."""
    for _, figure in diagnosis_figures(diagnosis(verdict)):
        words_are_apart(figure)


def test_every_axis_has_its_unit():
    """In parentheses beside its words."""
    figures = dict(diagnosis_figures(diagnosis("effect")))
    wholes, _ = whole_and_detail(figures["signals"])

    assert [ax.get_ylabel() for ax in wholes.values()] == [
        "current\n(A)", "speed\n(rpm)", "pressure P₁\n(bar)", "pressure P₂\n(bar)", "rod speed\n(mm/s)",
        "position\n(mm)",
    ]  # fmt: skip
    units = [ax.get_ylabel() for ax in figures["unknown_inputs"].axes if ax.get_ylabel()]
    assert units == ["unknown flow into chamber 1\n(cm³/s)", "unknown force\n(N)", "unknown torque\n(N m)"]
    labels = {ax.get_xlabel().replace("\n", " ") for figure in figures.values() for ax in figure.axes if ax.axison}
    assert {"share of the gap (%)", "time (s)", "the pressure difference (bar)", "the shaft's speed (rpm)"} <= labels
    assert any("(% of the signal" in label for label in labels)


def test_before_and_after_are_the_free_runs():
    """Every sample of measured, before and after in shown units on the left."""
    made = diagnosis("effect")
    wholes, details = whole_and_detail(diagnosis_figure(made))
    ax = wholes["pressure P₂"]

    for name, values in (
        ("measured", made.log["p2"]),
        ("before", made.simulated["nominal"]["p2"]),
        ("after", made.simulated["with_effects"]["p2"]),
    ):
        np.testing.assert_allclose(role(ax, ROLES[name]["color"]).get_ydata(), 1e-5 * values)
    assert np.ptp(role(details["position"], ROLES["after"]["color"]).get_xdata()) == pytest.approx(DETAIL, abs=0.01)


def test_the_detail_is_where_the_believed_plant_is_farthest_off():
    """Half a second of large errors lies within it."""
    _, details = whole_and_detail(diagnosis_figure(diagnosis("effect")))
    low, high = details["speed"].get_xlim()

    assert low <= diagnoses.TIME[diagnoses.WORSE] and diagnoses.TIME[diagnoses.WORSE + 124] <= high


def test_gaps_stand_beside_their_signals():
    """Before and after on held-out data; the position has none, and without a gap there is only one."""
    _, details = whole_and_detail(diagnosis_figure(diagnosis("effect")))
    _, same = whole_and_detail(diagnosis_figure(diagnosis("no_gap")))

    assert details["speed"].texts[0].get_text() == "held-out gap\nbefore 20 %\nafter 1.2 %"
    assert "no gap" in details["position"].texts[0].get_text()
    assert same["speed"].texts[0].get_text() == "held-out gap\n1 %"


def test_the_held_out_part_is_shaded_where_it_is_of_this_log():
    """From its first sample to the end; a second log that is held out shades nothing."""
    made = diagnosis("effect")
    other = replace(made, held_out="other.csv", held_spans=())

    def spans(found):
        wholes, _ = whole_and_detail(diagnosis_figure(found))
        return sorted(patch.get_x() for patch in wholes["speed"].patches)

    assert made.held_spans[0][0] == 1.6 and not other.held_spans
    assert len(spans(made)) == 2 and 1.6 in spans(made)
    assert len(spans(other)) == 1


def test_a_run_that_stopped_leaves_its_line_out():
    """Its gap is infinite; the figures are drawn all the same."""
    made = diagnosis("effect")
    endless = dict.fromkeys(made.gap["refit"], math.inf)
    stopped = replace(
        made, simulated={"with_effects": made.simulated["with_effects"]}, gap={**made.gap, "nominal": endless}
    )
    _, details = whole_and_detail(diagnosis_figure(stopped))
    figure = shrinkage_figure(stopped)

    assert details["speed"].texts[0].get_text() == "held-out gap\nbefore –\nafter 1.2 %"
    assert "run stopped" in {text.get_text() for text in axes_of(figure, "bars").texts}
    to_svg(figure)


def test_bars_of_gaps_are_the_gaps():
    """A bar for each signal and model, in percent; looks differ in hatching or lightness too."""
    made = diagnosis("effect")
    ax = axes_of(shrinkage_figure(made), "bars")

    for model, gaps in made.gap.items():
        assert bars(ax, LOOKS[model]) == pytest.approx([100 * gap for gap in gaps.values()])
    assert bars(axes_of(shrinkage_figure(diagnosis("outside_catalogue")), "bars"), LOOKS["with_effects"]) == []


def test_shares_by_causes_and_by_balances_stand_side_by_side():
    """Those of the causes only where some are named."""
    named, outside = (
        axes_of(where_figure(diagnosis(verdict)), "places") for verdict in ("effect", "outside_catalogue")
    )

    assert sorted(text.get_text() for text in named.texts) == ["10 %", "20 %", "20 %", "70 %", "80 %"]
    assert sorted(text.get_text() for text in outside.texts) == ["10 %", "20 %", "70 %"]


def test_what_a_sensor_errs_by_is_put_into_no_balance():
    """There is no gap that is left to draw then."""
    made = diagnosis("effect")
    over = {
        place: axes_of(where_figure(replace(made, location=location(place))), "time") for place in ("flow", "sensor")
    }

    assert len(over["flow"].patches) == 6 and len(over["sensor"].patches) == 3


def test_curves_of_unknown_inputs_are_the_regimes():
    """Mean in shown units over the variable in shown units."""
    made = diagnosis("outside_catalogue")
    figure = unknown_inputs_figure(made)
    regime = made.location.regimes[0]
    (ax,) = [ax for ax in figure.axes if ax.get_xlabel() == "the pressure difference (bar)"]

    (curve,) = [line for line in ax.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(curve.get_xdata(), 1e-5 * regime.bins)
    np.testing.assert_allclose(curve.get_ydata(), 1e6 * regime.mean)
    assert ax.get_title(loc="left") == "best: 93 % explained"


def test_candidates_are_drawn_by_their_evidence():
    """On a logarithmic axis, as long as the evidence against them; what has none is the best."""
    made = diagnosis("effect")
    ax = axes_of(candidates_figure(made), "bars")
    ends = [patch.get_x() + patch.get_width() for patch in ax.patches]

    assert ax.get_xscale() == "log"
    assert ends == pytest.approx([1.0, *(candidate.evidence for candidate in made.candidates[1:])])
    assert "best" in {text.get_text() for text in ax.texts}
    assert ax.get_yticklabels()[-1].get_text() == "nominal parameters alone"


@pytest.mark.parametrize("make", [where_figure, unknown_inputs_figure, candidates_figure])
def test_nothing_to_draw_is_said_in_a_sentence(make):
    """Without a gap there is no place, no unknown input and no candidate."""
    with pytest.raises(InputError, match="got a diagnosis without"):
        make(diagnosis("no_gap"))


def test_the_result_plots_itself():
    """`plot()` is the figure of the signals."""
    made = diagnosis("no_gap")

    assert to_svg(made.plot()) == to_svg(diagnosis_figure(made))
