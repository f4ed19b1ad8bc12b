"""The stretches of long logs in which effects and laws are searched; the best are then fitted to all training data.

A search takes some thousand simulations, whose time grows with the log, and a minute of motion tells the effects apart
nearly as well as ten. The stretch is the one that moves most, with most of the gap, in as many independent ways as
possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.text import join_words
from ..plant.plant import Plant
from .records import Record, Segment
from .signals import scored_signals
from .validation_segment import has_unmeasured_state, part_of_log

# The numbers below are engineering judgement.

#: Training data longer than this [s] is searched in a stretch of SEARCHED [s], which several logs share, but of at
#: least SHORTEST_STRETCH [s] of each.
LONG, SEARCHED, SHORTEST_STRETCH = 100.0, 60.0, 10.0
#: Number of stretches of a part that are compared, each shifted by the same time.
COMPARED = 40
#: Variance, relative to that over the part, that is added in every direction: it is too little to tell anything.
NOTHING = 1e-3


def search_segment(plants: Sequence[Plant], training: Segment) -> Segment:
    """The training (or held-out) data, or the stretches of it in which to search if it is long.

    plants: nominal, of each log.
    """
    seconds = [sum(record.lengths) * record.model.log.sample_time for record in training.records]
    if sum(seconds) <= LONG:
        return training
    share = max(SEARCHED / len(seconds), SHORTEST_STRETCH)
    found, words = [], []
    for plant, record in zip(plants, training.records, strict=True):
        log = record.model.log
        stretch = _stretch(plant, record, int(share / log.sample_time))
        if stretch is not None:
            record = part_of_log(plant, record.model, record.noise, [stretch])
            words.append(f"from {log.time[stretch.start]:.4g} to {log.time[stretch.stop - 1]:.4g} s of {log.name}")
        found.append(record)
    return replace(training, records=tuple(found), name=join_words(words)) if words else training


def _stretch(plant: Plant, record: Record, length: int) -> slice | None:
    """The `length` samples that tell most.

    None if the record has no more, its nominal run stops, or a stretch would save little.
    """
    (run,) = record.model.run([{}])
    longest = max(zip(record.lengths, record.parts, strict=True), key=lambda pair: pair[0])[1]
    begin, end, _ = longest.indices(len(record.model.log))
    if run is None or end - begin <= length:
        return None
    if has_unmeasured_state(plant, record.model.log):
        # Such a state is known only where the log begins, from where each run starts: after other data, a stretch
        # would save little.
        return slice(0, length) if begin == 0 else None
    log, of_system = record.model.log, plant.structure.system.scored
    measured, simulated = (scored_signals(of_system, values, log.sample_time) for values in (log.channels, run))
    rows = np.array([*measured.values(), *(measured[name] - simulated[name] for name in simulated)])[:, begin:end]
    spread = np.std(rows, axis=1, keepdims=True)
    rows = (rows - np.mean(rows, axis=1, keepdims=True)) / np.where(spread > 0.0, spread, 1.0)
    starts = np.unique(np.linspace(0, end - begin - length, COMPARED).astype(int))
    told = [_log_volume(rows[:, start : start + length]) for start in starts]
    start = begin + int(starts[int(np.argmax(told))])
    return slice(start, start + length)


def _log_volume(rows: np.ndarray) -> float:
    """Logarithm of the volume that samples (n, N) span: that of the determinant of their covariance."""
    return float(np.linalg.slogdet(np.cov(rows) + NOTHING * np.eye(len(rows)))[1])
