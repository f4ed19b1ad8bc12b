"""Candidate inputs: the excitations of the bench at several time scales, alone or one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.errors import InputError, choices
from ..simulation.excitation import EXCITATIONS

#: Multiples of its own frequencies at which an excitation is tried. A slow sine is a train of slow reversals, which
#: show friction.
PACES: dict[str, tuple[float, ...]] = {
    "noise": (1.0, 0.5, 2.0),
    "multisine": (1.0, 0.5),
    "steps": (1.0, 0.5),
    "sine": (1.0, 0.5, 0.25),
    "chirp": (1.0, 0.5),
    "ramp": (1.0,),
}
#: Excitations that depend on a seed.
RANDOM = ("noise", "multisine")


@dataclass(frozen=True)
class InputPart:
    """One excitation over a share of the time, with a peak of `size` times the amplitude of the whole."""

    kind: str
    pace: float = 1.0
    seed: int = 0
    share: float = 1.0
    size: float = 1.0

    def __str__(self) -> str:
        pace = self.pace
        return {
            "noise": f"noise {0.2 * pace:g}-{15 * pace:g} Hz",
            "multisine": f"multisine {0.25 * pace:g}-{19.75 * pace:g} Hz",
            "steps": f"steps of {0.25 / pace:g} s",
            "sine": f"sine {2 * pace:g} Hz",
            "chirp": f"chirp {0.2 * pace:g}-{20 * pace:g} Hz",
        }.get(self.kind, self.kind)


@dataclass(frozen=True)
class InputShape:
    """Parts one after the other."""

    parts: tuple[InputPart, ...]

    def current(self, time: np.ndarray, amplitude: float) -> np.ndarray:
        """Current (N,) [A] over time (N,) [s]; a single part of pace 1 is the excitation of its name and seed."""
        edges = np.round(np.cumsum([0.0, *(part.share for part in self.parts)]) * time.size).astype(int)
        pieces = []
        for part, first, last in zip(self.parts, edges[:-1], edges[1:], strict=True):
            own = (time[first:last] - time[first]) * part.pace
            pieces.append(EXCITATIONS[part.kind](own, part.size * amplitude, np.random.default_rng([part.seed, 77])))
        return np.concatenate(pieces)

    def __str__(self) -> str:
        return ", then ".join(map(str, self.parts))

    @property
    def kind(self) -> str:
        return ", then ".join(part.kind for part in self.parts)

    def words(self, amplitude: float, unit: str = "A") -> str:
        """As "noise 0.2-15 Hz, 2.5 A"; unit: SI unit of the drive."""
        return ", then ".join(f"{part}, {part.size * amplitude:.3g} {unit}" for part in self.parts)


def single_shapes(kind: str, seed: int, seeds: int) -> Iterator[InputShape]:
    """Shapes of one part: of one kind, or of all for "best". Raises InputError for an unknown kind."""
    if kind != "best" and kind not in PACES:
        raise InputError(f"no kind {kind!r} of input; {choices(kind, ['best', *PACES])}")
    for name in PACES if kind == "best" else (kind,):
        for pace in PACES[name]:
            for draw in range(seeds if name in RANDOM else 1):
                yield InputShape((InputPart(name, pace, seed + draw),))


def joined(
    first: InputShape, first_amplitude: float, second: InputShape, second_amplitude: float
) -> tuple[InputShape, float]:
    """One shape for half of the time, then the other, each with its own amplitude: the shape and its amplitude."""
    amplitude = max(first_amplitude, second_amplitude)
    halves = (
        replace(part, share=0.5 * part.share, size=part.size * own / amplitude)
        for shape, own in ((first, first_amplitude), (second, second_amplitude))
        for part in shape.parts
    )
    return InputShape(tuple(halves)), amplitude
