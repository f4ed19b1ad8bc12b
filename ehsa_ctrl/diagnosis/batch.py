"""Diagnoses of many logs of one rig. After an interruption, finished diagnoses are kept."""

from __future__ import annotations

import hashlib
import html
import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.checkpoint import open_checkpoint
from ..core.errors import EhsaError, InputError
from ..core.files import parse_json
from ..core.log import Log
from ..core.parallel import as_completed, worker_count
from ..core.result import Result, as_dict, as_table
from ..core.text import unique_names
from ..identification.plant_log import read_plant_log
from ..plant.plant import Plant
from ..simulation.trajectory import versions
from .diagnose import diagnose
from .diagnosis import NAMING, Diagnosis
from .prepared_logs import check_threshold

if TYPE_CHECKING:
    import pandas


#: Numeric fields of a row.
NUMBERS = ("probability", "gap_before", "gap_after", "seconds")


@dataclass(frozen=True)
class Row:
    """The diagnosis of one log as a row of a table.

    Attributes
    ----------
    file: path of the log.
    verdict: see `Diagnosis`; empty if the diagnosis failed.
    cause, probability: of the first cause. set: this cause and those that explain the log as well. causes: these
        sets of all causes.
    place: with the largest share of the gap.
    gap_before, gap_after: total gap on held-out data, of the nominal plant and with the law or else the causes.
    seconds: computing time. error: why the diagnosis failed. digest: hash of the log's content.
    """

    file: str
    verdict: str = ""
    cause: str = ""
    set: tuple[str, ...] = ()
    probability: float = math.nan
    place: str = ""
    gap_before: float = math.nan
    gap_after: float = math.nan
    seconds: float = 0.0
    error: str = ""
    digest: str = ""
    causes: tuple[tuple[str, ...], ...] = ()

    @property
    def cause_words(self) -> str:
        """All causes, each with those that explain the log as well."""
        return " + ".join(" or ".join(one) for one in self.causes or (self.set,))

    @classmethod
    def of(cls, file: str, found: Diagnosis, digest: str = "") -> Row:
        first = found.effects[0] if found.effects else None
        return cls(
            file=file,
            verdict=found.verdict,
            cause=first.name if first else "",
            set=(first.name, *first.ambiguous_with) if first else (),
            probability=first.probability if first else math.nan,
            place=found.where[0][0] if found.where else "",
            gap_before=found.gap["nominal"]["total"],
            gap_after=found.improved_gap["total"],
            seconds=found.seconds,
            digest=digest,
            causes=tuple((cause.name, *cause.ambiguous_with) for cause in found.effects),
        )

    @classmethod
    def from_line(cls, line: str) -> Row:
        """A row from a line of JSON."""
        content = parse_json(line)
        numbers = {name: math.nan if content[name] is None else float(content[name]) for name in NUMBERS}
        # Files of earlier versions lack the other causes.
        sets = {"set": tuple(content["set"]), "causes": tuple(map(tuple, content.get("causes", ())))}
        return cls(**(content | numbers | sets))

    to_dict = as_dict

    def to_line(self) -> str:
        return json.dumps(as_dict(self))


@dataclass(frozen=True, repr=False)
class LogBatch(Result):
    """The diagnoses of many logs of one rig.

    Attributes
    ----------
    plant: name of the nominal plant. threshold: smallest relevant gap.
    rows: of the finished logs, in the order given.
    diagnoses: file -> diagnosis, of those made in this call and not passed to `keep`.
    interrupted: whether logs are missing because of an interrupt.
    """

    plant: str
    threshold: float
    rows: tuple[Row, ...]
    diagnoses: Mapping[str, Diagnosis] = field(default_factory=dict, repr=False)
    interrupted: bool = False

    @property
    def failed(self) -> tuple[Row, ...]:
        """Logs that could not be diagnosed."""
        return tuple(row for row in self.rows if row.error)

    @property
    def counts(self) -> dict[str, int]:
        """Cause (or verdict if no cause is named) -> number of logs that have it, the most frequent first."""
        found: dict[str, int] = {}
        for row in self.rows:
            names = [one[0] for one in row.causes] or [row.cause]
            for word in ["failed"] if row.error else names if row.verdict in NAMING else [row.verdict]:
                found[word] = found.get(word, 0) + 1
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def to_pandas(self) -> pandas.DataFrame:
        """One row per log."""
        names = "verdict cause set causes probability place gap_before gap_after seconds error"
        return as_table(
            self.rows, names, index="file", set=lambda row: " or ".join(row.set), causes=lambda row: row.cause_words
        )

    def to_dict(self) -> dict[str, Any]:
        """Content of summary.json."""
        return as_dict(self, "plant threshold counts interrupted", logs=self.rows, provenance=versions())

    def __str__(self) -> str:
        words = ", ".join(f"{count} {word}" for word, count in self.counts.items())
        return f"{len(self.rows)} logs of {self.plant}: {words}\n{self.to_pandas().to_string()}"

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(str(self).splitlines()[0])}</p>" + str(self.to_pandas().to_html(float_format="%.3g"))


def diagnose_many(
    plant: Plant,
    logs: Sequence[str | Path | Log],
    *,
    threshold: float = 0.03,
    check: bool = True,
    jobs: int | None = None,
    file: str | Path | None = None,
    anew: bool = False,
    watch: Callable[[int, int], None] | None = None,
    keep: Callable[[str, Diagnosis], None] | None = None,
) -> LogBatch:
    """Diagnose many logs with the same nominal plant in parallel, one thread per diagnosis.

    Parameters
    ----------
    plant, threshold, check: as for `diagnose`.
    logs: paths, or logs that are already read.
    jobs: number of workers, -1 for all cores; by default that of joblib's context (`joblib.parallel_config`), else 1.
        Workers are processes unless the context has a backend, because much of a diagnosis holds Python's interpreter
        lock.
    file: each finished row is appended to it as a line of JSON. An existing file of the same plant and threshold is
        continued: only new, changed and failed logs are diagnosed.
    anew: start the file again.
    watch: progress callback, called with the number of finished logs and of all logs.
    keep: called with file and diagnosis of each finished log; the result then does not contain the diagnosis.

    Returns
    -------
    LogBatch: a row per log, with the error of a log that failed. After a keyboard interrupt the finished ones, if there
    are any.

    Raises
    ------
    InputError: no log, a log given twice, or a file of other diagnoses.
    """
    if not logs:
        raise InputError("no log to diagnose; give at least one")
    named = [_name(log, number) for number, log in enumerate(logs, 1)]
    twice = next((name for name in named if named.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{twice}: is given twice; give it once")
    labels = dict(zip(named, unique_names(named), strict=True))
    check_threshold(threshold)
    checkpoint = open_checkpoint(
        None if file is None else Path(file),
        "diagnoses",
        _settings_digest(plant, threshold, check),
        Row.from_line,
        anew=anew,
        none="is not a file of diagnoses; give another one",
        other="holds diagnoses with another plant or threshold; give another folder, or --force to start again",
        wrong="is not a row of a diagnosis",
    )
    earlier = {row.file: row for row in checkpoint.results}
    rows: dict[str, Row] = {}
    diagnoses: dict[str, Diagnosis] = {}
    todo: list[tuple[str, Log, str]] = []
    for name, log in zip(named, logs, strict=True):
        try:
            read = log if isinstance(log, Log) else read_plant_log(log, plant)
        except InputError as error:
            rows[name] = Row(name, error=str(error))
            continue
        digest = _log_digest(read)
        before = earlier.get(name)
        if before is not None and before.digest == digest and not before.error:
            rows[name] = before
        else:
            todo.append((name, replace(read, label=labels[name]), digest))
    checkpoint.append(row.to_line() for row in rows.values() if row.error)
    interrupted = False
    count = min(worker_count(jobs), max(len(todo), 1))
    try:
        work = partial(_diagnose_one, plant, threshold, check)
        with closing(as_completed(work, todo, count=count)) as results:
            for name, found, digest in results:
                if isinstance(found, str):
                    rows[name] = Row(name, error=found, digest=digest)
                else:
                    rows[name] = Row.of(name, found, digest)
                    if keep is None:
                        diagnoses[name] = found
                    else:
                        keep(name, found)
                checkpoint.append([rows[name].to_line()])
                if watch is not None:
                    watch(len(rows), len(named))
    except KeyboardInterrupt:
        if all(row.error for row in rows.values()):
            raise
        interrupted = True
    ordered = tuple(rows[name] for name in named if name in rows)
    return LogBatch(plant.name, threshold, ordered, diagnoses, interrupted)


def _diagnose_one(
    plant: Plant, threshold: float, check: bool, job: tuple[str, Log, str]
) -> tuple[str, Diagnosis | str, str]:
    """Name of a log, its diagnosis or the error in words, and the log's digest; runs on a worker."""
    name, log, digest = job
    try:
        return name, diagnose(plant, log, threshold=threshold, jobs=1, check=check), digest
    except EhsaError as error:
        return name, str(error), digest
    except (ArithmeticError, ValueError, LookupError) as error:
        # An unexpected failure of one log must not lose the results of the others.
        return name, f"{name}: the diagnosis failed ({type(error).__name__}: {error})", digest


def _name(log: str | Path | Log, number: int) -> str:
    if isinstance(log, Log):
        return str(log.path) if log.path else f"log {number}"
    return str(log)


def _log_digest(log: Log) -> str:
    """Hash of a log's content."""
    found = hashlib.sha256(log.time.tobytes())
    for name, values in log.channels.items():
        found.update(name.encode() + values.tobytes())
    return found.hexdigest()[:16]


def _settings_digest(plant: Plant, threshold: float, check: bool) -> str:
    """Hash of the settings that all rows of a file share."""
    parts = [str(plant.structure), plant.values, [str(s) for s in plant.sensors.values()], threshold, check]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]
