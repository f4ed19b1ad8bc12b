"""What changed between two logs of the same rig: the second is compared with the plant that explains the first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError
from ..core.log import Log, named
from ..core.result import Result, as_dict
from ..plant.plant import Plant
from .diagnose import diagnose
from .diagnosis import Cause, Diagnosis
from .hypothesis_model import with_every_effect
from .hypothesis_search import Watch
from .improved_plant import improved_plant
from .refit import objective_of, refit_nominal
from .validation_segment import whole_log

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False)
class Change(Result):
    """What changed between two logs.

    Attributes
    ----------
    before: the first log against the nominal plant.
    after: the second log against `rig`; its causes are what changed.
    rig: the plant adapted to the first log. brought: how, in words.
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
            # What the first log leaves unexplained is in the second log too.
            first = f"Whether anything changed can't be told: no cause was found for either log. {self.after.sentence}"
        return f"{first} Before, {self.brought}."

    def to_dict(self) -> dict[str, Any]:
        """As diagnosis.json: that of the second log, with the first under `before`."""
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
        """One row a cause of what the second log shows, as of `Diagnosis`."""
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
) -> Change:
    """Diagnose `after` against the plant that explains `before`: what both logs show is no cause.

    The plant is adapted to the first log: with the causes that it shows, or, where it has no gap or none was named,
    with the nominal parameters refitted within their priors.

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
    first = diagnose(plant, before, threshold=threshold, jobs=jobs, watch=_labelled(watch, "before"), check=check)
    rig, brought = _adapted(first)
    second = diagnose(rig, after, threshold=threshold, jobs=jobs, watch=_labelled(watch, "after"), check=check)
    return Change(first, second, rig, brought)


def _labelled(watch: Watch | None, word: str) -> Watch | None:
    if watch is None:
        return None
    return lambda stage, done, total: watch(f"{word}: {stage}", done, total)


def _adapted(first: Diagnosis) -> tuple[Plant, str]:
    """The plant adapted to the first log, and how."""
    if first.improved is not None:
        names = " and ".join(cause.name for cause in first.effects)
        return first.improved, f"the rig differed from the plant by {names}, which is no change"
    if first.verdict == "no_gap":
        why = "the log had no gap that matters"
    else:
        why = "no cause was named for the gap"
    return _refitted(first), f"{why}; the nominal parameters were refitted to it within their priors"


def _refitted(first: Diagnosis) -> Plant:
    """The plant with nominal parameters refitted to the whole log, under the same priors as any hypothesis."""
    plant, noise = first.plant, first.noise_sd
    model = whole_log(plant, with_every_effect(plant), first.log, noise).model
    values = refit_nominal(*objective_of(model, noise, first.threshold))
    return improved_plant(plant, (), values, {}) if values else plant
