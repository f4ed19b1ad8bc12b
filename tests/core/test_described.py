"""Every key of a TOML form has a description."""

import pytest

from ehsa_ctrl.core.described import keys, summary
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.plant.file import PlantFile
from ehsa_ctrl.scenario.definition import ScenarioFile


def forms(form, seen):
    """A form and all that its keys may hold."""
    if form in seen:
        return
    seen.append(form)
    for key in keys(form):
        for inner in key.forms:
            forms(inner, seen)


@pytest.mark.parametrize("form", [*(kind.file for kind in CONTROLLER_KINDS.values()), ScenarioFile, PlantFile])
def test_every_key_of_every_definition_is_explained(form):
    """A new key without Field(description=...) is noticed here."""
    seen = []
    forms(form, seen)
    silent = [f"{one.__name__}.{key.name}" for one in seen for key in keys(one) if not key.meaning]

    assert not silent
    assert all(summary(one) for one in seen)
