"""Diagnoses of many logs of one rig; an interrupt keeps those that are done."""

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
from .diagnose import check_threshold, diagnose
from .diagnosis import Diagnosis

if TYPE_CHECKING:
    import pandas


#: Fields of a row that are numbers.
NUMBERS = ("probability", "gap_before", "gap_after", "seconds")


@dataclass(frozen=True)
class Row:
    """The diagnosis of one log as a row of a table.

    Attributes
    ----------
    file: the log. verdict: as in `Diagnosis`; empty where it could not be diagnosed, for the reason in `error`.
    cause: name of the first cause; set: it and those that this log can't tell from it; probability: of the first cause.
    place: with the largest share. gap_before, gap_after: in total on held-out data, nominal and with the causes.
    seconds: of computation. digest: of the log's content.
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
            gap_after=found.gap["with_effects"]["total"],
            seconds=found.seconds,
            digest=digest,
        )

    @classmethod
    def from_line(cls, line: str) -> Row:
        """From a line of JSON."""
        content = parse_json(line)
        numbers = {name: math.nan if content[name] is None else float(content[name]) for name in NUMBERS}
        return cls(**(content | numbers | {"set": tuple(content["set"])}))

    to_dict = as_dict

    def to_line(self) -> str:
        return json.dumps(as_dict(self))


@dataclass(frozen=True, repr=False)
class LogBatch(Result):
    """The diagnoses of many logs of one rig.

    Attributes
    ----------
    plant: name of the nominal plant. threshold: a gap from which on it matters.
    rows: of the logs that are done, in the order in which they were given.
    diagnoses: file -> diagnosis, of those that were made in this call and not handed to `keep`.
    interrupted: not all logs are done.
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
        """First cause, or verdict where none is named -> number of logs; the most frequent first."""
        found: dict[str, int] = {}
        for row in self.rows:
            named = row.verdict in ("effect", "ambiguous")
            word = "failed" if row.error else row.cause if named else row.verdict
            found[word] = found.get(word, 0) + 1
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def to_pandas(self) -> pandas.DataFrame:
        """One row a log."""
        names = "verdict cause set probability place gap_before gap_after seconds error"
        return as_table(self.rows, names, index="file", set=lambda row: " or ".join(row.set))

    def to_dict(self) -> dict[str, Any]:
        """As summary.json."""
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
    """Diagnose many logs against the same plant, one thread each.

    Parameters
    ----------
    plant, threshold, check: as for `diagnose`, the same for all.
    logs: files, or logs that were read already.
    jobs: workers; -1 for all; by default those of joblib's context (`joblib.parallel_config`), else 1. Without a
        backend in that context: processes, as a good part of a diagnosis holds Python's lock.
    file: each row is appended to it when it is done, as a line of JSON. A file of the same plant and threshold is
        continued: its logs are not diagnosed again unless they have changed or failed.
    watch: called with the numbers of logs done and in all.
    anew: begin the file again with the first row.
    keep: called with each file and its diagnosis when it is done; the result does not contain it then.

    Returns
    -------
    A row for each log, with a sentence for one that could not be diagnosed; also after an interrupt from the keyboard,
    if at least one log is done.

    Raises
    ------
    InputError: no log, the same one twice, or the file is of other diagnoses.
    """
    if not logs:
        raise InputError("no log to diagnose; give one or more")
    named = [_name(log, number) for number, log in enumerate(logs, 1)]
    twice = next((name for name in named if named.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{twice}: is given twice; give it once")
    labels = dict(zip(named, unique_names(named), strict=True))
    check_threshold(threshold)
    checkpoint = open_checkpoint(
        None if file is None else Path(file),
        "diagnoses",
        _mark(plant, threshold, check),
        Row.from_line,
        anew=anew,
        none="is no file of diagnoses; give another one",
        other="holds diagnoses against another plant or with another threshold; give another folder, or --force to "
        "begin anew",
        wrong="is no row of a diagnosis",
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
        digest = _digest(read)
        before = earlier.get(name)
        if before is not None and before.digest == digest and not before.error:
            rows[name] = before
        else:
            todo.append((name, replace(read, label=labels[name]), digest))
    checkpoint.append(row.to_line() for row in rows.values() if row.error)
    interrupted = False
    count = min(worker_count(jobs), max(len(todo), 1))
    try:
        work = partial(_one, plant, threshold, check)
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


def _one(plant: Plant, threshold: float, check: bool, job: tuple[str, Log, str]) -> tuple[str, Diagnosis | str, str]:
    """A diagnosis, or the reason why there is none; on a worker."""
    name, log, digest = job
    try:
        return name, diagnose(plant, log, threshold=threshold, jobs=1, check=check), digest
    except EhsaError as error:
        return name, str(error), digest
    except (ArithmeticError, ValueError, LookupError) as error:
        # One log must not lose the results of the others.
        return name, f"{name}: the diagnosis broke off ({type(error).__name__}: {error})", digest


def _name(log: str | Path | Log, number: int) -> str:
    if isinstance(log, Log):
        return str(log.path) if log.path else f"log {number}"
    return str(log)


def _digest(log: Log) -> str:
    """A hash of a log's content."""
    found = hashlib.sha256(log.time.tobytes())
    for name, values in log.channels.items():
        found.update(name.encode() + values.tobytes())
    return found.hexdigest()[:16]


def _mark(plant: Plant, threshold: float, check: bool) -> str:
    """A hash of what the rows of one file have in common."""
    parts = [str(plant.structure), plant.values, [str(s) for s in plant.sensors.values()], threshold, check]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]
