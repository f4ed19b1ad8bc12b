"""Fill the shipped templates of `ehsa-ctrl new` with the values of an existing definition.

A template (cli/templates/*.toml) has one key per line, `key = value  # meaning`, below the header of its table. Keys
that the definition sets get its values, the others are switched off by a leading #.
"""

from __future__ import annotations

import re
import textwrap
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import BaseModel

FOLDER = Path(__file__).parent / "templates"
#: Characters in a line.
WIDTH = 118
ROW = re.compile(r"#?([\w.]+) = (.+?)(?:  # (.*))?")
HEADER = re.compile(r"#?(\[+[\w.]+\]+)")
HOW = (
    "A line that begins with # and no space is switched off: remove the # to switch it on. `ehsa-ctrl check` names "
    "the file and key of a mistake."
)


@dataclass(frozen=True)
class KeyLine:
    """A key of a template: its value as TOML, None where there is no example, and its meaning."""

    key: str
    value: str | None
    meaning: str = ""


@dataclass
class TableLines:
    """A table of a template: the comments above it, its header, and its rows and comment lines."""

    above: list[str]
    header: str
    rows: list[KeyLine | str]

    @property
    def name(self) -> str:
        return self.header.strip("[]")

    @property
    def many(self) -> bool:
        """Whether this is an element of an array of tables."""
        return self.header.startswith("[[")

    @property
    def kind(self) -> str | None:
        """Value of the key `kind`, by which one of several forms of a table is chosen."""
        rows = (row for row in self.rows if isinstance(row, KeyLine))
        return next((str(parse_value(row.value or "")) for row in rows if row.key == "kind"), None)


def template(*names: str) -> str:
    """Text of shipped templates, one after the other; empty if the first does not exist."""
    files = [FOLDER / f"{name}.toml" for name in names]
    return "".join(file.read_text(encoding="utf-8") for file in files) if files[0].exists() else ""


def form_template(form: type[BaseModel], *, required: bool = False) -> str:
    """A template with the keys of a form, for a kind of controller that has none; with `required` those alone.

    Each key has its meaning, unit and default; the example is the default, else a placeholder of the right type.
    """
    schema = form.model_json_schema()
    return "\n".join(_form_lines(schema, schema.get("$defs", {}), "", required)) + "\n"


def _form_lines(table: Mapping[str, Any], forms: Mapping[str, Any], path: str, required: bool) -> list[str]:
    """Lines of the keys of a table in a JSON schema, then of its tables."""
    lines: list[str] = []
    tables: list[str] = []
    for key, field in table["properties"].items():
        needed = key in table.get("required", ())
        if required and not needed:
            continue
        parts = [part for part in field.get("anyOf") or field.get("oneOf") or [field] if part.get("type") != "null"]
        if "$ref" in parts[0]:
            inner = forms[parts[0]["$ref"].rpartition("/")[2]]
            above = comment(field["description"]) if "description" in field else []
            tables += ["", *above, f"[{path}{key}]", *_form_lines(inner, forms, f"{path}{key}.", required)]
            continue
        unit, default = parts[0].get("unit", ""), field.get("default")
        value = _form_example(parts[0], default, unit)
        usual = "" if default in (None, "") else f"; default {value}".replace('"', "")
        words = "; required" if needed else usual
        meaning = f"{field.get('description', '')}{f' [{unit}]' if unit else ''}{words}"
        lines.append(f"{key} = {value}  # {meaning}")
    return lines + tables


def _form_example(part: Mapping[str, Any], default: Any, unit: str) -> str:
    """The default of a key as TOML, else a placeholder."""
    if unit:
        number = 1.0 if default is None else default
        return to_toml(f"{number:g} {unit}") if unit != "1" else to_toml(number)
    examples = {"string": "TEXT", "boolean": False, "integer": 1, "number": 1.0, "array": [], "object": {}}
    value = part.get("const", (part.get("enum") or [examples.get(part.get("type", ""), "TEXT")])[0])
    return to_toml(value if default is None else default)


def sections(text: str) -> list[TableLines]:
    """The tables of a template; the keys above the first table are a table without a header."""
    found = [TableLines([], "", [])]
    for line in text.splitlines():
        rows = found[-1].rows
        if header := HEADER.fullmatch(line):
            last = max((k for k, row in enumerate(rows, 1) if isinstance(row, KeyLine)), default=0)
            found.append(TableLines([row for row in rows[last:] if isinstance(row, str)], header[1], []))
            del rows[last:]
        else:
            row = ROW.fullmatch(line)
            rows.append(KeyLine(row[1], row[2], row[3] or "") if row else line)
    return found


def fill(
    text: str,
    given: Any,
    *,
    more: Mapping[str, Sequence[KeyLine | str]] | None = None,
    without: Collection[str] = (),
    example: Callable[[str, Any], Any] = lambda key, value: value,
) -> str:
    """Fill a template with the values of a definition.

    given: the definition as tomlkit parsed it, which keeps the notation of numbers and the comments behind values.
    more: table -> further rows, for tables whose keys depend on the plant.
    without: dotted keys and tables of the template that do not apply.
    example: (dotted key, example in the template) -> example for a key that is switched off.
    """
    lines: list[str] = []
    parts = [section for section in sections(text) if section.name not in without]
    names = {section.name for section in parts}
    done: set[tuple[str, str | None]] = set()
    for section in parts:
        tables = list(_tables(given, section.name))
        chosen = [table for table in tables if section.kind in (None, table.get("kind"))]
        if (section.name, section.kind) in done or (tables and not chosen and not section.many):
            # A repeated element of an array, or another kind of a table that is set.
            continue
        done.add((section.name, section.kind))
        prefix = f"{section.name}." if section.name else ""
        rows = [
            row
            for row in (*section.rows, *(more or {}).get(section.name, ()))
            if isinstance(row, str) or f"{prefix}{row.key}" not in without
        ]
        for k, table in enumerate(chosen or [{}]):
            first, entries = k == 0, _entries(table, prefix, names)
            lines += section.above if first else [""]
            if section.header:
                lines.append(section.header if chosen else f"#{section.header}")
            for row in rows:
                if isinstance(row, str):
                    lines += [row] if first else []
                elif row.key in entries:
                    item = entries.pop(row.key)
                    lines += _line(row.key, item.as_string(), row.meaning, item.trivia.comment)
                elif first and row.value is not None:
                    old = parse_value(row.value)
                    new = example(f"{prefix}{row.key}", old)
                    lines += _line(f"#{row.key}", row.value if new is old else to_toml(new), row.meaning)
            lines += [f"{key} = {item.as_string()}" for key, item in entries.items()]
    return "\n".join(lines).strip() + "\n"


def _tables(given: Any, name: str) -> Iterator[Any]:
    """The tables of a dotted name: one, several of an array, or none."""
    found = [given]
    for part in name.split(".") if name else ():
        inner = [table[part] for table in found if part in table]
        found = [table for one in inner for table in (one if isinstance(one, list) else [one])]
    yield from found


def _line(start: str, value: str, meaning: str, note: str = "") -> list[str]:
    """Lines of a key. Its meaning stands behind the value if it fits and the definition has no comment there."""
    text = f"{start} = {value}"
    if note or "\n" in text or len(text) + len(meaning) + 4 > WIDTH:
        above = comment(f"{start.lstrip('#')}: {meaning}") if meaning else []
        return [*above, f"{text}  {note}".rstrip()]
    return [f"{text}  # {meaning}" if meaning else text]


def _entries(table: Any, prefix: str, names: Collection[str]) -> dict[str, Any]:
    """Key -> item of a table. Leaves out inner tables that the template lists, and flattens others to dotted keys."""
    import tomlkit
    from tomlkit.items import InlineTable

    found: dict[str, Any] = {}
    for key, value in table.items():
        if any(f"{name}.".startswith(f"{prefix}{key}.") for name in names):
            continue
        if isinstance(value, Mapping) and not isinstance(value, InlineTable):
            found |= {f"{key}.{inner}": item for inner, item in _entries(value, f"{prefix}{key}.", names).items()}
        else:
            found[key] = table.item(key) if hasattr(table, "item") else tomlkit.item(value)
    return found


def comment(*texts: str) -> list[str]:
    """Texts as comment lines; one that begins with a space is not wrapped."""
    wrapped = (
        [text] if text.startswith(" ") else textwrap.wrap(text, WIDTH - 2, break_on_hyphens=False) for text in texts
    )
    return [f"# {line}" for lines in wrapped for line in lines]


def parse_value(text: str) -> Any:
    return tomllib.loads(f"value = {text}")["value"]


def to_toml(value: Any) -> str:
    import tomlkit

    return tomlkit.item(value).as_string()
