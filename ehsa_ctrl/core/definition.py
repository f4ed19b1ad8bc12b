"""Validation of TOML files; every mistake is one sentence with file and key."""

from __future__ import annotations

import typing
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AllowInfNan, BaseModel, BeforeValidator, ConfigDict, Strict, ValidationError

from .errors import InputError, choices, shown
from .files import read_toml
from .unit import parse


class Definition(BaseModel):
    """Base of all TOML forms: unknown keys are mistakes, values are frozen.

    Nothing is converted: true is no 1, "1" no 1, and a number is finite unless its field says otherwise.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, strict=True, allow_inf_nan=False
    )


#: Largest magnitude in SI units, its inverse the smallest: beyond them squares overflow or vanish.
LARGEST = 1e30


class In:
    """A quantity in an SI unit: `Annotated[float, In("m")]` reads "20 mm" as 0.02."""

    def __init__(self, unit: str) -> None:
        self.unit = unit

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        def convert(value: Any) -> float:
            if isinstance(value, str):
                try:
                    number = parse(value, self.unit)
                except InputError as error:
                    raise ValueError(str(error)) from None
            elif isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{shown(value)} is no quantity; write it as in '3 {self.unit}'")
            elif self.unit not in ("1", "fraction"):
                raise ValueError(f"{shown(value)} has no unit; write it as in '{shown(value)} {self.unit}'")
            else:
                number = value
            if number != 0 and not 1.0 / LARGEST <= abs(number) <= LARGEST:
                raise ValueError(f"{shown(value)} is beyond any meaning; expected 0, or {1 / LARGEST:g} to {LARGEST:g}")
            return float(number)

        # The bounds of a Field (gt, ge, lt, le) apply to the converted number.
        return core_schema.no_info_before_validator_function(convert, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"type": "string", "unit": self.unit}


#: Pairs and the like, which TOML writes as an array.
Array = Strict(False)
#: A number that may be infinite, where that means never.
Unlimited = Annotated[float, AllowInfNan(True)]

Metre = Annotated[float, In("m")]
Second = Annotated[float, In("s")]
Ampere = Annotated[float, In("A")]
Newton = Annotated[float, In("N")]
Hertz = Annotated[float, In("Hz")]
RadianPerSecond = Annotated[float, In("rad/s")]
Radian = Annotated[float, In("rad")]


def _whole(value: Any) -> Any:
    if type(value) is not int:
        raise ValueError(f"schema = {_got(value)}; expected the whole number 1")
    return value


#: Of a form; a Literal alone would take true for 1.
Schema = Annotated[Literal[1], BeforeValidator(_whole)]

D = TypeVar("D", bound=Definition)


def read_definition(path: Path, kind: type[D]) -> D:
    """Read and validate one definition. Raises InputError with file, key, what was got and what was expected."""
    return validate(read_toml(path), kind, str(path))


def validate(content: dict[str, Any], kind: type[D], where: str, context: dict[str, Any] | None = None) -> D:
    """Validate parsed TOML; `where` is the file's name for messages, `context` is passed to the validators."""
    try:
        return kind.model_validate(content, context=context)
    except ValidationError as error:
        raise InputError(f"{where}: {_sentence(error, kind)}") from None


#: Expected types of pydantic's errors, in terms of TOML.
EXPECTED = {
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "a table"),
    **dict.fromkeys(("list_type", "tuple_type"), "an array"),
    "string_type": "a text",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "finite_number": "a finite number",
}


def _got(value: Any) -> str:
    """A value in terms of TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    return "a table" if isinstance(value, dict) else "an array" if isinstance(value, list) else shown(value)


def _name(part: int | str) -> str:
    """A key as it is, quoted where it is long or not printable."""
    text = str(part)
    return text if len(text) <= 60 and text.isprintable() else shown(text)


def _sentence(error: ValidationError, kind: type[BaseModel]) -> str:
    """The first mistake as one sentence; an unknown key comes first, as it is often the cause of a missing one."""
    mistakes = sorted(error.errors(), key=lambda item: item["type"] != "extra_forbidden")
    first = mistakes[0]
    *tables, key = (_name(part) for part in first["loc"] or ("",))
    place = f"[{'.'.join(tables)}] {key}" if tables else key
    match first["type"]:
        case "extra_forbidden":
            sentence = f"{place}: unknown key; {choices(key, _fields(kind, first['loc'][:-1]))}"
        case "missing":
            sentence = f"{place}: is missing"
        case "value_error":
            sentence = f"{place}: {first['ctx']['error']}" if place else str(first["ctx"]["error"])
        case "union_tag_invalid" | "union_tag_not_found":
            word = str(first["ctx"]["discriminator"]).strip("'")
            got = first["input"].get(word) if isinstance(first["input"], dict) else None
            known = first["ctx"].get("expected_tags", "")
            sentence = f"{place}: {word} {'is missing' if got is None else f'= {_got(got)}'}" + (
                f"; known: {known}" if known else ""
            )
        case _:
            said = EXPECTED.get(first["type"])
            message = first["msg"].replace("Input should be greater", "expected a value greater")
            message = message.replace("Input should be less", "expected a value less")
            words = f"expected {said}" if said else f"{message[0].lower()}{message[1:]}"
            sentence = f"{place} = {_got(first['input'])}; {words}"
    more = len(mistakes) - 1
    return sentence + (f" (and {more} more mistake{'s' if more > 1 else ''})" if more else "")


def _fields(kind: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """Keys of the table at `loc`."""
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
