"""Results of a Monte Carlo campaign as they come: one JSON line a run, so that an interrupt loses nothing."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..core.kept import append_kept, read_kept


@dataclass(frozen=True)
class Outcome:
    """One run of a campaign.

    Attributes
    ----------
    run: its number. passed: whether the scenario's limits and the plant's were kept.
    margin: of the limit that was kept with the least room, as a share of that limit; negative if one was not kept,
        -inf if its metric did not happen.
    seed: of the sensors' noise. parameters: drawn values, SI units. metrics: those that happened.
    failures: in sentences.
    """

    run: int
    passed: bool
    margin: float
    seed: int
    parameters: Mapping[str, float]
    metrics: Mapping[str, float]
    failures: tuple[str, ...] = ()


@dataclass(frozen=True)
class Campaign:
    """The file of a campaign, if it has one, and what was in it.

    path: None keeps nothing. outcomes: of earlier sessions.
    """

    path: Path | None
    outcomes: tuple[Outcome, ...] = ()

    @classmethod
    def open(cls, path: Path | None, mark: str) -> Campaign:
        """Continue the campaign in this file, or begin it.

        mark: what makes two campaigns the same. A last line that was cut off by an interrupt is dropped.

        Raises InputError for a file of another campaign, or one that is none.
        """
        if path is None:
            return cls(None)
        outcomes = read_kept(
            path,
            "campaign",
            mark,
            _outcome,
            none="is no file of a Monte Carlo campaign; give another one",
            other="holds runs of another campaign (scenario, plant, controller, uncertainty or seed differ); give "
            "another folder, or --force to begin anew",
            wrong="is no result of a run",
        )
        return cls(path, tuple(outcomes))

    def append(self, outcomes: Iterable[Outcome]) -> None:
        """Add results to the file."""
        if self.path is not None:
            append_kept(self.path, map(_line, outcomes))


def _line(outcome: Outcome) -> str:
    content = vars(outcome) | {"margin": outcome.margin if math.isfinite(outcome.margin) else str(outcome.margin)}
    return json.dumps(content)


def _outcome(line: str) -> Outcome:
    content = json.loads(line)
    return Outcome(**(content | {"margin": float(content["margin"]), "failures": tuple(content["failures"])}))
