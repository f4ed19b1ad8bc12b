"""The loops around the bench: current command from reference and readings, once per sample."""

from __future__ import annotations

from numba import njit

# Current against friction of the published set while the rod moves, fed forward by a PID: (A_FM + D A_FR / A) / K_T
# and (B_FM A / D + D B_FR / A) / K_T.
DRY_CURRENT, VISCOUS_CURRENT = 0.94, 5.9  # A, A s/m


@njit(cache=True, error_model="numpy")
def _pid(k, wanted, x, memory, gains):
    """PID around the rod: reads the position in whole steps of its encoder, filters the derivative, limits the current.

    gains: A/m, A/(m s), A s/m, filter [s], limit [A], encoder step [m], rest band [m], share of friction fed forward.
    memory: integral [A], last error [m], its derivative [m/s], last reference [m].
    """
    error = wanted - round(x / gains[5]) * gains[5]
    if k > 0:
        memory[2] += 0.004 / (gains[3] + 0.004) * ((error - memory[1]) / 0.004 - memory[2])
    memory[1] = error
    ahead = (wanted - memory[3]) / 0.004
    memory[3] = wanted
    asked = gains[0] * error + memory[0] + gains[2] * memory[2]
    if ahead != 0.0:
        asked += gains[7] * (DRY_CURRENT * (1.0 if ahead > 0.0 else -1.0) + VISCOUS_CURRENT * ahead)
    # The integral rests in position, so that a stuck rod does not hunt, and while the current is at its limit.
    if abs(asked) < gains[4] and abs(error) > gains[6]:
        memory[0] += 0.004 * gains[1] * error
    return min(max(asked, -gains[4]), gains[4])


@njit(cache=True, error_model="numpy")
def ask(loop, k, wanted, speed, x, memory, gains):
    """Current command at sample k: open loop, with the slow centring loop, from a cascade, or from a PID."""
    if loop == 0.0:
        return wanted
    if loop == 1.0:
        memory[0] += 0.004 / gains[0] * (x - memory[0])
        return wanted - min(max(gains[1] * memory[0], -1.0), 1.0)
    if loop == 3.0:
        return _pid(k, wanted, x, memory, gains)
    speed_wanted = min(max(gains[0] * (wanted - x), -300.0), 300.0)
    error = speed_wanted - speed
    memory[0] = min(max(memory[0] + 0.004 * gains[2] * error, -3.0), 3.0)
    return min(max(gains[1] * error + memory[0], -5.0), 5.0)
