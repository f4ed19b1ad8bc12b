"""What a diagnosis measured and simulated, signal by signal, as figures and tables take it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..diagnosis.diagnosis import Diagnosis
from ..diagnosis.signals import SIGNALS, rod_velocity
from .channel import Shown, shown

if TYPE_CHECKING:
    import pandas

#: Length of the part that is shown in detail [s].
DETAIL = 1.5


@dataclass(frozen=True)
class Trace:
    """A signal (N,) in SI units, measured and simulated; all of it nan where a run stopped, None where there is none.

    scored: whether it has a gap; position drifts in free run and is shown alone.
    """

    name: str
    how: Shown
    measured: np.ndarray
    before: np.ndarray | None
    after: np.ndarray | None
    scored: bool


def signal_shown(signal: str) -> Shown:
    """Words and unit of a scored signal."""
    return shown("velocity" if signal == "rod_velocity" else signal)


def after_model(diagnosis: Diagnosis) -> str | None:
    """The model that is shown as "after": with causes where some are named, else refitted, none without a gap."""
    if diagnosis.verdict == "no_gap":
        return None
    return "with_effects" if diagnosis.verdict in ("effect", "ambiguous") else "refit"


def after_words(diagnosis: Diagnosis) -> str:
    """What the run afterwards is with."""
    if after_model(diagnosis) == "with_effects":
        return f"with the cause{'s' if len(diagnosis.effects) > 1 else ''} found"
    return "with nominal parameters refitted"


def models_shown(diagnosis: Diagnosis) -> list[str]:
    """The models whose gaps say something: without named causes there is nothing that has them."""
    without = {"no_gap": ("refit", "with_effects", "upper_bound"), "effect": (), "ambiguous": ()}
    left_out = without.get(diagnosis.verdict, ("with_effects",))
    return [model for model in diagnosis.gap if model not in left_out]


def traces(diagnosis: Diagnosis) -> list[Trace]:
    """Every scored signal of the log, and the position where the plant gives one."""
    log = diagnosis.log
    names = [name for name in SIGNALS if name in diagnosis.whole]
    names += ["position"] if "position" in {*log.channels} & {*diagnosis.plant.structure.system.outputs} else []
    after = after_model(diagnosis)
    return [
        Trace(
            name,
            signal_shown(name),
            _signal(name, log.channels, log.sample_time),
            _run(diagnosis, "nominal", name),
            None if after is None else _run(diagnosis, after, name),
            scored=name != "position",
        )
        for name in names
    ]


def _signal(name: str, channels: Mapping[str, np.ndarray], sample_time: float) -> np.ndarray:
    if name == "rod_velocity":
        return rod_velocity(channels["position"], sample_time)
    return np.asarray(channels[name])


def _run(diagnosis: Diagnosis, model: str, name: str) -> np.ndarray:
    """A signal of a free run; nan where the run stopped and was not kept."""
    if model not in diagnosis.simulated:
        return np.full(len(diagnosis.log), np.nan)
    return _signal(name, diagnosis.simulated[model], diagnosis.log.sample_time)


def widest(diagnosis: Diagnosis) -> slice:
    """Samples of the stretch in which what was believed is farthest off, all scored signals together."""
    log = diagnosis.log
    width = min(max(int(round(DETAIL / log.sample_time)), 2), len(log))
    off = np.zeros(len(log))
    for trace in traces(diagnosis):
        spread = float(np.std(trace.measured))
        if trace.scored and trace.before is not None and spread > 0.0:
            off += np.nan_to_num((trace.measured - trace.before) / spread) ** 2
    sums = np.cumsum(np.concatenate([[0.0], off]))
    first = int(np.argmax(sums[width:] - sums[:-width]))
    return slice(first, first + width)


def signals_table(diagnosis: Diagnosis) -> pandas.DataFrame:
    """A row a sample, SI units: t, the drive, and each signal measured, before (as believed) and after."""
    import pandas

    log, drive = diagnosis.log, diagnosis.plant.structure.system.drive
    columns = {"t": log.time, drive: log[drive]}
    for trace in traces(diagnosis):
        columns[trace.name] = trace.measured
        for word, values in (("before", trace.before), ("after", trace.after)):
            if values is not None:
                columns[f"{trace.name}_{word}"] = values
    return pandas.DataFrame(columns)
