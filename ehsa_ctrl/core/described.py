"""What the keys of a definition mean, read from the docstrings of the forms: one text for readers of the code, for the
templates that `ehsa-ctrl new` writes, and for the reference of keys.

A docstring says "key: meaning." or "key, other: meaning.", several in a row where they are short; a parenthesis may
follow a key. A table's own line ("A controller's [rest].") is what stands before the first key.
"""

from __future__ import annotations

import re
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
    name: as written in TOML. meaning: in words, empty if the docstring is silent.
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
    said = meanings(form)
    return [_key(field.alias or name, field, said.get(field.alias or name, "")) for name, field in _fields(form)]


def summary(form: type[BaseModel]) -> str:
    """What a form's docstring says before its first key, in one line."""
    text = _own(form)
    found = next(iter(_places(text, [field.alias or name for name, field in _fields(form)])), None)
    head = text if found is None else text[: found[1]]
    return " ".join(head.split()).removesuffix(" and").strip()


def meanings(form: type[BaseModel]) -> dict[str, str]:
    """Key -> meaning, of a form and what it builds on."""
    names = [field.alias or name for name, field in _fields(form)]
    found: dict[str, str] = {}
    for part in reversed(form.__mro__):
        if issubclass(part, BaseModel) and part is not BaseModel:
            found |= _read(_own(part), names)
    return found


def _fields(form: type[BaseModel]) -> Iterator[tuple[str, FieldInfo]]:
    yield from form.model_fields.items()


def _own(form: type[BaseModel]) -> str:
    return cleandoc(form.__dict__.get("__doc__") or "")


def _places(text: str, names: list[str]) -> list[tuple[list[str], int, int]]:
    """Keys in a docstring: which, where they begin, and where their meaning begins."""
    word = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    one = rf"\[{{0,2}}(?:{word})\]{{0,2}}(?: \([^)]*\))?"
    found = []
    for match in re.finditer(rf"(?:(?<=^)|(?<=[\s]))({one}(?:,\s+{one})*):\s", text):
        listed = re.findall(rf"(?<![\w])({word})(?![\w])", re.sub(r"\([^)]*\)", "", match[1]))
        found.append((listed, match.start(1), match.end()))
    return found


def _read(text: str, names: list[str]) -> dict[str, str]:
    places = _places(text, names)
    ends = [*(begin for _, begin, _ in places), len(text)][1:]
    found = {}
    for (listed, begin, start), end in zip(places, ends, strict=False):
        meaning = re.split(r"\n\s*\n", text[start:end])[0]
        meaning = " ".join(meaning.split()).rstrip(" .;")
        notes = dict(re.findall(r"(\w+) \(([^)]*)\)", text[begin:start]))
        for name in listed:
            found[name] = f"{notes[name]}: {meaning}" if name in notes and len(listed) > 1 else meaning
    return found


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
