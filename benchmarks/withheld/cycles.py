"""Rod references of a rig in production: moves with pauses, press cycles, bursts of a sine."""

from __future__ import annotations

import numpy as np
from plant import SAMPLE

SHAPES = ("moves", "press", "sine")


def reference(shape: str, n: int, reach: float, rng: np.random.Generator) -> np.ndarray:
    """(N,) m within +-reach, from the middle on; standstill is part of every shape."""
    draw = {"moves": _moves, "press": _press, "sine": _bursts}[shape]
    parts, place, length = [], 0.0, 0
    while length < n:
        part, place = draw(place, reach, rng)
        parts.append(part)
        length += part.size
    return np.concatenate(parts)[:n]


def _stand(place: float, seconds: float) -> np.ndarray:
    return np.full(int(seconds / SAMPLE), place)


def _move(start: float, end: float, speed: float) -> np.ndarray:
    """From rest to rest with least jerk; `speed` [m/s] is the largest on the way."""
    duration = max(1.875 * abs(end - start) / speed, 0.1)
    u = np.arange(1, int(duration / SAMPLE) + 1) / int(duration / SAMPLE)
    return start + (end - start) * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)


def _moves(place: float, reach: float, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    end = float(rng.uniform(-reach, reach))
    go = _move(place, end, rng.uniform(0.03, 0.11))
    return np.concatenate([go, _stand(end, rng.uniform(0.1, 0.8))]), end


def _press(place: float, reach: float, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Fast approach, slow stroke, hold, fast return, wait for the next part."""
    near, end, back = (float(reach * rng.uniform(*r)) for r in ((0.3, 0.6), (0.75, 1.0), (-1.0, -0.4)))
    parts = [
        _move(place, near, rng.uniform(0.06, 0.11)),
        _move(near, end, rng.uniform(0.012, 0.04)),
        _stand(end, rng.uniform(0.2, 1.2)),
        _move(end, back, rng.uniform(0.07, 0.12)),
        _stand(back, rng.uniform(0.2, 1.2)),
    ]
    return np.concatenate(parts), back


def _bursts(place: float, reach: float, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Whole periods of a sine around a place, then standstill."""
    f = rng.uniform(0.6, 1.8)
    swing = min(rng.uniform(0.4, 0.7) * reach, 0.11 / (2.0 * np.pi * f))
    end = float(rng.uniform(-1.0, 1.0) * (reach - swing))
    t = np.arange(0.0, rng.integers(3, 8) / f, SAMPLE)
    wave = end + swing * np.sin(2.0 * np.pi * f * t) * np.minimum(t * f, 1.0)
    return np.concatenate([_move(place, end, 0.06), wave, _stand(end, rng.uniform(0.2, 1.5))]), end
