"""What a side of a link counted and measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...core.result import Result, as_dict
from .endpoint import PacketCounts
from .latency import LatencyHistogram


@dataclass(frozen=True, repr=False)
class LinkSummary(Result):
    """Result of one side.

    Attributes
    ----------
    side: "plant" or "controller". samples: of the run. period: wall-clock time of a sample [s]; None for lock-step.
    packets: counts. missed: samples without an answer in time (plant), or without readings (controller).
    tripped: why the safe output acts, and from which sample on; empty if it does not.
    ended: why the run ended. latencies: histograms.
    """

    side: str
    samples: int
    period: float | None
    packets: PacketCounts
    missed: int
    tripped: str
    ended: str
    latencies: tuple[LatencyHistogram, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as in the JSON file."""
        return as_dict(self)

    def __str__(self) -> str:
        pace = "in lock-step" if self.period is None else f"in real time, {1e3 * self.period:g} ms a sample"
        lines = [f"{self.side}: {self.samples} samples {pace}; {self.ended}", f"  {self.packets}"]
        what = "an answer in time" if self.side == "plant" else "readings"
        lines.append(f"  {self.missed} samples without {what}")
        if self.tripped:
            lines.append(f"  SAFE OUTPUT: {self.tripped}")
        for histogram in self.latencies:
            lines += [f"  {line}" for line in str(histogram).splitlines()]
        return "\n".join(lines)
