"""One sample of a controller: supervision, trajectory, friction compensation, feedforward, feedback law.

`pipeline` runs in Python or compiled (compiled.py). Each stage has its slice of one memory and one settings vector;
neutral settings switch a stage off.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import feedforward as _feedforward
from . import rest as _rest
from . import supervision as _supervision
from . import trajectory as _trajectory
from .adaptation import adapt, renew_factors
from .feedforward import M_ADAPT, feedforward
from .rest import decide_hold, knock, rest
from .supervision import supervise
from .trajectory import plan

#: First index of the memory and settings of each stage and of the law; the compiled text contains them as numbers.
M_PLAN = _supervision.MEMORY
M_FEED = M_PLAN + _trajectory.MEMORY
M_REST = M_FEED + _feedforward.MEMORY
M_LAW = M_REST + _rest.MEMORY
S_PLAN = _supervision.SETTINGS
S_FEED = S_PLAN + _trajectory.SETTINGS
S_REST = S_FEED + _feedforward.SETTINGS
S_LAW = S_REST + _rest.SETTINGS
#: Index of the last current, which the adaptation uses.
M_CURRENT = M_FEED + M_ADAPT

#: Traces of every controller, in addition to those of its law.
TRACES = {
    "status": 0,
    "planned_position": M_PLAN,
    "planned_velocity": M_PLAN + 1,
    "hold": M_REST,
    "cure_current": M_REST + 1,
}


def run_stages(reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray) -> float:
    """All stages before the law; returns the additional current [A]. Arguments as of `pipeline`.

    memory[0] is 2 if the supervision has stopped the loop.
    """
    if supervise(measured, memory[:M_PLAN], settings[:S_PLAN]) == 2.0:
        return 0.0
    readings = memory[1:6]
    plan(reference, readings[3], memory[M_PLAN:M_FEED], settings[S_PLAN:S_FEED])
    planned = memory[M_PLAN : M_PLAN + 3]
    rest(planned, readings, memory[M_REST:M_LAW], settings[S_REST:S_LAW])
    extra = feedforward(planned, readings, memory[M_FEED:M_REST], settings[S_FEED:S_REST])
    return extra + memory[M_REST + 1]


#: Functions of the stages, each after those that it calls, for compilation and the export to C.
STAGES: tuple[Callable[..., Any], ...] = (
    supervise, plan, adapt, renew_factors, feedforward, knock, decide_hold, rest, run_stages,
)  # fmt: skip


def pipeline(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, law: Callable[..., float]
) -> float:
    """Current [A] of one sample; arguments as in core.controller_interface.Controller.step."""
    extra = run_stages(reference, measured, memory, settings)
    if memory[0] == 2.0:
        return 0.0
    planned, readings = memory[M_PLAN : M_PLAN + 4], memory[M_REST + 9 : M_REST + 14]
    current = law(planned, readings, memory[M_LAW:], settings[S_LAW:], extra, memory[M_REST])
    memory[M_CURRENT] = current
    return current
