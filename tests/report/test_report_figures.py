"""Figures: labelled, complete, legible, the same each time, and without a trace in matplotlib's state."""

import subprocess
import sys
from functools import cache
from io import BytesIO

import matplotlib
import numpy as np
import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.loop import LoopAnalysis
from ehsa_ctrl.design.analysis.system import analyse
from ehsa_ctrl.plant.linear import four_state, three_state
from ehsa_ctrl.plant.load import load_plant
from ehsa_ctrl.report.figures import (
    bode_figure,
    loop_figure,
    overlay_figure,
    save,
    scenario_figure,
    to_svg,
    trajectory_figure,
)
from ehsa_ctrl.report.style import RASTER_POINTS, ROLES, Sheet

from .reading import words_are_apart

pytestmark = pytest.mark.slow

FIGURES = (
    "scenario",
    "scenario tripped",
    "trajectory",
    "trajectory linear",
    "bode",
    "bode four states",
    "loop",
    "overlay",
)
TIME = np.arange(500) * 0.004


@pytest.fixture(scope="session")
def make(gentle, harsh):
    """A figure by name, made anew each time."""
    linear = load_plant("ehsa", model="linear")
    three, four = analyse(three_state(linear)), analyse(four_state(linear))
    wave = np.sin(20 * TIME)
    panels = {"speed (rpm)": {"measured": 90 * wave, "linear": 100 * wave}, "rod speed (mm/s)": {"nonlinear": wave}}
    makers = {
        "scenario": lambda: scenario_figure(gentle),
        "scenario tripped": lambda: scenario_figure(harsh),
        "trajectory": lambda: trajectory_figure(harsh.nonlinear.trajectory),
        "trajectory linear": lambda: trajectory_figure(gentle.linear.trajectory),
        "bode": lambda: bode_figure(three),
        "bode four states": lambda: bode_figure(four),
        "loop": lambda: loop_figure(gentle.loop),
        "overlay": lambda: overlay_figure(TIME, panels),
    }
    assert set(makers) == set(FIGURES)
    return lambda name: makers[name]()


@pytest.fixture(scope="session")
def drawn(make):
    """Figure and SVG by name, drawn once for all tests that only look."""

    @cache
    def draw(name):
        figure = make(name)
        return figure, to_svg(figure)

    return draw


def panels_of(figure):
    """Axes with curves: neither header nor strip."""
    return [ax for ax in figure.axes if ax.axison and ax.get_gid() != "strip"]


def panel(figure, words):
    (found,) = [ax for ax in figure.axes if ax.get_ylabel().replace("\n", " ").startswith(words)]
    return found


def line(ax, label):
    (found,) = [line for line in ax.lines if line.get_label() == label]
    return found


@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_says_its_quantity_and_unit(drawn, name):
    """Each panel has a label with a unit in brackets, and so has the axis below."""
    figure, _ = drawn(name)

    assert len(panels_of(figure)) >= 2
    for ax in panels_of(figure):
        assert ax.get_ylabel().endswith(")") and "(" in ax.get_ylabel(), ax.get_ylabel()
    for ax in figure.axes:
        if ax.axison and any(label.get_visible() for label in ax.get_xticklabels()) and ax.get_xlabel():
            assert ax.get_xlabel().startswith(("time (s)", "frequency (Hz)"))
    assert any(ax.get_xlabel() for ax in figure.axes)


@pytest.mark.parametrize("name", FIGURES)
def test_nothing_is_clipped_and_no_words_meet(drawn, name):
    """All words lie on the sheet; axis labels, panel legends, titles and notes do not overlap each other."""
    figure, _ = drawn(name)

    words_are_apart(figure)


@pytest.mark.parametrize("name", ["scenario tripped", "bode", "overlay"])
def test_the_same_figure_is_the_same_text(make, drawn, name):
    """Drawn twice, the SVGs agree to the letter, and no date is in them."""
    _, svg = drawn(name)

    assert to_svg(make(name)) == svg
    assert "<dc:date>" not in svg


def test_a_figure_is_saved_twice_over_as_the_same_bytes(make, tmp_path):
    """PNG of 1200 px width and SVG beside each other; a dot in the name is no suffix; folders are made."""
    from PIL import Image

    first, second = (save(make("overlay"), tmp_path / folder / "v1.2") for folder in "ab")
    picture = Image.open(BytesIO(first[0].read_bytes()))

    assert [path.name for path in first] == ["v1.2.png", "v1.2.svg"]
    assert picture.width == 1200
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_matplotlib_is_left_as_it_was(make, tmp_path):
    """Drawing and saving change no setting."""
    before = dict(matplotlib.rcParams)
    save(make("overlay"), tmp_path / "figure")

    assert dict(matplotlib.rcParams) == before


def test_a_users_style_does_not_reach_the_figures(make, drawn):
    """Figures look alike whatever the user has set."""
    _, plain = drawn("overlay")
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "black", "lines.linewidth": 5}):
        styled = to_svg(make("overlay"))

    assert styled == plain


def test_pyplot_is_not_imported():
    """The figures work where no display is, and stay out of pyplot's list of open figures."""
    text = "import sys, ehsa_ctrl.report.figures, ehsa_ctrl.report.write; sys.exit('matplotlib.pyplot' in sys.modules)"

    # control imports pyplot by itself, and analysing needs control; drawing must not add to it.
    assert subprocess.run([sys.executable, "-c", text], check=False).returncode == 0


def test_a_notebook_shows_a_figure_by_itself(make):
    """Without pyplot there is nobody else to do it."""
    from PIL import Image

    picture = Image.open(BytesIO(make("overlay")._repr_png_()))

    assert picture.format == "PNG" and picture.width == 800


def test_roles_differ_without_colour():
    """In black and white lines are told apart by dashes, width or markers."""
    looks = {(str(how["linestyle"]), how.get("marker"), how.get("linewidth")) for how in ROLES.values()}

    assert len(looks) == len(ROLES)


def test_a_scenario_is_drawn_in_shown_units(gentle):
    """Position in mm, speed in rpm, pressure difference in bar, error r - x in mm: linear and nonlinear."""
    figure = scenario_figure(gentle)
    run = gentle.nonlinear.trajectory

    np.testing.assert_allclose(line(panel(figure, "position"), "nonlinear plant").get_ydata(), 1e3 * run["x"])
    np.testing.assert_allclose(
        line(panel(figure, "position"), "reference").get_ydata(), 1e3 * gentle.linear.reference[:, 0]
    )
    np.testing.assert_allclose(line(panel(figure, "error"), "linear prediction").get_ydata(), 1e3 * gentle.linear.error)
    np.testing.assert_allclose(line(panel(figure, "speed"), "nonlinear plant").get_ydata(), run["omega"] * 30 / np.pi)
    np.testing.assert_allclose(line(panel(figure, "pressure diff"), "nonlinear plant").get_ydata(), run["dP"] / 1e5)
    np.testing.assert_allclose(line(panel(figure, "pressures"), "P₂").get_ydata(), run["P_2"] / 1e5)


def test_the_strip_shows_when_the_rod_sticks_and_the_force_acts(gentle):
    """Bars cover as much time as the rod sticks, and the force from 0.5 s to 0.7 s with its size."""
    (strip,) = [ax for ax in scenario_figure(gentle).axes if ax.get_gid() == "strip"]
    stuck, force = [collection.get_paths() for collection in strip.collections]
    sticks = gentle.nonlinear.trajectory.sticks("rod")[:-1]

    assert sum(np.ptp(path.vertices[:, 0]) for path in stuck) == pytest.approx(0.004 * np.count_nonzero(sticks))
    assert [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in force] == [pytest.approx((0.5, 0.7))]
    assert "3 kN" in [text.get_text() for text in strip.texts]


def test_a_passed_limit_is_drawn_and_marked_where_it_was_first_passed(harsh):
    """The pump's 4500 rpm is a line, with a cross at the time that the trip states, and said in words."""
    trips = {trip.limit: trip for trip in harsh.trips}
    figure = scenario_figure(harsh)
    speed = panel(figure, "speed")
    crosses = [line for line in speed.lines if line.get_marker() == "X"]
    header = " ".join(text.get_text() for text in figure.axes[0].texts)

    assert {"pump_speed", "pressure_min"} <= set(trips)
    np.testing.assert_allclose(np.abs(line(speed, "pump speed\n4500 rpm").get_ydata()), 4500)
    assert trips["pump_speed"].first in [float(cross.get_xdata()[0]) for cross in crosses]
    assert "limit exceeded: pump speed" in header
    assert "limit exceeded, as expected: a pressure fell" in header


def test_a_run_within_its_limits_shows_none(gentle):
    """No line for a limit that was kept: it would squeeze what there is to see."""
    assert gentle.trips == ()
    for ax in panels_of(scenario_figure(gentle)):
        assert not [line for line in ax.lines if "\n" in str(line.get_label()) or line.get_marker() == "X"]


def test_a_constant_signal_is_not_blown_up(gentle):
    """A force that is nearly constant gets a range that a person finds sensible."""
    ax = panel(overlay_figure(TIME, {"force (kN)": {"linear": np.full(500, 2.0)}}), "force")

    assert np.ptp(ax.get_ylim()) > 1


def test_loop_marks_agree_with_the_analysis(gentle):
    """The bars of the margins are as long as the margins, at their frequencies."""
    loop = gentle.loop
    top, middle, _ = panels_of(loop_figure(loop))
    (gain,) = [line for line in top.lines if line.get_linewidth() == 3.0]
    (phase,) = [line for line in middle.lines if line.get_linewidth() == 3.0]
    (curve,) = [line for line in middle.lines if len(line.get_xdata()) == loop.omega.size]

    assert np.ptp(gain.get_ydata()) == pytest.approx(20 * np.log10(loop.gain_margin))
    assert np.ptp(phase.get_ydata()) == pytest.approx(loop.phase_margin)
    assert phase.get_xdata()[0] == pytest.approx(loop.crossover / (2 * np.pi))
    assert np.interp(gain.get_xdata()[0], curve.get_xdata(), curve.get_ydata()) == pytest.approx(-180, abs=0.1)


def test_a_loop_without_margins_can_be_drawn():
    """A loop that never reaches a gain of 1 has no crossover: nothing is marked, nothing fails."""
    omega = np.geomspace(0.1, 100, 200)
    response = 0.1 / (1 + 1j * omega)
    margins = {"phase_margin": np.inf, "gain_margin": np.inf, "delay_margin": np.inf, "Ms": 1.0, "Mt": 0.1}
    loop = LoopAnalysis(controller="weak", omega=omega, response=response, stable=True, disk_margin=np.nan, **margins)

    assert not [line for ax in loop_figure(loop).axes for line in ax.lines if line.get_linewidth() == 3.0]


def test_bode_shows_the_model():
    """Position per ampere in mm, at a frequency, is the model's; its phase starts with the integrator's."""
    system = three_state(load_plant("ehsa", model="linear"))
    figure = bode_figure(analyse(system))
    gain, phase = panel(figure, "position (mm per A)"), panels_of(figure)[-1]
    omega = 2 * np.pi * gain.lines[0].get_xdata()
    row = system.output_labels.index("x")

    assert phase.get_ylabel() == "phase\n(deg)"
    np.testing.assert_allclose(gain.lines[0].get_ydata(), 1e3 * np.abs(system(1j * omega)[row, 0]))
    assert phase.lines[0].get_ydata()[0] == pytest.approx(-90, abs=3)


def test_every_point_of_a_long_record_is_kept():
    """Long lines become pixels inside the SVG, but none of their points is left out."""
    time = 0.004 * np.arange(RASTER_POINTS + 1)
    values = {"position (mm)": {"measured": np.sin(time)}}
    (ax,) = panels_of(overlay_figure(time, values))
    (short,) = panels_of(overlay_figure(time[1:], {"position (mm)": {"measured": np.sin(time[1:])}}))

    assert ax.lines[0].get_xdata().size == time.size
    assert ax.lines[0].get_rasterized() and not short.lines[0].get_rasterized()


@pytest.mark.parametrize(
    ("panels", "words"),
    [
        ({}, "no panel"),
        ({"speed": {"linear": TIME}}, "has no unit"),
        ({"speed (rpm)": {"linaer": TIME}}, "did you mean 'linear'"),
        ({"speed (rpm)": {"linear": TIME[1:]}}, r"expected that of time, \(500,\)"),
    ],
)
def test_a_wrong_overlay_is_refused_in_a_sentence(panels, words):
    """The error says what was wrong and what was expected."""
    with pytest.raises(InputError, match=words):
        overlay_figure(TIME, panels)


def test_a_name_with_a_dollar_is_no_formula_and_numbers_of_a_logarithmic_axis_are():
    """Half a formula in a file's name would not even be drawn."""
    figure = Sheet()
    ax = figure.add_subplot(title="$\\frac{$ of \udc80")
    ax.loglog([1.0, 1e6], [1.0, 1e6], label="$a_{b$")
    ax.legend()
    to_svg(figure)

    assert ax.get_title() == "$\\frac{$ of ?"
    assert all(label.get_parse_math() for label in ax.get_xticklabels())
