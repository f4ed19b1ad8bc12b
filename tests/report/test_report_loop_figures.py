"""Nyquist and robustness: what is drawn is what was computed, and nothing is clipped."""

import numpy as np
import pytest
from matplotlib.patches import Circle

import ehsa_ctrl
from ehsa_ctrl.design.analysis.robustness import robust_margins
from ehsa_ctrl.plant.draws import draw, drawn_models
from ehsa_ctrl.report.figures import loop_figure, nyquist_figure, robustness_figure, to_svg
from ehsa_ctrl.report.figures.loops import disk_of

from .reading import words_are_apart


@pytest.fixture(scope="module")
def robust():
    """The shipped PID with its plant and eight others, one of which has a long name."""
    plant = ehsa_ctrl.load_plant("ehsa", model="linear")
    models = drawn_models(plant, draw(plant, 8, unknown=0.1))
    return robust_margins(models, ehsa_ctrl.load_controller("pid_position", models["nominal"]))


@pytest.fixture(scope="module")
def unstable():
    """The same PID with one plant that it can't hold."""
    plant = ehsa_ctrl.load_plant("ehsa", model="linear")
    models = {"nominal": ehsa_ctrl.three_state(plant), "strong": ehsa_ctrl.three_state(plant.set(J_M=2e-5))}
    return robust_margins(models, ehsa_ctrl.load_controller("pid_position", models["nominal"]))


def circles(figure):
    return {patch.get_label(): patch for patch in figure.axes[0].patches if isinstance(patch, Circle)}


@pytest.mark.parametrize("name", ["nyquist", "nyquist of many", "robustness", "with an unstable one", "loop"])
def test_words_are_apart(robust, unstable, name):
    """All words lie on the sheet and none overlap."""
    loop = robust.loops["nominal"]
    figures = {
        "nyquist": lambda: nyquist_figure(loop),
        "nyquist of many": lambda: nyquist_figure(loop, robust),
        "robustness": lambda: robustness_figure(robust),
        "with an unstable one": lambda: robustness_figure(unstable),
        "loop": lambda: loop_figure(loop),
    }

    words_are_apart(figures[name]())


def test_the_loop_touches_its_disk_and_does_not_enter(robust):
    """The curve's least distance from the disk's centre is the disk's radius; so it is for the circle of Ms."""
    loop = robust.loops["nominal"]
    found = circles(nyquist_figure(loop))
    (disk,) = [patch for label, patch in found.items() if label.startswith("disk margin")]
    (ms,) = [patch for label, patch in found.items() if label.startswith("|1 + L|")]

    for patch in (disk, ms):
        distance = np.abs(loop.response - complex(*patch.center))
        assert np.min(distance) == pytest.approx(patch.radius, rel=1e-4)
    assert ms.center == (-1.0, 0.0)


@pytest.mark.parametrize("alpha", [0.1, 0.6, 1.5])
def test_the_disk_is_made_of_the_factors_that_bring_the_loop_to_the_brink(alpha):
    """All -1/f with f = (2 + d) / (2 - d), |d| = alpha, lie on its edge; -1 lies in it."""
    d = alpha * np.exp(1j * np.linspace(0, 2 * np.pi, 50))
    centre, radius = disk_of(alpha)

    np.testing.assert_allclose(np.abs(-(2 - d) / (2 + d) - centre), radius)
    assert abs(-1 - centre) < radius


def test_the_worst_of_many_is_drawn(robust):
    """The disk is the worst one's; one thin line a plant beside the first one's thick one."""
    figure = nyquist_figure(robust.loops["nominal"], robust)
    (disk,) = [patch for label, patch in circles(figure).items() if label.startswith("worst disk margin")]

    assert disk.radius == pytest.approx(disk_of(robust.disk_margin)[1])
    assert len([line for line in figure.axes[0].lines if line.get_linewidth() == 0.5]) == len(robust.loops)


def test_bands_hold_the_curves(robust):
    """The worst plant's |S| lies within the band, and its peak is Ms, in the legend too."""
    figure = robustness_figure(robust)
    upper = figure.axes[0]
    nominal, worst = [line for line in upper.lines if not line.get_label().startswith("_")]

    assert worst.get_label().endswith(f": Ms = {round(robust.Ms, 3):g}")
    assert np.max(worst.get_ydata()) == pytest.approx(20 * np.log10(robust.Ms), abs=0.02)
    assert np.max(nominal.get_ydata()) < np.max(worst.get_ydata())
    assert upper.get_ylabel() == "|S|\n(dB)" and figure.axes[-1].get_xlabel().startswith("frequency (Hz)")


@pytest.mark.slow
def test_loops_and_margins_draw_themselves(robust):
    """`plot()` is the figure that stands here under the name of what it shows."""
    loop = robust.loops["nominal"]

    assert to_svg(loop.plot()) == to_svg(loop_figure(loop))
    assert to_svg(robust.plot()) == to_svg(robustness_figure(robust))


def test_an_unstable_plant_is_said_in_the_title(unstable):
    """No curve of it is drawn: |S| of an unstable loop means nothing."""
    assert unstable.unstable == ("strong",)
    assert "1 of them NOT STABLE" in robustness_figure(unstable)._suptitle.get_text()
    assert "1 of them NOT STABLE" in nyquist_figure(unstable.loops["nominal"], unstable)._suptitle.get_text()


def test_the_same_figure_is_the_same_text(robust):
    """Drawn twice, the SVGs agree to the letter."""
    loop = robust.loops["nominal"]

    assert to_svg(nyquist_figure(loop, robust)) == to_svg(nyquist_figure(loop, robust))
