"""One end of a link: a UDP socket that takes the packets of one peer and counts all others."""

from __future__ import annotations

import socket
from dataclasses import dataclass, field, fields
from time import monotonic
from typing import Any

from ...core.errors import InputError
from .packet import END, LONGEST, Packet, decode

#: Largest number of a port, and of a run.
LAST_PORT, LAST_RUN = 2**16 - 1, 2**32 - 1


@dataclass
class PacketCounts:
    """Packets of a run.

    sent, received: well-formed ones of this run. repeated: with a number that was answered before. late: after the end
    of their sample. lost: never arrived. resent: sent again for want of an answer. malformed: no packets of this
    version. foreign: of another peer or run, or of the wrong kind. first_malformed: what was wrong with the first one.
    """

    sent: int = 0
    received: int = 0
    lost: int = 0
    late: int = 0
    repeated: int = 0
    resent: int = 0
    malformed: int = 0
    foreign: int = 0
    first_malformed: str = ""

    def __str__(self) -> str:
        words = (f.name for f in fields(self) if f.name not in ("sent", "received", "first_malformed"))
        found = ", ".join(f"{getattr(self, word)} {word}" for word in words)
        why = f" (the first: {self.first_malformed})" if self.first_malformed else ""
        return f"{self.sent} packets sent, {self.received} received; {found}{why}"


@dataclass
class Endpoint:
    """A UDP socket with one peer.

    Attributes
    ----------
    kind: of the packets to receive, besides END. peer: address and port; None until the first packet. run: number of
    the run; None takes that of the first packet. counts: of the packets so far.
    """

    kind: int
    peer: tuple[str, int] | None = None
    run: int | None = None
    counts: PacketCounts = field(default_factory=PacketCounts)
    _socket: Any = field(default=None, repr=False)

    @classmethod
    def bound(cls, kind: int, address: str, port: int = 0, **known: Any) -> Endpoint:
        """An endpoint on a local address; port 0 takes a free one.

        Raises InputError for an address or port that can't be had.
        """
        check_port(port)
        found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            found.bind((address, port))
        except OSError as error:
            found.close()
            raise InputError(
                f"{address}:{port}: can't listen there ({error.strerror or error}); give an IPv4 address of this "
                "machine and a free port"
            ) from None
        return cls(kind, _socket=found, **known)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def send(self, packet: Packet) -> None:
        """Send a packet to the peer. Raises InputError where the system refuses to send to this address."""
        try:
            self._socket.sendto(packet.encode(), self.peer)
        except OSError as error:
            host, port = self.peer or ("nobody", 0)
            raise InputError(f"{host}:{port}: can't be sent to ({error.strerror or error})") from None
        self.counts.sent += 1

    def receive(self, until: float) -> Packet | None:
        """The next valid packet of the peer, or None at the time `until` [s of monotonic()]."""
        while True:
            self._socket.settimeout(max(until - monotonic(), 0.0))
            try:
                data, sender = self._socket.recvfrom(LONGEST)
            except (TimeoutError, BlockingIOError):
                return None
            except ConnectionError:
                continue  # Windows reports here that an earlier packet found nobody
            try:
                packet = decode(data)
            except InputError as error:
                self.counts.malformed += 1
                self.counts.first_malformed = self.counts.first_malformed or str(error)
                continue
            known = self.peer in (None, sender) and self.run in (None, packet.run)
            # The first packet decides who the peer is.
            if not known or packet.kind not in (self.kind, *([END] if self.peer else [])):
                self.counts.foreign += 1
                continue
            self.peer, self.run = sender, packet.run
            self.counts.received += 1
            return packet

    def close(self) -> None:
        self._socket.close()


def check_port(port: int) -> None:
    """Raise InputError for a number that is no port."""
    if not 0 <= port <= LAST_PORT:
        raise InputError(f"port {port}; expected 0 to {LAST_PORT}")
