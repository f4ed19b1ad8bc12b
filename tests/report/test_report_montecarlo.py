"""The figure and the table of a Monte Carlo campaign: margins over parameters."""

import json

import numpy as np
import pytest

from ehsa_ctrl.report.figures import montecarlo_figure
from ehsa_ctrl.report.kinds import kinds
from ehsa_ctrl.report.kinds.montecarlo import KIND
from ehsa_ctrl.report.page import Table
from ehsa_ctrl.scenario.montecarlo import MonteCarlo
from ehsa_ctrl.scenario.outcome import Outcome
from ehsa_ctrl.scenario.uncertainty import ParameterUncertainty, UncertainParameter

#: Torque constants, and the error that each leaves [m]; the last run never settles.
K_T = np.linspace(1.0, 1.4, 41)
ERROR = np.append(1e-3 * (1.5 - K_T[:-1]), np.nan)
LIMIT = 3e-4


def _campaign(limits):
    outcomes = []
    for k, (value, error) in enumerate(zip(K_T, ERROR, strict=True)):
        margin = (LIMIT - error) / LIMIT if np.isfinite(error) else -np.inf
        metrics = {"SteadyStateError": error} if np.isfinite(error) else {}
        outcomes.append(Outcome(k, margin >= 0.0, margin, k, {"K_T": value}, metrics, ()))
    uncertain = ParameterUncertainty((UncertainParameter("K_T", 1.2, 1.0, 1.4, unit="N m/A"),))
    return MonteCarlo("s", "c", uncertain, tuple(outcomes), 0, limits=limits)


@pytest.fixture(scope="module")
def campaign():
    return _campaign({"SteadyStateError": (None, LIMIT)})


def test_the_margin_is_relative_to_the_limit(campaign):
    """(limit - value) / limit of each run; a run without a value is farther off than any other."""
    (margins,) = campaign.margins.values()
    (stated,) = campaign.to_dict()["margins"]

    np.testing.assert_allclose(margins[:-1], (LIMIT - ERROR[:-1]) / LIMIT)
    assert margins[-1] == -np.inf
    assert (stated["run"], stated["smallest"], stated["upper"]) == (40, None, LIMIT)
    assert stated["median"] == pytest.approx((LIMIT - 0.31e-3) / LIMIT)
    assert stated["violated"] == np.sum(ERROR[:-1] > LIMIT) + 1


def test_each_run_is_drawn_where_its_margin_is(campaign):
    """Dots pass, crosses fail; a triangle lies beyond the panel; the worst run has its number."""
    figure = montecarlo_figure(campaign)
    (ax,) = [ax for ax in figure.axes if "margin" in ax.get_ylabel()]
    drawn = {
        line.get_marker(): line for line in ax.lines if len(line.get_xdata()) > 1 and line.get_linestyle() == "None"
    }
    passing, failing = drawn["o"], drawn["x"]

    assert np.all(passing.get_ydata() >= 0.0) and np.all(failing.get_ydata() < 0.0)
    np.testing.assert_allclose(
        passing.get_ydata(), 100 * (LIMIT - 1e-3 * (1.5 - passing.get_xdata())) / LIMIT, atol=1e-9
    )
    shown = len(passing.get_xdata()) + len(failing.get_xdata())
    (below,) = [line for line in ax.lines if line.get_marker() == "v"]
    assert shown + len(below.get_xdata()) == 41 and K_T[-1] in below.get_xdata()
    assert [text.get_text() for text in ax.texts] == ["run 40"]
    assert ax.get_xlabel().startswith("K_T (N m/A)")


def test_a_campaign_of_noise_alone_and_one_without_limits_are_drawn():
    """The runs by their number; without limits the smallest margin of each."""
    few = tuple(Outcome(k, True, 0.5, k, {}, {"SteadyStateError": 1e-4 * k}, ()) for k in range(3))
    figure = montecarlo_figure(MonteCarlo("s", "c", ParameterUncertainty(()), few, 0))

    (ax,) = [ax for ax in figure.axes if "margin" in ax.get_ylabel()]
    assert ax.get_ylabel().startswith("smallest") and ax.get_xlabel().startswith("run (")


def test_the_page_states_margins_and_other_failures(campaign, tmp_path):
    """A limit with its bound, its worst run and the number of violations; a stop of the simulation is no limit."""
    content = json.loads(json.dumps(campaign.to_dict()))
    content["failures"] = {"SteadyStateError": 11, "trip: stroke": 2}
    page = kinds()[KIND.name].read({"campaigns": [content]}, tmp_path)
    margins, others = [block for block in page.sections[0].blocks if isinstance(block, Table)][:2]

    assert margins.rows[0][:2] == ["SteadyStateError", "at most 0.3 mm"]
    assert margins.rows[0][-2:] == ["run 40", str(content["margins"][0]["violated"])]
    assert others.rows == [["trip: stroke", "2"]]
