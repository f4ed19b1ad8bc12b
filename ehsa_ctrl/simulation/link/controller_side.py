"""The controller's side of a link: one current for each packet of readings.

A packet that was answered before gets the same answer again. Samples whose packets never arrived are run with lost
readings, so that the controller's memory keeps its time and its supervision sees the loss. After the watchdog's time of
lost samples, or without a packet in real time, the safe current is the answer until the end of the run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from ...core.controller_interface import MEASURED, REFERENCE, Controller
from ...core.errors import InputError
from ...core.watchdog import Watchdog
from . import PATIENCE
from .endpoint import Endpoint
from .latency import LatencyHistogram
from .packet import CURRENT, END, SAFE, Packet
from .summary import LinkSummary

if TYPE_CHECKING:
    import pandas


@dataclass
class ControllerSide:
    """A controller that answers packets.

    Attributes
    ----------
    endpoint: bound socket. controller: computes the currents. watchdog: timeout and safe current.
    reference: (N, 3) or (N, 4) of each sample, the last one held afterwards; None takes that of the packets.
    period: wall-clock time of a sample [s]; None for lock-step. patience: s to wait for a packet.
    rows: sequence, reference (4), readings (5) and current of each sample so far.
    """

    endpoint: Endpoint
    controller: Controller
    watchdog: Watchdog
    reference: np.ndarray | None = None
    period: float | None = None
    patience: float = PATIENCE
    rows: list[list[float]] = field(default_factory=list)
    _memory: np.ndarray = field(default_factory=lambda: np.zeros(0))
    _next: int = 0
    _answered: set[int] = field(default_factory=set)
    _answer: Packet | None = None
    _tripped: str = ""
    _missed: int = 0
    _times: list[float] = field(default_factory=list)

    def warm_up(self) -> None:
        """Run one sample and forget it: what it compiles or loads would delay the first answer."""
        self.controller.step(np.zeros(4), np.zeros(len(MEASURED)), self.controller.initial_memory())

    def serve(self, started: Callable[[tuple[str, int]], None] = lambda peer: None) -> LinkSummary:
        """Answer until the plant's side leaves, is silent for `patience`, or Ctrl-C; then close the socket.

        started: called with the peer at its first packet.

        Raises InputError if nobody sends within `patience`, and for readings without a reference where none is known.
        """
        self._memory = self.controller.initial_memory()
        try:
            ended = self._answer_all(started)
        except KeyboardInterrupt:
            ended = "interrupted"
        finally:
            if self.endpoint.peer is not None:
                self.endpoint.send(Packet(END, int(self.endpoint.run or 0), self._next))
            self.endpoint.close()
        self.endpoint.counts.lost = self._missed - self.endpoint.counts.late
        latencies = (LatencyHistogram("from readings to answer", np.array(self._times)),)
        return LinkSummary(
            "controller", self._next, self.period, self.endpoint.counts, self._missed, self._tripped, ended, latencies
        )

    def to_pandas(self) -> pandas.DataFrame:
        """One row per sample that the controller ran: sequence, reference, readings (nan where lost), current."""
        import pandas

        reference = [f"reference_{name}" for name in (*REFERENCE, "force")]
        return pandas.DataFrame(self.rows, columns=["sequence", *reference, *MEASURED, "current"])

    def _answer_all(self, started: Callable[[tuple[str, int]], None]) -> str:
        heard = monotonic()
        while True:
            watched = self.period is not None and self.endpoint.peer is not None and not self._tripped
            packet = self.endpoint.receive(heard + (self._silence if watched else self.patience))
            if packet is None and watched:
                self._trip(f"no readings for {1e3 * self._silence:.4g} ms")
                # Unasked: the plant's side may still hear this one.
                self._send(max(self._next - 1, 0), self.watchdog.safe_current)
                continue
            if packet is None:
                if self.endpoint.peer is None:
                    raise InputError(
                        f"port {self.endpoint.port}: no readings within {self.patience:g} s; start the plant's side, "
                        f"e.g. ehsa-ctrl serve --plant ehsa --port {self.endpoint.port}, or wait longer with --patience"
                    )
                return f"no packet for {self.patience:g} s"
            begun = heard = monotonic()
            if packet.kind == END:
                return "the plant's side ended the run"
            if self._answer is None:
                started(self.endpoint.peer or ("", 0))
            if packet.sequence == self._next - 1 and self._answer is not None:
                self.endpoint.counts.repeated += 1
                self.endpoint.send(self._answer)
            elif packet.sequence in self._answered:
                self.endpoint.counts.repeated += 1
            elif packet.sequence < self._next:
                self.endpoint.counts.late += 1
                self._answered.add(packet.sequence)
            else:
                self._sample(packet)
                self._times.append(monotonic() - begun)

    @property
    def _silence(self) -> float:
        """The watchdog's time by the wall clock [s]."""
        return self.watchdog.timeout * (self.period or 0.0) / self.controller.sample_time

    def _sample(self, packet: Packet) -> None:
        """Run the samples up to this packet, and answer it."""
        gap = packet.sequence - self._next
        self._missed += gap
        if gap * self.controller.sample_time >= self.watchdog.timeout * (1.0 - 1e-9):
            self._trip(f"{gap} samples without readings")
        if self._tripped:
            current = self.watchdog.safe_current
        else:
            given = np.array(packet.numbers[len(MEASURED) :])
            for k in range(self._next, packet.sequence):
                self._step(k, given, np.full(len(MEASURED), np.nan))
            current = self._step(packet.sequence, given, np.array(packet.numbers[: len(MEASURED)]))
        self._next = packet.sequence + 1
        self._answered.add(packet.sequence)
        self._send(packet.sequence, current)

    def _step(self, k: int, given: np.ndarray, measured: np.ndarray) -> float:
        if self.reference is None:
            reference = given
            if not np.isfinite(reference).all():
                raise InputError(
                    f"sample {k}: the readings come without a reference (nan); give one on this side with --scenario"
                )
        else:
            row = self.reference[min(k, len(self.reference) - 1)]
            reference = np.append(row, [0.0] * (4 - row.size))
        current = self.controller.step(reference, measured, self._memory)
        if not np.isfinite(current):
            self._trip(f"{self.controller.name} gave {current} A")
            current = self.watchdog.safe_current
        self.rows.append([k, *reference.tolist(), *measured.tolist(), current])
        return float(current)

    def _trip(self, why: str) -> None:
        at, current = self._next * self.controller.sample_time, self.watchdog.safe_current
        self._tripped = self._tripped or f"{why}; {current:g} A from sample {self._next} on, at {at:g} s"

    def _send(self, sequence: int, current: float) -> None:
        self._answer = Packet(CURRENT, int(self.endpoint.run or 0), sequence, (current,), SAFE if self._tripped else 0)
        self.endpoint.send(self._answer)
