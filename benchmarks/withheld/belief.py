"""What the modeller believes of the rig, and how far off that is."""

from __future__ import annotations

import numpy as np
from effects import IDS
from gap import largest
from rig import BELIEVED, LINEAR, Rig
from yardstick import THRESHOLD, UNSURE, Yardstick


def believe(rng: np.random.Generator, family: str, index: int) -> Rig:
    """The plant file's values, or in half of the cases another copy of the actuator whose values are told by --set."""
    rig = LINEAR if family == "linear" else Rig()
    id = IDS[index % len(IDS)] if family in ("single", "closed_loop") else ""
    if rng.random() < 0.5 and family != "linear":
        names = [n for n in BELIEVED if n not in ("D", "A", "P_0")]
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


def told(believed: Rig, family: str) -> dict[str, float]:
    plain = LINEAR if family == "linear" else Rig()
    return {n: getattr(believed, n) for n in BELIEVED if getattr(believed, n) != getattr(plain, n)}


def parameter_errors(
    rng: np.random.Generator, family: str, attempt: int, yardstick: Yardstick, touched: set[str]
) -> dict[str, float]:
    """Relative errors of 1 to 15 %.

    Each is first drawn as it comes. Where it is not meant to be a cause it is reduced until it moves no signal by more
    than a share of the threshold; one that would have to be less than 1 % is left out. Later attempts take less.
    """
    believed = yardstick.believed
    # V_20 stays, so that no error of both volumes stands for one of beta.
    names = [n for n in UNSURE if n not in touched and getattr(believed, n) > 0.0 and n != "V_20"]
    if family == "linear":
        names = ["J_M", "M", "K_L"]
    errors: dict[str, float] = {}
    for name in names:
        error = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.15))
        take, share = rng.random() < 0.7, rng.uniform(0.05, 0.6) * max(0.85**attempt, 0.3)
        if not take:
            continue
        moved = largest(yardstick.wrong(name, error).alone)
        if moved > share * THRESHOLD:
            error *= share * THRESHOLD / moved
        if abs(error) >= 0.01:
            errors[name] = error
    if family == "parameters":
        for name in rng.choice([n for n in names if n != "K_S"], int(rng.integers(1, 4)), replace=False):
            errors[str(name)] = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.15))
    return errors
