"""The store of a fleet: one Parquet part per log, keyed by what it depends on.

    STORE/fleet-store.json       plant and version
    STORE/scores/ab/KEY.parquet  score and information of one log; KEY = hash of log, plant and code
    STORE/tables/*.parquet       logs, estimates, rigs, parameters, drifts: what queries read

A part is written completely or not at all, and never changes. Whatever interrupts the computation, the parts that exist
need not be computed again. A changed log, plant or version of the code has another key.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.files import atomic_write, read_json, write_text
from ..plant.plant import Plant
from .query import EXTRA, TABLES, query_store
from .score import LogScore

if TYPE_CHECKING:
    import pandas

#: Names of files and folders in a store; the tables are in TABLES.
HEAD, PARTS, DIAGNOSES = "fleet-store.json", "scores", "diagnoses"
#: What a store has beside them that could be taken for logs.
RESULT_TABLES = ("rigs.csv", "parameters.csv", "drifts.csv")
#: Rows of a table that are in memory at once.
ROWS = 20_000
#: Folders of the package on which a score depends.
CODE = ("core", "physics", "plant", "simulation", "identification", "diagnosis")


class Store:
    """A store of one plant's fleet.

    Parameters
    ----------
    folder: need not exist. plant: the nominal plant; None to read only.

    Raises InputError for a folder that is no store or holds another plant's logs.
    """

    def __init__(self, folder: str | Path, plant: Plant | None = None) -> None:
        self.folder = Path(folder)
        head = self.folder / HEAD
        self._digest = "" if plant is None else plant_digest(plant)
        if head.exists():
            known = read_json(head)
            if not isinstance(known, dict) or not {"plant", "digest"} <= set(known):
                raise InputError(f"{head}: is not the head of a store; give another folder")
            self.plant = str(known["plant"])
            if plant is not None and known["digest"] != self._digest:
                what = "with other values" if plant.name == self.plant else f"of {self.plant}, not {plant.name}"
                raise InputError(
                    f"{self.folder}: holds the fleet of a plant {what}; give another folder with --out, or the plant "
                    "that it was begun with"
                )
        elif plant is None:
            raise InputError(f"{self.folder}: is not the store of a fleet; expected a folder with {HEAD}")
        else:
            self.plant = plant.name

    def begin(self) -> None:
        """Create the folder with its head. Raises InputError if it can't be written."""
        if not (self.folder / HEAD).exists():
            content = {"plant": self.plant, "digest": self._digest}
            write_text(self.folder / HEAD, json.dumps(content, indent=1) + "\n")

    def key(self, path: Path) -> str:
        """Key of a log's part. Raises InputError for a file that can't be read."""
        found = hashlib.sha256(f"{self._digest} {code_digest()} ".encode())
        try:
            with path.open("rb") as file:
                while piece := file.read(1 << 20):
                    found.update(piece)
        except OSError as error:
            raise InputError(f"{path}: can't be read ({error.strerror})") from None
        return found.hexdigest()[:32]

    def part(self, key: str) -> Path:
        """File of a part."""
        return self.folder / PARTS / key[:2] / f"{key}.parquet"

    def put(self, key: str, score: LogScore) -> None:
        """Write a part. Raises InputError if it can't be written, e.g. on a full disk."""
        pyarrow = _pyarrow()
        upper = score.information[np.triu_indices(len(score.names))].astype(np.float32)
        row = {
            "names": list(score.names), "nominal": score.nominal, "scale": score.scale.tolist(),
            "score": score.score.tolist(), "information": upper.tobytes(), "dispersion": score.dispersion,
            "causes": json.dumps({cause: list(names) for cause, names in score.causes.items()}), "rms": list(score.rms),
            "start": score.start,
        }  # fmt: skip
        table = pyarrow.Table.from_pylist([row])
        self._write(self.part(key), table.schema, [table])

    def get(self, key: str) -> LogScore:
        """Read a part. Raises InputError for one that can't be read."""
        from pyarrow import ArrowException, parquet

        path = self.part(key)
        try:
            (row,) = parquet.ParquetFile(path).read(use_threads=False).to_pylist()
            k = len(row["names"])
            matrix = np.zeros((k, k))
            matrix[np.triu_indices(k)] = np.frombuffer(row["information"], dtype=np.float32)
            return LogScore(
                tuple(row["names"]), int(row["nominal"]), np.array(row["scale"]), np.array(row["score"]),
                matrix + np.triu(matrix, 1).T, float(row["dispersion"]),
                {cause: tuple(names) for cause, names in json.loads(row["causes"]).items()}, tuple(row["rms"]),
                row["start"],
            )  # fmt: skip
        except (ArrowException, OSError, ValueError, LookupError, TypeError) as error:
            words = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(
                f"{path}: is damaged ({words}); delete this file, and the same command computes it again"
            ) from None

    def put_table(self, name: str, rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> None:
        """Write a table for queries. columns: name -> Arrow type. Raises InputError if it can't be written."""
        pyarrow = _pyarrow()
        schema = pyarrow.schema([(column, pyarrow.type_for_alias(kind)) for column, kind in columns.items()])
        path, left = self.folder / TABLES / f"{name}.parquet", iter(rows)
        parts = (pyarrow.Table.from_pylist(part, schema=schema) for part in iter(lambda: list(islice(left, ROWS)), []))
        self._write(path, schema, parts)

    def query(self, text: str) -> pandas.DataFrame:
        """As `query_store`."""
        return query_store(self.folder, text)

    @staticmethod
    def _write(path: Path, schema: Any, tables: Iterable[Any]) -> None:
        from pyarrow import ArrowException, parquet

        try:
            with atomic_write(path) as draft, parquet.ParquetWriter(draft, schema, compression="zstd") as writer:
                for table in tables:
                    writer.write_table(table)
        except ArrowException as error:
            raise InputError(f"{path}: can't be written ({error})") from None


def in_a_store(path: Path) -> bool:
    """Whether a file belongs to a store, and so is no log; logs that a user keeps in the same folder do not."""
    own = {PARTS, TABLES, DIAGNOSES, *RESULT_TABLES}
    return any(path.relative_to(p).parts[0] in own and (p / HEAD).is_file() for p in path.parents)


def plant_digest(plant: Plant) -> str:
    """Hash of everything of a plant that a score depends on."""
    sensors = {name: repr(s) for name, s in plant.sensors.items()}
    columns = {name: (c.column, c.scale, c.offset) for name, c in plant.log.items()}
    parts = [plant.model, repr(plant.structure), plant.values, sensors, columns, plant.sample_time]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:16]


@cache
def code_digest() -> str:
    """Hash of the source on which a score depends."""
    package = Path(__file__).parent.parent
    files = [file for folder in CODE for file in sorted((package / folder).rglob("*.py"))]
    found = hashlib.sha256()
    for file in [*files, Path(__file__).parent / "score.py"]:
        found.update(file.relative_to(package).as_posix().encode() + file.read_bytes())
    return found.hexdigest()[:16]


def _pyarrow() -> ModuleType:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(f"the store of a fleet needs pyarrow; install it with {EXTRA}") from None
    return pyarrow
