"""What changed between two logs of the same rig: the second is held against the plant that explains the first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError
from ..core.log import Log, named
from ..core.text import TextResult
from ..plant.plant import Plant
from .diagnose import Watch, diagnose
from .diagnosis import Cause, Diagnosis
from .fit import Bench, Metric, Nominal, refit
from .held_out import whole
from .improved import improved
from .twin import with_every_effect, without_dry_friction

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Change(TextResult):
    """What changed between two logs.

    Attributes
    ----------
    before: the first log against the plant as believed.
    after: the second log against `rig`; its causes are what changed.
    rig: the plant brought to the first log. brought: how, in words.
    """

    before: Diagnosis
    after: Diagnosis
    rig: Plant
    brought: str

    @property
    def new(self) -> tuple[Cause, ...]:
        """Causes of the second log beyond the first; none where the verdict names none."""
        return self.after.effects if self.after.verdict in ("effect", "ambiguous") else ()

    @property
    def sentence(self) -> str:
        """What changed and what did not, in two sentences."""
        if self.after.verdict == "no_gap":
            first = "Nothing that matters changed between the logs."
        elif self.new:
            named = " and ".join(" or ".join([cause.name, *cause.ambiguous_with]) for cause in self.new)
            first = f"Between the logs changed: {named}."
        elif self.before.verdict == "no_gap" or self.before.improved is not None:
            first = f"Something changed between the logs. {self.after.sentence}"
        else:
            # The rig was not explained, so that what is left of it stands in the second log too.
            first = f"Whether anything changed can't be told: no cause was found for either log. {self.after.sentence}"
        return f"{first} Before, {self.brought}."

    def to_dict(self) -> dict[str, Any]:
        """As diagnosis.json: that of the second log, with what is said of the first under `before`."""
        return {
            **self.after.to_dict(),
            "change": self.sentence,
            "before": {
                "log": self.before.log.path,
                "verdict": self.before.verdict,
                "sentence": self.before.sentence,
                "brought": self.brought,
            },
        }

    def to_pandas(self) -> pandas.DataFrame:
        """One row a cause of what the second log shows, as of `Diagnosis`."""
        return self.after.to_pandas()

    def __str__(self) -> str:
        return f"{self.sentence}\n{self.after}"

    __repr__ = __str__


def what_changed(
    plant: Plant,
    before: Log,
    after: Log,
    *,
    threshold: float = 0.03,
    jobs: int | None = None,
    watch: Watch | None = None,
    check: bool = True,
) -> Change:
    """Diagnose `after` against the plant that explains `before`: what both logs show is no cause.

    The plant is brought to the rig as it was: with the causes that `before` shows, or, where it has no gap or none was
    named, with its nominal parameters refitted within what a modeller gets wrong.

    Parameters
    ----------
    plant, threshold, jobs, watch, check: as for `diagnose`.
    before, after: logs of the same rig under the same load.

    Returns
    -------
    Change.

    Raises
    ------
    InputError: as `diagnose`, and the same log twice.
    """
    if before is after or (before.path is not None and before.path == after.path):
        raise InputError(f"{after.path or 'the log'}: is given as the log before and the one after; give two logs")
    before, after = named([before, after])
    told = _told(watch, "before")
    first = diagnose(plant, before, threshold=threshold, jobs=jobs, watch=told, check=check)
    rig, brought = _rig(first)
    second = diagnose(rig, after, threshold=threshold, jobs=jobs, watch=_told(watch, "after"), check=check)
    return Change(first, second, rig, brought)


def _told(watch: Watch | None, word: str) -> Watch | None:
    if watch is None:
        return None
    return lambda stage, done, total: watch(f"{word}: {stage}", done, total)


def _rig(first: Diagnosis) -> tuple[Plant, str]:
    """The plant as the first log shows it, and how it came about."""
    if first.improved is not None:
        names = " and ".join(cause.name for cause in first.effects)
        return first.improved, f"the rig differed from the plant by {names}, which is no change"
    if first.verdict == "no_gap":
        why = "the log had no gap that matters"
    else:
        why = "no cause was named for the gap"
    return _refitted(first), f"{why}; the nominal parameters were refitted to it within their priors"


def _refitted(first: Diagnosis) -> Plant:
    """The plant with nominal parameters at their best in the whole log, under the same priors as any hypothesis."""
    plant, log, noise = first.plant, first.log, first.noise_sd
    twin = whole(plant, with_every_effect(plant), log, noise).twin
    metric = Metric.of(twin, noise)
    lumped = without_dry_friction(twin.plant)
    nominal, columns = Nominal.of(twin, metric, first.threshold, lumped=lumped)
    found = refit(Bench(twin, metric, nominal), (), {}, columns, steps=8, fresh=2)
    return plant if found is None else improved(plant, (), found.values, {})
