"""Results as plain values and as tables."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ehsa_ctrl.core.result import Result, as_dict, as_table


@dataclass(frozen=True)
class Part:
    name: str
    value: float


@dataclass(frozen=True, repr=False)
class Whole(Result):
    parts: tuple[Part, ...]
    numbers: np.ndarray
    path: Path

    def __str__(self) -> str:
        return f"{len(self.parts)} parts < 9"


WHOLE = Whole((Part("a", 1.0), Part("b", math.inf)), np.array([1.0, np.nan]), Path("x.csv"))


def test_fields_become_plain_values():
    """Dataclasses within too: lists, None for what is not finite, paths as text."""
    parts = [{"name": "a", "value": 1.0}, {"name": "b", "value": None}]

    assert as_dict(WHOLE) == {"parts": parts, "numbers": [1.0, None], "path": "x.csv"}


def test_a_selection_of_attributes_has_further_values_beside():
    """Under their own names; `more` under its keys."""
    found = as_dict(WHOLE, "path", pole=complex(-1, 2), first=WHOLE.parts[0])

    assert found == {"path": "x.csv", "pole": [-1.0, 2.0], "first": {"name": "a", "value": 1.0}}
    assert json.loads(json.dumps(found)) == found


def test_a_table_has_a_row_an_item():
    """In the order of the names, computed columns among the others; infinity stays a number, no item is no row."""
    table = as_table(WHOLE.parts, "twice value", twice=lambda part: 2 * part.value)

    assert list(table.columns) == ["twice", "value"] and list(table.index) == ["a", "b"] and table.index.name == "name"
    assert table.loc["a", "twice"] == 2.0 and table.loc["b", "value"] == math.inf
    assert as_table([], "value").shape == (0, 1)


def test_a_result_is_shown_as_its_text():
    """In a terminal; in a notebook with its characters escaped."""
    assert repr(WHOLE) == "2 parts < 9" and WHOLE._repr_html_() == "<pre>2 parts &lt; 9</pre>"
