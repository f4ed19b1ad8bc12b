"""How a CSV is written: its encoding, what separates columns, points or commas, comments, and a row of units.

Only what a file leaves no doubt of is assumed, and what was assumed is said; a number that can be read in two ways is
refused, because a wrong scale that nobody sees is worse than a file that has to be saved again.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError
from .text import join_words

#: Separators by pandas' word for them -> what a sentence calls them.
SEPARATORS = {",": "','", ";": "';'", "\t": "tabs", r"\s+": "blanks"}
#: Rows that decide what separates columns.
SAMPLED = 30

_COMMENT = ("#", "%")
_EXPONENT = r"(?:[eE][-+]?\d+)?"
_COMMA = rf"[-+]?(?:\d+,\d*|,\d+){_EXPONENT}"
_POINT = rf"[-+]?(?:\d+\.\d*|\.\d+){_EXPONENT}"
#: Two marks or more, three digits between them: 1.234.567 or 1.234,5.
_GROUPED = r"[-+]?\d{1,3}(?:[.,]\d{3})+[.,]\d+"
#: One mark that may as well stand between thousands: 1,234.
_EITHER = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")


@dataclass(frozen=True)
class Dialect:
    """How one file is written.

    Attributes
    ----------
    names: of the columns, as the header has them; a nameless one at the end of every row included.
    units: of the columns, as a row of units has them, "" where it says none; empty without such a row.
    units_row: number of that row, 0 without one.
    separator, decimal: as pandas wants them.
    rows: the lines that hold data, blank ones among them included, those at the end not.
    numbers: of these lines in the file; the first line is 1.
    header_row: number of the header's.
    note: what was assumed, in words; empty for a file in the tool's own form.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
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
    """Read a text file and tell how it is written.

    Raises
    ------
    InputError: no text, no header row, or a form that can be taken in two ways; one sentence that says what to do.
    """
    text, encoding = _decoded(path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    comments = [i for i, line in enumerate(lines) if line.lstrip().startswith(_COMMENT)]
    # Spreadsheets are told by a first line sep=; what the rest says by itself.
    skipped = {*comments, *([0] if re.fullmatch(r"sep=.", lines[0] if lines else "") else [])}
    content = [i for i, line in enumerate(lines) if i not in skipped]
    filled = (i for i in content if lines[i].strip())
    head = next(filled, None)
    if head is None:
        raise InputError(f"{path}: is no CSV table with a header row (row 1 is empty)")
    said = []
    sample = [lines[i] for i in content if i > head and lines[i].strip()][:SAMPLED]
    commented = _commented_header(lines, comments, head, sample)
    if commented:
        header, first = commented, head
        said.append("the last comment row as header")
    else:
        header, first = lines[head], head + 1
    separator = _separator(path, header, [lines[head], *sample] if commented else sample, head, lines)
    names = split(header, separator)
    if names and all(_is_number(name) for name in names):
        raise InputError(
            f"{path}: row {head + 1} holds numbers and no names of columns; expected a CSV table with a header row: "
            "write the names above the numbers"
        )
    rows = [i for i in content if i >= first]
    units, units_row = _units(lines, rows, names, separator)
    if units:
        rows = rows[1:]
    body = [lines[i] for i in rows]
    if body:
        width = len(split(body[0], separator))
        if width == len(names) + 1 and not split(body[0], separator)[-1]:
            names = [*names, ""]
    decimal = _decimal(path, body, rows, separator)
    if separator != "," or decimal != ".":
        said = [
            f"{SEPARATORS[separator]} between columns",
            f"decimal {'commas' if decimal == ',' else 'points'}",
            *said,
        ]
    if encoding:
        said.append(f"{encoding} text")
    dropped = len(comments) - bool(commented)
    if dropped:
        said.append(f"{dropped} comment row{'s' if dropped > 1 else ''} left out")
    if units:
        said.append(f"row {units_row} as units")
    return Dialect(
        names=tuple(names),
        units=tuple(units),
        units_row=units_row,
        separator=separator,
        decimal=decimal,
        rows=tuple(body),
        numbers=tuple(i + 1 for i in rows),
        header_row=(comments[-1] if commented else head) + 1,
        note=f"{path}: read with {join_words(said)}" if said else "",
    )


def split(line: str, separator: str) -> list[str]:
    """The cells of a line, without the blanks around them."""
    if separator == r"\s+":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _decoded(path: Path) -> tuple[str, str]:
    """The text, and the name of its encoding where that is not UTF-8."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    tries = [("utf-8-sig", ""), ("cp1252", "Latin-1")]
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        tries = [("utf-16", "UTF-16")]
    for encoding, word in tries:
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not re.search(r"[\x00-\x08\x0e-\x1f\x7f]", text):
            return text, word
    raise InputError(f"{path}: is no CSV table with a header row (it holds bytes that are no text)")


def _commented_header(lines: Sequence[str], comments: Sequence[int], head: int, sample: Sequence[str]) -> str:
    """The header where it is the last comment before rows of numbers, as numpy.savetxt writes it; else empty."""
    before = [i for i in comments if i < head]
    if not before:
        return ""
    header = re.sub(r"^\s*[#%]+\s*", "", lines[before[-1]])
    for separator in SEPARATORS:
        names, first = split(header, separator), split(lines[head], separator)
        plain = all(_is_number(cell.replace(",", ".")) for cell in first)
        if len(names) == len(first) > 1 and plain and not any(_is_number(name) for name in names):
            return header
    return ""


def _separator(path: Path, header: str, sample: Sequence[str], head: int, lines: Sequence[str]) -> str:
    """The one separator that splits the header and all rows alike."""
    widths = {sign: len(split(header, sign)) for sign in SEPARATORS}
    fitting = [
        sign
        for sign, width in widths.items()
        if width > 1 and sign != r"\s+" and all(_fits(row, sign, width) for row in sample)
    ]
    if len(fitting) == 1 and all(split(header, fitting[0])[:-1]):
        return fitting[0]
    possible = fitting or [sign for sign in (",", ";", "\t") if widths[sign] > 1]
    _refuse_title(path, head, header, lines)
    if len(possible) > 1:
        words = " or ".join(SEPARATORS[sign] for sign in possible)
        raise InputError(
            f"{path}: row {head + 1} can be split at {words}, and the rows below don't tell which; save it with one of "
            "them alone, or names in quotes"
        )
    if possible:
        return possible[0]
    blank = [split(row, r"\s+") for row in sample]
    if widths[r"\s+"] > 1 and blank and all(len(row) == widths[r"\s+"] for row in blank):
        return r"\s+"
    return ","


def _fits(row: str, separator: str, width: int) -> bool:
    """Whether a row has that many cells, one more if that is empty, and no stronger separator is left in them."""
    cells = split(row, separator)
    stronger = {",": (";", "\t"), ";": ("\t",), "\t": (";",)}[separator]
    left = any(sign in cell for cell in cells for sign in stronger)
    return not left and (len(cells) == width or (len(cells) == width + 1 and not cells[-1]))


def _refuse_title(path: Path, head: int, header: str, lines: Sequence[str]) -> None:
    """Raise InputError where a row of names comes only after other text."""
    below = [i for i in range(head + 1, min(head + 1 + SAMPLED, len(lines) - 1)) if lines[i].strip()]
    for sign in (";", "\t", ","):
        named = sum(map(bool, split(header, sign)))
        for i in below:
            names, values = split(lines[i], sign), split(lines[i + 1], sign)
            if sum(map(bool, names)) <= max(named, 1) or len(values) != len(names):
                continue
            if not any(_is_number(name) for name in names) and _is_number(values[0].replace(",", ".")):
                raise InputError(
                    f"{path}: row {i + 1} looks like its header, with other text above; begin the rows above it "
                    "with #, or remove them"
                )


def _units(lines: Sequence[str], rows: Sequence[int], names: Sequence[str], separator: str) -> tuple[list[str], int]:
    """The cells of a row of units below the header and its number; empty where the first row holds numbers."""
    if not rows:
        return [], 0
    cells = split(lines[rows[0]], separator)
    if not any(cells) or any(_is_number(cell.replace(",", ".")) for cell in cells):
        return [], 0
    if len(cells) not in (len(names), len(names) + 1) or len(rows) < 2:
        return [], 0
    # Text in every row is no row of units; what is wrong with it is said where its numbers are asked for.
    if not any(_is_number(cell.replace(",", ".")) for cell in split(lines[rows[1]], separator)):
        return [], 0
    bare = [re.sub(r"^[\[(<](.*)[\])>]$", r"\1", cell).strip() for cell in cells]
    return ["" if unit in ("-", "--") else unit for unit in bare], rows[0] + 1


def _decimal(path: Path, body: Sequence[str], rows: Sequence[int], separator: str) -> str:
    """Point or comma. Raises InputError where numbers are written in both ways, or can be read in two."""
    text = "\n".join(body)
    if separator == "," and '"' not in text:
        return "."
    commas, points = _cells(text, _COMMA, separator, quoted=separator == ","), _cells(text, _POINT, separator)
    if separator == ",":
        return "," if commas and not points and not all(_EITHER.fullmatch(cell) for cell, _ in commas) else "."
    # Looking through a large file cell by cell takes long: only where there may be one.
    grouped = _cells(text, _GROUPED, separator) if re.search(r"[.,]\d{3}[.,]\d", text) else []
    if grouped:
        cell, at = grouped[0]
        raise InputError(f"{path}: row {rows[at] + 1}: {cell!r} has marks between its thousands; save it without them")
    if commas and points:
        (comma, i), (point, j) = commas[0], points[0]
        raise InputError(
            f"{path}: writes {comma!r} with a comma (row {rows[i] + 1}) and {point!r} with a point (row "
            f"{rows[j] + 1}); save it with one of them in all numbers"
        )
    marked = commas or points
    if marked and all(_EITHER.fullmatch(cell) for cell, _ in marked):
        cell, at = marked[0]
        raise InputError(
            f"{path}: row {rows[at] + 1}: {cell!r} is {cell.replace(',', '.')} or {re.sub('[.,]', '', cell)}, and no "
            "number in the file tells which; save it with ',' between columns and points for decimals"
        )
    return "," if commas else "."


def _cells(text: str, number: str, separator: str, *, quoted: bool = False) -> list[tuple[str, int]]:
    """The first cells of this form and the last, with their lines counted from 0; a few, and one that is certain."""
    if not any(mark in text for mark in (",." if number == _GROUPED else "," if number == _COMMA else ".")):
        return []
    between = {"\t": r"\t", r"\s+": r"[ \t]"}.get(separator, re.escape(separator))
    quote = '"' if quoted else '"?'
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
