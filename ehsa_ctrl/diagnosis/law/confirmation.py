"""The outcome of testing a law on further logs, and the effect's file with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import tomlkit

from ...core.errors import InputError
from ...core.files import write_text
from ...core.log import Log
from ...core.result import Result, as_dict
from ...core.text import join_words
from ...core.unit import unit_suffix
from ...physics.effects import LawFile, LawLog

#: The models of a confirmation.
MODELS = {
    "nominal": "nominal plant",
    "refit": "nominal parameters refitted",
    "with_law": "with the law as proposed",
    "law_refitted": "with the law refitted",
}


@dataclass(frozen=True)
class RefittedNumber:
    """A number of a law as proposed and as refitted to further logs, SI units. overlaps: whether both agree."""

    proposed: float
    proposed_sd: float | None
    value: float
    sd: float
    unit: str
    overlaps: bool


@dataclass(frozen=True)
class SeenRange:
    """Range of a variable in the logs from which a law was found, None if its file does not state it, and in others."""

    proposed: tuple[float, float] | None
    seen: tuple[float, float]

    @property
    def both(self) -> tuple[float, float]:
        """The range in all logs."""
        known = [pair for pair in (self.proposed, self.seen) if pair is not None]
        return min(pair[0] for pair in known), max(pair[1] for pair in known)

    @property
    def beyond(self) -> float:
        """What the further logs add, as a share of the range before."""
        if self.proposed is None or self.proposed[1] <= self.proposed[0]:
            return 0.0
        width = self.proposed[1] - self.proposed[0]
        return (self.both[1] - self.both[0]) / width - 1.0


@dataclass(frozen=True, repr=False)
class Confirmation(Result):
    """Whether further logs confirm a law.

    Attributes
    ----------
    name, file, law: effect, its file and what stands in it. logs: further logs.
    refused: the reasons against it; empty if it is confirmed.
    gap: model (see MODELS) -> signal -> gap on held-out data; in all but the first, nominal parameters follow.
    parameters: number -> as proposed and refitted. range: variable -> where the law was found, and here.
    alternatives: effects of the catalogue that explain these logs as well; not looked for where the law is refused.
    """

    name: str
    file: Path
    law: LawFile
    logs: tuple[Log, ...] = field(repr=False)
    refused: tuple[str, ...]
    gap: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    parameters: Mapping[str, RefittedNumber] = field(default_factory=dict)
    range: Mapping[str, SeenRange] = field(default_factory=dict)
    alternatives: tuple[str, ...] = ()
    held_out: str = ""

    @property
    def confirmed(self) -> bool:
        return not self.refused

    @property
    def gap_closed(self) -> float | None:
        """Share of the nominal gap in total that the law as proposed closes; None if it was not simulated."""
        if not self.gap or self.gap["nominal"]["total"] <= 0.0:
            return None
        return 1.0 - self.gap["with_law"]["total"] / self.gap["nominal"]["total"]

    def write(self) -> Path:
        """Write the status, the hashes and the ranges into the effect's file; all else in it stays, with its comments.

        Raises InputError for a law that is not confirmed, and for a file that can't be written.
        """
        if not self.confirmed:
            raise InputError(f"{self.file}: {self.name} is not confirmed: {'; '.join(self.refused)}")
        document: Any = tomlkit.parse(self.file.read_text(encoding="utf-8"))
        document["status"] = "confirmed"
        known = {one.sha256 for one in self.law.logs}
        document.setdefault("logs", tomlkit.aot())
        for log in self.logs:
            one = LawLog.of(log)
            if one is not None and one.sha256 not in known:
                document["logs"].append(one.model_dump())
        if self.range:
            ranges = document.setdefault("range", tomlkit.table())
            for name, pair in self.range.items():
                ranges[name] = list(pair.both)
        return write_text(self.file, tomlkit.dumps(document))

    def to_dict(self) -> dict[str, Any]:
        """Content of --json."""
        return as_dict(
            self, "name file confirmed refused gap gap_closed parameters alternatives held_out",
            status="confirmed" if self.confirmed else self.law.status, expression=self.law.expression,
            logs=[log.path for log in self.logs],
            range={name: as_dict(pair, "proposed seen beyond") for name, pair in self.range.items()},
        )  # fmt: skip

    def __str__(self) -> str:
        logs = join_words(log.name for log in self.logs)
        lines = [
            f"{self.name} is confirmed by {logs}." if self.confirmed else f"{self.name} is not confirmed by {logs}:"
        ]
        lines += [f"  {reason}" for reason in self.refused]
        lines.append(f"  law: {self.law.expression}")
        if self.gap:
            signals = list(self.gap["nominal"])
            lines.append(f"  {'gap, % (held out)':<28}" + "".join(f"{signal:>14}" for signal in signals))
            for model, gaps in self.gap.items():
                lines.append(f"  {MODELS[model]:<28}" + "".join(f"{100.0 * gaps[s]:>14.2f}" for s in signals))
            lines.append(f"  held-out data: {self.held_out}")
        for name, one in self.parameters.items():
            before = f"{one.proposed:.4g}" + (f" +- {one.proposed_sd:.2g}" if one.proposed_sd is not None else "")
            here = f"{one.value:.4g} +- {one.sd:.2g}{unit_suffix(one.unit)} here, "
            here += "agrees" if one.overlaps else "differs"
            lines.append(f"  {name}: {before} proposed, {here if isfinite(one.sd) else 'not determined here'}")
        for name, pair in self.range.items():
            before = "not stated" if pair.proposed is None else f"{pair.proposed[0]:.4g} to {pair.proposed[1]:.4g}"
            more = f", {100.0 * pair.beyond:.0f} % wider together" if pair.beyond > 0.005 else ""
            lines.append(f"  range of {name}: {before} before, {pair.seen[0]:.4g} to {pair.seen[1]:.4g} here{more}")
        if self.alternatives:
            lines.append(f"  explains these logs as well: {', '.join(self.alternatives)}")
        return "\n".join(lines)
