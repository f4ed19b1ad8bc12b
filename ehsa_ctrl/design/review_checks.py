"""The checks of a design review: model, linear loop, and effects of friction.

A check is a generator from a ReviewContext to findings; it yields nothing where it does not apply.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core.controller_interface import MEASURED
from .analysis.closed_loop import INPUTS, OUTPUTS, close_loop, discrete_response, spectral_radius, unit_step
from .analysis.contact import loop_model
from .analysis.loop import LoopAnalysis
from .analysis.sampled import DRIVES, drive_of, hidden_modes, readings, scaled_matrices, state_scales

if TYPE_CHECKING:
    import control

    from .analysis.robustness import RobustMargins

Verdict = Literal["good", "warning", "fault"]

# All thresholds are engineering judgement.
#: Limits on a loop: largest |S|, smallest disk margin, least samples per period of the crossover.
MAX_MS, MIN_DISK_MARGIN, MIN_SAMPLES = 1.6, 0.6, 10.0
#: Largest solver time per sample time: half is left for everything else. Largest RMS noise per current limit.
MAX_SOLVER_SHARE, MAX_NOISE_SHARE = 0.5, 0.02
#: Largest ratio of state sizes: its square, in a quadratic cost, takes 12 of the 16 digits of a double.
MAX_STATE_RATIO = 1e6
#: Current limit over breakaway current: at 1 the rod may never move; below 1.5 little is left to accelerate it.
NO_MOTION, LITTLE_MOTION = 1.0, 1.5
#: Error [m] whose breakaway time is reported, and the longest such time [samples].
STUCK_ERROR, LONGEST_WAIT = 1e-4, 5000
#: Two low frequencies, as shares of 1 / sample_time, between which an integrator's gain falls by ten.
LOW_FREQUENCIES = np.array([1e-6, 1e-5])


@dataclass(frozen=True)
class Known:
    """Facts beyond the linear model, in SI units; nan where unknown. `known_of` fills it from a plant.

    static, coulomb: breakaway current [A], and current that balances Coulomb friction while sliding, unloaded.
    slip: smallest motion [m] that a current pulse can cause.
    reach: m, largest |position| of the reference, for the force of the load's spring.
    solver_time: s, longest time that the solver takes for a sample.
    noise: channel -> standard deviation of its sensor noise.
    """

    static: float = nan
    coulomb: float = nan
    slip: float = nan
    reach: float = nan
    solver_time: float = nan
    noise: Mapping[str, float] | None = None


@dataclass(frozen=True)
class ReviewFinding:
    """Outcome of one check: result as text, verdict, and suggested fix unless the verdict is good."""

    test: str
    result: str
    verdict: Verdict
    fix: str = ""


class ReviewContext:
    """Common input of all checks.

    Attributes
    ----------
    system, controller, known, robust: as for `review`. loop: the analysis of the loop.
    sample_time: s. law, closed: discrete linear systems, see analysis.closed_loop.
    feedback: the controller's law object; some have `model` and `horizon`.
    rests: whether the controller has a [rest], which holds the integral while the rod rests.
    in_contact: whether the loop is closed against an environment, where the position has no target of its own.
    integrates: whether a constant error makes the current grow without bound.
    error_gain: A/m, largest current within five samples of a step of the error at rest.
    """

    def __init__(
        self,
        system: control.StateSpace,
        controller: Any,
        known: Known,
        loop: LoopAnalysis,
        robust: RobustMargins | None,
        lag: int,
    ) -> None:
        self.system, self.controller, self.known, self.loop, self.robust = system, controller, known, loop, robust
        self.sample_time = float(controller.sample_time)
        _, self.law, self.closed = close_loop(system, controller, lag * self.sample_time)
        self.feedback = getattr(controller, "law", controller)
        self.rests = getattr(controller, "rest", None) is not None
        self.in_contact = loop_model(system, controller) is not system
        self.current_limit = float(getattr(controller, "current_limit", inf))
        slow = np.abs(
            discrete_response(self.law[0, 3 + MEASURED.index("position")], LOW_FREQUENCIES / self.sample_time)[:, 0, 0]
        )
        self.integrates = bool(slow[0] > 3.0 * slow[1])
        self.error_gain = float(np.max(np.abs(self.current_of_error(5))))

    def current_of_error(self, samples: int) -> np.ndarray:
        """Current (samples,) [A/m] after a step of the error while friction holds the rod."""
        return unit_step(self.law, 0, [0], samples)[:, 0]

    def a(self, row: str, column: str) -> float:
        """Entry of the model's A by state names; nan if it lacks one of them."""
        return self._entry(self.system.A, row, list(self.system.state_labels), column)

    def b(self, row: str, column: str) -> float:
        """Entry of the model's B by state and input name; nan if it lacks one of them."""
        return self._entry(self.system.B, row, list(self.system.input_labels), column)

    def _entry(self, matrix: np.ndarray, row: str, columns: list[str], column: str) -> float:
        states = list(self.system.state_labels)
        return float(matrix[states.index(row), columns.index(column)]) if row in states and column in columns else nan

    @property
    def rise_time(self) -> float:
        """Time [s] from 10 to 90 % of a reference step; nan if 90 % is not reached."""
        # Five time constants of the slowest pole.
        decay = np.max(np.abs(self.loop.poles), initial=0.0)
        samples = int(min(max(5.0 / max(-np.log(max(decay, 1e-12)), 1e-4), 50), 20_000))
        step = unit_step(self.closed, INPUTS.index("r_position"), [OUTPUTS.index("position")], samples)[:, 0]
        if np.max(step) < 0.9:
            return nan
        return float(np.argmax(step >= 0.9) - np.argmax(step >= 0.1)) * self.sample_time

    @property
    def stiffness(self) -> float:
        """Load stiffness [N/m] in the model; nan if the model lacks the states."""
        return self.a("v", "x") / self.b("v", "F_D")


def _verdict(bad: bool, otherwise: Verdict = "warning") -> Verdict:
    return otherwise if bad else "good"


def reachability(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Modes that the current can't control or the readings can't observe."""
    a, b, c = scaled_matrices(case.system, state_scales(case.system))
    current, seen = b[:, [list(case.system.input_labels).index(drive_of(case.system))]], readings(case.system) @ c
    for word, modes, fix in (
        ("controllable", hidden_modes(a, current), "design on a model without the mode, e.g. three_state"),
        ("observable", hidden_modes(a.T, seen.T), "add a sensor, or design on a model without the mode"),
    ):
        listed = ", ".join(f"{mode if mode.imag else mode.real:.3g} rad/s" for mode in modes)
        verdict: Verdict = "good"
        if any(mode.real > 1e-9 for mode in modes):
            verdict = "fault"
        elif any(abs(mode.real) <= 1e-9 for mode in modes):
            verdict = "warning"
        yield ReviewFinding(f"model {word}", f"not the modes {listed}" if modes else "all modes", verdict, fix)


def stability(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Stability of the closed loop, and of the controller alone."""
    radius = float(np.max(np.abs(case.loop.poles), initial=0.0))
    yield ReviewFinding(
        "closed loop stable",
        f"largest |pole| {radius:.5f}" + ("" if case.loop.stable else ": NOT STABLE"),
        _verdict(not case.loop.stable, "fault"),
        "lower the gains or the crossover; check the sign of the feedback",
    )
    inner = spectral_radius(case.law.A)
    yield ReviewFinding(
        "controller stable by itself",
        f"largest |pole| {inner:.5f}" + (" (integral action)" if abs(inner - 1.0) < 1e-9 else ""),
        _verdict(inner > 1.0 + 1e-9),
        "an unstable law diverges while the current is limited: lower the crossover or slow the observer down",
    )


def stability_margins(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Ms, disk and delay margin, and samples per period of the crossover."""
    loop = case.loop
    if not loop.stable:
        return
    fix = "lower the crossover or specify a larger phase margin"
    yield ReviewFinding("Ms", f"{loop.Ms:.3g}, required at most {MAX_MS:g}", _verdict(loop.Ms > MAX_MS), fix)
    disk = f"{loop.disk_margin:.3g}, required at least {MIN_DISK_MARGIN:g}"
    yield ReviewFinding("disk margin", disk, _verdict(loop.disk_margin < MIN_DISK_MARGIN), fix)
    samples = loop.delay_margin / case.sample_time
    yield ReviewFinding(
        "delay margin",
        f"{1e3 * loop.delay_margin:.3g} ms, {samples:.3g} samples",
        _verdict(samples < 2.0, "fault" if samples < 1.0 else "warning"),
        "a real loop often adds one sample of delay: lower the crossover or sample faster",
    )
    if loop.crossover > 0:
        per_period = 2 * np.pi / (loop.crossover * case.sample_time)
        words = f"{per_period:.3g} samples per period of the crossover"
        yield ReviewFinding("sampling", words, _verdict(per_period < MIN_SAMPLES), "sample faster")


def worst_case(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Worst margins over the plants of `robust_margins`."""
    robust = case.robust
    if robust is None:
        return
    for name, key, value, bad in (
        ("worst disk margin", "disk_margin", robust.disk_margin, robust.disk_margin < MIN_DISK_MARGIN),
        ("worst Ms", "Ms", robust.Ms, not robust.Ms <= MAX_MS),
    ):
        yield ReviewFinding(
            name,
            f"{value:.3g} over {len(robust.loops)} plants, at {robust.worst[key].label}",
            _verdict(bad, "warning" if robust.stable else "fault"),
            "lower the crossover, or reduce the uncertainty of that parameter",
        )


def state_scaling(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Ratio of state magnitudes in the model that the law computes with."""
    from scipy.linalg import matrix_balance

    model = getattr(case.feedback, "model", None)
    scale = state_scales(case.system)
    if model is not None:
        _, (scale, _) = matrix_balance(np.asarray(model.A), permute=False, separate=True)
    ratio = float(np.max(scale) / np.min(scale))
    where = "the law's own model" if model is not None else "the plant's model, in SI units"
    computes = model is not None or hasattr(case.feedback, "horizon")
    yield ReviewFinding(
        "state scaling",
        f"state magnitudes differ by a factor of {ratio:.2g} in {where}",
        _verdict(computes and ratio > MAX_STATE_RATIO),
        "design in units that give states of similar magnitude (rad/s, bar, mm)",
    )


def steady_state_error(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Steady-state error of the linear loop to a reference and to a load."""
    if not case.loop.stable or case.in_contact:
        return
    closed, row = case.closed, OUTPUTS.index("position")
    column = INPUTS.index("r_position")
    gain = float(closed.C[row] @ np.linalg.solve(np.eye(closed.nstates) - closed.A, closed.B[:, column]))
    yield ReviewFinding(
        "reaches its target",
        f"{100 * (1 - gain):.3g} % steady-state error"
        if abs(1 - gain) > 1e-6
        else "no steady-state error in the linear model",
        _verdict(abs(1 - gain) > 1e-3),
        "add integral action, an estimate of the disturbance, or a reference gain",
    )
    static = abs(case.loop.static_compliance)
    words = f"{1e9 * static:.3g} um per kN of constant load" if static > 1e-15 else "none"  # below: rounding
    if case.stiffness > 0:
        words += f", with a spring of {1e-3 * case.stiffness:.4g} kN/m"
    yield ReviewFinding(
        "droop under load", words, _verdict(static > 1e-7), "add integral action or an estimate of the load"
    )


def leakage_creep(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Creep under load while friction holds the shaft: oil leaks past the pump, v = -K_L dP / A with dP = F / A."""
    leak = case.a("dP", "dP") / case.a("dP", "v")
    area = -case.a("v", "dP") / case.b("v", "F_D")
    if not (isfinite(leak) and isfinite(area)) or area == 0.0:
        return
    per_force = leak / area
    force = case.stiffness * case.known.reach
    words = f"{1e9 * per_force:.3g} um/s per kN while friction holds the shaft"
    if isfinite(force) and force > 0:
        words += f", {1e6 * per_force * force:.3g} um/s at {1e3 * case.known.reach:.3g} mm against the spring"
    yield ReviewFinding("creep by leakage", words, "good")


def friction(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Breakaway current, stick band, and limit cycles of the integral."""
    static, coulomb = case.known.static, case.known.coulomb
    if not (isfinite(static) and static > 0):
        return
    load = case.known.reach * -case.a("v", "x") / case.a("v", "dP")
    torque = case.a("omega", "dP") / case.b("omega", "current")
    spring = abs(load * torque) if isfinite(load * torque) else 0.0
    needed = static + spring
    unit = DRIVES[case.loop.drive]
    words = f"{static:.3g} {unit}" + (f" + {spring:.3g} {unit} for the spring" if spring else "")
    yield ReviewFinding(
        "breakaway",
        f"{words}, {'current ' if unit == 'A' else ''}limit {case.current_limit:.3g} {unit}",
        "fault" if case.current_limit <= NO_MOTION * needed else _verdict(case.current_limit < LITTLE_MOTION * needed),
        "raise current_limit or reduce the stroke",
    )
    if case.in_contact:
        return
    yield _stick_band(case)
    if case.integrates:
        words = "Coulomb friction is unknown"
        if isfinite(coulomb) and coulomb > 0:
            words = f"static friction is {100 * (static / coulomb - 1):.3g} % above Coulomb friction, "
            words += "[rest] holds the integral" if case.rests else "the integral keeps winding up at rest"
        yield ReviewFinding(
            "limit cycle of the integral",
            words,
            _verdict(isfinite(coulomb) and static > coulomb and not case.rests),
            "add a [rest] band of a few times the smallest slip, or remove the integral",
        )


def _stick_band(case: ReviewContext) -> ReviewFinding:
    """Position errors at which static friction holds the rod, and how long an integral takes to overcome it."""
    band = case.known.static / case.error_gain if case.error_gain > 0 else inf
    words = f"errors up to {1e6 * band:.4g} um persist"
    if case.integrates:
        current = np.abs(case.current_of_error(LONGEST_WAIT)) * STUCK_ERROR
        late = np.flatnonzero(current >= case.known.static)
        after = (
            f"{late[0] * case.sample_time:.3g} s" if late.size else f"more than {LONGEST_WAIT * case.sample_time:g} s"
        )
        words += f" until the integral has wound up, an error of {1e6 * STUCK_ERROR:g} um for {after}"
    if isfinite(case.known.slip):
        words += f"; the smallest slip is {1e6 * case.known.slip:.3g} um"
    fix = "add [feedforward] of friction or a [rest] with a knocker"
    return ReviewFinding("stick band", words, _verdict(not case.integrates and not case.rests), fix)


def noise(case: ReviewContext) -> Iterator[ReviewFinding]:
    """RMS current caused by sensor noise."""
    if not isfinite(case.loop.current_noise):
        return
    share = case.loop.current_noise / case.current_limit if isfinite(case.current_limit) else 0.0
    yield ReviewFinding(
        "noise in the current",
        f"{case.loop.drive_noise} rms" + (f", {100 * share:.2g} % of the limit" if share else ""),
        _verdict(share > MAX_NOISE_SHARE),
        "filter the derivative more strongly, or give the observer less process noise",
    )


def solver(case: ReviewContext) -> Iterator[ReviewFinding]:
    """Solver time and prediction horizon of an MPC."""
    h = case.sample_time
    if isfinite(case.known.solver_time):
        share = case.known.solver_time / h
        yield ReviewFinding(
            "solver time",
            f"at most {1e3 * case.known.solver_time:.3g} ms of {1e3 * h:.3g} ms per sample",
            _verdict(share > MAX_SOLVER_SHARE, "fault" if share > 1.0 else "warning"),
            "shorten the horizon, choose a faster solver or set a deadline",
        )
    horizon = getattr(case.feedback, "horizon", None)
    if horizon is None or not case.loop.stable:
        return
    rise = case.rise_time
    yield ReviewFinding(
        "horizon",
        f"{horizon} samples are {1e3 * horizon * h:.4g} ms, the loop rises in {1e3 * rise:.4g} ms",
        _verdict(bool(horizon * h < rise)),
        "lengthen the horizon: limits are not enforced beyond it",
    )


def own_findings(case: ReviewContext) -> Iterator[ReviewFinding]:
    """What the law itself has to say, by its method `findings(case)` if it has one."""
    findings = getattr(case.feedback, "findings", None)
    if findings is not None:
        yield from findings(case)


#: In the order of the report.
CHECKS: tuple[Callable[[ReviewContext], Iterator[ReviewFinding]], ...] = (
    reachability, stability, stability_margins, worst_case, state_scaling, steady_state_error, leakage_creep,
    friction, noise, solver, own_findings,
)  # fmt: skip
