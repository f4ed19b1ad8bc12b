"""Docstrings of definitions say what each key means."""

import pytest

from ehsa_ctrl.core.definition import Definition, Metre
from ehsa_ctrl.core.described import keys, meanings, summary
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.plant.file import PlantFile
from ehsa_ctrl.scenario.definition import ScenarioFile


class Inner(Definition):
    """[inner]: a table of its own."""

    depth: Metre = 0.5


class Outer(Definition):
    """[outer]: for the test.

    width (of the gap), height: how large
        it is. colour: red (or not).
    [inner]: what is within.

    A paragraph that says height: is not read as the key's continuation of colour.
    """

    width: Metre
    height: Metre | None = None
    colour: str = "red"
    inner: list[Inner] = []


def test_keys_are_read_from_the_docstring():
    """Several keys share a meaning; what is in parentheses belongs to one; a line that is broken is joined."""
    assert summary(Outer) == "[outer]: for the test."
    assert meanings(Outer)["width"] == "of the gap: how large it is"
    assert meanings(Outer)["colour"] == "red (or not)"
    assert meanings(Outer)["inner"] == "what is within"


def test_keys_know_unit_default_and_tables():
    """From the annotations, so that nothing is written twice."""
    found = {key.name: key for key in keys(Outer)}

    assert found["width"].unit == "m" and found["width"].required
    assert found["height"].unit == "m" and not found["height"].required
    assert found["colour"].default == "red"
    assert found["inner"].forms == (Inner,) and found["inner"].many


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
    """A new key without a line in its docstring is noticed here."""
    seen = []
    forms(form, seen)
    silent = [f"{one.__name__}.{key.name}" for one in seen for key in keys(one) if not key.meaning]

    assert not silent
    assert all(summary(one) for one in seen)
