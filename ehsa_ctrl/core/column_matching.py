"""Match the columns of a log to channels.

The plant's [log] table and the units in the file decide. For columns that are left over, [log] lines are suggested
from their names; a suggestion is only shown to the user, never applied.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from .errors import InputError, choices
from .log import CHANNELS, Column
from .unit import factor, names_angle

if TYPE_CHECKING:
    from .table import LogTable

#: A scale in [log] agrees with the file's unit within this factor. Engineering judgement: it may include a calibration
#: factor, and the units of one quantity that logs use differ by more than 2.
AGREES = 2.0

#: Channel -> usual column names, in lower case, without blanks and punctuation.
NAMES = {
    "t": ("t", "time", "timestamp", "seconds", "zeit", "temps", "tempo"),
    "current": (
        "current", "i", "icmd", "iref", "iset", "icommand", "icommanded", "iq", "iqref", "isoll", "currentcommand",
        "currentcmd", "currentref", "motorcurrent", "strom", "motorstrom", "corrente",
    ),
    "current_measured": ("currentmeasured", "imeas", "imeasured", "iact", "iist", "currentactual"),
    "speed": (
        "speed", "omega", "w", "n", "motorspeed", "pumpspeed", "shaftspeed", "omegam", "nmot", "nmotor", "drehzahl",
        "velocita",
    ),
    "p1": ("p1", "pressure1", "pa", "pressurea", "druck1", "druckp1", "drucka", "pressurep1"),
    "p2": ("p2", "pressure2", "pb", "pressureb", "druck2", "druckp2", "druckb", "pressurep2"),
    "position": ("position", "x", "s", "pos", "stroke", "rodposition", "xrod", "weg", "hub", "posizione"),
    "velocity": ("velocity", "v", "rodvelocity", "vrod", "xdot", "geschwindigkeit"),
    "acceleration": ("acceleration", "a", "acc", "xddot", "beschleunigung"),
    "force": ("force", "f", "fext", "load", "loadcell", "externalforce", "kraft", "forza"),
    "drive_force": ("driveforce", "motorforce"),
}  # fmt: skip


def find_channels(
    path: Path | str, tables: Sequence[LogTable], mapped: Mapping[str, Column]
) -> list[tuple[LogTable, dict[str, Column]]]:
    """The tables with channels, each with channel -> column; of several tables only those with more than a time.

    Raises InputError for an unknown channel, and for a column that several tables have.
    """
    for channel in mapped:
        if channel not in CHANNELS:
            raise InputError(f"[log] {channel}: is not a channel; {choices(channel, CHANNELS)}")
    own_format = not any(table.find(at.column) for table in tables for at in mapped.values())
    places: list[dict[str, Column]] = [{} for _ in tables]
    for channel in CHANNELS:
        at = Column(channel) if own_format else mapped.get(channel, Column(channel))
        having = [(place, table.group, column) for place, table in zip(places, tables, strict=True)
                  if (column := table.find(at.column))]  # fmt: skip
        if channel != "t" and len(having) > 1:
            options = " or ".join(repr(f"{group}/{column}") for _, group, column in having[:5])
            raise InputError(
                f"{path}: has {len(having)} columns {at.column!r}; name one of them in the plant's [log], as in "
                f"{channel} = {{ column = ... }} with {options}"
            )
        for place, _, column in having:
            place[channel] = replace(at, column=column)
    found = [_with_time(table, place, tables, places) for table, place in zip(tables, places, strict=True)]
    return found if len(found) == 1 else [(table, place) for table, place in found if set(place) - {"t"}]


def _with_time(
    table: LogTable, place: dict[str, Column], tables: Sequence[LogTable], places: Sequence[dict[str, Column]]
) -> tuple[LogTable, dict[str, Column]]:
    """A table and its channels, with the time column of the only other table of as many rows if it has none."""
    if "t" in place or table.time is not None:
        return table, place
    others = [(other, at["t"]) for other, at in zip(tables, places, strict=True)
              if "t" in at and len(other) == len(table)]  # fmt: skip
    if len(others) != 1:
        return table, place
    other, at = others[0]
    return table.joined(other, at.column), {**place, "t": at}


def column_names(tables: Sequence[LogTable]) -> list[str]:
    """All columns of a file, with their group where several tables have the name."""
    times = Counter(name for table in tables for name in table.names)
    return [name if times[name] == 1 else f"{table.group}/{name}" for table in tables for name in table.names]


def channel_scale(path: Path | str, channel: str, at: Column, table: LogTable) -> float:
    """SI units per unit of the column: from the mapping, or else from the unit in the file.

    Raises InputError for a unit that does not fit the channel, and for a mapping that contradicts the unit.
    """
    unit = table.units.get(at.column, "")
    if not unit:
        return at.scale
    si = CHANNELS[channel].unit
    own = unit_scale(unit, si)
    source = f"row {table.units_row} gives" if table.units_row else "gives"
    where = f"{path}: {source} column {at.column!r} the unit {unit!r}"
    comment = ", or begin the row with #" if table.units_row else ""
    if own is None and at.scale == 1.0 and not at.scale_given:
        raise InputError(
            f"{where}, which is not a known unit of {channel}; write "
            f'{channel} = {{ column = "{at.column}", scale = ... '
            f"}} ({si} per unit of the column) under [log] in the plant's TOML{comment}"
        )
    if own is None:
        return at.scale
    if at.scale == 1.0:
        return own
    if not 1.0 / AGREES < abs(at.scale) / own < AGREES:
        raise InputError(
            f"{where}, which is {own:.7g} {si}, but the plant's [log] scales {channel} by {at.scale:.7g}; write "
            f"scale = {math.copysign(own, at.scale):.7g} there{comment and f'{comment} if the unit is wrong'}"
        )
    return at.scale


def suggest_mapping(
    tables: Sequence[LogTable], places: Sequence[tuple[LogTable, Mapping[str, Column]]], wanted: Sequence[str]
) -> str:
    """Suggested [log] lines that map unused columns to missing wanted channels; empty for none."""
    found = {channel for table, at in places for channel in (*at, *(("t",) if table.time else ()))}
    missing = {channel: CHANNELS[channel].unit for channel in wanted if channel not in found and channel in CHANNELS}
    used = {at.column for _, place in places for at in place.values()}
    names = Counter(name for table in tables for name in table.names)
    free = [name for name, times in names.items() if name and times == 1 and name not in used]
    if not missing or not free:
        return ""
    matches = match_columns(free, missing)
    return ", ".join(matches[channel].line(channel) for channel in missing if channel in matches)


class ColumnMatch(NamedTuple):
    """A column, the unit in its name (empty if none), and SI units per unit of the column."""

    column: str
    unit: str
    scale: float

    def line(self, channel: str) -> str:
        """Line of this mapping in a plant's [log]."""
        column = self.column.replace("\\", "\\\\").replace('"', '\\"')
        scale = f", scale = {self.scale:.7g}" if self.scale != 1.0 else ""
        return f'{channel} = {{ column = "{column}"{scale} }}'


def match_columns(columns: Iterable[str], channels: Mapping[str, str]) -> dict[str, ColumnMatch]:
    """For each channel (name -> SI unit) the column whose name and unit fit, if exactly one does."""
    found: dict[str, list[ColumnMatch]] = {}
    for column in columns:
        for channel, si in channels.items():
            fits = _fit(column, channel, si)
            if fits is not None:
                found.setdefault(channel, []).append(fits)
    once = {channel: fits[0] for channel, fits in found.items() if len(fits) == 1}
    used = [fit.column for fit in once.values()]
    return {channel: fit for channel, fit in once.items() if used.count(fit.column) == 1}


def _fit(column: str, channel: str, si: str) -> ColumnMatch | None:
    """Match of a column to a channel; None if its name or unit does not fit."""
    for name, unit in _split_name(column):
        if re.sub(r"[^a-z0-9]", "", name.lower()) not in (*NAMES.get(channel, ()), channel.replace("_", "")):
            continue
        if not unit:
            return ColumnMatch(column, "", 1.0)
        scale = unit_scale(unit, si)
        if scale is not None:
            return ColumnMatch(column, unit, scale)
    return None


def _split_name(column: str) -> list[tuple[str, str]]:
    """Possible splits of a column's name, such as "I [A]", "n_rpm" or "p1 / bar", into name and unit."""
    inside = re.fullmatch(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*", column)
    if inside:
        return [(inside[1], inside[2].strip())]
    last = re.fullmatch(r"(.+?)(?:\s+in\s+|\s*/\s*|[\s_.]+)([^\s_]+)", column)
    return [(column, ""), *([(last[1], last[2])] if last else [])]


def unit_scale(unit: str, si: str) -> float | None:
    """Size of one `unit` in `si`; None if it is unknown, does not fit, or may mean turns or radians, as 1/min."""
    try:
        scale = factor(unit, si)
    except InputError:
        return None
    return None if "rad" in si and not names_angle(unit) else scale
