"""What changed between two logs of the same rig: the second is held against the plant that explains the first."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.log import Log
from ..plant.plant import Plant
from .diagnose import Watch, diagnose
from .diagnosis import Cause, Diagnosis
from .fit import Bench, Metric, Nominal, refit
from .held_out import whole
from .improved import improved
from .twin import with_every_effect


@dataclass(frozen=True)
class Change:
    """What changed between two logs.

    Attributes
    ----------
    before: the first log against the plant as believed.
    after: the second log against `rig`; its causes are what changed.
    rig: the plant brought to the first log. brought: how, in words.
    corrected: channels of the second log from which an error of the sensor was taken off, that the first one shows.
    """

    before: Diagnosis
    after: Diagnosis
    rig: Plant
    brought: str
    corrected: tuple[str, ...] = ()

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
        else:
            first = f"Something changed between the logs. {self.after.sentence}"
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
                "corrected": list(self.corrected),
            },
        }

    def __str__(self) -> str:
        return f"{self.sentence}\n{self.after}"

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


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
    told = _told(watch, "before")
    first = diagnose(plant, before, threshold=threshold, jobs=jobs, watch=told, check=check)
    rig, brought = _rig(first)
    rig, corrected, channels = _sensors_right(first, rig, after)
    second = diagnose(rig, corrected, threshold=threshold, jobs=jobs, watch=_told(watch, "after"), check=check)
    return Change(first, second, rig, brought, channels)


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
    lumped = twin.plant["A_FM"] + twin.plant["A_FR"] == 0.0
    nominal, columns = Nominal.of(twin, metric, first.threshold, lumped=lumped)
    found = refit(Bench(twin, metric, nominal), (), {}, columns, steps=8, fresh=2)
    return plant if found is None else improved(plant, (), found.values, {})


def _sensors_right(first: Diagnosis, rig: Plant, after: Log) -> tuple[Plant, Log, tuple[str, ...]]:
    """Take a sensor's bias and scale, and all errors of the logged current, off the second log and out of the plant.

    The search for causes takes a bias of 0 and a scale of 1 for what is believed, and the logged current for what
    drives the rig.
    """
    values = first.values["with_effects"] if first.improved is not None else {}
    channels, sensors, changed = dict(after.channels), dict(rig.sensors), []
    for channel in after.channels:
        bias, scale = values.get(f"bias.{channel}", 0.0), values.get(f"scale.{channel}", 1.0)
        if (bias, scale) != (0.0, 1.0):
            channels[channel] = (channels[channel] - bias) / scale
            changed.append(channel)
        if channel in sensors:
            sensors[channel] = replace(sensors[channel], bias=first.plant.sensors[channel].bias)
            sensors[channel] = replace(sensors[channel], scale=first.plant.sensors[channel].scale)
    if "delay.current" in values or "filter.current" in values:
        channels["current"] = _asked(channels["current"], values, after.sample_time)
        changed.append("current")
        if "current" in sensors:
            sensors["current"] = first.plant.sensors["current"]
    log = replace(after, channels=channels) if changed else after
    return replace(rig, sensors=sensors), log, tuple(dict.fromkeys(changed))


def _asked(current: np.ndarray, values: Mapping[str, float], sample_time: float) -> np.ndarray:
    """The current (N,) [A] that was there when a late or filtered one was logged."""
    index = np.arange(current.size)
    current = np.interp(index + values.get("delay.current", 0.0) / sample_time, index, current)
    lag = values.get("filter.current", 0.0)
    if lag > 0.0:
        a = np.exp(-sample_time / lag)
        current = np.concatenate([current[:1], (current[1:] - a * current[:-1]) / (1.0 - a)])
    return current
