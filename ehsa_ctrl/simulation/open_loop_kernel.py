"""The compiled loop over the samples of runs with a given input; the first arguments are those of PlantCode."""

# numba infers the types from the signature.
# mypy: ignore-errors

from __future__ import annotations

import numpy as np
from numba import boolean, float64, types

from ..core.compiled import cached_njit
from ..core.pointers import BYTE_CUBE, CUBE, TABLE, VECTOR, WORDS, call, pointer, shifted
from .integrator import (
    CELL,
    CODE,
    CONSTANT_COUNT,
    CONSTANTS,
    CONTACTS,
    DONE,
    STATES,
    STEPS_PER_CALL,
    UNFINISHED,
    advance,
    dead_time,
    work_size,
)  # fmt: skip


@cached_njit(
    types.void(
        *CODE, TABLE, TABLE, TABLE, TABLE, VECTOR, VECTOR, boolean, float64, float64, CUBE, BYTE_CUBE, TABLE, CUBE,
        CUBE, WORDS,
    ),
    error_model="numpy",
    nogil=True,
)  # fmt: skip
def open_loop(
    functions, shape, scales, p, y, mode, carry, current, force, first_order, dt, tol,
    states_out, modes_out, cell_out, extremes, impulses, status,
):  # fmt: skip
    """Simulate all samples of a run for every row of p, y, mode and carry, which are updated to the end of the run.

    Inputs are held over each sample, or linear between samples (first_order). Outputs after a failure stay as they are.
    impulses (runs, N, n): added to states other than speeds at each sample, after the output; (0, 0, 0) for none.
    The next call continues runs that are still UNFINISHED after STEPS_PER_CALL.
    """
    n, contacts = shape[STATES], shape[CONTACTS]
    constants, scratch = np.empty(shape[CONSTANT_COUNT]), np.empty(work_size(shape))
    code, layout, sizes = pointer(functions), pointer(shape), pointer(scales)
    last = carry.shape[1] - 1
    spent = 0
    for run in range(p.shape[0]):
        if status[run] != UNFINISHED:
            continue
        if spent > STEPS_PER_CALL:
            break
        # Within the loop: numba frees an array after its last use by name, and a pointer is none.
        c, work = pointer(constants), pointer(scratch)
        call(functions[CONSTANTS], shifted(pointer(p), run * p.shape[1]), c)
        whole, part = dead_time(shape, p[run], dt)
        state, direction = shifted(pointer(y), run * n), shifted(pointer(mode), run * contacts)
        memory, worst = shifted(pointer(carry), run * (last + 1)), shifted(pointer(extremes), run * 2 * n)
        at = int(carry[run, last])
        for k in range(at, current.size):
            at = k
            for i in range(n):
                states_out[run, k, i] = state[i]
            for i in range(contacts):
                modes_out[run, k, i] = np.int8(direction[i])
            cell_out[run, k] = call(functions[CELL], state, current[k], force[k], direction, c)
            if k + 1 == current.size:
                status[run] = DONE
            if k + 1 == current.size or spent > STEPS_PER_CALL:
                break
            if impulses.shape[0] > 0:
                for i in range(n):
                    state[i] += impulses[run, k, i]
                # The rates at the end of the last sample no longer hold.
                memory[1] = np.nan
            end = k + 1 if first_order else k
            # A delayed current changes within the sample: from `before` to `turn` in its first part, then to `after`.
            turn, new = current[max(k - whole, 0)], current[max(k + 1 - whole, 0)]
            middle = force[k]
            if part > 0.0:
                old = current[max(k - whole - 1, 0)]
                before = part * old + (1.0 - part) * turn if first_order else old
                middle = part * force[end] + (1.0 - part) * force[k]
                failure, steps = advance(
                    code, layout, sizes, c, state, direction, memory, worst, work, before,
                    turn if first_order else before, force[k], middle, part * dt, tol, c, c, layout, 0,
                )  # fmt: skip
                spent += steps
                if failure != DONE:
                    status[run] = failure
                    break
            after = part * turn + (1.0 - part) * new if first_order else turn
            failure, steps = advance(
                code, layout, sizes, c, state, direction, memory, worst, work, turn, after, middle, force[end],
                (1.0 - part) * dt if part > 0.0 else dt, tol, c, c, layout, 0,
            )  # fmt: skip
            spent += steps
            if failure != DONE:
                status[run] = failure
                break
        carry[run, last] = at
