"""The truth of a case as it is written down: causes, gap, and what the true structure leaves of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from cause import Bench
from drive import Drive
from effects import place_of
from gap import SIGNALS, gap, largest, of_samples, signals
from outside import OUTSIDE
from plant import Run, simulate
from rig import Rig
from yardstick import COARSE, Cause, seen, to_drive


def measured(log: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return signals(log["speed"], log["p1"], log["p2"], log["position"])


def held_out(
    believed: Rig,
    bench: Bench,
    causes: Sequence[Cause],
    run: Run,
    log: Mapping[str, np.ndarray],
    noise: Mapping[str, float],
    *,
    whole: bool,
) -> dict[str, Any]:
    """Gap on the part that a diagnosis keeps back: of the belief, of the belief with the true effects, of the truth.

    The belief starts the last third from the true state there, as a tool starts it from its estimate; the other two
    run from the start of the log, since their hidden states have a past.
    """
    n = run.current.size
    first = 0 if whole else 2 * n // 3
    y, current = measured(log), to_drive(bench, log["current"])
    nominal = simulate(believed, log["current"][first:], start=run.states[first], steps=COARSE)
    part = {name: values[first:] for name, values in y.items()}
    with_effects = Bench(believed)
    for cause in causes:
        if cause.counts:
            with_effects = cause.effect.apply(with_effects, cause.size)
    gaps = {
        "nominal": gap(part, of_samples(nominal.samples), noise),
        "effects": gap(y, seen(with_effects, current), noise, slice(first, None)),
        "truth": gap(y, seen(bench, current), noise, slice(first, None)),
    }
    return {"log": "validate" if whole else "last third", "gap": {name: _rounded(g) for name, g in gaps.items()}}


def key(
    family: str,
    drive: Drive,
    load_cell: bool,
    bench: Bench,
    causes: Sequence[Cause],
    errors: Mapping[str, float],
    total: Mapping[str, float],
    kept_back: Mapping[str, Any],
) -> dict[str, Any]:
    """`effects` largest cause first; `accepted` of each are the ids that are the same in principle."""
    counted = sorted((c for c in causes if c.counts), key=lambda c: -largest(c.alone))
    rows: dict[tuple[str, str | None], dict[str, Any]] = {}
    for cause in counted:
        effect = cause.effect
        row = {
            "id": effect.id,
            "channel": effect.channel,
            "law": effect.law,
            "place": place_of(effect.id, effect.law),
            "parameters": {name: float(f"{value:.6g}") for name, value in effect.value(bench).items()},
            "alone": _rounded(cause.alone),
            "accepted": [{"id": id, "channel": channel} for id, channel in effect.accepted],
        }
        rows.setdefault((effect.id, effect.channel), row)
    outside = any(id == OUTSIDE for id, _ in rows)
    return {
        "verdict": "outside_catalogue" if outside else ("effect" if rows else "no_gap"),
        "effects": list(rows.values()),
        "gap": {name: round(total[name], 4) for name in SIGNALS},
        "family": family,
        "loop": drive.loop,
        "excitation": drive.shape,
        "load_cell": load_cell,
        "parameter_errors": _rounded(errors),
        "below_threshold": [
            {"id": c.effect.id, "law": c.effect.law, "largest": round(largest(c.alone), 4)}
            for c in causes
            if not c.counts and not c.effect.law.endswith(" off")
        ],
        "held_out": dict(kept_back),
    }


def _rounded(values: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in values.items()}
