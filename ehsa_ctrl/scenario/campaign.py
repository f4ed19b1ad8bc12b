"""Results of a Monte Carlo campaign as they come: one JSON line a run, so that an interrupt loses nothing."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..core.checkpoint import Checkpoint, open_checkpoint
from ..core.files import parse_json


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


def open_campaign(path: Path | None, mark: str, *, anew: bool = False) -> Checkpoint[Outcome]:
    """Continue the campaign in this file, or begin it; see `open_kept`.

    mark: what makes two campaigns the same. anew: replace the campaign that is in the file.

    Raises InputError for a file of another campaign, or one that is none.
    """
    return open_checkpoint(
        path,
        "campaign",
        mark,
        _outcome,
        anew=anew,
        none="is no file of a Monte Carlo campaign; give another one",
        other="holds runs of another campaign (scenario, plant, controller, uncertainty or seed differ); give "
        "another folder, or --force to begin anew",
        wrong="is no result of a run",
    )


def line_of(outcome: Outcome) -> str:
    """A run as it stands in the file."""
    content = vars(outcome) | {"margin": outcome.margin if math.isfinite(outcome.margin) else str(outcome.margin)}
    return json.dumps(content)


def _outcome(line: str) -> Outcome:
    content = parse_json(line)
    return Outcome(**(content | {"margin": float(content["margin"]), "failures": tuple(content["failures"])}))
