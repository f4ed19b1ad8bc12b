"""One controller with many plants."""

import numpy as np
import pytest
from made_loops import integrator, proportional

from ehsa_ctrl import InputError, load_controller
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.analysis.robustness import robust_margins
from ehsa_ctrl.plant.draws import draw, drawn_models

H = 0.004


@pytest.fixture
def three():
    """An integrator of gain 1, of half and of 1.4 times of it, under k h = 1."""
    plants = {"as designed": integrator(), "weak": integrator(0.5), "strong": integrator(1.4)}
    return robust_margins(plants, proportional(1 / H))


def test_the_worst_is_named(three):
    """For L = k h / (z - 1) the largest gain is the worst in every margin, with values known by hand."""
    assert {worst.label for name, worst in three.worst.items() if name != "Mt"} == {"strong"}
    assert three.Ms == pytest.approx(2 / 0.6)
    assert three.disk_margin == pytest.approx(2 * 0.6 / 3.4)
    assert three.worst["gain_margin"].value == pytest.approx(2 / 1.4)
    assert "Ms" in str(three) and "strong" in str(three)


def test_targets_are_judged_on_the_worst(three):
    """Nominal Ms is 2, the worst 3.33."""
    assert three.stable
    assert not three.meets(Ms=2.5, disk_margin=0.1)
    assert three.meets(Ms=3.4, disk_margin=0.3)


def test_an_unstable_plant_is_the_worst_of_all():
    """With k h = 2.2 the loop is not stable, though its |S| has a lower peak than that with k h = 1.99."""
    plants = {"good": integrator(), "bad": integrator(2.2), "close": integrator(1.99)}
    found = robust_margins(plants, proportional(1 / H))

    assert found.unstable == ("bad",) and not found.stable
    assert {worst.label for worst in found.worst.values()} == {"bad"}
    assert found.Ms == np.inf and found.disk_margin == 0.0
    assert not found.meets(Ms=1e9, disk_margin=0.0)
    assert "1 NOT STABLE: bad" in str(found)


def test_the_band_holds_every_plant(three):
    """|S| of each plant lies between the lowest and the highest; at low frequencies it is small."""
    omega, low, high = three.band("S")
    for loop in three.loops.values():
        curve = np.interp(omega, loop.omega, np.abs(loop.sensitivity))
        assert np.all(low <= curve * 1.01) and np.all(curve <= high * 1.01)
    _, low_T, high_T = three.band("T")

    assert high[0] < 0.05 and low_T[0] == pytest.approx(1, abs=0.05) and np.max(high_T) > 2


def test_the_table_has_a_row_a_plant(three):
    """With the numbers of analyse_loop."""
    table = three.to_pandas()
    alone = analyse_loop(integrator(0.5), proportional(1 / H))

    assert list(table.index) == ["as designed", "weak", "strong"]
    assert table.loc["weak", "Ms"] == pytest.approx(alone.Ms)
    assert three.to_dict()["worst"]["Ms"]["plant"] == "strong"
    assert "<pre>" in three._repr_html_()


def test_a_coarse_grid_finds_the_same_margins(linear):
    """Peaks and crossovers are found between the points, so that 100 points do."""
    from ehsa_ctrl import three_state

    system = three_state(linear)
    controller = load_controller("lqr_position", system)
    coarse, fine = (analyse_loop(system, controller, points=points) for points in (100, 3000))

    for name in ("Ms", "Mt", "disk_margin", "phase_margin", "gain_margin", "delay_margin"):
        assert getattr(coarse, name) == pytest.approx(getattr(fine, name), rel=1e-4), name


def test_draws_of_the_plant_bracket_the_nominal_loop(linear):
    """With plants drawn around it, the worst is worse than the nominal loop and the best is better."""
    models = drawn_models(linear, draw(linear, 12, unknown=0.1))
    found = robust_margins(models, load_controller("pid_position", models["nominal"]))
    alpha = found.to_pandas()["disk_margin"]

    assert alpha.min() < alpha["nominal"] < alpha.max()
    assert found.disk_margin == alpha.min() == alpha[found.worst["disk_margin"].label]


def test_no_plant_and_no_symbol_are_refused(three):
    """In a sentence."""
    with pytest.raises(InputError, match="got no plant"):
        robust_margins({}, proportional(1.0))
    with pytest.raises(InputError, match="expected 'S' or 'T'"):
        three.band("K")
