"""How far identified values move over the believed ranges of assumed parameters, as the page shows it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..core.text import join_words
from ..identification.identification import Identification
from ..identification.refits import AssumptionRefit, EstimateSensitivity
from ..plant.file import both
from .grounds import written
from .number import NOTHING, number

#: An estimate that moves by more than this share is said to matter: no longer well determined.
MATTERS = 0.1


@dataclass(frozen=True)
class DriftTable:
    """A column for each end of each assumed parameter's range, a row for each identified one."""

    identification: Identification
    drifts: Sequence[EstimateSensitivity]

    @property
    def _ends(self) -> list[tuple[EstimateSensitivity, AssumptionRefit]]:
        return [(drift, end) for drift in self.drifts for end in drift.ends]

    @property
    def head(self) -> list[tuple[str, str]]:
        """Name and value of each end."""
        return [(both(drift.parameter.name), written(drift.parameter, end.value)) for drift, end in self._ends]

    @property
    def rows(self) -> list[tuple[str, list[str]]]:
        """Name, and by how many percent its estimate moves at each end."""
        return [
            (
                both(estimate.name),
                [_moved(end.values.get(estimate.name, math.nan), estimate.value) for _, end in self._ends],
            )
            for estimate in self.identification.estimates
        ]

    @property
    def costs(self) -> list[str]:
        """Variance of the residuals at each end, in that of the noise."""
        return [number(float(f"{end.cost:.3g}")) if math.isfinite(end.cost) else NOTHING for _, end in self._ends]

    @property
    def said(self) -> list[tuple[str, bool]]:
        """What the log says of each end, and whether it speaks against it."""
        return [("speaks against it" if end.excluded else "can't tell", end.excluded) for _, end in self._ends]

    @property
    def sentences(self) -> list[tuple[str, bool | None]]:
        """Of each assumed parameter what follows, and whether all is well with it."""
        return [_sentence(self.identification, drift) for drift in self.drifts]


def _moved(value: float, estimate: float) -> str:
    if not math.isfinite(value) or estimate == 0.0:
        return NOTHING
    share = 100.0 * (value / estimate - 1.0)
    return "0 %" if abs(share) < 0.005 else f"{share:+.2g} %" if abs(share) < 99.5 else f"{share:+.0f} %"


def _sentence(found: Identification, drift: EstimateSensitivity) -> tuple[str, bool | None]:
    name = both(drift.parameter.name)
    possible = [end for end in drift.ends if not end.excluded]
    ends = [written(drift.parameter, end.value) for end in drift.ends if end.excluded]
    if not possible:
        return f"{name}: the log speaks against both ends of its believed range; freed, it can be estimated.", None
    worst: tuple[float, str, AssumptionRefit] | None = None
    for end in possible:
        for estimate in found.estimates:
            size = abs(end.values[estimate.name] / estimate.value - 1.0) if estimate.value else 0.0
            if worst is None or size > worst[0]:
                worst = (size, estimate.name, end)
    assert worst is not None
    size, moved, end = worst
    against = f"; the log speaks against {join_words(ends)}" if ends else ""
    at = written(drift.parameter, end.value)
    moves = f"{both(moved)} moves by {number(100.0 * float(f'{size:.2g}'))} %"
    return f"{name}: at {at}, which the log does not exclude, {moves}{against}.", size < MATTERS
