"""Validate TOML files; each error is one sentence with file and key."""

from __future__ import annotations

import re
import typing
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AllowInfNan, BaseModel, BeforeValidator, ConfigDict, Strict, ValidationError

from .errors import InputError, choices, shown
from .files import read_toml
from .unit import parse, parse_angular_frequency


class Definition(BaseModel):
    """Base of all definitions in TOML: unknown keys are errors, instances are frozen.

    Types are strict: neither true nor "1" is accepted for 1. Numbers are finite unless the field is Unlimited.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, strict=True, allow_inf_nan=False
    )


#: Largest magnitude in SI units; its inverse is the smallest. Engineering judgement: no quantity of this field comes
#: near them, and squares and cubes neither overflow nor underflow.
LARGEST = 1e30


def from_python(info: Any) -> bool:
    """Whether a definition comes from Python, where a number is in SI units: the entry `si` of the context."""
    return bool((info.context or {}).get("si"))


class In:
    """A quantity in an SI unit: `Annotated[float, In("m")]` reads "20 mm" as 0.02.

    read: function of a text and the unit that returns the number in SI units.
    """

    def __init__(self, unit: str, *, read: Callable[[str, str], float] = parse) -> None:
        self.unit, self._read = unit, read

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        def convert(value: Any, info: Any) -> float:
            if isinstance(value, str):
                number = self._number(value, info)
            elif isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{shown(value)} is not a quantity; write it as in '3 {self.unit}'")
            elif self.unit not in ("1", "fraction") and not from_python(info):
                raise ValueError(f"{shown(value)} has no unit; write it as in '{shown(value)} {self.unit}'")
            else:
                number = value
            if number != 0 and not 1.0 / LARGEST <= abs(number) <= LARGEST:
                raise ValueError(f"{shown(value)} is out of range; expected 0, or {1 / LARGEST:g} to {LARGEST:g}")
            return float(number)

        # The bounds of a Field (gt, ge, lt, le) apply to the converted number.
        return core_schema.with_info_before_validator_function(convert, handler(source))

    def _number(self, text: str, info: Any) -> float:
        """The text as a number in the SI unit."""
        try:
            return self._read(text, self.unit)
        except InputError as error:
            raise ValueError(str(error)) from None

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"type": "string", "unit": self.unit}


class InDrive(In):
    """A quantity whose unit contains that of the plant's drive: `InDrive("A/m")` is in N/m where the drive is a force.

    The entry `drive_unit` of the context, A, N or V, admits that unit alone; without it each of them is read.
    """

    def unit_with(self, drive_unit: str) -> str:
        """The unit for a drive in `drive_unit`."""
        return self.unit.replace("A", drive_unit)

    def _number(self, text: str, info: Any) -> float:
        given = (info.context or {}).get("drive_unit")
        for drive_unit in DRIVE_UNITS:
            with suppress(InputError):
                number = self._read(text, self.unit_with(drive_unit))
                if given and drive_unit != given:
                    from pydantic_core import PydanticCustomError

                    raise PydanticCustomError(
                        OTHER_DRIVE,
                        "the drive of this plant is in {drive}; write it in {unit}, or take a controller for this "
                        "plant",
                        {"drive": given, "unit": self.unit_with(given)},
                    )
                return number
        return super()._number(text, info)


#: SI units that the drive of a plant may have: a current, or a force or voltage of a system that has such a drive.
DRIVE_UNITS = ("A", "N", "V")
#: Type of a validation error: a quantity in the unit of another plant's drive.
OTHER_DRIVE = "other_drive"
#: Tuples: TOML only has arrays, which strict validation would reject for a tuple.
Array = Strict(False)
#: A number that may be infinite, e.g. a limit that is never reached.
Unlimited = Annotated[float, AllowInfNan(True)]

Metre = Annotated[float, In("m")]
Second = Annotated[float, In("s")]
#: The drive of a plant.
Drive = Annotated[float, InDrive("A")]
Newton = Annotated[float, In("N")]
Hertz = Annotated[float, In("Hz")]
RadianPerSecond = Annotated[float, In("rad/s")]
#: A crossover or bandwidth, which may also be written in Hz.
AngularFrequency = Annotated[float, In("rad/s", read=lambda text, unit: parse_angular_frequency(text))]
Radian = Annotated[float, In("rad")]


def _whole(value: Any) -> Any:
    if type(value) is not int:
        raise ValueError(f"schema = {_got(value)}; expected the whole number 1")
    return value


#: Version of a definition's format. Literal alone would accept true for 1.
Schema = Annotated[Literal[1], BeforeValidator(_whole)]

D = TypeVar("D", bound=Definition)


def drive_quantities(form: type[BaseModel], prefix: str = "") -> dict[str, InDrive]:
    """Dotted key -> quantity of the keys of a form, and of its tables, whose unit contains that of the drive."""
    found: dict[str, InDrive] = {}
    for name, field in form.model_fields.items():
        parts = [field.annotation, *typing.get_args(field.annotation)]
        for part in parts:
            if isinstance(part, type) and issubclass(part, BaseModel):
                found |= drive_quantities(part, f"{prefix}{name}.")
        marks = [*field.metadata, *(mark for part in parts for mark in getattr(part, "__metadata__", ()))]
        found |= {f"{prefix}{name}": mark for mark in marks if isinstance(mark, InDrive)}
    return found


def read_definition(path: Path, kind: type[D]) -> D:
    """Read and validate one definition. Raises InputError with file, key, value found and value expected."""
    return validate(read_toml(path), kind, str(path))


def validate(content: dict[str, Any], kind: type[D], where: str, context: dict[str, Any] | None = None) -> D:
    """Validate parsed TOML.

    where: name of the file, for messages. context: passed to the validators. Raises InputError as `read_definition`.
    """
    try:
        return kind.model_validate(content, context=context)
    except ValidationError as error:
        raise InputError(f"{where}: {_sentence(error, kind)}") from None


def merged(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A definition with changed keys; of a table only the named keys change. Tuples and arrays become lists."""
    found = {key: _plain(value) for key, value in content.items()}
    for key, value in changes.items():
        old = found.get(key)
        found[key] = merged(old, value) if isinstance(old, dict) and isinstance(value, Mapping) else _plain(value)
    return found


def _plain(value: Any) -> Any:
    """A value as TOML would give it."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()  # an array or number of numpy
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


#: Type of a pydantic error -> the expected type, in terms of TOML.
EXPECTED = {
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "a table"),
    **dict.fromkeys(("list_type", "tuple_type"), "an array"),
    "string_type": "a string",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "finite_number": "a finite number",
}


def _got(value: Any) -> str:
    """A value found, in terms of TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    return "a table" if isinstance(value, dict) else "an array" if isinstance(value, list) else shown(value)


def _name(part: int | str) -> str:
    """A key for a message, quoted if it is long or not printable."""
    text = str(part)
    return text if len(text) <= 60 and text.isprintable() else shown(text)


def _sentence(error: ValidationError, kind: type[BaseModel]) -> str:
    """The first mistake as one sentence. Unknown keys come first: a misspelt key often causes a missing one."""
    mistakes = sorted(error.errors(), key=lambda item: item["type"] != "extra_forbidden")
    first = mistakes[0]
    *tables, key = (_name(part) for part in first["loc"] or ("",))
    place = f"[{'.'.join(tables)}] {key}" if tables else key
    match first["type"]:
        case "extra_forbidden":
            sentence = f"{place}: unknown key; {choices(key, _fields(kind, first['loc'][:-1]))}"
        case "literal_error" if key == "[key]":
            *tables, key = tables
            known = re.findall(r"'(\w+)'", first["ctx"]["expected"])
            sentence = f"[{'.'.join(tables)}] {key}: unknown key; {choices(key, known)}"
        case _ if first["type"] == OTHER_DRIVE:
            sentence = f"{place} = {_got(first['input'])}, but {first['msg']}"
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
            expected = EXPECTED.get(first["type"])
            message = first["msg"].replace("Input should be greater", "expected a value greater")
            message = message.replace("Input should be less", "expected a value less")
            words = f"expected {expected}" if expected else f"{message[0].lower()}{message[1:]}"
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
