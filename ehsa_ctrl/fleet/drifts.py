"""Parameters of the plant that move with time, rig by rig."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from ..plant.plant import Plant
from .changes import Names, Scan
from .manifest import FleetLog
from .null import ENOUGH_RIGS, false_discovery_rates, largest_null
from .result import Drift


def drifts(
    scans: Sequence[Scan],
    names: Names,
    plant: Plant,
    rate: float,
    logs: Mapping[str, Sequence[FleetLog]],
    stepped: Collection[str],
    sized: Callable[[str], Scan],
) -> tuple[Drift, ...]:
    """The drifts that are significant at a false-discovery rate over the rigs, at most one of each.

    A step shows as a trend too: rigs that changed in one (`stepped`) are left out. None in fewer than ENOUGH_RIGS
    rigs, whose own distribution can't be seen.

    scans: of each rig, with the plant's parameters as causes (`Names.of_parameters`); `statistics` are enough.
    sized: the scan of a rig with its sizes.
    """
    tested = [one for one in scans if -1 in one.times and one.rig not in stepped]
    if len(tested) < ENOUGH_RIGS:
        return ()
    parameters = names.names[: names.nominal]
    statistics = np.array([one.statistic[:, one.times.index(-1)] for one in tested])
    null = largest_null([row[:, None] for row in statistics], np.ones(len(parameters)))
    p = [null.p(row[:, None]) for row in statistics]
    found: list[Drift] = []
    for one, row, own_p, q in zip(tested, statistics, p, false_discovery_rates(p), strict=True):
        if q > rate:
            continue
        best = int(np.argmax(row / null.factor))
        name, column, own = parameters[best], one.times.index(-1), logs[one.rig]
        when = int(np.argmax(one.statistic[best]))
        whole = sized(one.rig)
        unit = names.scale[best] / ((own[-1].date - own[0].date).total_seconds() / 86400.0)
        found.append(
            Drift(
                one.rig, name, plant.parameters[name].unit, float(whole.size[name][column, 0] * unit),
                float(np.sqrt(whole.variance[name][column, 0] * null.factor[best]) * unit), own_p, float(q),
                "" if when == column else own[one.times[when]].date.isoformat(),
            )
        )  # fmt: skip
    return tuple(sorted(found, key=lambda drift: drift.p))
