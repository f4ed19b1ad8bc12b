"""Keys of the TOML forms: meaning, unit, default and nested tables."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from inspect import cleandoc
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from .definition import In


@dataclass(frozen=True)
class Key:
    """A key of a form.

    Attributes
    ----------
    name: as written in TOML. meaning: description of the field.
    unit: SI, of a quantity; None for a key that is none.
    choices: the words that it may be; empty for any.
    required: whether it must be there. default: what it is where it is left out.
    forms: of the tables that it may be; empty for a plain value. many: whether it is an array of such tables.
    """

    name: str
    meaning: str
    unit: str | None
    choices: tuple[str, ...]
    required: bool
    default: Any
    forms: tuple[type[BaseModel], ...]
    many: bool


def keys(form: type[BaseModel]) -> list[Key]:
    """The keys of a form, in their order."""
    return [_key(field.alias or name, field, field.description or "") for name, field in form.model_fields.items()]


def summary(form: type[BaseModel]) -> str:
    """First paragraph of a form's docstring, in one line."""
    return " ".join(cleandoc(form.__doc__ or "").split("\n\n")[0].split())


def _key(name: str, field: FieldInfo, meaning: str) -> Key:
    parts = list(_parts(field.annotation))
    metadata = [*field.metadata, *(item for part in parts for item in typing.get_args(part)[1:] if _annotated(part))]
    unit = next((item.unit for item in metadata if isinstance(item, In)), None)
    plain = [typing.get_args(part)[0] if _annotated(part) else part for part in parts]
    words = [str(word) for part in plain if typing.get_origin(part) is Literal for word in typing.get_args(part)]
    forms = tuple(part for part in plain if isinstance(part, type) and issubclass(part, BaseModel))
    many = any(typing.get_origin(part) in (list, tuple) for part in _flat(field.annotation))
    default = None if field.default is PydanticUndefined else field.default
    return Key(name, meaning, unit, tuple(words), field.is_required(), default, forms, many and bool(forms))


def _annotated(part: Any) -> bool:
    return typing.get_origin(part) is typing.Annotated


def _flat(annotation: Any) -> Iterator[Any]:
    """The alternatives of an annotation, as they stand."""
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        for part in typing.get_args(annotation):
            yield from _flat(part)
    else:
        yield annotation


def _parts(annotation: Any) -> Iterator[Any]:
    """The alternatives of an annotation, and what lists of them hold."""
    for part in _flat(annotation):
        inner = typing.get_args(part)[0] if _annotated(part) else part
        if typing.get_origin(inner) in (typing.Union, types.UnionType):
            yield from _parts(inner)
        elif typing.get_origin(part) in (list, tuple):
            for item in typing.get_args(part):
                if item is not Ellipsis:
                    yield from _parts(item)
        else:
            yield part
