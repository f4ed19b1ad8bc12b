"""The bench plant step by step: (12) with (8) and all effects, with set-valued friction.

Pressures and position take half a step with the old speeds; the speeds take a whole step with the mid-step pressures
(dry friction as a set-valued law, solved exactly for each body); pressures and position take the other half with the
new speeds. The scheme has order two while the motion is smooth, order one in a step in which a body sticks or breaks
away. It neither locates events nor adapts the step.
"""

from __future__ import annotations

from math import cos, exp, inf, sin, sqrt

import numpy as np
from laws import (
    beyond,
    bump,
    contact,
    free_air,
    maxwell_slip,
    orifice,
    saturated,
    slide,
    spring,
    stiffness,
    stribeck,
    turbulent,
)  # fmt: skip
from loop import ask
from numba import njit

# Constants of effects of another form; engineering judgement.
LOSS = 150.0  # W of shaft power at which the oil warms up fully
RESEAT = 0.95  # pressure at which an open relief valve closes, over its cracking pressure
SOLUTION_TIME = 0.4  # s in which free air goes into solution and comes out again


@njit(cache=True, error_model="numpy")
def integrate(p, loop, wanted, seen, gains, disturbance, start, steps, dense, states, current):
    n = wanted.size
    h = 0.004 / steps
    every = steps // 4
    w, P1, P2, v, x = start[0], start[1], start[2], start[3], start[4]
    A1 = p.A * (1.0 + (0.5 * p.dA if p.area_law == 0.0 else p.dA))
    A2 = p.A * (1.0 - (0.5 * p.dA if p.area_law == 0.0 else 0.0))
    delay = int(round(p.T_d / h))
    mass = p.M + p.m_rod + (p.m_load if p.width == 0.0 else 0.0)
    carriage = 8.0 + p.m_load
    J_pump = 0.25 * p.J_M if p.coupling > 0.0 else 0.0
    angle, twist, w_pump = 0.0, 0.0, w
    first_lag, lagged, slew, lag_rate = p.I_0, p.I_0, 0.0, 0.0
    z, v_load, x_load, cell = 0.0, v, x, p.F_0 + spring(x, p.K_S, p.k_3, p.hardening_law)
    wall_1, wall_2, fresh, last = P1, P2, 1.0, 0.0
    drop_line, heat = 0.0, 0.0
    gas_1 = gas_2 = free_air(p.P_0, p.air)
    open_1, open_2 = False, False
    slip = np.zeros(3)
    up = down = p.A_FR
    lag_1 = exp(-h / p.tau_I) if p.tau_I > 0.0 and p.lag_law == 0.0 else 0.0
    lag_2 = exp(-2.0 * h / p.tau_I) if p.tau_I > 0.0 and p.lag_law == 1.0 else 0.0
    # Second order with damping 0.5, exact over a step in which the input is held.
    damped = sqrt(0.75) * h / p.tau_I if p.tau_I > 0.0 else 0.0
    lag_c, lag_s, lag_decay = cos(damped), sin(damped) / sqrt(0.75), exp(-damped * 0.5 / sqrt(0.75))
    memory = np.zeros(4)
    for k in range(n):
        t = k * 0.004
        states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4] = w, P1, P2, v, x
        current[k] = ask(loop, k, wanted[k], w + seen[k, 0], x + seen[k, 1], memory, gains)
        warm = 1.0 - p.drop * ((1.0 - exp(-t / p.warm_time)) if p.warm_law == 0.0 else min(t / 24.0, 1.0))
        if p.warm_law == 2.0:
            heat += 0.004 / p.warm_time * (abs(p.K_T * current[k] * w) / LOSS - heat)
            warm = 1.0 - p.drop * (1.0 - exp(-heat))
        K_T = p.K_T * (1.0 - p.heat_droop * (1.0 - exp(-t / 10.0)))
        K_L = p.K_L + p.leak_growth * t / 24.0
        B_M, B_R = p.B_FM * warm, p.B_FR * warm
        jam = p.jam if t >= p.jam_time else 0.0
        push = p.wander * disturbance[k]
        for j in range(steps):
            if j % every == 0:
                i = 4 * k + j // every
                dense[i, 0], dense[i, 1], dense[i, 2] = w, P1 + drop_line, P2 - drop_line
                dense[i, 3], dense[i, 4] = x, cell

            # Drive.
            at = k * steps + j - delay
            asked = current[at // steps] if at >= 0 else 0.0
            if p.drive_step > 0.0:
                asked = p.drive_step * round(asked / p.drive_step)
            asked = beyond(asked, p.drive_dead_band)
            slew += (
                min(max(asked - slew, -p.drive_slope * h), p.drive_slope * h) if p.drive_slope < inf else asked - slew
            )
            aim = slew + p.I_0
            if lag_1 > 0.0 or lag_2 > 0.0:
                before = lagged
                if lag_1 > 0.0:
                    lagged = aim + (lagged - aim) * lag_1
                else:
                    middle = 0.5 * first_lag
                    first_lag = aim + (first_lag - aim) * lag_2
                    middle += 0.5 * first_lag
                    lagged = middle + (lagged - middle) * lag_2
                drive = 0.5 * (before + lagged)
            elif p.tau_I > 0.0 and p.lag_law == 2.0:
                before = lagged
                away = lagged - aim
                lagged = aim + lag_decay * ((lag_c + 0.5 * lag_s) * away + lag_s * p.tau_I * lag_rate)
                lag_rate = lag_decay * ((lag_c - 0.5 * lag_s) * lag_rate - lag_s / p.tau_I * away)
                drive = 0.5 * (before + lagged)
            else:
                drive = aim

            for half in range(2):
                # Pressures, position, angle and bristle: half a step.
                g = 0.5 * h
                pump = w_pump
                if p.pump_dead_zone > 0.0:
                    pump = beyond(pump, p.pump_dead_zone)
                D = p.D
                if p.displacement_pressure != 0.0:
                    D *= 1.0 - p.displacement_pressure * abs(P1 - P2) / 1e6
                if p.filling_loss != 0.0:
                    D *= 1.0 - p.filling_loss * (pump / 471.0) ** 2
                if p.flow_ripple != 0.0:
                    D *= 1.0 + p.flow_ripple * sin(p.flow_order * angle)
                dP = P1 - P2
                across = K_L * dP
                if p.K_t > 0.0:
                    across += orifice(dP, p.K_t, p.orifice_law)
                if p.one_way_leak > 0.0:
                    across += p.one_way_leak * max(dP, 0.0)
                if p.relief_law == 1.0:
                    across += 2e-10 * beyond(dP, p.P_crack)
                q = D * pump - across
                q1, q2 = q - A1 * v, A2 * v - q
                q1 -= p.K_e1 * P1
                q2 -= p.K_e2 * P2
                if p.relief_law == 0.0 and p.P_crack < inf:
                    q1 -= 2e-10 * max(P1 - p.P_crack, 0.0)
                    q2 -= 2e-10 * max(P2 - p.P_crack, 0.0)
                elif p.relief_law == 2.0:
                    close = RESEAT * p.P_crack
                    open_1 = close < P1 and (open_1 or p.P_crack < P1)
                    open_2 = close < P2 and (open_2 or p.P_crack < P2)
                    q1 -= 2e-10 * (P1 - close) if open_1 else 0.0
                    q2 -= 2e-10 * (P2 - close) if open_2 else 0.0
                if p.P_open > -inf:
                    q1 += 1e-9 * max(p.P_open - P1, 0.0)
                    q2 += 1e-9 * max(p.P_open - P2, 0.0)
                if p.hose > 0.0:
                    late_1, late_2 = (P1 - wall_1) / p.hose_time, (P2 - wall_2) / p.hose_time
                    q1 -= p.hose * late_1
                    q2 -= p.hose * late_2
                    wall_1 += g * late_1
                    wall_2 += g * late_2
                air_1, air_2 = p.air, p.air
                if p.air_law == 3.0 and p.air > 0.0:
                    gas_1 += g / SOLUTION_TIME * (free_air(P1, p.air) - gas_1)
                    gas_2 += g / SOLUTION_TIME * (free_air(P2, p.air) - gas_2)
                    air_1, air_2 = gas_1, gas_2
                b1 = p.beta if p.air == 0.0 else stiffness(P1, p.beta, air_1, p.air_law)
                b2 = p.beta if p.air == 0.0 else stiffness(P2, p.beta, air_2, p.air_law)
                P1 += g * b1 * q1 / (p.V_10 + p.stroke_term * A1 * x)
                P2 += g * b2 * q2 / (p.V_20 - p.stroke_term * A2 * x)
                x += g * v
                x_load += g * v_load
                angle += g * w_pump
                twist += g * (w - w_pump)
                if p.bristle > 0.0 and p.bristle_law == 2.0:
                    level = (up if v > 0.0 else down) + stribeck(v, p.C_FR, p.tau_FR)
                    maxwell_slip(slip, g * v / p.bristle, level)
                elif p.bristle > 0.0:
                    level = (up if v > 0.0 else down) + (stribeck(v, p.C_FR, p.tau_FR) if p.bristle_law == 0.0 else 0.0)
                    z = (z + g * v) / (1.0 + g * abs(v) / (p.bristle * level))
                if half == 1:
                    break

                # Shaft: a whole step.
                dP = P1 - P2
                if p.line_law == 1.0:
                    flow = D * pump - across
                    drop_line = p.R_lam * flow + p.R_turb * turbulent(flow, p.line_exponent)
                torque = K_T * saturated(drive, p.k_sat, p.saturation_law)
                if p.T_c > 0.0:
                    u = p.ripple_order * angle + p.ripple_phase
                    torque -= p.T_c * (sin(u) + 0.2 * sin(2.0 * u))
                    if p.ripple_second > 0.0:
                        torque -= p.T_c * p.ripple_share * sin(p.ripple_second * angle + 1.3 * p.ripple_phase)
                load = D * (dP + 2.0 * drop_line)
                dry = p.A_FM
                if p.c_f > 0.0:
                    film = 1.0 if p.loss_law == 0.0 else 0.7 + 0.9 / (1.0 + abs(w) / 40.0)
                    if p.loss_law == 2.0:
                        film = abs(w) / 100.0
                    dry += p.c_f * film * abs(load)
                if abs(drive) < p.brake_current:
                    dry += p.brake
                if p.windage > 0.0:
                    torque -= p.windage * w * abs(w)
                if p.coupling > 0.0:
                    link = beyond(twist, p.coupling_play) / p.coupling + 0.01 * (w - w_pump)
                    w = slide(w, torque - link, p.J_M - J_pump, B_M, dry, dry, p.C_FM, p.tau_FM, h)
                    w_pump += h * (link - load) / J_pump
                else:
                    w = slide(w, torque - load, p.J_M, B_M, dry, dry, p.C_FM, p.tau_FM, h)
                    w_pump = w

                # Rod: a whole step.
                force = A1 * P1 - A2 * P2 - p.F_rod - push
                if p.line_law == 0.0 and (p.R_lam > 0.0 or p.R_turb > 0.0):
                    flow = p.A * v
                    force -= 2.0 * p.A * (p.R_lam * flow + p.R_turb * turbulent(flow, p.line_exponent))
                dry = p.A_FR + jam
                if p.h > 0.0:
                    dry += p.A_FR * p.h * bump(x, p.bump_place, p.bump_width, p.bump_law)
                if p.kappa > 0.0:
                    dry += p.kappa * p.A * (abs(dP) if p.seal_law == 0.0 else max(max(P1, P2) - p.P_0, 0.0))
                if p.memory > 0.0:
                    if v * last < 0.0:
                        fresh = 0.0
                    if v != 0.0:
                        last = v
                        fresh += h * (1.0 - fresh) / p.memory_time
                    dry *= 1.0 - p.memory * (1.0 - fresh)
                up, down = dry + p.asymmetry * p.A_FR, dry - p.asymmetry * p.A_FR
                B = B_R
                if p.asymmetry_law == 1.0:
                    B *= 1.0 + (p.asymmetry if v > 0.0 else -p.asymmetry)
                if x > p.x_stop:
                    force -= contact(x - p.x_stop, v, p.stop_law)
                elif x < -p.x_stop:
                    force += contact(-p.x_stop - x, -v, p.stop_law)
                if p.width > 0.0:
                    gap = beyond(x - x_load, 0.5 * p.width)
                    cell = 4e6 * gap + (4e3 * (v - v_load) if gap != 0.0 else 0.0)
                    held = spring(x_load, p.K_S, p.k_3, p.hardening_law) + p.F_0
                    v_load += h * (cell - held - 60.0 * v_load) / carriage
                else:
                    cell = spring(x, p.K_S, p.k_3, p.hardening_law) + p.F_0
                    v_load = v
                force -= cell
                before = v
                if p.bristle > 0.0 and p.bristle_law == 2.0:
                    v = slide(v, force - slip.sum(), mass, B, 0.0, 0.0, 0.0, 1.0, h)
                elif p.bristle > 0.0:
                    level = (up if v > 0.0 else down) + (stribeck(v, p.C_FR, p.tau_FR) if p.bristle_law == 0.0 else 0.0)
                    rate = v - abs(v) * z / (p.bristle * level)
                    force -= z / p.bristle + (2e4 * rate if p.bristle_law == 0.0 else 0.0)
                    v = slide(v, force, mass, B, 0.0, 0.0, 0.0, 1.0, h)
                else:
                    v = slide(v, force, mass, B, up, down, p.C_FR, p.tau_FR, h)
                if p.m_load > 0.0 and p.width == 0.0:
                    cell += p.m_load * (v - before) / h
    states[n, 0], states[n, 1], states[n, 2], states[n, 3], states[n, 4] = w, P1, P2, v, x
    dense[4 * n, 0], dense[4 * n, 1], dense[4 * n, 2] = w, P1 + drop_line, P2 - drop_line
    dense[4 * n, 3], dense[4 * n, 4] = x, cell
