"""Step responses of a linear sampled loop."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.closed_loop import step_response
from ehsa_ctrl.design.controller import SampledController
from ehsa_ctrl.design.kinds.pid import Gains, Pid
from ehsa_ctrl.report.figures import step_figure

T_S = 0.004


def controller(k_p, k_i=0.0):
    return SampledController("mine", "pid", T_S, 6.0, Pid(Gains(k_p, k_i), 1.0, 0.0, 6.0, np.inf, False, T_S))


@pytest.fixture
def integrator():
    """Position as the integral of the current less the force."""
    import control

    return control.ss([[0.0]], [[1.0, -1.0]], [[1.0]], 0, states=["x"], inputs=["current", "F_D"], outputs=["x"])


def test_p_on_an_integrator_is_the_closed_form(integrator):
    """x[k] = 1 - (1 - a)^k and, after a force of 1, -(1 - (1 - a)^k) / k_p with a = k_p T_s."""
    found = step_response(integrator, controller(25.0), 0.4)

    k = np.arange(101)
    rest = 0.9**k
    assert np.allclose(found.position["reference"], 1 - rest)
    assert np.allclose(found.position["force"], -(1 - rest) / 25.0)
    assert np.allclose(found.current["reference"], 25.0 * rest)
    assert found.overshoot == 0.0
    assert found.settling_time == pytest.approx(T_S * np.flatnonzero(rest <= 0.02)[0])


def test_the_force_is_paid_for_by_the_integral(linear):
    """A constant force leaves no error and needs the current F n / K_T, n = D / A, apart from leakage."""
    found = step_response(ehsa_ctrl.three_state(linear), controller(60.0, 60.0), 8.0)

    assert abs(found.position["force"][-1]) < 1e-3 * np.max(np.abs(found.position["force"]))
    assert found.current["force"][-1] == pytest.approx(linear["D"] / linear["A"] / linear["K_T"], rel=0.01)


@pytest.mark.parametrize(("drive", "unit"), [("current", "A"), ("F_M", "N")])
def test_the_drive_has_the_models_unit(integrator, drive, unit):
    integrator.input_labels = [drive, "F_D"]

    found = step_response(integrator, controller(25.0), 0.4)

    assert found.drive_unit == unit
    assert any(ax.get_ylabel().endswith(f"({unit})") for ax in step_figure(found).axes)


def test_an_unstable_loop_has_no_step_response(integrator):
    with pytest.raises(InputError, match="not stable"):
        step_response(integrator, controller(600.0))
