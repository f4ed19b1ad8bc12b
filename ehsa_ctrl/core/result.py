"""Results in other forms: plain values for JSON, a table, text in a terminal and in a notebook."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas


class Result:
    """Base of what users look at: shown as its `__str__`, in a notebook in a font of fixed width.

    A dataclass with `repr=False` shows its text in a terminal too.
    """

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        import html

        return f"<pre>{html.escape(str(self))}</pre>"


def as_dict(item: Any, names: str = "", /, **more: Any) -> dict[str, Any]:
    """Attributes of an item under their own names, then `more`, as plain values: {"value": item.value, "sd": item.sd}.

    names: separated by spaces; by default all fields of a dataclass.
    """
    own = names.split() or [each.name for each in fields(item)]
    return {key: plain(value) for key, value in ({name: getattr(item, name) for name in own} | more).items()}


def plain(value: Any) -> Any:
    """A value as JSON has it: results and dataclasses as dictionaries, arrays as lists, nan and infinity as None."""
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return as_dict(value) if is_dataclass(value) else value


def to_json(value: Any) -> str:
    """A value as indented JSON."""
    return json.dumps(plain(value), indent=2)


def as_table(
    items: Iterable[Any], names: str, *, index: str = "name", **computed: Callable[[Any], Any]
) -> pandas.DataFrame:
    """One row an item, by default under its attribute `index`; a column each of `names`.

    names: separated by spaces. computed: of a name that is no attribute, a function of the item.
    """
    import pandas

    found = list(items)
    columns = {name: list(map(computed.get(name, attrgetter(name)), found)) for name in names.split()}
    return pandas.DataFrame(columns, index=pandas.Index([getattr(item, index) for item in found], name=index))
