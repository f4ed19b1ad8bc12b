"""Reference solution of the paper's (12) with friction (8), where sign(0) is a set.

A contact either slides in a direction d, in which (8) is smooth, or sticks at zero speed while the net force is below
the breakaway force A + C. SciPy integrates between mode changes and locates them. The file implements the equations
independently of the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import exp
from typing import Any

import numpy as np
from engine_cases import DT, SCALES, START, Array, Case
from scipy.integrate import solve_ivp

SHAFT, ROD = 0, 1
SPEED = (0, 3)  # where omega and v stand in the state

#: A contact that has just broken away starts on its own switching surface; its stop is searched only after this time.
BLIND = 1e-6  # s


class Physics:
    """Equations (8) and (12) for given sliding directions; current = u + slope * t."""

    def __init__(self, values: dict[str, float]) -> None:
        self.p = values

    def drive(self, contact: int, y: Array, current: float) -> float:
        """Torque on the shaft or force on the rod, without friction."""
        p, dP = self.p, float(y[1] - y[2])
        return p["K_T"] * current - p["D"] * dP if contact == SHAFT else p["A"] * dP - p["K_S"] * float(y[4])

    def breakaway(self, contact: int) -> float:
        """Breakaway level of (8) at speed 0."""
        return self.p["A_FM"] + self.p["C_FM"] if contact == SHAFT else self.p["A_FR"] + self.p["C_FR"]

    def rates(self, u: float, slope: float, d: tuple[int, int]) -> Callable[[float, Array], list[float]]:
        p = self.p
        J_M, K_T, D, K_L, V_10, V_20 = p["J_M"], p["K_T"], p["D"], p["K_L"], p["V_10"], p["V_20"]
        beta, A, M, K_S = p["beta"], p["A"], p["M"], p["K_S"]
        A_FM, B_FM, C_FM, tau_FM = p["A_FM"], p["B_FM"], p["C_FM"], p["tau_FM"]
        A_FR, B_FR, C_FR, tau_FR = p["A_FR"], p["B_FR"], p["C_FR"], p["tau_FR"]
        d_M, d_R = d

        def f(t: float, y: Array) -> list[float]:
            omega, P_1, P_2, v, x = y.tolist()
            dP = P_1 - P_2
            Q = D * omega - A * v - K_L * dP
            d_omega = d_v = 0.0
            if d_M:
                # Trial steps may overshoot a stop by far; the bound only keeps them from overflowing.
                T_FM = d_M * A_FM + B_FM * omega + d_M * C_FM * exp(min(-d_M * omega / tau_FM, 50.0))
                d_omega = (K_T * (u + slope * t) - T_FM - D * dP) / J_M
            if d_R:
                F_FR = d_R * A_FR + B_FR * v + d_R * C_FR * exp(min(-d_R * v / tau_FR, 50.0))
                d_v = (A * dP - F_FR - K_S * x) / M
            return [d_omega, beta / (V_10 + A * x) * Q, -beta / (V_20 - A * x) * Q, d_v, v]

        return f


@dataclass(frozen=True)
class Solution:
    """States (N, 5) at the samples, and the instants at which a contact stopped, reversed or broke away."""

    states: Array
    event_times: Array


def pieces(case: Case, every_sample: bool) -> list[tuple[int, int]]:
    """Sample ranges over which the current runs along one line, or every sample by itself."""
    edges = [0]
    for k in range(1, case.current.size - 1):
        (u_0, slope_0), (u, slope) = case.line(k - 1), case.line(k)
        if every_sample or slope != slope_0 or u != u_0 + slope_0 * DT:
            edges.append(k)
    edges.append(case.current.size - 1)
    return list(pairwise(edges))


def event_driven(case: Case, method: str = "DOP853", rtol: float = 1e-12, every_sample: bool = True) -> Solution:
    """Integrate with any method of solve_ivp; `every_sample` restarts there, so that no output is interpolated."""
    physics = Physics(case.values)
    y, d, blind = START.copy(), [0, 0], [False, False]
    states = np.empty((case.current.size, 5))
    states[0] = y
    found: list[float] = []
    for first, last in pieces(case, every_sample):
        u, slope = case.line(first)
        length, t = (last - first) * DT, 0.0
        samples = DT * np.arange(1, last - first + 1)
        samples[-1] = length
        for contact in (SHAFT, ROD):  # the current may have jumped past what a resting contact holds
            if d[contact] == 0:
                _settle(physics, y, d, blind, contact, u)
        while t < length:
            end = min(t + BLIND, length) if any(blind) else length
            events = _events(physics, d, blind, u, slope)
            i, j = np.searchsorted(samples, (t, end), side="right")
            times = samples[i:j] if j > i and samples[j - 1] == end else np.append(samples[i:j], end)
            run = solve_ivp(
                physics.rates(u, slope, (d[SHAFT], d[ROD])), (t, end), y, method=method, t_eval=times,
                events=[g for _, g in events], rtol=rtol, atol=rtol * SCALES, max_step=DT,
            )  # fmt: skip
            if run.status < 0:
                raise RuntimeError(f"{method} at {first * DT + t:.6f} s: {run.message}")
            for k, column in zip(range(i, j), np.transpose(run.y), strict=False):  # an event may come before the end
                states[first + 1 + k] = column
            hit = [(contact, i) for i, (contact, _) in enumerate(events) if run.t_events[i].size]
            if hit:
                t = float(run.t_events[hit[0][1]][-1])
                y = run.y_events[hit[0][1]][-1].copy()
            else:
                t, y = end, run.y[:, -1].copy()
            for contact in (SHAFT, ROD):
                if blind[contact] and not hit:
                    blind[contact] = False
                    if d[contact] * y[SPEED[contact]] <= 0.0:  # it fell back at once
                        y[SPEED[contact]], d[contact] = 0.0, 0
            for contact, _ in hit:
                found.append(first * DT + t)
                if d[contact] == 0:  # the root stands for equality of drive and hold
                    d[contact], blind[contact] = int(np.sign(physics.drive(contact, y, u + slope * t))), True
                else:
                    y[SPEED[contact]], d[contact] = 0.0, 0
                    _settle(physics, y, d, blind, contact, u + slope * t)
    return Solution(states, np.array(found))


def _settle(physics: Physics, y: Array, d: list[int], blind: list[bool], contact: int, current: float) -> None:
    """A contact at rest starts to slide if the net force exceeds its breakaway level."""
    drive = physics.drive(contact, y, current)
    if abs(drive) > physics.breakaway(contact):
        d[contact], blind[contact] = int(np.sign(drive)), True


def _events(
    physics: Physics, d: list[int], blind: list[bool], u: float, slope: float
) -> list[tuple[int, Callable[[float, Array], float]]]:
    """Event function of each contact: it crosses zero when the mode ends."""

    def stop(contact: int) -> Callable[[float, Array], float]:
        direction, speed = d[contact], SPEED[contact]
        return lambda t, y: direction * y[speed]

    def release(contact: int) -> Callable[[float, Array], float]:
        hold = physics.breakaway(contact)
        return lambda t, y: hold - abs(physics.drive(contact, y, u + slope * t))

    events = []
    for contact in (SHAFT, ROD):
        if not blind[contact]:
            g: Any = stop(contact) if d[contact] else release(contact)
            g.terminal, g.direction = True, -1.0
            events.append((contact, g))
    return events
