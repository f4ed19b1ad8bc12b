"""Iterative learning: contraction in theory and in simulation, what is refused, the command's files."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.closed_loop import INPUTS, OUTPUTS, close_loop, discrete_response
from ehsa_ctrl.scenario import learning as learning_module
from ehsa_ctrl.scenario.learning import learn_reference
from ehsa_ctrl.scenario.prepare import prepare

#: A whole number of periods in a run, and long enough that what the ends of the run lose does not count.
SINE = {
    "schema": 1, "title": "under test", "why": "test", "plant": "ehsa", "controller": "pid_position",
    "duration": "8 s", "reference": {"kind": "sine", "amplitude": "5 mm", "frequency": "1.25 Hz"},
    "sensors": {"noise": False},
}  # fmt: skip


def test_on_the_linear_plant_each_trial_contracts_as_theory_says(monkeypatch):
    """The error of a sine, trial by trial: Q (1 - gamma z^m T) of the last one, away from both ends."""
    case = prepare(SINE)
    # A run is refused on the linear plant, which alone has exact theory.
    monkeypatch.setattr(learning_module, "prepare", lambda *_, **__: replace(case, nonlinear=case.linear))
    found = learn_reference(SINE, trials=3, gain=0.5, cutoff=10.0)
    learning, w = found.learning, 2 * np.pi * 1.25
    _, _, closed = close_loop(case.model, case.controller)
    T = discrete_response(closed[OUTPUTS.index("position"), INPUTS.index("r_position")], w)[0, 0, 0]
    Q = np.cos(0.5 * w * 0.004) ** (learning.taps.size - 1)
    rho = Q * (1 - learning.gain * np.exp(1j * learning.lead * w * 0.004) * T)
    # w_j = Q gamma z^m e_0 (1 + rho + ... ) and e_j = e_0 - T w_j, whatever e_0 is: the velocity is fed forward too.
    lead = np.exp(1j * learning.lead * w * 0.004)
    expected = abs(1 - T * Q * learning.gain * lead * (1 + rho + rho**2))
    middle = slice(800, 1200)
    assert found.best.number == 3 and not found.grows
    ratio = np.max(np.abs(found.errors[3][middle])) / np.max(np.abs(found.errors[0][middle]))

    assert ratio == pytest.approx(expected, rel=0.02)
    assert ratio < 0.5


def test_under_friction_a_press_cycle_is_learnt():
    found = e.learn_reference("press_cycle", controller="cascade_friction", trials=4)

    assert found.trials[-1].rms < 0.35 * found.trials[0].rms
    assert len(found.to_pandas()) == 5
    assert np.allclose(found.trajectory()["position"], found.reference[:, 0] + found.correction)


def test_the_reference_is_that_of_the_best_trial():
    """Under a PID that lags, friction makes the error grow after a few trials, which is said."""
    found = e.learn_reference("press_cycle", controller="pid_friction", trials=8)
    best = found.trials[found.best.number]
    assert found.grows and best.rms == min(one.rms for one in found.trials)

    run = prepare("press_cycle", controller="pid_friction")
    loop = run.simulate(run.nonlinear, run.scenario.definition.sensors.seed + best.number, found.correction)
    error = found.reference[:, 0] - loop.trajectory["x"]

    assert np.sqrt(np.mean(error**2)) == pytest.approx(best.rms, rel=1e-9)
    assert f"the reference is that of trial {best.number}" in str(found) and "the error grows again" in str(found)
    assert set(found.errors) == {0, best.number}


@pytest.mark.parametrize(
    ("scenario", "given", "sentence"),
    [
        ("steps_spring", {}, "its target jumps, and no correction makes the rod follow a jump"),
        ("press_cycle", {"trials": 0}, "trials = 0; expected 1 to 1000"),
        ("press_cycle", {"cutoff": 200.0}, "expected more than 0 and less than 125 Hz"),
        ("press_cycle", {"cutoff": 100.0, "lead": 0}, "learning does not converge .* lower it to"),
        ("press_cycle", {"deadband": -1.0}, "deadband = -1 m; expected 0 or more"),
    ],
)
def test_what_can_not_be_learnt_is_one_sentence(scenario, given, sentence):
    with pytest.raises(InputError, match=sentence):
        learn_reference(scenario, **given)


def test_a_law_in_python_is_refused():
    with pytest.raises(InputError, match="no linear law"):
        learn_reference(SINE, controller=lambda t, y, r: 0.0)
