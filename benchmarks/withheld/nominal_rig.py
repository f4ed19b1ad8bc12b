"""The nominal model given to the tool, and its parameter errors."""

from __future__ import annotations

import numpy as np
from effect_gap import THRESHOLD, UNCERTAIN, EffectGap
from family import RIG_FAMILIES, effect_of
from gap import largest
from rig import LINEAR, PLANT_PARAMETERS, Rig


def draw_nominal_rig(rng: np.random.Generator, family: str, index: int) -> Rig:
    """The plant file's values, or in half of the cases another copy of the actuator, passed by --set."""
    rig = LINEAR if family == "linear" else Rig()
    id = effect_of(family, index, 0)
    if rng.random() < 0.5 and family != "linear":
        names = [n for n in PLANT_PARAMETERS if n not in ("D", "A", "P_0")]
        rig = rig._replace(**{n: _short(getattr(rig, n) * rng.uniform(0.9, 1.1)) for n in names})
    if id == "anti_cavitation":
        rig = rig._replace(P_0=_short(rng.uniform(8e5, 14e5)))
    elif rng.random() < 0.2:
        rig = rig._replace(P_0=_short(rng.uniform(14e5, 35e5)))
    u = rng.random()
    if u < 0.35 or id == "backlash":
        return rig._replace(K_S=50e3)
    return rig._replace(K_S=_short(rng.uniform(20e3, 100e3))) if u < 0.55 else rig


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def set_options(nominal_rig: Rig, family: str) -> dict[str, float]:
    plain = LINEAR if family == "linear" else Rig()
    return {n: getattr(nominal_rig, n) for n in PLANT_PARAMETERS if getattr(nominal_rig, n) != getattr(plain, n)}


def parameter_errors(
    rng: np.random.Generator, family: str, attempt: int, effect_gap: EffectGap, touched: set[str]
) -> dict[str, float]:
    """Relative errors of nominal parameters.

    Family nominals_off: 5 to 15 % of two to five parameters. On other rigs what an identification leaves: at most 0.5 %
    of six. Elsewhere 1 to 15 %: each is first drawn freely. Unless it is meant to be a cause, it is reduced until it
    changes no signal by more than a share of the threshold; an error that would be less than 1 % is omitted. Later
    attempts use smaller shares.
    """
    nominal_rig = effect_gap.nominal_rig
    # V_20 is exact, so that errors of both volumes can't imitate one of beta.
    names = [n for n in UNCERTAIN if n not in touched and getattr(nominal_rig, n) > 0.0 and n != "V_20"]
    if family == "linear":
        names = ["J_M", "M", "K_L"]
    if family in RIG_FAMILIES and family != "production":
        return _errors_of_a_rig(rng, family, [n for n in names if n not in ("tau_FM", "tau_FR", "K_S")])
    errors: dict[str, float] = {}
    for name in names:
        error = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.15))
        take, share = rng.random() < 0.7, rng.uniform(0.05, 0.6) * max(0.85**attempt, 0.3)
        if not take:
            continue
        moved = largest(effect_gap.of_parameter_error(name, error).alone)
        if moved > share * THRESHOLD:
            error *= share * THRESHOLD / moved
        if abs(error) >= 0.01:
            errors[name] = error
    if family == "parameters":
        for name in rng.choice([n for n in names if n != "K_S"], int(rng.integers(1, 4)), replace=False):
            errors[str(name)] = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.15))
    return errors


def _errors_of_a_rig(rng: np.random.Generator, family: str, names: list[str]) -> dict[str, float]:
    off = family == "nominals_off"
    low, high = (0.05, 0.15) if off else (0.0005, 0.005)
    count = int(rng.integers(2, 6)) if off else 6
    chosen = rng.choice(names, min(count, len(names)), replace=False)
    return {str(name): float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high)) for name in chosen}
