"""One sample of a controller: supervision, trajectory, feed-forward, cures against friction, feedback law.

`pipeline` is the text that runs, plain or compiled. Each stage has its own slice of one memory and one settings
vector; a stage that is not asked for has neutral settings and changes nothing.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from . import feedforward as _feedforward
from . import rest as _rest
from . import supervision as _supervision
from . import trajectory as _trajectory
from .feedforward import feedforward
from .rest import decide_hold, knock, rest
from .supervision import supervise
from .trajectory import plan

#: First index of each stage's memory and settings, and of the law's; the compiled text has them as numbers.
M_PLAN = _supervision.MEMORY
M_FEED = M_PLAN + _trajectory.MEMORY
M_REST = M_FEED + _feedforward.MEMORY
M_LAW = M_REST + _rest.MEMORY
S_PLAN = _supervision.SETTINGS
S_FEED = S_PLAN + _trajectory.SETTINGS
S_REST = S_FEED + _feedforward.SETTINGS
S_LAW = S_REST + _rest.SETTINGS

#: The stages' functions, each behind those that it calls: what is compiled, and written as C, before the law.
STAGES: tuple[Callable[..., Any], ...] = (supervise, plan, feedforward, knock, decide_hold, rest)
#: What is kept of each sample of every controller, beside the law's own traces.
TRACES = {
    "status": 0,
    "planned_position": M_PLAN,
    "planned_velocity": M_PLAN + 1,
    "hold": M_REST,
    "cure_current": M_REST + 1,
}


def pipeline(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, law: Callable[..., float]
) -> float:
    """Current [A] of one sample; arguments as in core.controller_interface.Controller.step."""
    if supervise(measured, memory[:M_PLAN], settings[:S_PLAN]) == 2.0:
        return 0.0
    trusted = memory[1:6]
    plan(reference, trusted[3], memory[M_PLAN:M_FEED], settings[S_PLAN:S_FEED])
    planned = memory[M_PLAN : M_PLAN + 3]
    rest(planned, trusted, memory[M_REST:M_LAW], settings[S_REST:S_LAW])
    extra = feedforward(planned, trusted[4], memory[M_FEED:M_REST], settings[S_FEED:S_REST])
    extra += memory[M_REST + 1]
    return law(planned, memory[M_REST + 9 : M_REST + 14], memory[M_LAW:], settings[S_LAW:], extra, memory[M_REST])


HEAD = """\
# A compiled controller: written by design/stages/pipeline.py, changed by nobody.
from math import atan, cos, exp, inf, isfinite, log, pi, sin, sqrt, tan, tanh

import numpy as np
from numba import float64, njit, types

from ehsa_ctrl.core.compiled import cached_njit
"""


@cache
def compiled_pipeline(law: Callable[..., float], uses: tuple[Callable[..., Any], ...]) -> Callable[..., float]:
    """The pipeline around a law, compiled: float64(reference, measured, memory, settings).

    The first call ever compiles (some 10 s), later ones load the result.
    """
    from ...core.compiled import load_compiled

    edges = "\n".join(f"{name} = {value}" for name, value in sorted(_edges().items()))
    text = [HEAD, edges, *(f'@njit(error_model="numpy")\n{source_text(stage)}' for stage in (*STAGES, *uses, law))]
    # A function handed over as an argument would keep numba from caching the step; a name of the module does not.
    text.append(f"law = {law.__name__}")
    text.append(f'@njit(error_model="numpy")\n{source_text(pipeline, without="law")}')
    text.append(
        "VECTOR = types.Array(float64, 1, 'C')\n\n"
        "@cached_njit(float64(VECTOR, VECTOR, VECTOR, VECTOR), error_model='numpy', nogil=True)\n"
        "def step(reference, measured, memory, settings):\n"
        "    return pipeline(reference, measured, memory, settings)\n"
    )
    module = load_compiled("\n\n\n".join(text), f"the controller law {law.__name__}")
    step: Callable[..., float] = module.step
    return step


def _edges() -> dict[str, int]:
    return {
        "M_PLAN": M_PLAN,
        "M_FEED": M_FEED,
        "M_REST": M_REST,
        "M_LAW": M_LAW,
        "S_PLAN": S_PLAN,
        "S_FEED": S_FEED,
    } | {
        "S_REST": S_REST,
        "S_LAW": S_LAW,
    }


def source_text(function: Callable[..., Any], without: str = "") -> str:
    """Source of a function without the types of its arguments, which the compiled module has no names for, and
    without the argument `without`."""
    import ast

    tree = ast.parse(inspect.getsource(function)).body[0]
    assert isinstance(tree, ast.FunctionDef)
    tree.returns = None
    tree.args.args = [argument for argument in tree.args.args if argument.arg != without]
    for argument in (*tree.args.args, *tree.args.kwonlyargs):
        argument.annotation = None
    return ast.unparse(tree)
