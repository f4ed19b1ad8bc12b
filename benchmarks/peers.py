"""The same plant as users of python-control, scipy and casadi would write it: sign(s) smoothed to tanh(s / width).

Every peer is a function of a case that prepares whatever can be prepared and returns the run to be timed.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, tanh
from typing import Any

import numpy as np
from cases import DT, SCALES, START, Array, Case
from reference import event_driven, pieces
from scipy.integrate import solve_ivp

Run = Callable[[], Array]
Widths = tuple[float, float]

#: Smoothing widths in omega [rad/s] and v [m/s]: what is often taken, and as narrow as the solvers bear.
E1: Widths = (1.0, 1e-3)
E3: Widths = (0.01, 1e-5)

#: An absolute tolerance that is the same number for Pa and m gives plausible wrong answers; these are per state.
TIGHT: dict[str, Any] = {"rtol": 1e-6, "atol": 1e-6 * SCALES}


def smooth_rates(case: Case, widths: Widths) -> Callable[[list[float], float], list[float]]:
    """Right-hand side of (12) with smoothed (8), on plain floats: the fastest that Python offers."""
    p = case.values
    J_M, K_T, D, K_L, V_10, V_20 = p["J_M"], p["K_T"], p["D"], p["K_L"], p["V_10"], p["V_20"]
    beta, A, M, K_S = p["beta"], p["A"], p["M"], p["K_S"]
    A_FM, B_FM, C_FM, tau_FM = p["A_FM"], p["B_FM"], p["C_FM"], p["tau_FM"]
    A_FR, B_FR, C_FR, tau_FR = p["A_FR"], p["B_FR"], p["C_FR"], p["tau_FR"]
    width_M, width_R = widths

    def f(y: list[float], current: float) -> list[float]:
        omega, P_1, P_2, v, x = y
        dP = P_1 - P_2
        Q = D * omega - A * v - K_L * dP
        T_FM = tanh(omega / width_M) * (A_FM + C_FM * exp(-abs(omega) / tau_FM)) + B_FM * omega
        F_FR = tanh(v / width_R) * (A_FR + C_FR * exp(-abs(v) / tau_FR)) + B_FR * v
        return [
            (K_T * current - T_FM - D * dP) / J_M,
            beta / (V_10 + A * x) * Q,
            -beta / (V_20 - A * x) * Q,
            (A * dP - F_FR - K_S * x) / M,
            v,
        ]

    return f


def python_control(case: Case, widths: Widths, **options: Any) -> Run:
    """`input_output_response`. It joins samples by lines, so a held input has to be held inside the update function."""
    import control

    f = smooth_rates(case, widths)
    held = case.current.tolist()

    def joined(t: float, y: Array, u: Array, params: dict[str, Any]) -> list[float]:
        return f(y.tolist(), u[0])

    def stepped(t: float, y: Array, u: Array, params: dict[str, Any]) -> list[float]:
        return f(y.tolist(), held[int(t / DT + 1e-9)])

    system = control.nlsys(joined if case.first_order else stepped, None, inputs=1, outputs=5, states=5)
    time = DT * np.arange(case.current.size)
    current = case.current if case.first_order else np.zeros(case.current.size)
    return lambda: control.input_output_response(system, time, current, START, **options).states.T


def scipy_lsoda(case: Case) -> Run:
    """`solve_ivp`, restarted where the current jumps."""
    f = smooth_rates(case, E3)
    time, samples = DT * np.arange(case.current.size), case.current.tolist()
    ranges = [(0, case.current.size - 1)] if case.first_order else pieces(case, every_sample=False)

    def joined(t: float, y: Array) -> list[float]:
        k = min(int(t / DT), len(samples) - 2)
        return f(y.tolist(), samples[k] + (samples[k + 1] - samples[k]) * (t / DT - k))

    def run() -> Array:
        states = np.empty((case.current.size, 5))
        states[0] = START
        for first, last in ranges:
            u = samples[first]
            part = solve_ivp(
                joined if case.first_order else lambda t, y, u=u: f(y.tolist(), u),
                (time[first], time[last]), states[first], method="LSODA", t_eval=time[first + 1 : last + 1], **TIGHT,
            )  # fmt: skip
            if part.status < 0:
                raise RuntimeError(part.message)
            states[first + 1 : last + 1] = part.y.T
        return states

    return run


def scipy_event_driven(case: Case) -> Run:
    """Set-valued friction and `solve_ivp` with events: what the compiled engine does, in Python."""
    return lambda: event_driven(case, "DOP853", 1e-6, every_sample=False).states


def casadi_cvodes(case: Case) -> Run:
    """casadi's integrator with exact Jacobians; it restarts where its piecewise constant controls change."""
    import casadi as ca

    p = case.values
    z, time, w = ca.SX.sym("z", 5), ca.SX.sym("t"), ca.SX.sym("w", 3)
    y = z * SCALES.tolist()  # cvodes takes one absolute tolerance for all
    omega, P_1, P_2, v, x = ca.vertsplit(y)
    current = w[0] + w[1] * (time - w[2])
    dP = P_1 - P_2
    Q = p["D"] * omega - p["A"] * v - p["K_L"] * dP
    T_FM = ca.tanh(omega / E3[0]) * (p["A_FM"] + p["C_FM"] * ca.exp(-ca.fabs(omega) / p["tau_FM"]))
    F_FR = ca.tanh(v / E3[1]) * (p["A_FR"] + p["C_FR"] * ca.exp(-ca.fabs(v) / p["tau_FR"]))
    rates = ca.vertcat(
        (p["K_T"] * current - T_FM - p["B_FM"] * omega - p["D"] * dP) / p["J_M"],
        p["beta"] / (p["V_10"] + p["A"] * x) * Q,
        -p["beta"] / (p["V_20"] - p["A"] * x) * Q,
        (p["A"] * dP - F_FR - p["B_FR"] * v - p["K_S"] * x) / p["M"],
        v,
    )
    n = case.current.size
    lines = np.array([[*case.line(k), k * DT if case.first_order else 0.0] for k in range(n - 1)])
    dae = {"x": z, "t": time, "u": w, "ode": rates / SCALES.tolist()}
    options = {"reltol": 1e-6, "abstol": 1e-6, "max_num_steps": 1_000_000}
    integrator = ca.integrator("plant", "cvodes", dae, 0.0, (DT * np.arange(1, n)).tolist(), options)

    def run() -> Array:
        result = integrator(x0=START / SCALES, u=lines.T)["xf"]
        return np.vstack([START, np.asarray(result).T * SCALES])

    return run
