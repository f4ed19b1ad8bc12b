"""The page of a comparison: how well free runs of a plant fit a log, and what is doubtful in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import InputError
from ..identification.checks import LogFinding
from ..identification.comparison import GOOD, POOR, Comparison, fit_words, quality
from ..identification.preparation import Step
from .document import Picture, embedded, merged_versions, write_document
from .figures import replay_figure
from .grounds import assumed_of, hashes
from .kinds._result import BANNERS, FITS
from .number import number


@dataclass(frozen=True)
class Replayed:
    """One model's free run, as the page shows it."""

    replay: Comparison

    @property
    def name(self) -> str:
        return f"{self.replay.plant.model} model"

    @property
    def banner(self) -> str:
        """Class of its banner, by the worst fit of a channel; a run that ended early has failed."""
        known = [fit for fit in self.replay.fit_percent.values() if not math.isnan(fit)]
        if self.replay.stopped:
            return BANNERS[False]
        return BANNERS[FITS[quality(min(known))] if known else None]

    @property
    def sentence(self) -> str:
        """How well it fits, in words."""
        run = self.replay
        if run.stopped:
            return f"The free run ended early, no fit is given: {run.stopped.rstrip('.')}."
        known = {channel: fit for channel, fit in run.fit_percent.items() if not math.isnan(fit)}
        if not known:
            return "No channel moved, so that there is no fit."
        ordered = sorted(known, key=lambda channel: known[channel])
        worst, best = ordered[0], ordered[-1]
        if len(ordered) == 1:
            return f"The fit of {worst} is {number(known[worst])} %, {quality(known[worst])}."
        ends = f"from {number(known[worst])} % ({worst}) to {number(known[best])} % ({best})"
        return f"The fit is {ends}: {fit_words(known)}."


def write_comparison_page(
    replays: Sequence[Comparison],
    folder: Path,
    *,
    command: str,
    findings: Iterable[LogFinding] = (),
    untold: Iterable[str] = (),
    steps: Iterable[Step] = (),
) -> Path:
    """Write `report.html` to the folder and return its path; the same replays give the same bytes.

    Parameters
    ----------
    replays: of one log, each model once.
    command: the command line that made them, for the page's end.
    findings: what `check_log` says of the log. untold: what it can't tell. steps: how it was prepared.

    Raises InputError if there is no replay.
    """
    if not replays:
        raise InputError("there is no replay to report; replay at least one model")
    log, plant = replays[0].log, replays[0].plant
    channels = list(dict.fromkeys(channel for run in replays for channel in run.fit_percent))
    models = [Replayed(run) for run in replays]
    return write_document(
        "comparison.html.j2",
        folder,
        headline=f"{plant.name} beside {log.name}",
        models=models,
        named=(GOOD, POOR),
        fits=[(channel, [number(run.fit_percent.get(channel, math.nan)) for run in replays]) for channel in channels],
        section={"name": plant.name, "pictures": _pictures(replays, models)},
        findings=list(findings),
        untold=list(untold),
        steps=list(steps),
        facts=[
            ("log", str(log.path or "not from a file")),
            ("samples", f"{len(log)}, {number(1e3 * log.sample_time)} ms apart"),
            ("time", f"{number(float(log.time[0]))} to {number(float(log.time[-1]))} s"),
            *((f"{model.name} starts", model.replay.start.words) for model in models),
        ],
        files=hashes([log.path, plant.path]),
        versions=merged_versions(run.provenance for run in replays),
        assumed=assumed_of(run.plant for run in replays),
        command=command,
    )


def _pictures(replays: Sequence[Comparison], models: Sequence[Replayed]) -> list[Picture]:
    words = " ".join(f"{model.name}: {model.sentence}" for model in models)
    kinds = (
        ("All of the log", False, "Free runs, driven by the logged drive and nothing else."),
        ("In detail", True, "The second in which the drive varies most."),
    )
    return [
        Picture(heading, embedded(replay_figure(replays, detail=detail), f"Measured and simulated. {words}"), caption)
        for heading, detail, caption in kinds
    ]
