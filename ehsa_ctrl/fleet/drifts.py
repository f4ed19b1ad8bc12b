"""Parameters of the plant that move with time, rig by rig."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ..plant.plant import Plant
from .changes import Names, Scan
from .manifest import FleetLog
from .null import false_discovery_rates, single_null
from .result import Drift


def drifts(
    scans: Sequence[Scan],
    names: Names,
    plant: Plant,
    rate: float,
    logs: Mapping[str, Sequence[FleetLog]],
    stepped: Collection[str],
) -> tuple[Drift, ...]:
    """The drifts that are significant at a false-discovery rate over all rigs and parameters.

    A step shows as a trend too: rigs that changed in one (`stepped`) are left out.

    scans: of each rig, with the plant's parameters as causes (`Names.of_parameters`).
    """
    tested = [one for one in scans if -1 in one.times and one.rig not in stepped]
    if not tested:
        return ()
    parameters = names.names[: names.nominal]
    statistics = np.array([one.statistic[:, one.times.index(-1)] for one in tested])
    null = single_null(statistics)
    rows: list[Drift] = []
    p = []
    for one in tested:
        column = one.times.index(-1)
        of_all = null.p(one.statistic[:, column])
        span = (logs[one.rig][-1].date - logs[one.rig][0].date).total_seconds() / 86400.0
        for i, name in enumerate(parameters):
            best = int(np.argmax(one.statistic[i]))
            since = "" if best == column else logs[one.rig][one.times[best]].date.isoformat()
            unit = names.scale[i] / span
            sd = float(np.sqrt(one.variance[name][column, 0] * null.factor[i]) * unit)
            p.append(float(of_all[i]))
            slope = float(one.size[name][column, 0] * unit)
            rows.append(Drift(one.rig, name, plant.parameters[name].unit, slope, sd, p[-1], 1.0, since))
    q = false_discovery_rates(p)
    found = [
        Drift(row.rig, row.parameter, row.unit, row.slope, row.sd, row.p, float(value), row.since)
        for row, value in zip(rows, q, strict=True)
        if value <= rate
    ]
    return tuple(sorted(found, key=lambda row: row.p))
