"""A definition's form, key by key: what is set with its meaning beside it, what is not as a line switched off."""

from __future__ import annotations

import copy
import math
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from ...core.described import Key, keys, summary
from ...core.files import read_toml
from ...core.unit import factor

#: Lines of a template; in each a comment begins with "# " and what is switched off with "#" alone.
Lines = list[str]
WIDTH = 110
#: Tables of which a definition has one.
RIVALS = ("design", "tuning", "gains")

HOW = (
    "What begins with # and no space is switched off: take the # away to switch it on. What is wrong then, ehsa-ctrl "
    "check says, with file and key."
)
QUANTITIES = 'Quantities are texts with a unit, any that converts ("20 mm", "50 kN/m"); in brackets stands the SI unit.'


@dataclass(frozen=True)
class Annotator:
    """Writes definitions of one form.

    Attributes
    ----------
    form: of the whole file.
    given: content of the definition that it starts from, as tomlkit read it: texts of numbers and comments are kept.
    examples: dotted key -> value of other definitions, for what `given` leaves out.
    special: dotted key of a table whose keys are names -> its lines, from the table as it is set (None where not).
    context: what the form's validators may ask for.
    """

    form: type[BaseModel]
    given: Any
    examples: Mapping[str, Any]
    special: Mapping[str, Callable[[Any], Lines]] = field(default_factory=dict)
    context: Mapping[str, Any] | None = None

    def text(self, head: Sequence[str]) -> str:
        """The file under its head of comments: what is set, then the tables that are switched off."""
        on, off = self._set(self.form, self.given, "")
        lines = [*comment(*head, HOW), "", *on]
        if off:
            lines += ["", *comment("What else there can be, switched off:"), *off]
        return "\n".join(lines).rstrip() + "\n"

    def _set(self, form: type[BaseModel], given: Any, path: str) -> tuple[Lines, Lines]:
        """Lines of a table that is set, and of the tables within it that are not."""
        from tomlkit.items import InlineTable

        on: Lines = []
        off: Lines = []
        known = keys(form)
        for key in sorted(known, key=_order):
            at = f"{path}{key.name}"
            if key.forms or at in self.special:
                continue
            if key.name in given:
                item = given.item(key.name)
                on += line(key, f"{key.name} = {item.as_string()}", item.trivia.comment)
            else:
                shown = self._example(key, at)
                fits = shown is not None and self._fits(at, _value(shown))
                on += line(key, f"#{key.name} = {shown}") if fits else in_words(key, why=shown is not None)
        for key in known:
            at = f"{path}{key.name}"
            there = given.get(key.name)
            if isinstance(there, InlineTable):
                on += line(key, f"{key.name} = {there.as_string()}", there.trivia.comment)
            elif at in self.special:
                said = comment(upper(f"{meaning(key, left_out=False)}."))
                (off if there is None else on).extend(["", *said, *self.special[at](there)])
            elif key.forms and there is None:
                off += self._offered(key, at, self.given.unwrap())
            elif key.forms:
                for one in there if key.many else [there]:
                    form_ = form_of(key.forms, one)
                    heading = f"[[{at}]]" if key.many else f"[{at}]"
                    more_on, more_off = self._set(form_, one, f"{at}.")
                    if key.many and one is not there[0]:
                        # What the keys mean stands above the first one.
                        more_on = [text for text in more_on if not text.startswith("#")]
                        more_off = []
                    on += ["", *title(key, form_), heading, *more_on]
                    off += more_off
        return on, off

    def _offered(self, key: Key, at: str, content: dict[str, Any]) -> Lines:
        """Tables that are switched off, each with the keys that go with what is set."""
        lines: Lines = []
        content = dict(content)
        rivals = [name for name in RIVALS if name in content] if at in RIVALS else []
        for name in rivals:
            del content[name]
        for form in key.forms:
            found = self._candidate(form, at, content, many=key.many)
            if found is None:
                lines += ["", *in_words(key, f"[{at}]")]
                continue
            instead = f"Instead of [{rivals[0]}], whose lines then go: " if rivals else ""
            lines += ["", *title(key, form, instead), f"#[[{at}]]" if key.many else f"#[{at}]"]
            for inner in sorted(keys(form), key=_order):
                if inner.name in found:
                    lines += line(inner, f"#{inner.name} = {toml(found[inner.name])}")
                elif not inner.forms:
                    lines += in_words(inner, why=self._example(inner, f"{at}.{inner.name}") is not None)
            for inner in keys(form):
                if inner.forms:
                    lines += self._offered(inner, f"{at}.{inner.name}", _with(content, at, found, many=key.many))
        return lines

    def _candidate(
        self, form: type[BaseModel], at: str, content: dict[str, Any], *, many: bool
    ) -> dict[str, Any] | None:
        """A table with as many of its keys as go together and with the rest; None if it does not go at all."""
        plain = [(key, self._example(key, f"{at}.{key.name}")) for key in keys(form) if not key.forms]
        found = {key.name: _value(shown) for key, shown in plain if key.required and shown is not None}
        valid = self._valid(_with(content, at, found, many=many))
        for key, shown in plain:
            if key.required or shown is None:
                continue
            tried = found | {key.name: _value(shown)}
            fits = self._valid(_with(content, at, tried, many=many))
            if fits or not valid:
                found, valid = tried, fits
        return found if valid else None

    def _example(self, key: Key, at: str) -> str | None:
        """What a key that is not set might be, as TOML: as in another definition, or its default."""
        if key.name == "kind" and len(key.choices) == 1:
            return toml(key.choices[0])
        if at in self.examples:
            return toml(self.examples[at])
        if key.unit is not None:
            plain = isinstance(key.default, int | float) and math.isfinite(key.default)
            return toml(quantity(key.default, key.unit)) if plain else None
        if key.default is None:
            return toml(key.choices[0]) if key.choices else None
        return toml(key.default)

    def _fits(self, at: str, value: Any) -> bool:
        *tables, name = at.split(".")
        return self._valid(_with(self.given.unwrap(), ".".join(tables), {name: value}, many=False))

    def _valid(self, content: dict[str, Any]) -> bool:
        try:
            self.form.model_validate(content, context=dict(self.context or {}))
        except ValidationError:
            return False
        return True


def _with(content: dict[str, Any], at: str, table: Mapping[str, Any], *, many: bool) -> dict[str, Any]:
    """The content with these keys in the table `at`; of an array of tables, in the first one."""
    content = copy.deepcopy(content)
    place: Any = content
    *outer, last = at.split(".") if at else ["", ""]
    for name in (name for name in (*outer, last) if name):
        if name == last and many:
            place = place.setdefault(name, [{}])
        else:
            place = place.setdefault(name, {})
        place = place[0] if isinstance(place, list) else place
    place.update(table)
    return content


def _order(key: Key) -> bool:
    """What kind of table it is comes first."""
    return key.name not in ("schema", "kind")


def _value(text: str) -> Any:
    return tomllib.loads(f"value = {text}")["value"]


def line(key: Key, text: str, note: str = "") -> Lines:
    """A key with its meaning: behind it where there is room, above it where not; a note that it has stays behind it."""
    said = meaning(key)
    if note:
        return [*comment(f"{key.name}: {said}"), f"{text}  {note}"]
    short = "\n" not in text and len(text) + len(said) + 4 <= WIDTH
    return [f"{text}  # {said}"] if short else [*comment(f"{key.name}: {said}"), text]


def in_words(key: Key, name: str = "", *, why: bool = True) -> Lines:
    """A key or table in words alone, because there is no example of it, or (why) none that goes with what is set."""
    reason = "; not with what is set here" if why else ""
    return comment(f"{name or key.name}: {meaning(key, left_out=False)}{reason}")


def title(key: Key, form: type[BaseModel], before: str = "") -> Lines:
    """What stands above a table."""
    said = summary(form)
    words = (said.split("]: ", 1)[1] if "]: " in said else said).rstrip(".")
    others = [word for word in kinds(key.forms) if word not in kinds([form])] if len(key.forms) > 1 else []
    other = f" Other kinds: {', '.join(others)}." if others else ""
    return comment(f"{before}{upper(words)}.{other}")


def meaning(key: Key, *, left_out: bool = True) -> str:
    """A key in words: what it is, its unit, the words it may be, what it is where it is left out."""
    parts = [key.meaning or key.name.replace("_", " ")]
    if key.unit not in (None, "1"):
        parts[0] += f" [{key.unit}]"
    if len(key.choices) > 1:
        parts.append("one of " + ", ".join(key.choices))
    if left_out and not key.forms and "left out" not in key.meaning and "default" not in key.meaning:
        parts.append(_left_out(key))
    return "; ".join(part for part in parts if part)


def _left_out(key: Key) -> str:
    if key.required:
        return "must be given"
    if isinstance(key.default, int | float) and not isinstance(key.default, bool):
        if not math.isfinite(key.default):
            return "left out: no bound"
        return f"left out: {quantity(key.default, key.unit or '1')}"
    if isinstance(key.default, bool):
        return f"left out: {str(key.default).lower()}"
    return f"left out: {key.default}" if isinstance(key.default, str) and key.default else ""


def quantity(value: float, unit: str) -> str:
    """A number with its unit; angles in degrees, as a person writes them."""
    if unit == "rad":
        return f"{value / factor('deg', 'rad'):.4g} deg"
    return f"{value:.4g}" if unit == "1" else f"{value:.4g} {unit}"


def comment(*texts: str) -> Lines:
    """Texts as comments, each from a new line; what is indented is a command and is not broken."""
    lines: Lines = []
    for text in filter(None, texts):
        whole = text.startswith(" ")
        lines += [text] if whole else textwrap.wrap(text, WIDTH - 2, break_on_hyphens=False, break_long_words=False)
    return [f"# {line}" for line in lines]


def named(table: str, given: Any, rows: Iterable[tuple[str, str, str | None]]) -> Lines:
    """A table whose keys are names: those that are set, and the others switched off.

    rows: name, meaning, and what it might be as TOML; None where there is nothing to show unless it is set.
    """
    lines = [f"[{table}]" if given is not None else f"#[{table}]"]
    for name, said, example in rows:
        if given is not None and name in given:
            item = given.item(name)
            text, note = f"{name} = {item.as_string()}", item.trivia.comment
        elif example is not None:
            text, note = f"#{name} = {example}", ""
        else:
            continue
        short = not note and "\n" not in text and len(text) + len(said) + 4 <= WIDTH
        behind = f"  # {said}" if short else f"  {note}" if note else ""
        lines += [*([] if short else comment(f"{name}: {said}")), text + behind]
    return lines


def upper(text: str) -> str:
    """With a capital letter, if it begins with a plain word."""
    first = text.split(" ", 1)[0].rstrip(",:;")
    plain = first.isalpha() and first.islower() and (len(first) > 1 or first == "a")
    return text[:1].upper() + text[1:] if plain else text


def kinds(forms: Sequence[type[BaseModel]]) -> Iterator[str]:
    """The words that tell forms apart."""
    for form in forms:
        yield from next(key.choices for key in keys(form) if key.name == "kind")


def form_of(forms: Sequence[type[BaseModel]], given: Any) -> type[BaseModel]:
    """Which of several forms a table has."""
    if len(forms) == 1:
        return forms[0]
    return next(form for form in forms if given.get("kind") in kinds([form]))


def toml(value: Any) -> str:
    """A plain value as TOML, on one line."""
    import tomlkit

    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return tomlkit.item(value).as_string()


def examples_of(files: Iterable[Path]) -> dict[str, Any]:
    """Dotted key -> value in the first of these definitions that has it."""
    found: dict[str, Any] = {}
    for path in files:
        for key, value in leaves(read_toml(path)).items():
            found.setdefault(key, value)
    return found


def change(given: Any, values: Mapping[str, Any]) -> None:
    """Give dotted keys of a TOML document other values; a comment on the old value goes."""
    for key, value in values.items():
        *tables, name = key.split(".")
        place = given
        for table in tables:
            place = place.setdefault(table, {})
        place[name] = value
        place.item(name).trivia.comment = ""


def leaves(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted key -> value of a definition; of an array of tables the first one's."""
    found: dict[str, Any] = {}
    for name, item in content.items():
        key = f"{prefix}{name}"
        if isinstance(item, list) and item and isinstance(item[0], Mapping):
            item = item[0]
        if isinstance(item, Mapping):
            found |= leaves(item, f"{key}.")
        else:
            found[key] = item
    return found
