"""The packets of a link: little-endian, one datagram each, of fixed length.

Header of 16 bytes: "EHSA", version (uint8), kind (uint8), flags (uint16), run (uint32), sequence (uint32). Then, by
kind, float64 numbers: READINGS has speed, p1, p2, position, force and the reference's position, velocity,
acceleration, force; CURRENT has the current; END has none. SI units; nan is a lost reading or no reference.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import isfinite

from ...core.controller_interface import MEASURED, REFERENCE
from ...core.errors import InputError

MAGIC, VERSION = b"EHSA", 1
#: Kinds of packets: from the plant, from the controller, and from a side that leaves.
READINGS, CURRENT, END = 1, 2, 3
#: Flag: the sender's safe output acts.
SAFE = 1
#: Numbers of each kind.
NUMBERS = {READINGS: len(MEASURED) + len(REFERENCE) + 1, CURRENT: 1, END: 0}
NAMES = {READINGS: "READINGS", CURRENT: "CURRENT", END: "END"}
_HEADER = struct.Struct("<4sBBHII")
#: Longest datagram to read [bytes]; one more than a packet has shows that it is too long.
LONGEST = _HEADER.size + 8 * max(NUMBERS.values()) + 1


@dataclass(frozen=True)
class Packet:
    """A packet.

    Attributes
    ----------
    kind: READINGS, CURRENT or END. run: number of the run, chosen by the plant's side. sequence: number of the sample.
    numbers: as above, SI units. flags: 0 or SAFE.
    """

    kind: int
    run: int
    sequence: int
    numbers: tuple[float, ...] = ()
    flags: int = 0

    @property
    def safe(self) -> bool:
        return bool(self.flags & SAFE)

    def encode(self) -> bytes:
        head = _HEADER.pack(MAGIC, VERSION, self.kind, self.flags, self.run, self.sequence % 2**32)
        return head + struct.pack(f"<{NUMBERS[self.kind]}d", *self.numbers)


def decode(data: bytes) -> Packet:
    """Read a datagram. Raises InputError for one that is no packet of this version, or a current that is not finite."""
    if len(data) < _HEADER.size:
        raise InputError(f"{len(data)} bytes; expected a header of {_HEADER.size} bytes")
    magic, version, kind, flags, run, sequence = _HEADER.unpack_from(data)
    if magic != MAGIC:
        raise InputError(f"begins with {magic!r}; expected {MAGIC!r}")
    if version != VERSION:
        raise InputError(f"version {version}; expected version {VERSION}")
    if kind not in NUMBERS:
        raise InputError(f"kind {kind}; expected {', '.join(f'{key} ({word})' for key, word in NAMES.items())}")
    size = _HEADER.size + 8 * NUMBERS[kind]
    if len(data) != size:
        more = " or more" if len(data) == LONGEST else ""
        raise InputError(f"a {NAMES[kind]} packet of {len(data)} bytes{more}; expected {size}")
    numbers = struct.unpack_from(f"<{NUMBERS[kind]}d", data, _HEADER.size)
    if kind == CURRENT and not isfinite(numbers[0]):
        raise InputError(f"a current of {numbers[0]}; expected a finite number")
    return Packet(kind, run, sequence, numbers, flags)
