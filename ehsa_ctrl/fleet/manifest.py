"""Which rig a log is of, and when it was recorded."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from ..core.errors import InputError, choices
from ..core.formats import FORMATS
from ..core.text import join_words
from .store import in_a_store

#: The file of a folder that lists its logs, and its columns.
MANIFEST, FILE, DATE = "fleet.csv", "file", "date"
#: `by` for the name of a log's folder, and the column that a manifest has for the rig.
FOLDER, RIG = "folder", "rig"
#: A date in a file's name: 2026-03-01, 20260301, 2026_03_01, with a time behind it or without.
NAMED_DATE = re.compile(
    r"(?<!\d)(20\d\d)[-_]?(0[1-9]|1[0-2])[-_]?([0-2]\d|3[01])(?:[T _-]?([01]\d|2[0-3])[-_:h]?([0-5]\d))?"
)


#: Sources of a log's date, besides "manifest" and "name": its own time stamps, and the time at which it was written.
STAMPS, FILE_TIME = "stamps", "file time"


@dataclass(frozen=True)
class FleetLog:
    """A log of a fleet. date: of the recording, UTC if the source says no zone. dated: where the date comes from."""

    path: Path
    rig: str
    date: datetime
    dated: str

    def stamped(self, start: float | None) -> FleetLog:
        """With the date of its first sample [s since 1970]; as it is without one."""
        return self if start is None else replace(self, date=datetime.fromtimestamp(start, UTC), dated=STAMPS)


def find_logs(given: Sequence[str | Path], by: str = "") -> list[FleetLog]:
    """The logs of files, folders and manifests, by rig and date.

    A manifest is a CSV named fleet.csv with the columns `file` (relative to it), `date` (ISO 8601, may be left out) and
    the rig. In a folder with one, the manifest says which logs count; without one, all logs of the folder and of those
    in it count, without the files of a store, and a log's folder names its rig. Where nothing says the date, it is in
    the file's name, or else the time at which the file was last written, for which the log's own time stamps are put
    once it is read (`stamped`).

    Parameters
    ----------
    by: column of the manifest with the rig, "rig" by default, for which a folder without a manifest has its folders'
        names; "folder" for these names in any case.

    Raises InputError for a path that does not exist, a folder without logs, a wrong manifest, and a log given twice.
    """
    found: list[FleetLog] = []
    for path in map(Path, given):
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
        manifest = path / MANIFEST if path.is_dir() else path
        if manifest.name == MANIFEST and manifest.is_file() and by != FOLDER:
            found += _listed(manifest, by or RIG)
        elif by not in ("", FOLDER, RIG):
            raise InputError(
                f"--by {by}: {manifest if path.is_dir() else path.parent / MANIFEST} does not exist; write it with the "
                f"columns {FILE}, {by} and {DATE}, or leave --by out to take the folders' names"
            )
        elif path.is_dir():
            known = {suffix for one in FORMATS.values() for suffix in one.suffixes}
            files = sorted(p for p in path.rglob("*") if p.suffix.lower() in known and p.is_file())
            files = [p for p in files if p.name != MANIFEST and not any(part.startswith(".") for part in p.parts)]
            files = [p for p in files if not in_a_store(p)]
            if not files:
                raise InputError(f"{path}: contains no logs; expected files such as {path}/rig_1/2026-03-01.csv")
            found += [_of_folder(file) for file in files]
        else:
            found.append(_of_folder(path))
    seen: dict[Path, Path] = {}
    for log in found:
        place = log.path.resolve()
        if place in seen:
            raise InputError(f"{log.path}: is given twice; give it once")
        seen[place] = log.path
    if not found:
        raise InputError("no log given; expected files, folders with a folder for each rig, or a fleet.csv")
    return in_order(found)


def in_order(logs: Iterable[FleetLog]) -> list[FleetLog]:
    """Logs by rig and date."""
    return sorted(logs, key=lambda log: (log.rig, log.date, str(log.path)))


def _of_folder(path: Path) -> FleetLog:
    return FleetLog(path, path.absolute().parent.name, *_date_of(path))


def _date_of(path: Path) -> tuple[datetime, str]:
    matched = NAMED_DATE.search(path.name)
    if matched:
        year, month, day, hour, minute = (int(part or 0) for part in matched.groups())
        try:
            return datetime(year, month, day, hour, minute, tzinfo=UTC), "name"
        except ValueError:
            pass
    return datetime.fromtimestamp(int(path.stat().st_mtime), UTC), FILE_TIME


def _listed(manifest: Path, by: str) -> list[FleetLog]:
    import pandas

    try:
        table = pandas.read_csv(manifest, dtype=str, keep_default_na=False, skipinitialspace=True)
    except (OSError, ValueError) as error:
        raise InputError(f"{manifest}: can't be read as CSV ({' '.join(str(error).split())})") from None
    for column in (FILE, by):
        if column not in table:
            raise InputError(f"{manifest}: has no column {column!r}; {choices(column, table.columns)}")
    found, without = [], []
    for number, row in enumerate(table.to_dict("records"), 2):
        path = manifest.parent / row[FILE]
        if not row[FILE].strip() or not row[by].strip():
            raise InputError(f"{manifest}: row {number} has no {FILE if not row[FILE].strip() else by}; give one")
        if not path.is_file():
            without.append(str(row[FILE]))
            continue
        text = row.get(DATE, "").strip()
        if not text:
            found.append(FleetLog(path, row[by].strip(), *_date_of(path)))
            continue
        try:
            date = datetime.fromisoformat(text)
        except ValueError:
            raise InputError(
                f"{manifest}: row {number} has the date {text!r}; expected ISO 8601, as in 2026-03-01 or "
                "2026-03-01T14:30:00Z"
            ) from None
        found.append(FleetLog(path, row[by].strip(), date if date.tzinfo else date.replace(tzinfo=UTC), "manifest"))
    if without:
        raise InputError(
            f"{manifest}: lists {len(without)} files that do not exist, such as "
            f"{join_words(without[:2])}; paths are relative to the manifest"
        )
    if not found:
        raise InputError(f"{manifest}: lists no log")
    return found
