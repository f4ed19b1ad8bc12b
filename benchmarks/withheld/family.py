"""The families of cases: which effects each draws, how large, and what its causes must be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from cause import Conditions, Effect
from effect_gap import THRESHOLD, Cause
from effects import CONTRACT, DRAWN
from effects import draw as draw_effect
from effects_other_forms import OTHER_FORMS, draw_other_form
from effects_outside import LAWS, OUTSIDE, draw_outside
from gap import largest
from rig import Rig

MARGIN = 0.03  # relative distance from the threshold that every decisive gap must keep
#: Nearer to a real rig: closed loops, a logger's sensors, logs that begin in motion.
RIG_FAMILIES = ("nominals_off", "rig_loop", "other_form", "several", "production", "outside_rig")
#: A family's place in this order is part of its seeds: append only.
FAMILIES = (
    "single", "pair", "none", "outside", "weak", "closed_loop", "parameters", "linear", *RIG_FAMILIES,
)  # fmt: skip
#: From this attempt on, an id or a law that had no relevant effect gives way to a random one.
REPLACE = 30


def effect_of(family: str, index: int, attempt: int) -> str:
    """Id of a family that takes every id in turn; empty where it is drawn."""
    if family in ("single", "closed_loop"):
        return DRAWN[index % len(DRAWN)]
    if family in ("nominals_off", "rig_loop") and attempt < REPLACE:
        return CONTRACT[index % len(CONTRACT)]
    if family == "other_form" and attempt < REPLACE:
        return tuple(OTHER_FORMS)[index % len(OTHER_FORMS)]
    return ""


def intended_effects(family: str, index: int, attempt: int, c: Conditions) -> list[tuple[Effect, float]]:
    """Effects to apply and the gap that each is to cause alone, from half of the threshold to twelve times it."""
    rng = c.rng
    ids = [id for id in CONTRACT if c.K_S > 0.0 or id != "backlash"]
    id = effect_of(family, index, attempt)

    def target(low: float = 0.5, high: float = 12.0) -> float:
        return THRESHOLD * float(np.exp(rng.uniform(np.log(low), np.log(high))))

    match family:
        case "single" | "closed_loop":
            return [(draw_effect(id, c), target())]
        case "nominals_off" | "rig_loop":
            return [(draw_effect(id if id in ids else str(rng.choice(ids)), c), target(1.3, 6.0))]
        case "other_form":
            return [(draw_other_form(c, id or str(rng.choice(list(OTHER_FORMS)))), target(1.5, 8.0))]
        case "several":
            return _distinct(rng.choice(ids, 3 if rng.random() < 0.3 else 2, replace=False), c, target)
        case "weak":
            return [(draw_effect(str(rng.choice(ids)), c), target(1.2, 10.0))]
        case "none":
            return [(draw_effect(str(rng.choice(ids)), c), target(0.2, 0.9))] if index % 3 == 0 else []
        case "outside" | "outside_rig":
            # Every law in turn; one that has no relevant effect on this bench is replaced.
            law = LAWS[index % len(LAWS)] if attempt < REPLACE else ""
            return [(draw_outside(c, law), target(1.2))]
        case "linear":
            return [(effect, 0.0) for effect in _nonlinear_terms()]
        case "pair":
            return _distinct(rng.choice(ids, 2, replace=False), c, target)
    return []


def _distinct(ids: Sequence[str], c: Conditions, target: Callable[[float], float]) -> list[tuple[Effect, float]]:
    """Effects of these ids, without one that no log could tell from another."""
    out: list[Effect] = []
    for effect in [draw_effect(str(id), c) for id in ids]:
        if not any(set(effect.accepted) & set(other.accepted) for other in out):
            out.append(effect)
    return [(effect, target(1.2)) for effect in out]


def _nonlinear_terms() -> list[Effect]:
    """What the linear model lacks, with the values of the nonlinear one."""
    full = Rig()
    parts = {
        "rod_friction": ("A_FR", "C_FR", "tau_FR"),
        "motor_friction": ("A_FM", "C_FM", "tau_FM"),
        "chamber_volume_variation": ("V_10", "V_20", "stroke_term"),
    }

    def effect(id: str, names: tuple[str, ...]) -> Effect:
        values = {name: getattr(full, name) for name in names}
        return Effect(id, "missing", lambda b, s: b.with_rig(**values), 1.0, 1.0, lambda b: values)

    return [effect(id, names) for id, names in parts.items()]


def consistent(family: str, chosen: Sequence[Cause], errors: Sequence[Cause], total: Mapping[str, float]) -> bool:
    """Gap and causes agree, with a margin to the threshold, and the case belongs to its family.

    chosen: the drawn effects; errors: nominal parameters that are off and sensors that are not ideal.
    """
    decisive = [largest(total), *(largest(c.alone) for c in (*chosen, *errors))]
    if any(abs(value / THRESHOLD - 1.0) < MARGIN for value in decisive) or not all(np.isfinite(decisive)):
        return False
    counted = [c for c in (*chosen, *errors) if c.counts]
    if bool(counted) != (largest(total) >= THRESHOLD):
        return False
    match family:
        case "none" | "production":
            return not counted
        case "outside" | "outside_rig":
            return [c.effect.id for c in counted] == [OUTSIDE]
        case "pair":
            return len(counted) == 2
        case "weak":
            return len(counted) == 1
        case "rig_loop" | "other_form":
            return len(counted) == 1 and chosen[0].counts
        case "several":
            return len(chosen) > 1 and all(c.counts for c in chosen) and len(counted) == len(chosen)
        case "nominals_off":
            return chosen[0].counts and len(counted) > 1
        case "parameters" | "linear":
            return 1 <= len(counted) <= 3
    return len(counted) <= 1
