"""Force targets of a scenario and their metrics, with a controller of the user's own."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.scenario.definition import ScenarioFile
from ehsa_ctrl.scenario.force_metrics import force_metrics, tracking_metrics
from ehsa_ctrl.scenario.force_reference import ForceChange, ForceLevels

STIFFNESS = 1e6
SCENARIO = {
    "plant": "ehsa",
    "duration": 4.0,
    "load": {"stiffness": STIFFNESS},
    "reference": {
        "kind": "steps",
        "times": [0.0],
        "positions": [0.0],
        "force": {"times": [0.1, 1.5], "forces": [2e3, 4e3], "rate": 5e3},
    },
}
REFERENCE = SCENARIO["reference"]


class Integral:
    """Slow integral action on the force beside a feedforward: whatever the plant's gain, it ends at the target."""

    def __init__(self):
        self.current = 0.0

    def step(self, t, y, r):
        self.current += 2e-6 * (r.force - y.force)
        return r.force / 3100.0 + self.current


def test_levels_are_reached_at_the_rate():
    """Half of a change after half of its time, and the level from its end on."""
    levels = ForceLevels(times=["1 s", "3 s"], forces=["4 kN", "0 N"], rate="4 kN/s")
    signal = levels.signal(np.array([0.0, 1.0, 1.5, 2.0, 2.9, 3.5, 9.0]))

    np.testing.assert_allclose(signal, [0, 0, 2e3, 4e3, 4e3, 2e3, 0], atol=1e-9)
    assert levels.changes() == [ForceChange(1.0, 2.0, 0.0, 4e3, 3.0), ForceChange(3.0, 4.0, 4e3, 0.0)]


def test_steps_act_at_their_sample():
    """Without a rate the target jumps."""
    signal = ForceLevels(times=["0.5 s"], forces=["-1 kN"]).signal(np.array([0.4, 0.5, 0.6]))

    assert signal.tolist() == [0.0, -1e3, -1e3]


def test_a_sine_is_added_to_the_levels():
    """From its start on; the level is held until then, and the largest target counts it."""
    sine = {"amplitude": "1 kN", "frequency": "2 Hz", "start": "3 s"}
    levels = ForceLevels(times=["1 s"], forces=["2 kN"], sine=sine)

    np.testing.assert_allclose(levels.signal(np.array([2.9, 3.125, 3.375])), [2e3, 3e3, 1e3], rtol=1e-9)
    assert levels.changes() == [ForceChange(1.0, 1.0, 0.0, 2e3, 3.0)]
    assert levels.largest == 3e3


def test_impact_and_lost_contacts_are_counted():
    """A rod that hits with 900 N against a target of 500 N, rebounds twice and then presses."""
    time = 0.01 * np.arange(20)
    target = np.full(20, 500.0)
    force = np.array([0, 0, 900, 0, 700, 0, *[500] * 14], dtype=float)
    asked = np.ones(20, dtype=bool)
    found = tracking_metrics(time, force, target, asked, gap=True)

    assert found["ContactImpact"] == 400.0 and found["LostContacts"] == 2.0
    error = np.array([400, 500, 200, 500, *[0] * 14])
    assert found["ForceRMSError"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert tracking_metrics(time, 0.0 * force, target, asked, gap=True) == {"LostContacts": 0.0}
    assert "ContactImpact" not in tracking_metrics(time, force, target, asked, gap=False)


@pytest.fixture(scope="module")
def pressed():
    """The linear and nonlinear run under an integral controller of the user's own."""
    return e.run(SCENARIO, controller=Integral())


def test_the_force_is_stiffness_times_penetration(pressed):
    """F = K_S x at every sample, on both plants."""
    for loop in (pressed.linear, pressed.nonlinear):
        np.testing.assert_allclose(loop.trajectory.cell_force, STIFFNESS * loop["x"], atol=1e-6)


def test_integral_action_reaches_the_force(pressed):
    """On the linear plant the error vanishes; the metrics tell the same as the signals."""
    force, target = pressed.linear.trajectory.cell_force, pressed.linear["reference_force"]
    linear = {name: pair[0] for name, pair in pressed.metrics.items()}

    assert force[-1] == pytest.approx(4e3, rel=2e-3) and target[-1] == 4e3
    assert linear["ForceSteadyStateError"] < 20.0
    assert 0.4 < linear["ForceSettlingTime"] < 2.5
    assert "reference_force" in pressed.time_series()


def test_force_metrics_are_those_of_the_signal(pressed):
    """A first-order lag of 50 ms settles after T ln 50, without overshoot; 300 N short is an error of 300 N."""
    run = pressed.linear.trajectory
    lag = 6e3 * (1 - np.exp(-np.maximum(run.time - 0.1, 0.0) / 0.05))
    short = np.where(run.time < 0.1, 0.0, 5.7e3)
    first, second = (
        force_metrics(
            replace(pressed.linear, trajectory=replace(run, cell_force=force)), [ForceChange(0.1, 0.1, 0, 6e3)]
        )
        for force in (lag, short)
    )

    assert first["ForceSettlingTime"] == pytest.approx(0.05 * np.log(50), abs=2e-3)
    assert first["ForceOvershoot"] == 0.0
    assert second["ForceSteadyStateError"] == pytest.approx(300.0) and np.isnan(second["ForceSettlingTime"])


def test_a_release_has_no_metrics(pressed):
    """A change to zero is left out."""
    assert force_metrics(pressed.linear, [ForceChange(0.1, 0.35, 5e3, 0.0)]) == {}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"forces": [5e3]}, "times has 2 and forces 1 entries"),
        ({"times": [1.0, 0.5]}, "times must increase"),
        ({"rate": 1e3}, "raise the rate or start later"),
        ({"times": [0.1, 3.9]}, "duration = 4 s, but an event of the scenario is at 4.3 s"),
    ],
)
def test_impossible_levels_are_said(change, message):
    """Counts, order, a rate that is too slow, a change that ends after the run."""
    with pytest.raises(InputError, match=message):
        e.run({**SCENARIO, "reference": {**REFERENCE, "force": REFERENCE["force"] | change}}, controller=Integral())


def test_a_force_metric_needs_a_force_target():
    """A limit on one is refused without it; with it the metric is shown."""
    content = {"schema": 1, "title": "t", "why": "w", "plant": "ehsa", "controller": "pid_position", "duration": "2 s"}
    reference = {"kind": "steps", "times": ["0.2 s"], "positions": ["1 mm"]}
    limits = {"ForceOvershoot": {"max": "5 %"}}
    with pytest.raises(InputError, match="the reference has no force target"):
        validate({**content, "reference": reference, "limits": limits}, ScenarioFile, "file")
    reference["force"] = {"times": ["0.2 s"], "forces": ["1 kN"]}

    assert validate({**content, "reference": reference, "limits": limits}, ScenarioFile, "file").reference.force
