"""The key of a case: true causes, the gap, and the gap that the true structure leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from cause import Bench
from effect_gap import COARSE, NO_LEAD, Cause, drive_command, simulated_signals
from effects import place_of
from effects_outside import OUTSIDE
from gap import SIGNALS, gap, largest, of_samples, signals
from operation import Operation
from plant import Run, simulate
from rig import Rig

#: Realisations of the input noise for the gap that the true bench repeats.
REPEATS = 5


def measured(log: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return signals(log["speed"], log["p1"], log["p2"], log["position"])


def held_out(
    nominal_rig: Rig,
    bench: Bench,
    causes: Sequence[Cause],
    run: Run,
    log: Mapping[str, np.ndarray],
    noise: Mapping[str, float],
    *,
    whole: bool,
    lead: np.ndarray = NO_LEAD,
) -> dict[str, Any]:
    """Gap on the held-out part: of the nominal rig, of the nominal rig with the true effects, of the true bench.

    The nominal rig starts the last third from the true state there, as a tool starts it from an estimate; the other two
    run from rest, through the lead, because of their hidden states. "repeated" is the gap of the true bench where the
    noise of the logged current is drawn again, the median of REPEATS: where the rod sticks and slips it decides single
    slips, and the smallest error of a parameter decides them too.
    """
    n = run.current.size
    first = 0 if whole else 2 * n // 3
    y, current = measured(log), drive_command(bench, log["current"])
    nominal = simulate(nominal_rig, log["current"][first:], start=run.states[first], steps=COARSE)
    part = {name: values[first:] for name, values in y.items()}
    with_effects = Bench(nominal_rig)
    for cause in causes:
        if cause.counts:
            with_effects = cause.effect.apply(with_effects, cause.size)
    gaps = {
        "nominal": gap(part, of_samples(nominal.samples), noise),
        "effects": gap(y, simulated_signals(with_effects, current, lead=lead), noise, slice(first, None)),
        "truth": gap(y, simulated_signals(bench, current, lead=lead), noise, slice(first, None)),
    }
    random, sd = np.random.default_rng(n), bench.sensors.noise["current"]
    again = [run.current + sd * random.standard_normal(n) for _ in range(REPEATS)]
    each = [gap(y, simulated_signals(bench, one, lead=lead), noise, slice(first, None)) for one in again]
    gaps["repeated"] = {name: float(np.median([one[name] for one in each])) for name in each[0]}
    return {"log": "validate" if whole else "last third", "gap": {name: _rounded(g) for name, g in gaps.items()}}


def beside_the_others(
    plain: Bench, causes: Sequence[Cause], logged: np.ndarray, lead: np.ndarray = NO_LEAD
) -> list[dict[str, float]]:
    """Gap between the rig with all causes and with all but this one, for each that counts; empty for the others.

    plain: the nominal rig with the logger's sensors. logged: current. An end stop that a pump's losses keep out of
    reach makes no gap here, whatever it makes alone: the log has no trace of it.
    """

    def signals_with(some: Sequence[Cause]) -> dict[str, np.ndarray]:
        bench = plain
        for cause in some:
            bench = cause.effect.apply(bench, cause.size)
        return simulated_signals(bench, drive_command(bench, logged), lead=lead)

    everything = signals_with(causes)
    return [gap(everything, signals_with([o for o in causes if o is not c])) if c.counts else {} for c in causes]


def key(
    family: str,
    operation: Operation,
    load_cell: bool,
    bench: Bench,
    causes: Sequence[Cause],
    beside: Sequence[Mapping[str, float]],
    errors: Mapping[str, float],
    total: Mapping[str, float],
    held_out_gap: Mapping[str, Any],
) -> dict[str, Any]:
    """`effects` largest cause first; `accepted` lists the equivalent ids of each. beside: see `beside_the_others`."""
    pairs = ((c, found) for c, found in zip(causes, beside, strict=True) if c.counts)
    rows: dict[tuple[str, str | None], dict[str, Any]] = {}
    for cause, others in sorted(pairs, key=lambda pair: -largest(pair[0].alone)):
        effect = cause.effect
        row = {
            "id": effect.id,
            "channel": effect.channel,
            "law": effect.law,
            "place": place_of(effect.id, effect.law),
            "parameters": {name: float(f"{value:.6g}") for name, value in effect.value(bench).items()},
            "alone": _rounded(cause.alone),
            "beside": _rounded(others),
            "accepted": [{"id": id, "channel": channel} for id, channel in effect.accepted],
        }
        first = rows.setdefault((effect.id, effect.channel), row)
        if first is not row:
            # Several changes under one id are one cause, with the sizes of all.
            first["parameters"] = {**row["parameters"], **first["parameters"]}
            first["law"] += f", {row['law']}"
            first["beside"] = {name: max(value, row["beside"][name]) for name, value in first["beside"].items()}
            first["accepted"] += [a for a in row["accepted"] if a not in first["accepted"]]
    outside = any(id == OUTSIDE for id, _ in rows)
    return {
        "verdict": "outside_catalogue" if outside else ("effect" if rows else "no_gap"),
        "effects": list(rows.values()),
        "gap": {name: round(total[name], 4) for name in SIGNALS},
        "family": family,
        "loop": operation.loop,
        "excitation": operation.shape,
        "begins_at_rest": operation.lead == 0,
        "load_cell": load_cell,
        "parameter_errors": _rounded(errors),
        "below_threshold": [
            {
                "id": c.effect.id,
                "channel": c.effect.channel,
                "law": c.effect.law,
                "largest": round(largest(c.alone), 4),
            }
            for c in causes
            if not c.counts and not c.effect.law.endswith(" off")
        ],
        "held_out": dict(held_out_gap),
    }


def _rounded(values: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in values.items()}
