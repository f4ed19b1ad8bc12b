"""Baselines: comparison with the recorded run, and recording with a reason."""

import json
from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.scenario import prepare
from ehsa_ctrl.scenario.baseline import SIGNALS, Predictability
from ehsa_ctrl.scenario.baseline_file import baseline_path, read_baseline, update_baseline, write_baseline

#: At 2 mm/s friction falls with speed: the rod creeps in stick-slip.
CREEP = """schema = 1
title = "Creep"
why = "Neighbouring motions part."
plant = "ehsa"
controller = "pid_friction"
duration = "24 s"
[load]
stiffness = "50 kN/m"
[reference]
kind = "ramp"
position = "40 mm"
velocity = "2 mm/s"
start = "0.2 s"
"""


@pytest.fixture
def recorded(project):
    """A run of the short move and its baseline."""
    path = project()
    write_baseline(ehsa_ctrl.run(path), "first look")
    return path


def test_a_run_keeps_to_its_own_baseline(recorded):
    """A new run passes against the recorded one; the result contains file and reason."""
    result = ehsa_ctrl.run(recorded)

    assert result.verdict == "pass"
    assert result.to_dict()["baseline"]["reason"] == "first look"
    assert result.baseline.path == recorded.parent / "baselines" / "short-pid_position.json"


def test_recorded_points_follow_the_run(recorded):
    """A line through the kept points misses no sample by more than a quarter of the tolerance."""
    result = ehsa_ctrl.run(recorded)
    run, kept = result.nonlinear.trajectory, result.baseline.signals
    for name in SIGNALS:
        line = np.interp(run.time, kept["time"], kept[name])

        assert np.max(np.abs(line - run[name])) < result.scenario.definition.baseline.of(name) / 4, name


def test_few_points_of_a_long_run_are_refined(project, monkeypatch):
    """However far apart the evenly spaced points are, the lines keep within a quarter of the tolerance."""
    monkeypatch.setattr("ehsa_ctrl.scenario.baseline_file.POINTS", 5)
    result = ehsa_ctrl.run(project())
    kept = read_baseline(write_baseline(result, "sparse")).signals
    run = result.nonlinear.trajectory
    for name in SIGNALS:
        line = np.interp(run.time, kept["time"], kept[name])
        assert np.max(np.abs(line - run[name])) <= 0.251 * result.scenario.definition.baseline.of(name), name
    assert kept["time"].size < run.time.size / 2


def test_another_plant_leaves_it(recorded, project):
    """More friction: the position leaves its tube, metrics differ, and the plant is named as what has changed."""
    path = project(add='\n[settings]\nA_FR = "1300 N"\n')
    result = ehsa_ctrl.run(path)
    text = "\n".join(result.failures)

    assert result.verdict == "fail"
    assert "x leaves its tube by" in text
    assert "RMSError (nonlinear) was" in text
    assert "because: first look; changed since then: scenario, plant" in text


def test_a_small_change_stays_within(recorded, project):
    """Another seed of the noise moves the rod by less than the tolerances."""
    path = project(add='\n[sensors]\nseed = 1\n\n[baseline]\nposition = "0.4 mm"\nspeed = "60 rad/s"\nshare = 0.5\n')
    tubes = [line for line in ehsa_ctrl.run(path).failures if "tube" in line]

    assert not any("x leaves" in line for line in tubes)


def test_tolerances_of_zero_let_nothing_through(recorded, project):
    """Recorded values are rounded to six digits, so a tube without height is violated."""
    path = project(add='\n[baseline]\ntime = "0 s"\nposition = "0 mm"\n')

    assert any("x leaves its tube" in line for line in ehsa_ctrl.run(path).failures)


def test_another_checked_plant_is_not_held_against_it(recorded):
    """A run on another plant is compared with no baseline."""
    assert ehsa_ctrl.run(recorded, plant="ehsa").baseline is None


def test_updating_records_what_is_new_and_leaves_what_is_kept(recorded, project):
    """A run within the tolerances keeps the file; one outside records a new one with its reason."""
    file = baseline_path(ehsa_ctrl.run(recorded))
    before = file.read_bytes()
    same, nothing = update_baseline(ehsa_ctrl.run(recorded), "no reason at all")
    assert not nothing and file.read_bytes() == before and same.verdict == "pass"

    changed, told = update_baseline(ehsa_ctrl.run(project(add='\n[settings]\nA_FR = "1300 N"\n')), "stiffer seal")

    assert changed.verdict == "pass" and any("leaves its tube" in line for line in told)
    assert json.loads(file.read_text())["reason"] == "stiffer seal"


def test_a_run_that_fails_its_limits_is_not_recorded(project):
    """A failing run is not recorded."""
    result = ehsa_ctrl.run(project(add='\n[limits]\nMaxError = { max = "1 um" }\n'))

    assert update_baseline(result, "never mind") == (result, ())
    with pytest.raises(InputError, match="a run that fails can't become a baseline"):
        write_baseline(result, "never mind")


def test_a_reason_is_needed(project):
    """Without a reason nothing is written."""
    result = ehsa_ctrl.run(project())
    with pytest.raises(InputError, match="no reason given"):
        write_baseline(result, "  ")

    assert not baseline_path(result).exists()


def test_a_scenario_that_asks_for_nothing_is_untested(project):
    """No limit, no trip expected, no baseline: neither pass nor fail."""
    assert ehsa_ctrl.run(project(add="")).verdict == "untested"


def test_a_run_that_ends_early_leaves_its_baseline(recorded):
    """A run that ends early deviates."""
    result = ehsa_ctrl.run(recorded)
    half = replace(result, nonlinear=result.nonlinear.first(150))

    assert any("the run ended at 0.596 s" in line for line in half.baseline.differences(half))


@pytest.mark.parametrize("text", ["", "{}", '{"metrics": {}, "signals": {}}', '{"metrics": {"IAE": [1]}}'])
def test_a_broken_file_is_a_sentence(tmp_path, text):
    """The message names the file and the remedy."""
    file = tmp_path / "b.json"
    file.write_text(text)
    with pytest.raises(InputError, match=r"b\.json: is not a valid baseline .* --update-baselines"):
        read_baseline(file)


def test_its_figure_and_table_show_the_tube(recorded):
    """One row per sample; the run lies within the bounds."""
    result = ehsa_ctrl.run(recorded)
    table = result.baseline.to_pandas(result)

    assert len(table) == len(result.nonlinear.trajectory)
    assert ((table.x >= table.x_lower) & (table.x <= table.x_upper)).all()
    assert len(result.plot_baseline().axes) == 4


@pytest.mark.slow
def test_a_run_that_rounding_changes_is_compared_as_long_as_it_does_not(tmp_path, monkeypatch):
    """A rod in stick-slip forgets its start: rounded parameters give another run, within what its baseline holds it to;
    without what rounding does to it, that run would fail."""
    path = tmp_path / "creep.toml"
    path.write_text(CREEP)
    kept = read_baseline(write_baseline(ehsa_ctrl.run(path), "creeps"))
    plant = ehsa_ctrl.load_plant("ehsa")
    rounded = plant.set(B_FM=plant["B_FM"] * (1 + 7e-14))
    given = prepare._given_plant
    monkeypatch.setattr(
        prepare, "_given_plant", lambda name, plant, model: rounded if name == "plant" else given(name, plant, model)
    )
    result = ehsa_ctrl.run(path)
    tube = kept.tube(result, "x")

    assert 2 < kept.predictable.until < 24
    assert np.isfinite(tube.upper[0]) and np.isnan(tube.upper[-1])
    assert kept.differences(result) == ()
    assert replace(kept, predictable=Predictability()).differences(result)


def test_a_run_without_slow_motion_is_predictable(recorded):
    """A move with planned acceleration: rounding changes nothing that a baseline could see."""
    assert ehsa_ctrl.run(recorded).baseline.predictable == Predictability()
    assert "predictable" not in json.loads(baseline_path(ehsa_ctrl.run(recorded)).read_text())
