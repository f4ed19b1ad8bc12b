"""Changes between two logs of a rig: the second log is diagnosed with the plant that explains the first one."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError
from ..core.log import Log, named
from ..core.result import Result, as_dict
from ..plant.plant import Plant
from .diagnose import diagnose
from .diagnosis import NAMING, Cause, Diagnosis
from .hypothesis_model import with_every_effect
from .improved_plant import improved_plant
from .objective import objective_of
from .pool import Watch
from .records import Segment
from .refit import refit_nominal
from .validation_segment import whole_log
from .verdict_text import with_alternatives

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False)
class Change(Result):
    """The change between two logs of a rig.

    Attributes
    ----------
    before: diagnosis of the first log with the nominal plant.
    after: diagnosis of the second log with `rig`; its causes are the changes.
    rig: the plant adapted to the first log.
    brought: how the plant was adapted, in words.
    """

    before: Diagnosis
    after: Diagnosis
    rig: Plant
    brought: str

    @property
    def new(self) -> tuple[Cause, ...]:
        """Causes that are new in the second log; empty if the verdict names none."""
        return self.after.effects if self.after.verdict in NAMING else ()

    @property
    def sentence(self) -> str:
        """The change, and how the plant was adapted to the first log, in words."""
        if self.after.verdict == "no_gap":
            first = "No relevant change between the logs."
        elif self.new:
            first = f"Changed between the logs: {with_alternatives(self.new)}."
        elif self.before.verdict in ("no_gap", *NAMING):
            first = f"Something changed between the logs. {self.after.sentence}"
        else:
            # The unexplained gap of the first log is in the second log too.
            first = f"A change can't be determined: no cause was found for either log. {self.after.sentence}"
        return f"{first} Earlier log: {self.brought}."

    def to_dict(self) -> dict[str, Any]:
        """Content of diagnosis.json: the diagnosis of the second log, with the first one under `before`."""
        nominal, rig = self.before.plant, self.rig.parameters
        before = as_dict(
            self.before, "verdict sentence", log=self.before.log.path, brought=self.brought,
            parameters={
                name: as_dict(parameter, "value unit", nominal=nominal[name])
                for name, parameter in rig.items()
                if name in nominal.parameters and abs(parameter.value - nominal[name]) > 1e-6 * abs(nominal[name])
            },
        )  # fmt: skip
        return self.after.to_dict() | {"change": self.sentence, "before": before}

    def to_pandas(self) -> pandas.DataFrame:
        """One row per cause of the second log, as of `Diagnosis`."""
        return self.after.to_pandas()

    def __str__(self) -> str:
        return f"{self.sentence}\n{self.after}"


def what_changed(
    plant: Plant,
    before: Log,
    after: Log,
    *,
    threshold: float = 0.03,
    jobs: int | None = None,
    watch: Watch | None = None,
    check: bool = True,
    without: Collection[str] = (),
) -> Change:
    """Diagnose the log `after` with the plant that explains the log `before`, so that only changes are causes.

    The plant is adapted to the first log by the causes found in it. If it has no gap, or no cause was found, the
    nominal parameters are refitted within their priors.

    Parameters
    ----------
    plant, threshold, jobs, watch, check, without: as for `diagnose`.
    before, after: logs of the same rig under the same load.

    Returns
    -------
    Change.

    Raises
    ------
    InputError: as `diagnose`; or both logs are the same.
    """
    if before is after or (before.path is not None and before.path == after.path):
        raise InputError(f"{after.path or 'the log'}: is given as both the earlier and the later log; give two logs")
    before, after = named([before, after])

    def find(plant: Plant, log: Log, word: str) -> Diagnosis:
        labelled = _with_label(watch, word)
        return diagnose(plant, log, threshold=threshold, jobs=jobs, watch=labelled, check=check, without=without)

    first = find(plant, before, "before")
    rig, brought = _adapt_plant(first)
    second = find(rig, after, "after")
    return Change(first, second, rig, brought)


def _with_label(watch: Watch | None, word: str) -> Watch | None:
    if watch is None:
        return None
    return lambda stage, done, total: watch(f"{word}: {stage}", done, total)


def _adapt_plant(first: Diagnosis) -> tuple[Plant, str]:
    """The plant adapted to the first log, and how, in words."""
    if first.verdict in NAMING and first.improved is not None:
        names = " and ".join(cause.name for cause in first.effects)
        return first.improved, f"the rig already differed from the nominal plant by {names}"
    if first.verdict == "no_gap":
        why = "it has no relevant gap"
    else:
        why = "no cause was found for its gap"
    return _refit_plant(first), f"{why}; the nominal parameters were refitted to it within their priors"


def _refit_plant(first: Diagnosis) -> Plant:
    """The plant with nominal parameters refitted to the whole log, under the priors of a hypothesis."""
    plant, noise = first.plant, first.noise_sd
    whole = Segment((whole_log(plant, with_every_effect(plant), first.log, noise),), first.log.name)
    values = refit_nominal(*objective_of(whole, first.threshold))
    return improved_plant(plant, (), values, {}) if values else plant
