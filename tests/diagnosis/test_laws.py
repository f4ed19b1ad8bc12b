"""Laws of another form: logs of a bench written apart from this project are named by the right effect."""

import json

import pytest

import ehsa_ctrl

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
