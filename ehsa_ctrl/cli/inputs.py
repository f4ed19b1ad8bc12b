"""Read the plants and logs that commands get: --set, --model, preparation of logs, notes and warnings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.log import CHANNELS
from ..core.text import unique_names
from ..identification.plant_log import read_plant_log
from ..plant.load import has_setting, load_plant, models_of
from .options import OneModel, OneOrBoth
from .output import note, warn, warn_implausible

if TYPE_CHECKING:
    from ..core.log import Log
    from ..identification.preparation import Preparation, Step
    from ..plant.plant import Plant

#: Range of the sample intervals over their median above which sampling counts as uneven; as in Preparation.
UNEVEN = 1e-3
#: Below this rate [Hz] the drive of a rig like the EHSA changes much between two samples.
SLOW = 80.0


def load_model(plant: str, model: OneModel, settings: Mapping[str, str]) -> Plant:
    """Load one model of a plant with --set; warn of implausible values. Raises InputError as load_plant does."""
    loaded = load_plant(plant, model=model, settings=settings)
    warn_implausible([loaded])
    return loaded


def load_models(plant: str, model: OneOrBoth, settings: Mapping[str, str]) -> list[Plant]:
    """Load one model or both; with "both", a setting applies to those models that have the parameter.

    Raises InputError as load_plant does, and for a setting that no model has.
    """
    if model != "both":
        return [load_model(plant, model, settings)]
    nominal = [load_plant(plant, model=word) for word in models_of(plant)]
    for key in settings:
        if not any(has_setting(each, key) for each in nominal):
            load_plant(plant, model=nominal[-1].model, settings={key: settings[key]})
    loaded = [
        load_plant(plant, model=each.model, settings={key: settings[key] for key in settings if has_setting(each, key)})
        for each in nominal
    ]
    warn_implausible(loaded)
    return loaded


@dataclass(frozen=True)
class LogWithSteps:
    """A log as read (`raw`) and as prepared (`log`), with the preparation steps."""

    raw: Log
    log: Log
    steps: tuple[Step, ...]

    def step_dicts(self) -> list[dict[str, Any]]:
        """Content of `preparation` in a result's JSON."""
        return [{"log": str(self.raw.path), **step.to_dict()} for step in self.steps]

    def diagnosis_step_dicts(self) -> list[dict[str, Any]]:
        """`step_dicts` with a caution about resampling, which is also printed as a warning."""
        caution = self._caution()
        if not caution:
            return self.step_dicts()
        warn(caution)
        return [*self.step_dicts(), {"log": str(self.raw.path), "kind": "caution", "words": caution}]

    def _caution(self) -> str:
        """Warning about the gap that resampling causes; empty if the log was not resampled."""
        rates = [step.figures["rate"] / step.figures["rate_before"] for step in self.steps if step.kind == "resample"]
        steps = np.diff(self.raw.time)
        uneven = float(np.ptp(steps)) > UNEVEN * float(np.median(steps))
        merged = any(step.kind == "rates" for step in self.steps)
        if not merged and (not rates or (abs(rates[0] - 1.0) < 1e-6 and not uneven)):
            return ""
        slow = any(step.figures["rate"] < SLOW for step in self.steps if step.kind == "resample")
        # Measured on a log of the EHSA with noise of the current: 2 % at 125 Hz, 3 at 100, 11 at 50, 37 at 25 Hz.
        size = "3 to 10 % where the drive changes at every sample" if uneven else "1 to 5 %"
        size = "10 % at 50 Hz and 40 % at 25 Hz, where the drive changes faster" if slow else size
        return (
            f"{self.raw.path}: resampling alone causes a gap of about {size}, because it smooths the steps of the "
            "current and colours the sensor noise; ignore a cause of that size, or set --threshold above it"
        )


def read_prepared(path: Path, plant: Plant, how: Preparation, *, notes: bool = True) -> LogWithSteps:
    """Read and prepare one log. notes: print the assumptions made in reading it.

    Raises InputError as `read_plant_log` and `Preparation.apply` do.
    """
    if str(path) in CHANNELS and not path.exists():
        raise InputError(f"{path}: no such log; separate channels by commas without blanks, as in --zero p1,p2")
    return prepare(read_raw(path, plant, how), plant, how, notes=notes)


def read_raw(path: Path, plant: Plant, how: Preparation) -> Log:
    """Read a log; if the whole log is faulty, only the rows between --from and --to.

    Raises InputError as `read_plant_log` does.
    """
    uniform, step, rate = how.resample is None, how.sample_time, how.resample
    try:
        return read_plant_log(path, plant, uniform=uniform, sample_time=step, rate=rate)
    except InputError:
        if how.from_ is None and how.to is None:
            raise
        return read_plant_log(path, plant, uniform=uniform, span=(how.from_, how.to), sample_time=step, rate=rate)


def prepare(raw: Log, plant: Plant, how: Preparation, *, notes: bool = True) -> LogWithSteps:
    """Prepare a log read by `read_raw`. Raises InputError as `Preparation.apply` does."""
    if notes:
        print_notes(raw)
    ready, steps = how.apply(raw, plant)
    return LogWithSteps(raw, replace(ready, path=raw.path, missing=raw.missing), steps)


def refuse_repeated(logs: Sequence[Path]) -> None:
    """Raise InputError for a log that is given twice."""
    files = [log.resolve() for log in logs]
    for log, file in zip(logs, files, strict=True):
        if files.count(file) > 1:
            raise InputError(f"{log}: is given twice; give it once")


def whole(how: Preparation) -> Preparation:
    """The preparation without --from and --to, for a validation or earlier log, which is used whole."""
    return replace(how, from_=None, to=None)


def print_notes(log: Log) -> None:
    """Print the assumptions made in reading a log on standard error."""
    for sentence in log.notes:
        note(sentence)


def preparation_sentences(steps: Iterable[Mapping[str, Any]], *, reading: bool = True) -> list[str]:
    """Sentences on the preparation of each log. reading: include those that were printed on standard error."""
    steps = list(steps)
    lines = []
    for name, step in zip(unique_names([step["log"] for step in steps]), steps, strict=True):
        if step["kind"] not in ("read", "caution"):
            lines.append(f"{name}: {step['words']}")
        elif reading:
            lines.append(str(step["words"]))
    return lines


def fit_table(title: str, columns: Sequence[str], rows: Mapping[str, Sequence[float]]) -> str:
    """Fit in percent, a row for each entry of `rows` and a column for each model."""
    from ..identification.comparison import fit_cell

    width = max(len(title), *map(len, rows), 10) + 1
    lines = [f"{title:<{width}}" + "".join(f"{column:>12}" for column in columns)]
    lines += [f"{name:<{width}}" + "".join(f"{fit_cell(value):>12}" for value in rows[name]) for name in rows]
    return "\n".join(lines)
