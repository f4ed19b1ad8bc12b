"""The result on a fleet: its rigs, its parameters, and drifts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError, choices
from ..core.result import Result, as_dict, as_table
from ..core.text import join_words
from ..simulation.trajectory import versions

if TYPE_CHECKING:
    import numpy as np
    import pandas

    from .store import Store

#: Rows of a table in the printed result.
MOST_ROWS = 40
#: Rigs with their logs and series in fleet.json: as many as the page shows. The store's tables have those of all.
MOST_SERIES = 400


@dataclass(frozen=True)
class LogLine:
    """A log of a rig.

    file: as it was given. place: the same, seen from the store; empty where no relative path leads there. date: ISO
    8601. rms: of the residuals at the nominal plant and with its parameters refitted.
    """

    file: str
    place: str
    date: str
    dated: str
    rms: tuple[float, float]


@dataclass(frozen=True)
class RigDiagnosis:
    """The full diagnosis of the first log after a change, with the rig as it was before.

    causes: each with those that explain the log as well. folder: relative to the store; empty without one.
    error: why there is none.
    """

    file: str
    verdict: str = ""
    causes: tuple[tuple[str, ...], ...] = ()
    probability: float = float("nan")
    gap_before: float = float("nan")
    gap_after: float = float("nan")
    folder: str = ""
    error: str = ""


@dataclass(frozen=True)
class FurtherChange:
    """Another step of a rig that changed more than once, by the score test; the fields are those of `FleetRig`."""

    cause: str
    same: tuple[str, ...]
    since: str
    earliest: str
    latest: str
    file: str
    size: Mapping[str, Mapping[str, Any]]
    p: float

    @property
    def words(self) -> str:
        """What changed, with what explains it as well."""
        return " or ".join([self.cause, *self.same])


@dataclass(frozen=True)
class FleetRig:
    """A rig of a fleet.

    Attributes
    ----------
    name; logs: in order of time.
    changed: whether it changed between its logs, at the fleet's false-discovery rate.
    kind: "step" or "drift". since: date of the first log after the step; of a drift, of its first log. earliest,
        latest: the dates between which the step may lie. file: log of `since`.
    cause: what changed, by the full diagnosis if it names a cause, else by the score test. same: causes that explain it
        as well. by: "diagnosis" or "score".
    size: parameter -> {"change", "sd", "unit"}, of the score test's cause `scored`.
    further: its other steps in order of time; the fields above are of the most significant one.
    p, q: probability of a change as large by chance, and the false-discovery rate at which it counts.
    unlike: cause by which the rig differs from its fleet in all logs before a change, empty if it does not; unlike_p,
        unlike_q as p and q.
    series: cause or parameter -> (logs, 2) value and its sd, as deviation from nominal, other parameters as fitted to
        all of the rig's logs.
    """

    name: str
    logs: tuple[LogLine, ...]
    changed: bool = False
    kind: str = ""
    cause: str = ""
    same: tuple[str, ...] = ()
    by: str = ""
    scored: str = ""
    since: str = ""
    earliest: str = ""
    latest: str = ""
    file: str = ""
    size: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    further: tuple[FurtherChange, ...] = ()
    p: float = 1.0
    q: float = 1.0
    unlike: str = ""
    unlike_p: float = 1.0
    unlike_q: float = 1.0
    diagnosis: RigDiagnosis | None = None
    series: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False, compare=False)

    @property
    def words(self) -> str:
        """What changed, with what explains it as well."""
        return " or ".join([self.cause, *self.same]) if self.changed else ""


@dataclass(frozen=True)
class FleetParameter:
    """A parameter of the fleet, SI units.

    nominal: of the plant's file. mean, mean_sd: of the fleet. spread: standard deviation between units, None if the
    logs do not determine the parameter. units: number of rigs' worth of information.
    """

    name: str
    unit: str
    nominal: float
    mean: float
    mean_sd: float
    spread: float | None
    units: float


@dataclass(frozen=True)
class Drift:
    """A parameter of a rig that moves with time: slope per day with its sd, SI units.

    p, q: see `FleetRig`. since: date of a step that explains it better, else empty.
    """

    rig: str
    parameter: str
    unit: str
    slope: float
    sd: float
    p: float
    q: float
    since: str = ""


@dataclass(frozen=True, repr=False)
class Fleet(Result):
    """What the logs of a fleet say.

    Attributes
    ----------
    plant: name of the nominal plant. rate: false-discovery rate.
    rigs: in order of their names. parameters: of the plant. drifts: significant ones.
    causes: all that were tested.
    failed: file -> why a log could not be used. notes: sentences on the data.
    computed, kept: number of logs that were computed, and found in the store.
    truth: of a virtual fleet, rig -> {"cause", "since"}.
    store: for queries.
    """

    plant: str
    rate: float
    rigs: tuple[FleetRig, ...]
    parameters: tuple[FleetParameter, ...]
    drifts: tuple[Drift, ...]
    causes: tuple[str, ...]
    failed: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    computed: int = 0
    kept: int = 0
    truth: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    store: Store | None = field(default=None, compare=False)

    @property
    def changed(self) -> tuple[FleetRig, ...]:
        """The rigs that changed, the most significant first."""
        return tuple(sorted((rig for rig in self.rigs if rig.changed), key=lambda rig: rig.p))

    @property
    def unlike(self) -> tuple[FleetRig, ...]:
        """The rigs that differ from their fleet."""
        return tuple(sorted((rig for rig in self.rigs if rig.unlike), key=lambda rig: rig.unlike_p))

    @property
    def log_count(self) -> int:
        """Number of logs that were used."""
        return sum(len(rig.logs) for rig in self.rigs)

    def rig(self, name: str) -> FleetRig:
        """A rig by its name. Raises InputError for an unknown one."""
        for one in self.rigs:
            if one.name == name:
                return one
        raise InputError(f"the fleet has no rig {name!r}; {choices(name, [one.name for one in self.rigs])}")

    def query(self, text: str) -> pandas.DataFrame:
        """As `Store.query`."""
        if self.store is None:
            raise InputError("this fleet has no store; analyse the logs with a folder for it")
        return self.store.query(text)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per rig."""
        names = "logs changed kind cause same by since earliest latest further p q unlike unlike_q"
        return as_table(
            self.rigs, names, logs=lambda rig: len(rig.logs), same=lambda rig: "; ".join(rig.same),
            further=lambda rig: further_words(rig.further),
        )  # fmt: skip

    def parameter_table(self) -> pandas.DataFrame:
        """One row per parameter of the fleet."""
        return as_table(self.parameters, "unit nominal mean mean_sd spread units")

    def drift_table(self) -> pandas.DataFrame:
        """One row per significant drift."""
        return as_table(self.drifts, "parameter unit slope sd p q since", index="rig")

    def to_dict(self) -> dict[str, Any]:
        """Content of fleet.json."""
        counts = {"rigs": len(self.rigs), "logs": self.log_count, "changed": len(self.changed)}
        first = sorted(self.rigs, key=lambda rig: (not rig.changed, rig.p if rig.changed else 0.0, not rig.unlike))
        shown = {rig.name for rig in first[:MOST_SERIES]}
        rigs = [rig if rig.name in shown else replace(rig, logs=(), series={}) for rig in self.rigs]
        return {
            **as_dict(self, "plant rate"), "counts": counts,
            **as_dict(
                self, "causes parameters drifts failed notes computed kept truth", rigs=rigs,
                score=self.score() if self.truth else None, provenance=versions(),
            ),
        }  # fmt: skip

    def score(self) -> dict[str, int]:
        """A virtual fleet's results against its truth.

        found: changed rigs that are found. dated: of these, with the right log. named: with the right cause, alone or
        among those that explain the log as well. false: rigs that are said to have changed in what they did not.
        """
        found = [rig for rig in self.changed if rig.name in self.truth]
        named = [rig for rig in found if self.truth[rig.name]["cause"] in (rig.cause, *rig.same)]
        return {
            "changed": len(self.truth),
            "found": len(found),
            "dated": sum(rig.since == self.truth[rig.name]["since"] for rig in found),
            "named": len(named),
            "false": len(self.changed) - len(named),
        }

    def __str__(self) -> str:
        first = f"{len(self.rigs)} rigs of {self.plant}, {self.log_count} logs: {len(self.changed)} changed"
        first += f" (false-discovery rate {100 * self.rate:g} %)"
        lines = [first, ""]
        if self.changed:
            rows: list[tuple[str, ...]] = []
            for rig in self.changed[:MOST_ROWS]:
                verdict = "" if rig.diagnosis is None else rig.diagnosis.verdict or "failed"
                since = ("drift from " if rig.kind == "drift" else "") + rig.since[:10]
                rows.append((rig.name, rig.words, since, _sizes(rig.size), f"{rig.q:.1g}", verdict))
                rows += [("  also", one.words, one.since[:10], _sizes(one.size), "", "") for one in rig.further]
            lines += [*_table(("rig", "changed in", "since", "change by score test", "q", "diagnosis"), rows), ""]
            if len(self.changed) > MOST_ROWS:
                lines += [f"... and {len(self.changed) - MOST_ROWS} more, in rigs.csv", ""]
        if self.unlike:
            others = [(rig.name, rig.unlike, f"{rig.unlike_q:.1g}") for rig in self.unlike[:MOST_ROWS]]
            lines += ["unlike the fleet from the first log on:", *_table(("rig", "in", "q"), others), ""]
        parameters = [
            (one.name, f"{one.nominal:.4g}", f"{one.mean:.4g}", f"{one.mean_sd:.2g}",
             "not determined" if one.spread is None else f"{one.spread:.2g}",
             "" if one.spread is None or not one.mean else f"{100 * one.spread / abs(one.mean):.2g} %", one.unit)
            for one in self.parameters
        ]  # fmt: skip
        lines += _table(("parameter", "nominal", "fleet mean", "its sd", "spread", "", "unit"), parameters)
        if self.drifts:
            named = [
                f"{one.rig} {one.parameter} {one.slope * 365.25:+.2g} {one.unit} a year"
                for one in self.drifts[:MOST_ROWS]
            ]
            lines += ["", f"drifts: {'; '.join(named)}"]
        if self.failed:
            lines += [
                "",
                f"{len(self.failed)} logs could not be used:",
                *map(str, list(self.failed.values())[:MOST_ROWS]),
            ]
        lines += ["", *self.notes] if self.notes else []
        if self.truth:
            score = self.score()
            lines += ["", f"against the truth: {score['found']} of {score['changed']} changed rigs found, "
                      f"{score['dated']} with the right date, {score['named']} with the right cause; "
                      f"{score['false']} false"]  # fmt: skip
        return "\n".join(lines)


def further_words(further: Sequence[FurtherChange]) -> str:
    """Date and cause of the other steps of a rig."""
    return "; ".join(f"{one.since[:10]} {one.words}" for one in further)


def _sizes(size: Mapping[str, Mapping[str, Any]]) -> str:
    """The first changes of a rig in words."""
    return join_words([f"{name} {one['change']:+.2g} {one['unit']}".rstrip() for name, one in list(size.items())[:2]])


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in [head, *rows]
    ]
