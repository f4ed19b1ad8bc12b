"""Laws of another form are named by the right effect: logs of a bench written apart from this project, and of ours."""

import json

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.physics.effects import EFFECTS

#: Of the logs [s].
DURATION = 7.0

pytestmark = pytest.mark.slow


def diagnosed(folder, name):
    """The diagnosis of a log with the plant and load that its modeller believes."""
    asked = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    plant = ehsa_ctrl.load_plant("ehsa").set(K_S=asked["spring_stiffness"])
    return ehsa_ctrl.diagnose(plant, ehsa_ctrl.read_plant_log(folder / f"{name}.csv", plant))


@pytest.mark.parametrize(
    ("name", "id", "law"), [("HL14", "viscosity_warmup", "E_w"), ("HL15", "torque_ripple", "a_c2")]
)
def test_the_law_is_named_with_the_parameter_of_its_form(shared_logs, name, id, law):
    """The effect alone, in the form that the bench has: warming by heat, a ripple of two orders."""
    found = diagnosed(shared_logs.parent / "hard" / "labelled", name)

    assert [cause.id for cause in found.effects] == [id]
    assert law in found.effects[0].parameters
    assert found.gap["with_effects"]["total"] < 0.2 * found.gap["nominal"]["total"]


def recorded(rig):
    """A log of the rig with its sensors' noise."""
    log, _ = ehsa_ctrl.record(rig, *ehsa_ctrl.excitation("noise", amplitude=4.0, duration=DURATION, seed=2), seed=1)
    return log


@pytest.mark.parametrize(
    ("id", "form"),
    [
        ("pump_torque_loss", {"c_f": 0.0, "c_w": 1e-3}),
        ("pump_torque_loss", {"c_f": 0.12, "b_f": 2.0, "w_f": 40.0}),
        ("torque_saturation", {"k_sat": 0.0, "I_knee": 1.8, "s_knee": 0.2}),
        ("end_stop", {"x_stop": np.inf, "x_cushion": 0.003, "B_cushion": 0.0, "C_cushion": 5e7}),
        ("end_stop", {"x_stop": np.inf, "x_cushion": 0.004, "B_cushion": 2e7, "K_cushion": 1e5}),
        ("drive_lag", {"tau_I": 0.01, "b_I": 1.0}),
        ("relief_hysteresis", {"P_crack": 24e5, "P_hyst": 3e5, "K_relief": 2e-7}),
        ("position_dependent_friction", {"h_FR": 0.4, "x_h": 0.002, "n_h": 150.0}),
        ("position_dependent_friction", {"h_FR": 0.5, "x_h": -0.005, "w_h": 0.003, "h_FR2": 0.8, "x_h2": 0.004}),
        (
            "position_dependent_friction",
            {"h_FR": 0.0, "c_FR1": 0.35, "c_FR3": -0.4, "c_FR4": 0.3, "c_FR6": 0.2, "x_a": -0.02, "x_b": 0.02},
        ),
        ("maxwell_slip", {"s_slip": 2e-7}),
        ("hose_wall", {"C_h": 1.5e-12, "tau_h": 0.1}),
        ("entrained_air", {"air_fraction": 0.03, "P_diss": 10e5, "tau_diss": 1.0}),
    ],
)
def test_a_form_of_a_law_has_its_name(plant, id, form):
    """Under a spring, which loads the pump at all speeds; nothing else is named."""
    loaded = plant.set(K_S=5e4)

    found = ehsa_ctrl.diagnose(loaded, recorded(loaded.with_effects(id, **form)))

    assert [cause.id for cause in found.effects] == [EFFECTS[id].extends or id]
    assert found.gap["with_effects"]["total"] < 0.2 * found.gap["nominal"]["total"]


def test_another_level_with_elastic_sliders_is_one_cause(plant):
    """The rod's friction is wrong in level and in form: `rod_friction` alone, with the sliders' compliance."""
    loaded = plant.set(K_S=5e4)
    rig = loaded.set(A_FR=1.25 * plant["A_FR"]).with_effects("maxwell_slip", s_slip=1e-7)

    found = ehsa_ctrl.diagnose(loaded, recorded(rig))

    assert [cause.id for cause in found.effects] == ["rod_friction"]
    assert found.effects[0].parameters["A_FR"].value == pytest.approx(rig["A_FR"], rel=0.05)
    assert found.effects[0].parameters["s_slip"].value == pytest.approx(1e-7, rel=0.3)
