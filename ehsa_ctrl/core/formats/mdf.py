"""MDF (ASAM MDF 4, and the older MDF 3) of measurement and calibration tools, read with asammdf."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..table import FileTime, LogTable, number_columns, table_of
from ._format import Format


def _read(path: Path) -> list[LogTable]:
    from asammdf import MDF

    tables = []
    try:
        opened = MDF(path)
    except Exception as error:
        _close(error)
        raise
    with opened as file:
        groups: Any = file.groups
        for number, group in enumerate(groups):
            master = file.masters_db.get(number)
            if master is None:
                continue
            time = np.asarray(file.get_master(number), dtype=float)
            columns: dict[str, np.ndarray] = {}
            units: dict[str, str] = {}
            for index, channel in enumerate(group.channels):
                if index == master or channel.name in columns:
                    continue
                # Invalid samples stay in place: without them channels of a group would have different lengths.
                signal = file.get(group=number, index=index, ignore_invalidation_bits=True)
                found = number_columns(channel.name, signal.samples)
                if signal.invalidation_bits is not None:
                    invalid = np.asarray(signal.invalidation_bits, dtype=bool)
                    found = {name: np.where(invalid, np.nan, values) for name, values in found.items()}
                columns |= found
                units |= dict.fromkeys(found, signal.unit or "")
            name = group.channel_group.acq_name if file.version >= "4.00" else ""
            source = f"master channel {group.channels[master].name!r}"
            tables.append(
                table_of(path, columns, units=units, group=name or f"group {number}", time=FileTime(time, source))
            )
    return tables


def _close(error: Exception) -> None:
    """Close what asammdf opened for a damaged file: it would fail once more, and print it, when it is deleted."""
    frame = error.__traceback__
    while frame is not None:
        opened: Any = frame.tb_frame.f_locals.get("self")
        if hasattr(opened, "_closed"):
            opened._closed = True
            if getattr(opened, "_tempfile", None) is not None:
                opened._tempfile.close()
        frame = frame.tb_next


format = Format(
    name="MDF",
    suffixes=(".mf4", ".mdf"),
    contents="all channel groups of numbers, after conversion; time from the master channel; units",
    read=_read,
    modules=("asammdf",),
    extra="mdf",
    magic=(b"MDF ", b"UnFinMF "),
)
