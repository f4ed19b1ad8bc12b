"""Which column of somebody else's log is probably which channel: the lines of a plant's [log] to begin with.

A suggestion to read and to check, never something that is done unasked.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from .errors import InputError
from .unit import factor, names_angle

#: Channel -> names that rigs give it, without blanks, marks and capitals.
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


class Likely(NamedTuple):
    """A column, the unit that its name says (empty where it says none), and how many SI units that is."""

    column: str
    unit: str
    scale: float

    def line(self, channel: str) -> str:
        """As it stands in a plant's [log]."""
        column = self.column.replace("\\", "\\\\").replace('"', '\\"')
        scale = f", scale = {self.scale:.7g}" if self.scale != 1.0 else ""
        return f'{channel} = {{ column = "{column}"{scale} }}'


def likely(columns: Iterable[str], channels: Mapping[str, str]) -> dict[str, Likely]:
    """The one column for each of these channels (name -> SI unit) whose name and unit fit it; none where two do."""
    found: dict[str, list[Likely]] = {}
    for column in columns:
        for channel, si in channels.items():
            fits = _fit(column, channel, si)
            if fits is not None:
                found.setdefault(channel, []).append(fits)
    once = {channel: fits[0] for channel, fits in found.items() if len(fits) == 1}
    used = [fit.column for fit in once.values()]
    return {channel: fit for channel, fit in once.items() if used.count(fit.column) == 1}


def _fit(column: str, channel: str, si: str) -> Likely | None:
    """A column as this channel, with its unit taken off the name; None where they don't go together."""
    for name, unit in _parted(column):
        if re.sub(r"[^a-z0-9]", "", name.lower()) not in (*NAMES.get(channel, ()), channel.replace("_", "")):
            continue
        if not unit:
            return Likely(column, "", 1.0)
        scale = fitting(unit, si)
        if scale is not None:
            return Likely(column, unit, scale)
    return None


def _parted(column: str) -> list[tuple[str, str]]:
    """A column's name taken apart into name and unit, in all ways that make sense: "I [A]", "n_rpm", "p1 / bar"."""
    inside = re.fullmatch(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*", column)
    if inside:
        return [(inside[1], inside[2].strip())]
    last = re.fullmatch(r"(.+?)(?:\s+in\s+|\s*/\s*|[\s_.]+)([^\s_]+)", column)
    return [(column, ""), *([(last[1], last[2])] if last else [])]


def fitting(unit: str, si: str) -> float | None:
    """How many `si` are one `unit`; None where it is unknown, does not fit, or may be turns or radians, as 1/min."""
    try:
        scale = factor(unit, si)
    except InputError:
        return None
    return None if "rad" in si and not names_angle(unit) else scale
