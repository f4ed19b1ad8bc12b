"""Every key of a TOML file is documented by its field."""

import pytest

from ehsa_ctrl import InputError, load_scenario
from ehsa_ctrl.core.definition import drive_quantities, validate
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.plant.file import PlantFile
from ehsa_ctrl.scenario.definition import ScenarioFile


@pytest.mark.parametrize("form", [*(kind.file for kind in CONTROLLER_KINDS.values()), ScenarioFile, PlantFile])
def test_every_key_has_a_description(form):
    """A new key without Field(description=...) is noticed here, and a table without a docstring."""
    schema = form.model_json_schema()

    for table in (schema, *schema["$defs"].values()):
        assert table.get("description"), table["title"]
        assert [key for key, field in table["properties"].items() if not field.get("description")] == []


def test_a_quantity_has_its_unit_in_the_schema():
    """So that the documentation, and editors with TOML support, know it."""
    schema = ScenarioFile.model_json_schema()

    assert schema["properties"]["duration"]["unit"] == "s"


def test_a_misspelt_word_of_a_table_of_words_is_an_unknown_key():
    with pytest.raises(
        InputError, match=r"\[load\] stifness: unknown key; did you mean 'stiffness'\? known: force, gap"
    ):
        load_scenario("steps_spring", load={"stifness": 20e3})


def test_a_unit_of_the_drive_is_that_of_the_plant():
    """A quantity in A is read in N or V where the plant's drive is one, and in nothing else."""
    quantities = drive_quantities(CONTROLLER_KINDS["pid"].file)
    damping = quantities["feedforward.viscous"]

    assert {"current_limit", "gains.k_i", "feedforward.coulomb", "tuning.noise_gain"} <= set(quantities)
    assert {damping.unit_with(unit) for unit in "ANV"} == {"A s/m", "N s/m", "V s/m"}
    content = {"schema": 1, "kind": "pid", "title": "test", "current_limit": "1 kN", "gains": {"k_p": "2 kN/m"}}
    assert validate(content, CONTROLLER_KINDS["pid"].file, "", {"drive_unit": "N"}).gains.k_p == 2000.0
    with pytest.raises(InputError, match="'1 kN', but the drive of this plant is in V; write it in V"):
        validate(content, CONTROLLER_KINDS["pid"].file, "", {"drive_unit": "V"})
