"""File formats of logs, one per file; adding a file adds the format everywhere.

A reader returns tables of channels with the names, units and times of the file. What follows is common to all formats:
`core/log_reader.py` maps columns to channels, converts and checks them.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from pathlib import Path

from ..errors import InputError, reason
from ..registry import members
from ..table import LogTable
from ._format import Format

FORMATS: dict[str, Format] = members(sys.modules[__name__], "format")

#: Bytes at the beginning of a file that show its format.
HEAD = 4096


def read_tables(path: Path) -> tuple[LogTable, ...]:
    """Read the tables of a file; its first bytes decide the format, else its ending, else it is CSV.

    Raises
    ------
    InputError: no such file, a folder that is no ROS 2 bag, a missing library, not a file of this format or a damaged
        one, no numbers in it, or two columns of one name in a table.
    """
    chosen = format_of(path)
    chosen.require(path)
    if chosen.magic and not chosen.fits(path, _head(path)):
        raise InputError(f"{path}: is not a valid {chosen.name} file (it does not begin like one)")
    try:
        # Libraries warn of deviations that don't matter here, such as an unusual version of the format.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tables = tuple(table for table in chosen.read(path) if table.frame.shape[1])
    except (InputError, MemoryError):
        raise
    except Exception as error:  # a parser of a damaged file raises whatever it runs into
        raise InputError(f"{path}: is not a valid {chosen.name} file ({reason(error)})") from None
    if not tables:
        raise InputError(f"{path}: contains no channel of numbers")
    for table in tables:
        twice = [name for name, times in Counter(table.names).items() if times > 1]
        if twice:
            where = f" in {table.group!r}" if table.group else ""
            raise InputError(f"{path}: has more than one column {min(twice)!r}{where}; rename all but one")
    return tables


def read_table(path: Path) -> LogTable:
    """Read a file that holds one table. Raises InputError as `read_tables`, and for several tables."""
    tables = read_tables(path)
    if len(tables) > 1:
        groups = ", ".join(repr(table.group) for table in tables[:10])
        raise InputError(f"{path}: has {len(tables)} tables ({groups}); expected one")
    return tables[0]


def format_of(path: Path) -> Format:
    """The format of a file. Raises InputError for a file that can't be opened, and for a folder without a bag."""
    try:
        folder = path.is_dir()
        path.stat()
        head = b"" if folder else _head(path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: is not a file name") from None
    for each in FORMATS.values():
        if each.fits(path, head):
            return each
    if folder:
        raise InputError(f"{path}: is a folder; give the file of one log")
    suffix = path.suffix.lower()
    return next((each for each in FORMATS.values() if suffix in each.suffixes), FORMATS["CSV"])


def _head(path: Path) -> bytes:
    if path.is_dir():
        return b""
    with path.open("rb") as file:
        return file.read(HEAD)


__all__ = ["FORMATS", "Format", "format_of", "read_table", "read_tables"]
