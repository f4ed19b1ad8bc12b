"""How long rounding leaves a run predictable, and how far it moves the metrics after that.

Friction that falls with speed makes neighbouring motions part exponentially: a rod in stick-slip forgets its start
within seconds. From then on the last bit of an addition decides when it slips, and another processor or another version
of a library gives another run that is just as right. The run is repeated with all parameters changed by rounding alone,
and what these runs have in common is what a baseline can hold later runs to.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .baseline import Predictability, leaves_tube
from .metrics import METRICS
from .prepare import prepare

if TYPE_CHECKING:
    from ..plant.plant import Plant
    from .result import ScenarioResult

#: Number of repetitions, and largest relative change of a parameter in them: a few hundred times the rounding of a
#: number, since a run adds up that of thousands of steps (engineering judgement).
REPETITIONS, CHANGE = 8, 1e-13


def predictability(result: ScenarioResult) -> Predictability:
    """Repeat the nonlinear run of a scenario with parameters that differ by rounding."""
    case = prepare(result.scenario, controller=result.controller)
    draw = np.random.default_rng(0)
    until = np.inf
    spread: dict[str, float] = {}
    for _ in range(REPETITIONS):
        loop = case.simulate(_rounded(case.nonlinear, draw))
        until = min(until, leaves_tube(result, loop.trajectory, share=0.5))
        for name, value in case.metrics(loop).items():
            change = _change(result.metrics[name][1], value)
            if change > METRICS[name].absolute_tolerance:
                spread[name] = max(spread.get(name, 0.0), change)
    return Predictability(until, spread)


def _rounded(plant: Plant, draw: np.random.Generator) -> Plant:
    """The plant with every parameter changed by at most CHANGE."""
    changes = 1.0 + CHANGE * draw.uniform(-1.0, 1.0, len(plant.parameters))
    changed = zip(plant.parameters.items(), changes, strict=True)
    return replace(plant, parameters={name: replace(one, value=one.value * by) for (name, one), by in changed})


def _change(old: float, new: float) -> float:
    if np.isfinite(old) and np.isfinite(new):
        return abs(new - old)
    return 0.0 if np.array_equal(old, new, equal_nan=True) else np.inf
