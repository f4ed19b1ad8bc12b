"""Keys of other benches in the form of this one's.

Three forms are read: rows of `{"id", "channel"}`; plain ids, where sensors carry the channel in their name and effects
outside the catalogue begin with OUT_; and `effect_detail` with `parameters` and `minor`, each with the gap that it
causes alone. Sizes are compared only where the key has one under the name of the catalogue's parameter.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from effects import IDS
from effects_outside import OUTSIDE
from equivalent_ids import equivalents
from gap import SIGNALS

#: Ids of other benches: (id, channels any of which is right).
_OTHER_IDS: dict[str, tuple[str, tuple[str | None, ...]]] = {
    "cylinder_friction": ("rod_friction", (None,)),
    "position_scale": ("sensor_scale", ("position",)),
    "position_delay": ("sensor_delay", ("position",)),
    "speed_filter": ("sensor_filter", ("speed",)),
    # That key does not say which of the two sensors.
    "pressure_bias": ("sensor_bias", ("p1", "p2")),
    "OUT_pump_dead_speed": ("pump_dead_zone", (None,)),
}


def read_key(file: Path) -> dict[str, dict[str, Any]]:
    """All cases of a key.json, each in this bench's form."""
    return {name: in_this_form(row) for name, row in json.loads(file.read_text()).items()}


def in_this_form(row: Mapping[str, Any]) -> dict[str, Any]:
    """One case. A row of this bench is returned as it is."""
    if "effect_detail" in row:
        effects = _merged([*map(_effect, row["effect_detail"]), *map(_parameter, row["parameters"])])
        minor = [_parameter(r) for r in row["minor"]]
    elif any(isinstance(effect, str) for effect in row["effects"]):
        effects, minor = [_plain_id(id) for id in row["effects"]], []
    elif all("accepted" in effect for effect in row["effects"]) and "held_out" in row:
        return dict(row)
    else:
        effects, minor = [_effect(effect) for effect in row["effects"]], []
    outside = any(effect["id"] == OUTSIDE for effect in effects)
    return {
        "verdict": OUTSIDE if outside else ("effect" if effects else "no_gap"),
        "effects": effects,
        "gap": _signals(row["gap"]),
        "family": row.get("family", ""),
        "loop": "position" if row.get("loop") else "",
        "load_cell": row.get("force", True),
        "below_threshold": minor,
        "held_out": {
            "gap": {
                model: _with_total(row[f"held_out_{model}"])
                for model in ("nominal", "truth")
                if row.get(f"held_out_{model}")
            }
        },
    }


def _signals(gap: Mapping[str, float] | Sequence[float]) -> dict[str, float]:
    values = gap.values() if isinstance(gap, Mapping) else gap
    return dict(zip(SIGNALS, values, strict=True))


def _with_total(gap: Sequence[float]) -> dict[str, float]:
    return {**_signals(gap), "total": float(np.sqrt(np.mean(np.square(gap))))}


def _row(
    id: str, channels: Sequence[str | None], law: str, alone: Any, parameters: Any, **shape: bool
) -> dict[str, Any]:
    outside = id not in IDS
    accepted = [(id, channel) for channel in channels]
    if not outside:
        accepted += equivalents(id, channels[0], **shape)
    return {
        "id": OUTSIDE if outside else id,
        "channel": channels[0],
        "law": law or id,
        "parameters": parameters,
        "alone": _signals(alone) if alone else {},
        "accepted": [{"id": OUTSIDE if outside else i, "channel": c} for i, c in accepted],
    }


def _effect(row: Mapping[str, Any]) -> dict[str, Any]:
    # "id/form" is a law of another form, whose size is another quantity.
    size = {row["parameter"]: row["value"]} if row.get("parameter") and "/" not in row["law"] else {}
    return _row(
        row["id"],
        [row.get("channel")],
        row.get("law", ""),
        row.get("alone"),
        size,
        laminar="R_lam" in size,
        more_drag=float(row.get("magnitude") or 1.0) > 0.0,
    )


def _parameter(row: Mapping[str, Any]) -> dict[str, Any]:
    # Sensors among the minor causes have no relative error.
    error = row.get("relative")
    size = {row["name"]: row["value"]} if error is not None else {"value": row["value"]}
    law = f"{row['name']} {100 * error:+.0f} %" if error is not None else row["name"]
    more_drag = error is not None and error > 0.0
    return _row(row["id"], [row.get("channel")], law, row.get("alone"), size, more_drag=more_drag)


def _plain_id(name: str) -> dict[str, Any]:
    id, channels = _OTHER_IDS.get(name, (name, (None,)))
    return _row(id, channels, name, None, {}, laminar=False)


def _merged(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Largest first; several changes under one id are one cause with the sizes of all."""
    out: dict[tuple[str, str | None], dict[str, Any]] = {}
    for row in sorted(rows, key=lambda r: -max(r["alone"].values(), default=0.0)):
        name = (row["id"], row["channel"])
        if name not in out:
            out[name] = row
            continue
        first = out[name]
        first["parameters"] = {**row["parameters"], **first["parameters"]}
        first["law"] += f", {row['law']}"
        first["accepted"] += [a for a in row["accepted"] if a not in first["accepted"]]
    return list(out.values())
