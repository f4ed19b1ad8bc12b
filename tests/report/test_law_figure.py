"""The figure of a law: dry friction is drawn for each direction apart, because its mean over both is zero."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.report.figures.law import _bins, _means, law_figure

from .diagnoses import CUBIC


def law_axes(figure):
    return next(ax for ax in figure.axes if ax.get_title("left") == "unknown input and law")


def curves(**fields):
    """Label -> y of the curves in the left axes, of a law with these fields."""
    figure = law_figure(SimpleNamespace(law=replace(CUBIC, **fields)))
    found = {line.get_label(): line.get_ydata() for line in law_axes(figure).get_lines()}
    plt.close(figure)
    return {label: y for label, y in found.items() if not label.startswith("_")}


def test_dry_friction_has_two_directions():
    """Friction of 30 % of a torque: V-shaped and of either sign, while all motion together shows nothing."""
    z = np.linspace(-1.0, 1.0, 2000)
    direction = np.where(np.arange(z.size) % 2 == 0, 1.0, -1.0)
    friction = -0.3 * direction * np.abs(z)
    dry = curves(variable=z, measured=friction, fitted=friction, direction=direction)
    whole = curves(variable=z, measured=friction, fitted=friction)

    assert set(whole) == {"unknown input", "law"} and np.abs(whole["unknown input"]).max() < 0.01
    assert dry["law, positive motion"].min() == pytest.approx(-0.3, abs=0.03)
    assert dry["unknown input, negative motion"].max() == pytest.approx(0.3, abs=0.03)


def test_the_band_is_of_the_mean():
    """White noise of 1: samples of one passage through a bin count once, of as many passages as samples each."""
    noise = np.random.default_rng(0).standard_normal(30_000)
    slow = np.linspace(0.0, 1.0, noise.size)
    mixed = np.random.default_rng(1).permutation(slow)

    for z, sd in {"slow": (slow, 1.0), "mixed": (mixed, 1.0 / np.sqrt(1000.0))}.values():
        means = _means(z, noise, _bins(z))
        assert np.mean(means[:, 2]) == pytest.approx(sd, rel=0.1)


def test_motion_in_one_direction_alone():
    """A log that never reverses has an empty second curve."""
    z = np.linspace(0.0, 1.0, 200)
    found = curves(variable=z, measured=z, fitted=z, direction=np.ones(z.size))

    assert found["law, negative motion"].size == 0 and found["law, positive motion"].size > 10


def test_a_displacement_is_drawn_as_the_flow_that_it_makes():
    """The unknown input is a flow; only the expression is a displacement."""
    labels = []
    for place in ("pump_flow", "displacement"):
        figure = law_figure(SimpleNamespace(law=replace(CUBIC, place=place)))
        labels.append(law_axes(figure).get_ylabel().rpartition("(")[2])
        plt.close(figure)

    assert labels[0] == labels[1] != ""


def test_a_diagnosis_without_a_law():
    with pytest.raises(e.InputError, match="without a law"):
        law_figure(SimpleNamespace(law=None))
