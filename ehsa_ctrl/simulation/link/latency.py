"""Histograms of times from about a microsecond to seconds, in bins of 1, 2, 5 times a power of ten."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

#: Edges of the bins [s], from 1 us to 1 s.
EDGES = np.array([base * 10.0**power for power in range(-6, 0) for base in (1.0, 2.0, 5.0)] + [1.0])
#: Width of the longest bar [characters].
WIDTH = 40


@dataclass(frozen=True)
class LatencyHistogram:
    """Distribution of a time.

    Attributes
    ----------
    title: what was measured. times: (N,) s.
    """

    title: str
    times: np.ndarray

    @property
    def counts(self) -> np.ndarray:
        """Number of times per bin: below the first edge, between two edges, from the last edge on."""
        return np.bincount(np.searchsorted(EDGES, self.times, side="right"), minlength=EDGES.size + 1)

    def to_dict(self) -> dict[str, Any]:
        """Quantiles [s] and the histogram; None where nothing was measured."""
        words = ("median", "p99", "max")
        values = np.quantile(self.times, [0.5, 0.99, 1.0]).tolist() if self.times.size else [None] * 3
        return {
            "title": self.title,
            "samples": int(self.times.size),
            **dict(zip(words, values, strict=True)),
            "edges": EDGES.tolist(),
            "counts": self.counts.tolist(),
        }

    def __str__(self) -> str:
        if not self.times.size:
            return f"{self.title}: nothing measured"
        values = ", ".join(
            f"{word} {_text(value)}"
            for word, value in zip(
                ("median", "99 %", "largest"), np.quantile(self.times, [0.5, 0.99, 1.0]).tolist(), strict=True
            )
        )
        lines, counts = [f"{self.title}: {values}"], self.counts
        filled = np.flatnonzero(counts)
        for k in range(int(filled[0]), int(filled[-1]) + 1):
            label = f"below {_text(EDGES[0])}" if k == 0 else f"from {_text(EDGES[k - 1])}"
            bar = "#" * int(np.ceil(WIDTH * counts[k] / counts.max()))
            lines.append(f"  {label:<13}{counts[k]:>8} {bar}".rstrip())
        return "\n".join(lines)


def _text(seconds: float) -> str:
    """A time in the unit that a person reads."""
    unit, scale = ("us", 1e6) if seconds < 1e-3 else ("ms", 1e3) if seconds < 1.0 else ("s", 1.0)
    return f"{seconds * scale:.3g} {unit}"
