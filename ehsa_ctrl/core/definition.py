"""TOML in, checked definition out; every mistake is one sentence with file and key."""

from __future__ import annotations

import tomllib
import typing
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from .errors import InputError, choices
from .unit import parse


class Definition(BaseModel):
    """Base of everything that a user writes in TOML: unknown keys are mistakes, values don't change afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class In:
    """Marks a text field as a quantity in an SI unit: `Annotated[float, In("m")]` reads "20 mm" as 0.02."""

    def __init__(self, unit: str) -> None:
        self.unit = unit

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        def convert(value: Any) -> float:
            if isinstance(value, str):
                try:
                    return parse(value, self.unit)
                except InputError as error:
                    raise ValueError(str(error)) from None
            if isinstance(value, int | float) and not isinstance(value, bool):
                if self.unit in ("1", "fraction"):
                    return float(value)
                raise ValueError(f"{value!r} has no unit; write it as in '{value} {self.unit}'")
            raise ValueError(f"{value!r} is no quantity; write it as in '3 {self.unit}'")

        return core_schema.no_info_plain_validator_function(convert)


Metre = Annotated[float, In("m")]
Second = Annotated[float, In("s")]
Ampere = Annotated[float, In("A")]
Newton = Annotated[float, In("N")]
Hertz = Annotated[float, In("Hz")]
RadianPerSecond = Annotated[float, In("rad/s")]
Radian = Annotated[float, In("rad")]

D = TypeVar("D", bound=Definition)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises InputError naming file and line if it is absent or is no TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can't be read as text ({error})") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is no valid TOML: {error}") from None


def read_definition(path: Path, kind: type[D]) -> D:
    """Read and validate one definition. Raises InputError with file, key, what was got and what was expected."""
    return validate(read_toml(path), kind, str(path))


def validate(content: dict[str, Any], kind: type[D], where: str, context: dict[str, Any] | None = None) -> D:
    """Validate parsed TOML; `where` is the file's name for messages, `context` what its validators may ask for."""
    try:
        return kind.model_validate(content, context=context)
    except ValidationError as error:
        raise InputError(f"{where}: {_sentence(error, kind)}") from None


def _sentence(error: ValidationError, kind: type[BaseModel]) -> str:
    """The first mistake as one sentence; an unknown key comes first, as it is often the cause of a missing one."""
    mistakes = sorted(error.errors(), key=lambda item: item["type"] != "extra_forbidden")
    first = mistakes[0]
    *tables, key = first["loc"] or ("",)
    place = f"[{'.'.join(str(part) for part in tables)}] {key}" if tables else str(key)
    match first["type"]:
        case "extra_forbidden":
            sentence = f"{place}: unknown key; {choices(str(key), _fields(kind, first['loc'][:-1]))}"
        case "missing":
            sentence = f"{place}: is missing"
        case "value_error":
            sentence = f"{place}: {first['ctx']['error']}" if place else str(first["ctx"]["error"])
        case _:
            got = first["input"]
            sentence = f"{place} = {got!r}: {first['msg'][0].lower()}{first['msg'][1:]}"
    more = len(mistakes) - 1
    return sentence + (f" (and {more} more mistake{'s' if more > 1 else ''})" if more else "")


def _fields(kind: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """Names that are known in the table at `loc`."""
    current: Any = kind
    for part in loc:
        if isinstance(current, type) and issubclass(current, BaseModel):
            field = current.model_fields.get(str(part))
            current = field.annotation if field else None
        else:
            arguments = typing.get_args(current)
            current = arguments[-1] if arguments else None
        options = [a for a in typing.get_args(current) if isinstance(a, type) and issubclass(a, BaseModel)]
        if options and typing.get_origin(current) is not dict:
            current = options[0]
    if isinstance(current, type) and issubclass(current, BaseModel):
        return [field.alias or name for name, field in current.model_fields.items()]
    return []
