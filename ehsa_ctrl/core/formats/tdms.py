"""TDMS of LabVIEW and other National Instruments software, read with npTDMS."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..table import FileTime, LogTable, number_columns, table_of
from ._format import Format

#: Properties of a channel that hold its unit.
UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def _read(path: Path) -> list[LogTable]:
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    # npTDMS would print what is said in the note below.
    log_manager.set_level(logging.ERROR)
    file = TdmsFile.read(path)
    cut = file.file_status.incomplete_final_segment
    note = f"{path}: ends within a segment, as if it was cut or not closed: what is complete is read"
    tables = []
    for group in file.groups():
        together: dict[tuple[Any, ...], dict[str, Any]] = {}
        for channel in group.channels():
            if len(channel):
                together.setdefault(_clock(channel), {})[channel.name] = channel
        for clock, channels in together.items():
            columns: dict[str, np.ndarray] = {}
            for name, channel in channels.items():
                columns |= number_columns(name, channel[:])
            units = {name: _unit(channel) for name, channel in channels.items()}
            table = table_of(path, columns, units=units, group=group.name, time=_time(clock))
            tables.append(replace(table, notes=(note,) if cut else ()))
    if cut and not tables:
        raise InputError(f"{path}: ends within its first segment, as if it was cut: no sample of it can be read")
    return tables


def _clock(channel: Any) -> tuple[int, float, float, Any]:
    """Number of samples, increment and offset [s], and start of a channel, as LabVIEW's waveform properties say."""
    properties = channel.properties
    step = properties.get("wf_increment")
    start = properties.get("wf_start_time")
    # An increment of 0 and a start before 1970 are LabVIEW's values for "not set".
    begins = None if start is None or np.datetime64(start, "ns").astype(np.int64) <= 0 else np.datetime64(start, "ns")
    return len(channel), float(step or 0.0), float(properties.get("wf_start_offset") or 0.0), begins


def _time(clock: tuple[int, float, float, Any]) -> FileTime | None:
    count, step, offset, start = clock
    if not step > 0.0:
        return None
    begins = None if start is None else start.astype(np.int64) * 1e-9
    return FileTime(offset + step * np.arange(count), "wf_increment", step, begins)


def _unit(channel: Any) -> str:
    return next((str(channel.properties[key]) for key in UNITS if channel.properties.get(key)), "")


format = Format(
    name="TDMS",
    suffixes=(".tdms",),
    contents="all groups; time from `wf_increment` and `wf_start_time`, or a column; units from `unit_string`",
    read=_read,
    modules=("nptdms",),
    extra="tdms",
    magic=(b"TDSm",),
)
