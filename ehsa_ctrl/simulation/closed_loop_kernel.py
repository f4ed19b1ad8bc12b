"""The compiled sampled closed loop of a plant and a controller; the first arguments are those of PlantCode."""

# numba infers the types from the signature.
# mypy: ignore-errors

from __future__ import annotations

from math import isfinite, nan

import numpy as np
from numba import float64, int64

from ..core.compiled import cached_njit
from ..core.pointers import BYTE_TABLE, TABLE, VECTOR, WORDS, call, function_at, pointer
from .integrator import (
    CELL,
    CODE,
    CONSTANT_COUNT,
    CONSTANTS,
    CONTACTS,
    DONE,
    MEASURED,
    NO_CURRENT,
    STATES,
    STEPS_PER_CALL,
    UNFINISHED,
    advance,
    dead_time,
    work_size,
)  # fmt: skip

# Cost of a controller's step, in steps of the plant: that of an MPC.
STEPS_PER_CONTROL = 100

# Output of a controller from its reference, the measured values, its memory and its settings.
CONTROLLER = float64(VECTOR, VECTOR, VECTOR, VECTOR)
_controller_at = function_at(CONTROLLER)


@cached_njit(
    int64(
        *CODE, int64, VECTOR, VECTOR, VECTOR, VECTOR, int64, VECTOR, VECTOR, TABLE, VECTOR, VECTOR,
        TABLE, VECTOR, VECTOR, TABLE, int64, float64, float64, TABLE, BYTE_TABLE, TABLE, TABLE, TABLE, VECTOR, TABLE,
        BYTE_TABLE, VECTOR, WORDS, TABLE,
    ),
    error_model="numpy",
    nogil=True,
)  # fmt: skip
def closed_loop(
    functions, shape, scales, stop, p, y, mode, carry, controller, settings, memory, reference, force, scale,
    noise, resolution, delay, weights, lag, dt, tol, states_out, modes_out, true, filtered, measured, asked, extremes,
    fault, ceiling, traced, traces,
):  # fmt: skip
    """Simulate a plant under a sampled controller, from its current sample to stop - 1; returns a status.

    At each sample the controller gets its row of `reference` and the measured speed, p1, p2, position and force. A
    measurement is the true value, filtered by a first-order filter with these `weights` from steady state, `delay`
    samples ago (linear between samples), times `scale`, plus `noise`, rounded to `resolution`. The current acts `lag`
    samples later, limited to `ceiling`, and is held. `controller`: address of the controller's step; 0 if the caller
    writes `asked` between two calls. A reading with `fault` 1 repeats the last value, with 2 it is lost (nan).
    `traces` records the entries `traced` of the controller's memory.
    """
    n = shape[STATES]
    constants, scratch = np.empty(shape[CONSTANT_COUNT]), np.empty(work_size(shape))
    call(functions[CONSTANTS], pointer(p), pointer(constants))
    whole, part = dead_time(shape, p, dt)
    whole += lag
    step = _controller_at(controller)
    status, spent = DONE, 0
    for k in range(int(carry[-1]), stop):
        # Within the loop: numba frees an array after its last use by name, and a pointer is none.
        c = pointer(constants)
        if spent > STEPS_PER_CALL:
            status = UNFINISHED
            break
        spent += STEPS_PER_CONTROL
        limit = ceiling[max(k - 1, 0)]
        acting = asked[k - 1 - whole] if k > whole else 0.0
        acting = min(max(acting, -limit), limit)
        if k > 0:
            # With a dead time, the current changes within the sample: `before` acts for its first part.
            before = asked[k - 2 - whole] if k > whole + 1 else 0.0
            before = min(max(before, -limit), limit)
            for second in range(0 if part > 0.0 else 1, 2):
                u = acting if second else before
                duration = ((1.0 - part) * dt if part > 0.0 else dt) if second else part * dt
                status, steps = advance(
                    pointer(functions), pointer(shape), pointer(scales), c, pointer(y), pointer(mode),
                    pointer(carry), pointer(extremes), pointer(scratch), u, u, force[k - 1], force[k - 1], duration,
                    tol, c, c, pointer(shape), 0,
                )  # fmt: skip
                spent += steps
                if status != DONE:
                    break
            if status != DONE:
                break
        for i in range(n):
            states_out[k, i] = y[i]
        for i in range(shape[CONTACTS]):
            modes_out[k, i] = np.int8(mode[i])
        for i in range(4):
            column = shape[MEASURED + i]
            true[k, i] = y[column] if column >= 0 else 0.0
        true[k, 4] = call(functions[CELL], pointer(y), acting, force[k], pointer(mode), c)
        for i in range(5):
            filtered[k, i] = true[k, i]
            if k > 0 and weights[i, 1] != 1.0:
                filtered[k, i] = (
                    weights[i, 0] * filtered[k - 1, i] + weights[i, 1] * true[k, i] + weights[i, 2] * true[k - 1, i]
                )
            ago = int(delay[i])
            late = filtered[max(k - ago, 0), i]
            late += (delay[i] - ago) * (filtered[max(k - ago - 1, 0), i] - late)
            measured[k, i] = scale[i] * late + noise[k, i]
            if resolution[i] > 0.0:
                measured[k, i] = np.round(measured[k, i] / resolution[i]) * resolution[i]
            if fault[k, i] == 1 and k > 0:
                measured[k, i] = measured[k - 1, i]
            elif fault[k, i] == 2:
                measured[k, i] = nan
        if controller != 0:
            asked[k] = step(reference[k], measured[k], memory, settings)
            if not isfinite(asked[k]):
                status = NO_CURRENT
                break
            for i in range(traced.size):
                traces[k, i] = memory[traced[i]]
        carry[-1] = k + 1
    return status
