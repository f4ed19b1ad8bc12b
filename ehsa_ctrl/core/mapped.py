"""Where each channel stands in a table, and how many SI units one of its numbers is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import InputError, choices
from .log import CHANNELS, Column

if TYPE_CHECKING:
    from .table import Table

#: A scale of the plant's [log] may be a calibration too: it agrees with a unit within this factor.
AGREES = 2.0


def places_of(table: Table, mapped: Mapping[str, Column]) -> dict[str, Column]:
    """Where each channel stands in this file, those that don't left out."""
    for channel in mapped:
        if channel not in CHANNELS:
            raise InputError(f"[log] {channel}: is no channel; {choices(channel, CHANNELS)}")
    names = table.names
    own_format = not any(at.column in names for at in mapped.values())
    places = {}
    for channel in CHANNELS:
        at = Column(channel) if own_format else mapped.get(channel, Column(channel))
        if at.column in names:
            places[channel] = at
    return places


def scale_of(path: Path | str, channel: str, at: Column, table: Table) -> float:
    """SI units that are one of the column: as mapped, else as the file's row of units says.

    Raises InputError for a unit that does not fit the channel, and where mapping and unit contradict each other.
    """
    unit = table.units.get(at.column, "")
    if not unit:
        return at.scale
    from .likely import fitting

    si = CHANNELS[channel].unit
    own = fitting(unit, si)
    where = f"{path}: row {table.units_row} gives column {at.column!r} the unit {unit!r}"
    if own is None and at.scale == 1.0:
        raise InputError(
            f"{where}, which is not known as one of {channel}; write "
            f'{channel} = {{ column = "{at.column}", scale = ... '
            f"}} ({si} per unit of the column) under [log] in the plant's TOML, or begin the row with #"
        )
    if own is None:
        return at.scale
    if at.scale == 1.0:
        return own
    if not 1.0 / AGREES < abs(at.scale) / own < AGREES:
        raise InputError(
            f"{where}, which is {own:.7g} {si}, and the plant's [log] scales {channel} by {at.scale:.7g}; write "
            f"scale = {math.copysign(own, at.scale):.7g} there, or begin the row with # if the unit is wrong"
        )
    return at.scale


def suggested(table: Table, places: Mapping[str, Column], wanted: Sequence[str]) -> str:
    """Lines of [log] for channels that are wanted and not there, out of columns that nothing is read from."""
    missing = {channel: CHANNELS[channel].unit for channel in wanted if channel not in places and channel in CHANNELS}
    used = {at.column for at in places.values()}
    free = [name for name in table.names if name and name not in used]
    if not missing or not free:
        return ""
    from .likely import likely

    found = likely(free, missing)
    return ", ".join(found[channel].line(channel) for channel in missing if channel in found)
