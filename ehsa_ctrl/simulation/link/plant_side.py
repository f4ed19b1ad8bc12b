"""The plant's side of a link: a controller for the closed loop that asks the other side for its current.

The plant is the master of the samples: it sends the readings of sample k and waits for the current of sample k, which
then acts from that sample on, as in `run_closed_loop`. In lock-step it waits as long as the answer takes, and repeats
its packet, so that a lost one changes nothing. In real time sample k begins k periods after the start and the answer
must arrive within its period; otherwise the last current is held. After the watchdog's time without an answer, the safe
current acts until the end of the run.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import monotonic, sleep

import numpy as np

from ...core.controller_interface import REFERENCE_FORCE
from ...core.errors import InputError
from ...core.watchdog import Watchdog
from . import PATIENCE
from .endpoint import LAST_RUN, Endpoint
from .latency import LatencyHistogram
from .packet import CURRENT, END, READINGS, SAFE, Packet
from .summary import LinkSummary

#: Time after which readings without an answer are sent again, in lock-step and before the first answer [s].
RESEND = 0.05


@dataclass
class RemoteController:
    """A core.controller_interface.Controller whose step is done by the other side of a link.

    Attributes
    ----------
    endpoint: socket; its peer is the controller's side. sample_time: s.
    watchdog: timeout and safe current of the plant.
    period: wall-clock time of a sample [s]; None for lock-step.
    patience: s to wait for the first answer, and in lock-step for each.
    answered: number of samples so far, without those after an interrupt or a trip in lock-step.
    """

    endpoint: Endpoint
    sample_time: float
    watchdog: Watchdog
    period: float | None = None
    patience: float = PATIENCE
    name: str = "the other side of the link"
    compiled: Callable[..., float] | None = None
    traces: Mapping[str, int] = field(default_factory=dict)
    answered: int = 0
    interrupted: bool = False
    _tripped: str = ""
    _missed: int = 0
    _silent: int = 0
    _held: float = 0.0
    _start: float = 0.0
    _unanswered: set[int] = field(default_factory=set)
    _round_trips: list[float] = field(default_factory=list)
    _lateness: list[float] = field(default_factory=list)

    @classmethod
    def connected(
        cls, address: str, port: int, sample_time: float, watchdog: Watchdog, **options: float | None
    ) -> RemoteController:
        """A side that sends to this address and port, with a random number of the run.

        Raises InputError for an address or port that can't be used.
        """
        if port == 0:
            raise InputError("port 0; expected the port at which the controller listens, 1 to 65535")
        local = "127.0.0.1" if address.startswith("127.") else "0.0.0.0"
        endpoint = Endpoint.bound(CURRENT, local, peer=(address, port), run=secrets.randbelow(LAST_RUN))
        return cls(endpoint, sample_time, watchdog, **options)  # type: ignore[arg-type]

    def settings(self) -> np.ndarray:
        return np.zeros(0)

    def initial_memory(self) -> np.ndarray:
        """The number of the sample, of which `step` counts."""
        return np.zeros(1)

    def step(self, reference: np.ndarray, measured: np.ndarray, memory: np.ndarray) -> float:
        """Current of this sample [A]: the other side's, the last one, or the safe one.

        Raises InputError if nobody answers the first packet.
        """
        k = int(memory[0])
        memory[0] += 1.0
        if self.interrupted or (self._tripped and self.period is None):
            return self.watchdog.safe_current
        try:
            current = self._exchange(k, reference, measured)
        except KeyboardInterrupt:
            self.interrupted = True
            return self.watchdog.safe_current
        self.answered = k + 1
        return current

    def _exchange(self, k: int, reference: np.ndarray, measured: np.ndarray) -> float:
        """Send the readings of sample k at its time; the current that acts from then on [A]."""
        motion = [*reference.tolist(), *[0.0] * (REFERENCE_FORCE + 1 - reference.size)]
        flags = SAFE if self._tripped else 0
        readings = Packet(READINGS, int(self.endpoint.run or 0), k, (*measured.tolist(), *motion), flags)
        if k == 0 or self.period is None:
            answer = self._ask(readings, monotonic() + self.patience, repeat=True)
        else:
            due = self._start + k * self.period
            sleep(max(due - monotonic(), 0.0))
            self._lateness.append(max(monotonic() - due, 0.0))
            answer = self._ask(readings, due + self.period, repeat=False)
        if k == 0:
            if answer is None:
                host, port = self.endpoint.peer or ("", 0)
                raise InputError(
                    f"{host}:{port}: no answer within {self.patience:g} s; start the controller's side there, e.g. "
                    f"ehsa-ctrl serve --controller pid_position --port {port}"
                )
            self._start = monotonic()
        if answer is None:
            self._miss(k)
        else:
            self._silent, self._held = 0, answer
        return self.watchdog.safe_current if self._tripped else self._held

    def _miss(self, k: int) -> None:
        """Count a sample without an answer in time; the watchdog acts after too many in a row."""
        self._missed += 1
        self._silent += 1
        self._unanswered.add(k)
        if self.period is None:
            self._trip(f"no answer for {self.patience:g} s", k)
        elif self._silent * self.sample_time >= self.watchdog.timeout * (1.0 - 1e-9):
            self._trip(f"no answer in time for {self._silent} samples", k)

    def _trip(self, why: str, k: int) -> None:
        current = self.watchdog.safe_current
        self._tripped = self._tripped or f"{why}; {current:g} A from sample {k} on, at {k * self.sample_time:g} s"

    def _ask(self, readings: Packet, until: float, *, repeat: bool) -> float | None:
        """Send the readings; the current of their sample, or None at the time `until` or where the other side left."""
        begun, counts = monotonic(), self.endpoint.counts
        self.endpoint.send(readings)
        while True:
            packet = self.endpoint.receive(min(until, monotonic() + RESEND) if repeat else until)
            if packet is None:
                if monotonic() >= until:
                    return None
                if repeat:
                    self.endpoint.send(readings)
                    counts.resent += 1
            elif packet.kind == END:
                self._trip("the controller's side left", readings.sequence)
                return None
            elif packet.sequence == readings.sequence:
                self._round_trips.append(monotonic() - begun)
                return packet.numbers[0]
            elif packet.safe:
                # The other side's safe output, sent unasked because it misses readings, is valid for every sample.
                return packet.numbers[0]
            elif packet.sequence > readings.sequence:
                counts.foreign += 1
            elif packet.sequence in self._unanswered:
                self._unanswered.remove(packet.sequence)
                counts.late += 1
            else:
                counts.repeated += 1

    def finish(self) -> LinkSummary:
        """Tell the other side that the run has ended, close the socket, and sum up."""
        self.endpoint.send(Packet(END, int(self.endpoint.run or 0), self.answered))
        self.endpoint.close()
        self.endpoint.counts.lost = len(self._unanswered)
        ended = "interrupted" if self.interrupted else "complete"
        latencies = [LatencyHistogram("from readings to current", np.array(self._round_trips))]
        if self.period is not None:
            latencies.append(LatencyHistogram("start of a sample after its time", np.array(self._lateness)))
        return LinkSummary(
            "plant",
            self.answered,
            self.period,
            self.endpoint.counts,
            self._missed,
            self._tripped,
            ended,
            tuple(latencies),
        )
