"""Detect the dialect of a CSV file: encoding, separator, decimal mark, comments, and a row of units.

csv.Sniffer guesses, and in a log a guess that is wrong by a factor of a thousand would go unnoticed. Here only what is
unambiguous is assumed, and reported in a note; a number that can be read in two ways is an error.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError
from .text import join_words

#: Separator as pandas takes it -> name in messages.
SEPARATORS = {",": "','", ";": "';'", "\t": "tabs", r"\s+": "blanks"}
#: Number of rows that determine the separator. Engineering judgement: enough to expose an ambiguous one.
SAMPLED = 30

_COMMENT = ("#", "%")
_NUMBER = {mark: rf"[-+]?(?:\d+{mark}\d*|{mark}\d+)(?:[eE][-+]?\d+)?" for mark in (",", r"\.")}
#: Thousands separators: two marks or more with three digits between them, as in 1.234.567 or 1.234,5.
_GROUPED = r"[-+]?\d{1,3}(?:[.,]\d{3})+[.,]\d+"
#: Ambiguous number: one mark that may be a decimal mark or a thousands separator, as in 1,234.
_EITHER = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")


@dataclass(frozen=True)
class Dialect:
    """Dialect and rows of one file.

    Attributes
    ----------
    names: column names of the header, including an empty one for a separator at the end of every row.
    units: column -> unit, from a row of units; empty without one. units_row: its number, 0 without one.
    separator, decimal: as pandas takes them.
    rows: the lines with data, including blank lines between them. numbers: line numbers of these rows, from 1.
    header_row: line number of the header.
    note: the assumptions, in a sentence; empty for a file in the package's own format.
    """

    names: tuple[str, ...]
    units: Mapping[str, str]
    units_row: int
    separator: str
    decimal: str
    rows: tuple[str, ...]
    numbers: tuple[int, ...]
    header_row: int
    note: str = ""

    def cells(self, index: int) -> list[str]:
        """The cells of one of `rows`."""
        return split(self.rows[index], self.separator)


def read_dialect(path: Path) -> Dialect:
    """Read a text file and detect its dialect.

    Raises InputError for a file without text or header row, and for an ambiguous one, with the remedy.
    """
    text, encoding = _decode(path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    comments = [i for i, line in enumerate(lines) if line.lstrip().startswith(_COMMENT)]
    # Spreadsheet programs write a first line sep=X; the other lines show the separator too.
    skipped = {*comments, *([0] if re.fullmatch(r"sep=.", lines[0] if lines else "") else [])}
    content = [i for i, line in enumerate(lines) if i not in skipped]
    head = next((i for i in content if lines[i].strip()), None)
    if head is None:
        raise InputError(f"{path}: is not a CSV table with a header row (row 1 is empty)")
    sample = [lines[i] for i in content if i > head and lines[i].strip()][:SAMPLED]
    commented = _commented_header(lines, comments, head, sample)
    header = commented or lines[head]
    separator = _separator(path, header, [lines[head], *sample] if commented else sample, head, lines)
    names = split(header, separator)
    if names and all(_is_number(name) for name in names):
        raise InputError(
            f"{path}: row {head + 1} contains numbers instead of column names; write a header row with the names above "
            "the numbers"
        )
    rows = [i for i in content if i >= (head if commented else head + 1)]
    units = _units(lines, rows, names, separator)
    units_row = rows.pop(0) + 1 if units else 0
    body = [lines[i] for i in rows]
    first = split(body[0], separator) if body else []
    if len(first) == len(names) + 1 and not first[-1]:
        names = [*names, ""]
    decimal = _decimal(path, body, rows, separator)
    dropped = len(comments) - bool(commented)
    notes = {
        f"{SEPARATORS[separator]} between columns": separator != "," or decimal != ".",
        f"decimal {'commas' if decimal == ',' else 'points'}": separator != "," or decimal != ".",
        "the last comment row as header": bool(commented),
        f"{encoding} text": bool(encoding),
        f"{dropped} comment row{'s' if dropped > 1 else ''} skipped": dropped > 0,
        f"row {units_row} as units": units_row > 0,
    }
    assumed = [note for note, applies in notes.items() if applies]
    return Dialect(
        names=tuple(names),
        units={name: unit for name, unit in zip(names, units, strict=False) if name and unit},
        units_row=units_row,
        separator=separator,
        decimal=decimal,
        rows=tuple(body),
        numbers=tuple(i + 1 for i in rows),
        header_row=(comments[-1] if commented else head) + 1,
        note=f"{path}: read with {join_words(assumed)}" if assumed else "",
    )


def split(line: str, separator: str) -> list[str]:
    """The cells of a line, without surrounding blanks."""
    if separator == r"\s+":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _decode(path: Path) -> tuple[str, str]:
    """The text, and the name of its encoding if that is not UTF-8."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    encodings = {"utf-8-sig": "", "cp1252": "Latin-1"}
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = {"utf-16": "UTF-16"}
    for encoding, name in encodings.items():
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not re.search(r"[\x00-\x08\x0e-\x1f\x7f]", text):
            return text, name
    raise InputError(f"{path}: is not a CSV table with a header row (it contains bytes that are not text)")


def _commented_header(lines: Sequence[str], comments: Sequence[int], head: int, sample: Sequence[str]) -> str:
    """The header if it is the last comment above the numbers, as numpy.savetxt writes it; else empty."""
    before = [i for i in comments if i < head]
    if not before:
        return ""
    header = re.sub(r"^\s*[#%]+\s*", "", lines[before[-1]])
    for separator in SEPARATORS:
        names, first = split(header, separator), split(lines[head], separator)
        if len(names) == len(first) > 1 and all(map(_is_any_number, first)) and not any(map(_is_number, names)):
            return header
    return ""


def _separator(path: Path, header: str, sample: Sequence[str], head: int, lines: Sequence[str]) -> str:
    """The only separator that splits the header and all rows alike."""
    widths = {sign: len(split(header, sign)) for sign in SEPARATORS}
    possible = [sign for sign in (",", ";", "\t") if widths[sign] > 1]
    fitting = [sign for sign in possible if all(_fits(row, sign, widths[sign]) for row in sample)]
    if len(fitting) == 1 and all(split(header, fitting[0])[:-1]):
        return fitting[0]
    possible = fitting or possible
    _refuse_title(path, head, header, lines)
    if len(possible) > 1:
        words = " or ".join(SEPARATORS[sign] for sign in possible)
        raise InputError(
            f"{path}: row {head + 1} can be split at {words}, and the rows below don't decide; save it with only one "
            "of them, or put the names in quotes"
        )
    if possible:
        return possible[0]
    blank = {len(row.split()) for row in sample}
    return r"\s+" if widths[r"\s+"] > 1 and blank == {widths[r"\s+"]} else ","


def _fits(row: str, separator: str, width: int) -> bool:
    """Whether a row has this many cells (or one more that is empty), and none of them a more likely separator."""
    cells = split(row, separator)
    stronger = {",": (";", "\t"), ";": ("\t",), "\t": (";",)}[separator]
    contained = any(sign in cell for cell in cells for sign in stronger)
    return not contained and (len(cells) == width or (len(cells) == width + 1 and not cells[-1]))


def _refuse_title(path: Path, head: int, header: str, lines: Sequence[str]) -> None:
    """Raise InputError if the header row follows other text, such as a title."""
    below = [i for i in range(head + 1, min(head + 1 + SAMPLED, len(lines) - 1)) if lines[i].strip()]
    for sign in (";", "\t", ","):
        named = sum(map(bool, split(header, sign)))
        for i in below:
            names, values = split(lines[i], sign), split(lines[i + 1], sign)
            if sum(map(bool, names)) <= max(named, 1) or len(values) != len(names):
                continue
            if not any(map(_is_number, names)) and _is_any_number(values[0]):
                raise InputError(
                    f"{path}: row {i + 1} looks like the header, but other text is above it; begin the rows above "
                    "with #, or remove them"
                )


def _units(lines: Sequence[str], rows: Sequence[int], names: Sequence[str], separator: str) -> list[str]:
    """The cells of a row of units below the header; empty if there is none.

    A row of units contains no number, but the row below it does.
    """
    first, second = (split(lines[i], separator) for i in rows[:2]) if len(rows) > 1 else ([], [])
    if len(first) not in (len(names), len(names) + 1) or not any(first):
        return []
    if any(map(_is_any_number, first)) or not any(map(_is_any_number, second)):
        return []
    bare = [re.sub(r"^[\[(<](.*)[\])>]$", r"\1", cell).strip() for cell in first]
    return ["" if unit in ("-", "--") else unit for unit in bare]


def _decimal(path: Path, body: Sequence[str], rows: Sequence[int], separator: str) -> str:
    """The decimal mark, point or comma. Raises InputError for both marks, and for ambiguous numbers."""
    text = "\n".join(body)
    if separator == "," and '"' not in text:
        return "."
    commas = _find_cells(text, _NUMBER[","], separator) if "," in text else []
    points = _find_cells(text, _NUMBER[r"\."], separator) if "." in text else []
    if separator == ",":
        return "," if commas and not points and not all(_EITHER.fullmatch(cell) for cell, _ in commas) else "."
    # The search over all cells of a large file is slow; the cheap test avoids it for most files.
    grouped = _find_cells(text, _GROUPED, separator) if re.search(r"[.,]\d{3}[.,]\d", text) else []
    if grouped:
        cell, at = grouped[0]
        raise InputError(f"{path}: row {rows[at] + 1}: {cell!r} has thousands separators; save it without them")
    if commas and points:
        (comma, i), (point, j) = commas[0], points[0]
        raise InputError(
            f"{path}: has {comma!r} with a decimal comma (row {rows[i] + 1}) and {point!r} with a decimal point (row "
            f"{rows[j] + 1}); save all numbers with the same mark"
        )
    marked = commas or points
    if marked and all(_EITHER.fullmatch(cell) for cell, _ in marked):
        cell, at = marked[0]
        raise InputError(
            f"{path}: row {rows[at] + 1}: {cell!r} may mean {cell.replace(',', '.')} or {re.sub('[.,]', '', cell)}, "
            "and no number in the file decides; save it with ',' between columns and decimal points"
        )
    return "," if commas else "."


def _find_cells(text: str, number: str, separator: str) -> list[tuple[str, int]]:
    """The first cell of this form, and the first unambiguous one (or else the last), with their row indices."""
    between = {"\t": r"\t", r"\s+": r"[ \t]"}.get(separator, re.escape(separator))
    # In a file with commas between columns, a number with a decimal comma must be in quotes.
    quote = '"' if (separator, number) == (",", _NUMBER[","]) else '"?'
    form = re.compile(rf"(?:^|(?<={between})) *{quote}({number}){quote} *(?={between}|$)", re.MULTILINE)
    found = []
    for match in form.finditer(text):
        found.append((match[1], match.start()))
        if not _EITHER.fullmatch(match[1]):
            break
    return [(cell, text.count("\n", 0, at)) for cell, at in (*found[:1], *found[-1:])]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _is_any_number(cell: str) -> bool:
    """Whether a cell is a number with a decimal point or comma."""
    return _is_number(cell.replace(",", "."))
