"""The same plant in other tools, as their users would write it.

With python-control, SciPy, CasADi and diffrax, sign(s) is smoothed to tanh(s / width). Time stepping and MuJoCo keep
friction set-valued with a fixed step. Every peer is a function of a case that prepares the simulation and returns the
function to be timed.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, tanh
from typing import Any

import numpy as np
from engine_cases import DT, SCALES, START, Array, Case
from reference import event_driven, pieces
from scipy.integrate import solve_ivp

Run = Callable[[], Array]
Widths = tuple[float, float]

#: Smoothing widths in omega [rad/s] and v [m/s]: common values, and the smallest that the solvers handle.
E1: Widths = (1.0, 1e-3)
E3: Widths = (0.01, 1e-5)

#: Absolute tolerances per state; one number for both Pa and m gives plausible but wrong results.
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
    """`input_output_response`; it interpolates the input, so the update function itself must hold a constant input."""
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
    """CasADi's CVODES integrator with exact Jacobians; it restarts when a piecewise constant input changes."""
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


def by_diffrax(case: Case, solver: str, widths: Widths) -> Run:
    """A solver of diffrax, compiled by XLA and restarted at every sample, as the current may jump there."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    p, scale, E = case.values, jnp.array(SCALES), widths

    def rates(t: Any, z: Any, line: Any) -> Any:
        omega, P_1, P_2, v, x = z * scale
        dP = P_1 - P_2
        Q = p["D"] * omega - p["A"] * v - p["K_L"] * dP
        T_FM = jnp.tanh(omega / E[0]) * (p["A_FM"] + p["C_FM"] * jnp.exp(-jnp.abs(omega) / p["tau_FM"]))
        F_FR = jnp.tanh(v / E[1]) * (p["A_FR"] + p["C_FR"] * jnp.exp(-jnp.abs(v) / p["tau_FR"]))
        slopes = jnp.array(
            [
                (p["K_T"] * (line[0] + line[1] * t) - T_FM - p["B_FM"] * omega - p["D"] * dP) / p["J_M"],
                p["beta"] / (p["V_10"] + p["A"] * x) * Q,
                -p["beta"] / (p["V_20"] - p["A"] * x) * Q,
                (p["A"] * dP - F_FR - p["B_FR"] * v - p["K_S"] * x) / p["M"],
                v,
            ]
        )
        return slopes / scale

    term, method = diffrax.ODETerm(rates), getattr(diffrax, solver)()
    control = diffrax.PIDController(rtol=1e-6, atol=1e-6)

    def sample(z: Any, line: Any) -> tuple[Any, Any]:
        found = diffrax.diffeqsolve(
            term, method, 0.0, DT, 1e-4, z, line, stepsize_controller=control, max_steps=100_000,
            saveat=diffrax.SaveAt(t1=True), adjoint=diffrax.ForwardMode(),
        )  # fmt: skip
        return found.ys[0], found.ys[0]

    lines = jnp.array([case.line(k) for k in range(case.current.size - 1)])
    whole = jax.jit(lambda z: jax.lax.scan(sample, z, lines)[1])
    first = jnp.array(START / SCALES)

    return lambda: np.vstack([START, np.asarray(whole(first)) * SCALES])


def time_stepping(case: Case, substeps: int = 16) -> Run:
    """Moreau-Jean's theta method at a fixed step: set-valued friction by projection, no events; compiled by numba.

    Source: V. Acary, B. Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", Springer 2008, chapter 10;
    theta = 1/2, the oil's stiffness taken implicitly, the Stribeck level from the step's beginning.
    """
    p = case.values
    names = ("J_M", "K_T", "D", "K_L", "V_10", "V_20", "beta", "A", "M", "K_S")
    names += ("A_FM", "B_FM", "C_FM", "tau_FM", "A_FR", "B_FR", "C_FR", "tau_FR")
    values = np.array([p[name] for name in names])
    lines = np.array([case.line(k) for k in range(case.current.size - 1)])
    run = _moreau_jean()

    return lambda: run(values, lines, START, DT, substeps)


def _moreau_jean() -> Callable[..., Array]:
    import numba

    @numba.njit(fastmath=True)
    def run(values: Array, lines: Array, start: Array, dt: float, substeps: int) -> Array:
        J_M, K_T, D, K_L, V_10, V_20, beta, A, M, K_S = values[:10]
        A_FM, B_FM, C_FM, tau_FM, A_FR, B_FR, C_FR, tau_FR = values[10:]
        out = np.empty((len(lines) + 1, 5))
        out[0] = start
        omega, P_1, P_2, v, x = start
        h, p_M, p_R = dt / substeps, 0.0, 0.0
        for k in range(len(lines)):
            for i in range(substeps):
                u = lines[k, 0] + lines[k, 1] * (i + 0.5) * h
                soft_1, soft_2 = beta / (V_10 + A * x), beta / (V_20 - A * x)
                soft = 0.5 * h * (soft_1 + soft_2)
                # dP in the middle of the step is (dP + soft (D omega - A v)) / leak with the mean speeds.
                leak = 1.0 + soft * K_L
                g = 0.25 * h * 2.0 * soft / leak
                G_MM = J_M + 0.5 * h * B_FM + g * D * D
                G_RR = M + 0.5 * h * B_FR + g * A * A + 0.25 * h * h * K_S
                G_MR = -g * D * A
                dP = (P_1 - P_2 + 0.5 * soft * (D * omega - A * v)) / leak
                b_M = J_M * omega + h * (K_T * u - D * dP - 0.5 * B_FM * omega)
                b_R = M * v + h * (A * dP - K_S * (x + 0.25 * h * v) - 0.5 * B_FR * v)
                most_M = h * (A_FM + C_FM * np.exp(-abs(omega) / tau_FM))
                most_R = h * (A_FR + C_FR * np.exp(-abs(v) / tau_FR))
                per = 1.0 / (G_MM * G_RR - G_MR * G_MR)
                for _ in range(50):
                    was_M, was_R = p_M, p_R
                    new_omega = (G_RR * (b_M - p_M) - G_MR * (b_R - p_R)) * per
                    p_M = min(max(p_M + new_omega / (G_RR * per), -most_M), most_M)
                    new_v = (G_MM * (b_R - p_R) - G_MR * (b_M - p_M)) * per
                    p_R = min(max(p_R + new_v / (G_MM * per), -most_R), most_R)
                    if abs(p_M - was_M) <= 1e-13 and abs(p_R - was_R) <= 1e-10:
                        break
                new_omega = (G_RR * (b_M - p_M) - G_MR * (b_R - p_R)) * per
                new_v = (G_MM * (b_R - p_R) - G_MR * (b_M - p_M)) * per
                mean_omega, mean_v = 0.5 * (omega + new_omega), 0.5 * (v + new_v)
                dP = (P_1 - P_2 + soft * (D * mean_omega - A * mean_v)) / leak
                into = h * (D * mean_omega - A * mean_v - K_L * dP)
                P_1, P_2, x = P_1 + soft_1 * into, P_2 - soft_2 * into, x + h * mean_v
                omega, v = new_omega, new_v
            out[k + 1] = omega, P_1, P_2, v, x
        return out

    compiled: Callable[..., Array] = run
    return compiled


def mujoco_tendon(case: Case) -> Run:
    """MuJoCo with 0.1 ms steps: hinge and slide, oil as a tendon stiffness, Coulomb friction as `frictionloss`.

    A simpler model: no Stribeck effect, no leakage, and no volumes that vary with the stroke.
    """
    import mujoco

    p = case.values
    stiffness = p["beta"] * (1.0 / p["V_10"] + 1.0 / p["V_20"])
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco><option timestep="1e-4" gravity="0 0 0" integrator="implicitfast" cone="elliptic"/>
  <worldbody>
    <body><joint name="shaft" type="hinge" axis="1 0 0" damping="{p["B_FM"]}" frictionloss="{p["A_FM"]}"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{p["J_M"]} {p["J_M"]} {p["J_M"]}"/></body>
    <body><joint name="rod" type="slide" axis="1 0 0" damping="{p["B_FR"]}" frictionloss="{p["A_FR"]}"
        stiffness="{p["K_S"]}"/>
      <inertial pos="0 0 0" mass="{p["M"]}" diaginertia="1 1 1"/></body>
  </worldbody>
  <tendon><fixed name="oil" stiffness="{stiffness}" springlength="0">
    <joint joint="shaft" coef="{p["D"]}"/><joint joint="rod" coef="{-p["A"]}"/></fixed></tendon>
  <actuator><motor joint="shaft" gear="{p["K_T"]}"/></actuator>
</mujoco>""")
    data, steps = mujoco.MjData(model), round(DT / model.opt.timestep)

    def run() -> Array:
        mujoco.mj_resetData(model, data)
        states = np.empty((case.current.size, 5))
        for k in range(case.current.size):
            pressed = p["D"] * data.qpos[0] - p["A"] * data.qpos[1]
            P_1, P_2 = START[1] + p["beta"] / p["V_10"] * pressed, START[2] - p["beta"] / p["V_20"] * pressed
            states[k] = data.qvel[0], P_1, P_2, data.qvel[1], data.qpos[1]
            u, slope = case.line(min(k, case.current.size - 2))
            data.ctrl[0] = u + 0.5 * slope * DT
            mujoco.mj_step(model, data, nstep=steps)
        return states

    return run
