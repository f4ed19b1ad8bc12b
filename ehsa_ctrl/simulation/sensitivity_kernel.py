"""The compiled loop over the samples of a run with its sensitivities; the first arguments are those of PlantCode."""

# numba infers the types from the signature.
# mypy: ignore-errors

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64

from ..core.compiled import cached_njit
from ..core.pointers import CUBE, TABLE, VECTOR, WORDS, call, pointer
from .integrator import (
    CODE,
    CONSTANT_COUNT,
    CONSTANTS,
    DONE,
    STATES,
    STEPS_PER_CALL,
    UNFINISHED,
    advance,
    work_size,
)  # fmt: skip


@cached_njit(
    int64(
        *CODE, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, boolean, float64, float64, WORDS, boolean, TABLE, TABLE,
        CUBE, TABLE,
    ),
    error_model="numpy",
    nogil=True,
)  # fmt: skip
def sensitivity(
    functions, shape, scales, p, y, mode, carry, current, force, first_order, dt, tol, columns, restart, S,
    states_out, S_out, extremes,
):  # fmt: skip
    """As `open_loop` for one run, with sensitivities S (state, column) of columns[parameter], the last one for none.

    S contains the initial derivatives; S_out gets those at every sample, without the last column. With `restart`, every
    sample begins with the initial S, so that S_out[k] contains only the effect of sample k - 1. Returns a status; call
    again if it is UNFINISHED.
    """
    n, width = shape[STATES], S.shape[1]
    constants, scratch = np.empty(shape[CONSTANT_COUNT]), np.empty(work_size(shape))
    by_parameter = np.zeros((6, n, width))
    call(functions[CONSTANTS], pointer(p), pointer(constants))
    begin = S.copy()
    status, spent = DONE, 0
    for k in range(int(carry[-1]), current.size):
        # Within the loop: numba frees an array after its last use by name, and a pointer is none.
        c = pointer(constants)
        carry[-1] = k
        for i in range(n):
            states_out[k, i] = y[i]
            for q in range(width - 1):
                S_out[k, i, q] = S[i, q]
                if restart:
                    S[i, q] = begin[i, q]
        if k + 1 == current.size:
            break
        if spent > STEPS_PER_CALL:
            status = UNFINISHED
            break
        end = k + 1 if first_order else k
        status, steps = advance(
            pointer(functions), pointer(shape), pointer(scales), c, pointer(y), pointer(mode), pointer(carry),
            pointer(extremes), pointer(scratch), current[k], current[end], force[k], force[end], dt, tol,
            pointer(S), pointer(by_parameter), pointer(columns), width,
        )  # fmt: skip
        spent += steps
        if status != DONE:
            break
    return status
