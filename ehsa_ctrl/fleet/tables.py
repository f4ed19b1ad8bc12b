"""The tables of a store that queries read."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .result import Fleet, further_words
from .store import Store

#: Table -> column -> Arrow type.
COLUMNS = {
    "rigs": {
        "rig": "string", "logs": "int64", "changed": "bool", "kind": "string", "cause": "string", "same": "string",
        "decided_by": "string", "since": "string", "earliest": "string", "latest": "string", "file": "string",
        "further": "string", "p": "float64", "q": "float64", "unlike": "string", "unlike_p": "float64",
        "unlike_q": "float64", "verdict": "string",
    },
    "logs": {
        "rig": "string", "file": "string", "date": "string", "dated": "string", "rms_nominal": "float64",
        "rms_refitted": "float64",
    },
    "estimates": {
        "rig": "string", "file": "string", "date": "string", "name": "string", "value": "float64", "sd": "float64",
    },
    "parameters": {
        "name": "string", "unit": "string", "nominal": "float64", "mean": "float64", "mean_sd": "float64",
        "spread": "float64", "units": "float64",
    },
    "drifts": {
        "rig": "string", "parameter": "string", "unit": "string", "slope": "float64", "sd": "float64", "p": "float64",
        "q": "float64", "since": "string",
    },
}  # fmt: skip


def write_tables(store: Store, fleet: Fleet) -> None:
    """Write the tables rigs, logs, estimates, parameters and drifts. Raises InputError if one can't be written."""
    rows: dict[str, Iterable[dict[str, Any]]] = {
        "rigs": [
            {
                "rig": rig.name, "logs": len(rig.logs), "changed": rig.changed, "kind": rig.kind, "cause": rig.cause,
                "same": "; ".join(rig.same), "decided_by": rig.by, "since": rig.since, "earliest": rig.earliest,
                "latest": rig.latest, "file": rig.file, "further": further_words(rig.further),
                "p": rig.p, "q": rig.q, "unlike": rig.unlike, "unlike_p": rig.unlike_p, "unlike_q": rig.unlike_q,
                "verdict": "" if rig.diagnosis is None else rig.diagnosis.verdict,
            }
            for rig in fleet.rigs
        ],
        "logs": (
            {"rig": rig.name, "file": log.file, "date": log.date, "dated": log.dated, "rms_nominal": log.rms[0],
             "rms_refitted": log.rms[1]}
            for rig in fleet.rigs for log in rig.logs
        ),
        "estimates": (
            {"rig": rig.name, "file": log.file, "date": log.date, "name": name, "value": value, "sd": sd}
            for rig in fleet.rigs for name, values in rig.series.items()
            for log, (value, sd) in zip(rig.logs, values, strict=True)
        ),
        "parameters": [
            {name: getattr(one, name) for name in COLUMNS["parameters"]} for one in fleet.parameters
        ],
        "drifts": [{name: getattr(one, name) for name in COLUMNS["drifts"]} for one in fleet.drifts],
    }  # fmt: skip
    for name, listed in rows.items():
        store.put_table(name, listed, COLUMNS[name])
