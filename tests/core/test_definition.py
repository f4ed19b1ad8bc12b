"""Every key of a TOML file is documented by its field."""

import pytest

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
