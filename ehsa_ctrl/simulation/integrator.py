"""Integrate one sample of a run: Dormand-Prince steps between mode changes, whose instants are located exactly.

The same compiled code serves every structure. The functions of a structure (`plant_text.py`) are called by their
addresses: `functions` and `shape` as in PlantCode. Vectors are pointers (core/pointers.py): y states, d sliding
directions (0: the contact sticks), k1 and k7 rates at the beginning and end of a step, y_n states at its end, c
constants of the run. u and f are the two inputs, which change linearly over a step.
"""

# numba infers the types from the signature.
# mypy: ignore-errors

from __future__ import annotations

from math import inf

import numpy as np
from numba import njit

from ..core.compiled import cached_njit
from ..core.pointers import VECTOR, WORDS, call, shifted

DONE, FAILED, CHATTERS, NO_CURRENT, STIFF, UNFINISHED = 0, 1, 2, 3, 4, 5
MAX_EVENTS_PER_SAMPLE = 1000
# Friction that rises while a contact slides, faster than the effort on it does, holds it at once after each breakaway:
# it creeps, in slips of no length. More than CHATTERING changes in a row, each within CLOSE of a sample of the last
# one, are such a creep; the contact then rests for at least REST of a sample between two slips. Engineering judgement:
# in such a rest the effort rises by a hundredth of what it does in a sample.
CHATTERING, CLOSE, REST = 20, 0.002, 0.01
# A sample of an actuator takes 1 to 200 steps; a plant that needs more than this is far too stiff.
MAX_STEPS_PER_SAMPLE = 20000
# After this many steps, some tenths of a second, a compiled loop returns to Python, so that it can handle interrupts.
STEPS_PER_CALL = 1000000
# Longest step of a slowly sliding contact, relative to the time in which a deviation grows e-fold: see `longest`.
SHORT, LONG, SHARE = 0.12, 0.3, 1.5

# Indices in `functions` and `shape`, see plant_code.py.
CONSTANTS, STEP, ACCEPT, RATES, CELL, PROPAGATE, CONTACT = range(7)
HOLD, NET, FRICTION = range(3)
STATES, CONTACTS, CONSTANT_COUNT, LATE, MEASURED, KINKS, SPEEDS = 0, 1, 2, 3, 4, 8, 9


# Types of the three parts of PlantCode.
CODE = (WORDS, WORDS, VECTOR)


@njit(error_model="numpy", forceinline=True)
def dead_time(shape, p, dt):
    """Dead time of the first input: whole samples, and the remaining fraction of one."""
    late = p[shape[LATE]] / dt if shape[LATE] >= 0 else 0.0
    whole = int(late)
    return whole, late - whole


@njit(error_model="numpy", forceinline=True)
def of_contact(functions, i, which):
    """Address of a function of the contact i."""
    return functions[CONTACT + 3 * i + which]


@njit(error_model="numpy", forceinline=True)
def kink(functions, shape, scales, i, y, u, f, d, c):
    """Signal of the kink i, in units of its scale."""
    contacts = shape[CONTACTS]
    return call(functions[CONTACT + 3 * contacts + i], y, u, f, d, c) * scales[2 * contacts + i]


@njit(error_model="numpy", forceinline=True)
def work_size(shape):
    """Numbers of working memory that `advance` needs: y_n, k7, y_m, modes, accelerations, sides of the kinks."""
    return 3 * shape[STATES] + 2 * shape[CONTACTS] + shape[KINKS]


@njit(error_model="numpy", forceinline=True)
def tenth_root(x):
    """x^(1/10) within 7 %, enough to choose a step length; the bits of x as an integer grow like its logarithm."""
    one = np.int64(4607182418800017408)
    return np.int64(one + 0.1 * (np.float64(x).view(np.int64) - one)).view(np.float64)


@njit(error_model="numpy", forceinline=True)
def lowest(start, middle, end):
    """Fraction of a step at which the parabola through three margins has a negative minimum between positive ends.

    0 if there is no such minimum.
    """
    bend = start - 2.0 * middle + end
    if not (start > 0.0 and end > 0.0 and bend > 0.0):
        return 0.0
    tilt = end - start
    share = 0.5 - 0.25 * tilt / bend
    return share if 0.0 < share < 1.0 and middle - 0.125 * tilt * tilt / bend < 0.0 else 0.0


@njit(error_model="numpy", forceinline=True)
def longest(speed, acceleration, at_rest):
    """Longest step of a decelerating contact, from its acceleration now and the one it would have at speed 0.

    If friction rises towards rest (Stribeck), a deviation grows on the way there, e-fold in `growth_time` on average.
    Step errors are such deviations, above all their change with the step length. The number of e-folds that are still
    to come follows from the time to rest; the more there are, the shorter the steps.
    """
    rise = acceleration - at_rest
    growth_time = speed / rise
    if not growth_time > 0.0:
        return inf
    # The e-folds still to come are |rise / acceleration|.
    return max(SHORT, min(LONG, SHARE * abs(acceleration / rise))) * growth_time


@njit(error_model="numpy", forceinline=True)
def margin(functions, shape, scales, y, u, f, d, fresh, rests, sides, c):
    """Distance to the nearest mode change or kink, in units of its scale; negative beyond it.

    A contact that has just begun to move (fresh) is on its own switching surface, and is left out until it has left
    this surface. rests: contacts that stick are left out too, see CHATTERING. sides: sign of each kink's signal at the
    start of the step.
    """
    least = inf
    for i in range(shape[CONTACTS]):
        if not shape[SPEEDS + 2 * i + 1]:
            continue
        if d[i] == 0.0:
            if not rests:
                least = min(least, call(of_contact(functions, i, HOLD), y, u, f, d, c))
        elif fresh[i] == 0.0:
            least = min(least, (d[i] * y[shape[SPEEDS + 2 * i]] - c[i]) * scales[shape[CONTACTS] + i])
    for i in range(shape[KINKS]):
        if sides[i] != 0.0:
            least = min(least, sides[i] * kink(functions, shape, scales, i, y, u, f, d, c))
    return least


@njit(error_model="numpy")
def locate(
    functions, shape, scales, y, k1, y_n, k7, y_m, a_0, h, u, du, f, df, d, fresh, rests, sides, at_end, exact, c
):
    """Length of the step that ends where the margin crosses zero; y_n and k7 become the values at its end.

    at_end: margin at the end of the whole step. The first guess is the root of the margin along the cubic through both
    ends; a Newton iteration that repeats the step refines it. The step ends just beyond the crossing: the target is the
    middle of the allowed margins, -exact to 0. y_m is working memory.
    """
    n = shape[STATES]
    aim = 0.5 * exact
    at_low = margin(functions, shape, scales, y, u, f, d, fresh, rests, sides, c)
    if at_low <= 0.0:
        at_low = exact
    a, b, at_a, at_b = 0.0, 1.0, at_low + aim, at_end + aim
    s = 1.0
    side = 0
    for _ in range(12):
        s = a + (b - a) * at_a / (at_a - at_b)
        r = 1.0 - s
        start, end, start_k, end_k = r * r * (1.0 + 2.0 * s), s * s * (3.0 - 2.0 * s), h * s * r * r, -h * s * s * r
        for i in range(n):
            y_m[i] = start * y[i] + end * y_n[i] + start_k * k1[i] + end_k * k7[i]
        at_s = margin(functions, shape, scales, y_m, u + du * s, f + df * s, d, fresh, rests, sides, c) + aim
        if abs(at_s) < aim or b - a < 1e-6:
            break
        if at_s < 0.0:
            b, at_b = s, at_s
            if side == -1:
                at_a *= 0.5
            side = -1
        else:
            a, at_a = s, at_s
            if side == 1:
                at_b *= 0.5
            side = 1
    low, high, mid = 0.0, h, s * h
    at_mid = at_end
    for trial in range(60):
        if trial > 0:
            s = mid / h - 1e-6
            for i in range(n):
                y_m[i] = y_n[i] - 1e-6 * h * k7[i]
            before = margin(functions, shape, scales, y_m, u + du * s, f + df * s, d, fresh, rests, sides, c)
            mid = mid - 1e-6 * h * (at_mid + aim) / (at_mid - before) if at_mid < before else low
        if not low < mid < high:
            mid = 0.5 * (low + high)
        s = mid / h
        call(functions[STEP], y, mid, u, du * s, f, df * s, d, c, k1, y_n, k7, a_0)
        at_mid = margin(functions, shape, scales, y_n, u + du * s, f + df * s, d, fresh, rests, sides, c)
        if at_mid < 0.0:
            high = mid
            if -at_mid <= exact or high - low <= 1e-15:
                break
        else:
            low = mid
    return mid


@njit(error_model="numpy")
def switch(functions, shape, y, u, f, d, fresh, c):
    """Change the mode of every contact with a margin of 0 or less: stop, break away, reverse. True if one changed."""
    changed = False
    for i in range(shape[CONTACTS]):
        if not shape[SPEEDS + 2 * i + 1]:
            continue
        speed = shape[SPEEDS + 2 * i]
        was = d[i]
        if was == 0.0 or (d[i] * y[speed] - c[i] <= 0.0 and fresh[i] == 0.0):
            net = call(of_contact(functions, i, NET), y, u, f, d, c)
            ahead = 1.0 if net > 0.0 else -1.0
            if was != 0.0:
                y[speed] = 0.0
            d[i] = ahead
            held = ahead * call(of_contact(functions, i, FRICTION), y, u, f, d, c)
            if abs(net) > held:
                fresh[i] = 1.0
            else:
                d[i] = 0.0
                fresh[i] = 0.0
            changed = changed or d[i] != was
    return changed


@njit(error_model="numpy")
def leap(n, speed, before, after, S, width):
    """Jump of the sensitivities S (state, column) at the stop of a contact, whose instant shifts with the parameters.

    The derivative of the speed is S[speed], its rate before the stop is before[speed], so the instant shifts by
    -S[speed] / before[speed], and the rates after it apply accordingly earlier or later (saltation). A breakaway needs
    no jump, because the rates are continuous. before, after: rates (n,).
    """
    if before[speed] != 0.0:
        for q in range(width - 1):
            shift = -S[speed * width + q] / before[speed]
            for i in range(n):
                S[i * width + q] += (before[i] - after[i]) * shift
            S[speed * width + q] = -after[speed] * shift


@njit(error_model="numpy", forceinline=True)
def watch(functions, shape, scales, y, k1, y_n, k7, y_m, h, dt, u, f, u_n, f_n, d, fresh, rests, sides, kinks, c):
    """Check a step for mode changes and kinks: returns the margin at its end and the length that the step should have.

    Sets the sides of the first `kinks` kinks at its start (see `margin`). The length is less than h if a contact may
    break away, or stop, and return within the step; the step then ends where the margin is lowest. It is also less for
    a fresh contact that has already reversed. Also returns whether a contact is fresh, and whether one slides slowly
    (see `longest`).
    """
    at_end, wanted, some_fresh, slow = inf, h, False, False
    divisible = h > 1e-6 * dt
    for i in range(shape[CONTACTS]):
        if not shape[SPEEDS + 2 * i + 1]:
            continue
        speed, share = shape[SPEEDS + 2 * i], 0.0
        if d[i] == 0.0:
            if rests:
                continue
            for j in range(shape[STATES]):
                y_m[j] = 0.5 * (y[j] + y_n[j]) + 0.125 * h * (k1[j] - k7[j])
            hold = of_contact(functions, i, HOLD)
            start = call(hold, y, u, f, d, c)
            middle = call(hold, y_m, 0.5 * (u + u_n), 0.5 * (f + f_n), d, c)
            end = call(hold, y_n, u_n, f_n, d, c)
            share = lowest(start, middle, end)
            at_end = min(at_end, end)
        else:
            slow = slow or abs(y_n[speed]) < scales[i]
            end = d[i] * y_n[speed]
            if fresh[i] != 0.0 and end < 0.0:
                if divisible:
                    wanted = 0.25 * h
                    break
                fresh[i] = 0.0
            if fresh[i] != 0.0:
                some_fresh = True
            else:
                if d[i] * k1[speed] < 0.0 < d[i] * k7[speed]:
                    middle = 0.5 * (y[speed] + y_n[speed]) + 0.125 * h * (k1[speed] - k7[speed])
                    share = lowest(d[i] * y[speed] - c[i], d[i] * middle - c[i], end - c[i])
                at_end = min(at_end, (end - c[i]) * scales[shape[CONTACTS] + i])
        if 0.02 < share < 0.98 and divisible:
            wanted = share * h
            break
    for i in range(kinks):
        start = kink(functions, shape, scales, i, y, u, f, d, c)
        sides[i] = np.sign(start) if abs(start) < inf else 0.0
        if sides[i] != 0.0:
            for j in range(shape[STATES]):
                y_m[j] = 0.5 * (y[j] + y_n[j]) + 0.125 * h * (k1[j] - k7[j])
            middle = sides[i] * kink(functions, shape, scales, i, y_m, 0.5 * (u + u_n), 0.5 * (f + f_n), d, c)
            end = sides[i] * kink(functions, shape, scales, i, y_n, u_n, f_n, d, c)
            share = lowest(abs(start), middle, end)
            if 0.02 < share < 0.98 and divisible:
                wanted = min(wanted, share * h)
            at_end = min(at_end, end)
    return at_end, wanted, some_fresh, slow


@cached_njit(error_model="numpy")
def advance(
    functions, shape, scales, c, y, d, memory, extremes, work, u, u_end, f, f_end, dt, tol, S, F, columns, width
):
    """Advance one sample: y, d, memory and extremes to its end; returns the status and the number of steps.

    memory: state of the integrator between samples: step length, inputs at the end of the last sample, rates there (n),
    which contacts are fresh (see `margin`). extremes: lowest and highest states so far. work: `work_size` numbers.
    S, F, columns, width: sensitivities and their working memory (see sensitivity_kernel.py); width 0 for none.
    """
    n, contacts = shape[STATES], shape[CONTACTS]
    k1, fresh = shifted(memory, 3), shifted(memory, 3 + n)
    y_n, k7, y_m, d_was = work, shifted(work, n), shifted(work, 2 * n), shifted(work, 3 * n)
    a_0, sides = shifted(work, 3 * n + contacts), shifted(work, 3 * n + 2 * contacts)
    exact = 1e-3 * tol
    inverse = 1.0 / (tol * tol)
    shortest = 1e-9 * dt
    h = memory[0]
    if memory[1] != u or memory[2] != f:
        switch(functions, shape, y, u, f, d, fresh, c)
        call(functions[RATES], y, u, f, d, c, k1)
    # An infinite signal stands for a kink that is never reached.
    kinks = 0
    for i in range(shape[KINKS]):
        sides[i] = 0.0
        if abs(kink(functions, shape, scales, i, y, u, f, d, c)) < inf:
            kinks = shape[KINKS]
    slope_u, slope_f = (u_end - u) / dt, (f_end - f) / dt
    t = 0.0
    events = 0
    steps = 0
    # End of the last change or rest, changes close to each other, and until when contacts that stick do so at least.
    changed, close, resting = -inf, 0, 0.0
    status = DONE
    while t < dt:
        steps += 1
        if steps > MAX_STEPS_PER_SAMPLE:
            status = STIFF
            break
        rests = t < resting
        until = resting if rests else dt
        left = until - t
        last = h >= left
        tried = left if last else (0.5 * left if 2.0 * h > left else h)
        u_t, f_t = u + slope_u * t, f + slope_f * t
        error = call(functions[STEP], y, tried, u_t, slope_u * tried, f_t, slope_f * tried, d, c, k1, y_n, k7, a_0)
        error *= inverse
        if not error <= 1.0:
            h = tried * (max(0.2, 0.9 / tenth_root(error)) if error < 1e30 else 0.1)
            if tried < shortest:
                status = FAILED
                break
            continue
        u_n, f_n = u_t + slope_u * tried, f_t + slope_f * tried
        at_end, wanted, some_fresh, slow = watch(
            functions, shape, scales, y, k1, y_n, k7, y_m, tried, dt, u_t, f_t, u_n, f_n, d, fresh, rests, sides,
            kinks, c,
        )  # fmt: skip
        if wanted < tried:
            h = wanted
            continue
        if at_end < -exact:
            tried = locate(
                functions, shape, scales, y, k1, y_n, k7, y_m, a_0, tried, u_t, slope_u * tried, f_t, slope_f * tried,
                d, fresh, rests, sides, at_end, exact, c,
            )  # fmt: skip
            u_n, f_n = u_t + slope_u * tried, f_t + slope_f * tried
            last = False
        if at_end < 0.0:
            events += 1
            if events > MAX_EVENTS_PER_SAMPLE:
                status = CHATTERS
                break
        if width > 0:
            call(functions[PROPAGATE], y, tried, u_t, slope_u * tried, f_t, slope_f * tried, d, c, S, F, columns, width)
        if some_fresh:
            for i in range(contacts):
                if fresh[i] != 0.0 and not d[i] * y_n[shape[SPEEDS + 2 * i]] <= c[i]:
                    fresh[i] = 0.0
        if at_end < 0.0 or (rests and last):
            for i in range(contacts):
                d_was[i] = d[i]
            switch(functions, shape, y_n, u_n, f_n, d, fresh, c)
            now = until if last else t + tried
            if at_end < 0.0:
                close = close + 1 if now - changed < CLOSE * dt else 0
                if close > CHATTERING:
                    for i in range(contacts):
                        if d_was[i] != 0.0 and d[i] == 0.0:
                            resting = min(now + REST * dt, dt)
            changed = now
            call(functions[RATES], y_n, u_n, f_n, d, c, y_m)
            if width > 0:
                for i in range(contacts):
                    if d_was[i] != 0.0 and d[i] != d_was[i]:
                        leap(n, shape[SPEEDS + 2 * i], k7, y_m, S, width)
            k7, y_m = y_m, k7
        else:
            grown = tried * min(5.0, 0.9 / tenth_root(error) if error > 1e-9 else 5.0)
            h = max(h, grown) if last and error <= 1e-7 else grown
            if slow:
                for i in range(contacts):
                    speed = shape[SPEEDS + 2 * i]
                    if shape[SPEEDS + 2 * i + 1] and d[i] != 0.0 and 0.0 < abs(y_n[speed]) < scales[i]:
                        h = min(h, longest(y_n[speed], k7[speed], a_0[i]))
        call(functions[ACCEPT], y, k1, y_n, k7, extremes)
        t = until if last else t + tried
    memory[0], memory[1], memory[2] = h, u_end, f_end
    return status, steps
