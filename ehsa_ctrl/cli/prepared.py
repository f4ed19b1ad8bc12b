"""A log as a command uses it: read through the plant's [log], prepared as the options ask, and what was done said."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from ..core.log import Log
    from ..identification.preparation import Preparation, Step
    from ..plant.plant import Plant


#: Steps of time that differ by this share were not even.
UNEVEN = 1e-3


class Prepared(NamedTuple):
    """A log as it was read, as it is used, and what was done to it."""

    raw: Log
    log: Log
    steps: tuple[Step, ...]

    @property
    def stated(self) -> list[dict[str, Any]]:
        """The steps as JSON has them under `preparation`."""
        return [{"log": str(self.raw.path), **step.to_dict()} for step in self.steps]

    def cautioned(self) -> list[dict[str, Any]]:
        """`stated` for a diagnosis; what that has to be taken with is said on standard error too."""
        from .output import warn

        if not self.caution:
            return self.stated
        warn(self.caution)
        return [*self.stated, {"log": str(self.raw.path), "kind": "caution", "words": self.caution}]

    @property
    def caution(self) -> str:
        """What resampling does to a diagnosis, in a sentence; empty where it did nothing."""
        import numpy as np

        rates = [step.figures["rate"] / step.figures["rate_before"] for step in self.steps if step.kind == "resample"]
        steps = np.diff(self.raw.time)
        uneven = float(np.ptp(steps)) > UNEVEN * float(np.median(steps))
        if not rates or (abs(rates[0] - 1.0) < 1e-6 and not uneven):
            return ""
        size = "3 to 10 % where the drive changes at every sample" if uneven else "1 to 5 %"
        return (
            f"{self.raw.path}: resampling makes a gap of its own, of about {size}, because it blurs the drive's steps "
            "and colours the sensors' noise; don't believe a cause of that size, or set --threshold above it"
        )


def read_prepared(path: Path, plant: Plant, how: Preparation, *, tell: bool = True) -> Prepared:
    """Read and prepare one log; `tell` says on standard error what was assumed in reading it.

    Raises InputError as `read_plant_log` and `Preparation.apply` do.
    """
    from ..core.errors import InputError
    from ..core.log import CHANNELS

    if str(path) in CHANNELS and not path.exists():
        raise InputError(f"{path}: no such log; channels are separated by commas without blanks, as in --zero p1,p2")
    return prepared(read_raw(path, plant, how), plant, how, tell=tell)


def read_raw(path: Path, plant: Plant, how: Preparation) -> Log:
    """A log as it stands; where it can't be read as a whole, the rows that --from and --to leave.

    Raises InputError as `read_plant_log`.
    """
    from ..core.errors import InputError
    from ..identification.plant_log import read_plant_log

    uniform = how.resample is None
    try:
        return read_plant_log(path, plant, uniform=uniform)
    except InputError:
        if how.from_ is None and how.to is None:
            raise
        return read_plant_log(path, plant, uniform=uniform, span=(how.from_, how.to))


def prepared(raw: Log, plant: Plant, how: Preparation, *, tell: bool = True) -> Prepared:
    """Prepare a log that was read; as `read_prepared`."""
    if tell:
        say_notes(raw)
    ready, steps = how.apply(raw, plant)
    return Prepared(raw, replace(ready, path=raw.path, missing=raw.missing), steps)


def sentences(stated: Iterable[Mapping[str, Any]], *, read: bool = True) -> list[str]:
    """What was done to which log; without `read` not what standard error has: how it was read, and cautions."""
    from ..core.text import unique_names

    lines, stated = [], list(stated)
    names = unique_names([step["log"] for step in stated])
    for name, step in zip(names, stated, strict=True):
        if step["kind"] not in ("read", "caution"):
            lines.append(f"{name}: {step['words']}")
        elif read:
            lines.append(str(step["words"]))
    return lines


def whole(how: Preparation) -> Preparation:
    """The same for a log beside the one that --from and --to are meant for."""
    return replace(how, from_=None, to=None)


def say_notes(log: Log) -> None:
    """What was assumed in reading a log, on standard error."""
    from .output import note

    for sentence in log.notes:
        note(sentence)
