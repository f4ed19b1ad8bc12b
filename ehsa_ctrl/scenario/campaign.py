"""Results of a Monte Carlo campaign as they come: one JSON line a run, so that an interrupt loses nothing."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import InputError


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
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"campaign": mark}) + "\n", encoding="utf-8")
            return cls(path)
        head, *lines = path.read_text(encoding="utf-8").split("\n")
        try:
            found = json.loads(head)["campaign"]
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: is no file of a Monte Carlo campaign; give another one") from None
        if found != mark:
            raise InputError(
                f"{path}: holds runs of another campaign (scenario, plant, controller, uncertainty or seed differ); "
                "give another folder, or --force to begin anew"
            )
        outcomes, whole = [], [head]
        for number, line in enumerate(lines, 2):
            if not line:
                continue
            try:
                outcomes.append(_outcome(line))
            except (ValueError, KeyError, TypeError):
                if number <= len(lines):
                    raise InputError(f"{path}: line {number} is no result of a run; mend or delete it") from None
                continue
            whole.append(line)
        # Without what was cut off: the next result must not be joined to it.
        path.write_text("\n".join(whole) + "\n", encoding="utf-8")
        return cls(path, tuple(outcomes))

    def append(self, outcomes: Iterable[Outcome]) -> None:
        """Add results to the file."""
        if self.path is None:
            return
        with self.path.open("a", encoding="utf-8") as file:
            file.writelines(_line(outcome) + "\n" for outcome in outcomes)


def _line(outcome: Outcome) -> str:
    content = vars(outcome) | {"margin": outcome.margin if math.isfinite(outcome.margin) else str(outcome.margin)}
    return json.dumps(content)


def _outcome(line: str) -> Outcome:
    content = json.loads(line)
    return Outcome(**(content | {"margin": float(content["margin"]), "failures": tuple(content["failures"])}))
