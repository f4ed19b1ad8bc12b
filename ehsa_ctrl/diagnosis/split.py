"""The part of a log that is held out: one in which, and beside which, the log moves and has a gap.

The last third is held out where that holds. A servo may stand still there, and a valve or an end stop may act there
alone; then another part is held out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.log import Log
from ..core.text import join_words
from .records import Record

# The numbers below are engineering judgement.

#: Share of a log that is held out.
HELD_OUT = 1.0 / 3.0
#: A part shows a signal whose standard deviation is this share of that over the whole log. On 117 logs of benches the
#: smallest share of the last third is 0.22; on servo records that end at rest it is 0.00 to 0.14.
EXCITED = 0.15
#: A part has no gap if the largest of a signal is below this share of the threshold.
NO_GAP = 0.5
#: Largest ratio of the gaps of both parts: beyond it, a valve or an end stop acts mainly in one of them. On 117 logs of
#: benches four exceed it.
UNEVEN = 4.0
#: Number of blocks of which every third is held out where no third will do.
BLOCKS = 9


@dataclass(frozen=True)
class Split:
    """Training and held-out samples of a log. name: of the held-out part."""

    name: str
    training: tuple[slice, ...]
    held_out: tuple[slice, ...]

    def words(self, log: Log) -> str:
        """The held-out part in words."""
        times = log.time
        if self.held_out[-1].stop == len(log) and len(self.held_out) == 1:
            span = f"from {times[self.held_out[0].start]:g} s on"
        else:
            spans = [f"{times[part.start]:g} to {times[part.stop - 1]:g} s" for part in self.held_out]
            span = f"from {join_words(spans)}"
        return f"{self.name} of {log.name if log.path else 'the log'}, {span}"

    def spans(self, log: Log) -> tuple[tuple[float, float], ...]:
        """Start and end [s] of each held-out part."""
        return tuple((float(log.time[part.start]), float(log.time[part.stop - 1])) for part in self.held_out)


def thirds(samples: int) -> tuple[Split, ...]:
    """The splits of a log that hold out one third: the last, the first, the middle one."""
    edge = int(round(samples * (1.0 - HELD_OUT)))
    first = samples - edge
    return (
        Split("the last third", (slice(0, edge),), (slice(edge, samples),)),
        Split("the first third", (slice(first, samples),), (slice(0, first),)),
        Split("the middle third", (slice(0, first), slice(edge, samples)), (slice(first, edge),)),
    )


def splits(samples: int) -> tuple[Split, ...]:
    """The splits of a log, in the order of preference."""
    edges = np.round(np.linspace(0.0, samples, BLOCKS + 1)).astype(int).tolist()
    blocks = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    training = tuple(slice(edges[k], edges[k + 2]) for k in range(0, BLOCKS, 3))
    return (*thirds(samples), Split("every third ninth", training, tuple(blocks[2::3])))


def choose_split(
    whole: Record, threshold: float, nominal_gaps: Callable[[Split], tuple[float, float]] | None = None
) -> Split:
    """The split of a log: the first of `splits` whose parts both move and have a gap of about the same size.

    nominal_gaps: largest gap of the nominal model on training and held-out data of a split; by default gaps play no
        part. If no split is like that, the most even one whose training data has a gap.
    """
    candidates = splits(len(whole.model.log))
    excited = [split for split in candidates if excitation(whole, split) >= EXCITED]
    if not excited:
        return max(candidates, key=lambda split: excitation(whole, split))
    if nominal_gaps is None:
        return excited[0]
    fitted: list[tuple[float, Split]] = []
    for split in excited:
        training, held_out = nominal_gaps(split)
        if training >= NO_GAP * threshold:
            uneven = max(training, held_out) / max(min(training, held_out), 1e-9)
            if held_out >= NO_GAP * threshold and uneven <= UNEVEN:
                return split
            fitted.append((uneven, split))
    return min(fitted, key=lambda pair: pair[0])[1] if fitted else excited[0]


def excitation(whole: Record, split: Split) -> float:
    """Standard deviation of a signal in the part in which it moves least, as a share of that over the whole log.

    Of the signal for which this is smallest; signals that stand still in the whole log do not count.
    """
    shares = [1.0]
    for values in whole.measured.values():
        spread = float(np.std(values))
        shares += [_spread(values, parts) / spread for parts in (split.training, split.held_out)]
    return min(shares)


def _spread(values: np.ndarray, parts: Sequence[slice]) -> float:
    return float(np.std(np.concatenate([values[part] for part in parts])))
