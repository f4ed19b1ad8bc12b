"""The same task with SciPy's `least_squares` over free runs instead of the package's estimator, and its cost."""

from __future__ import annotations

import time
from dataclasses import dataclass

import control
import numpy as np
from engine_cases import SCALES, Array
from joblib import Parallel, delayed, parallel_config
from recovery import DT, Case, bench_log, start_plant, truth
from scipy.optimize import least_squares

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.plant.plant import Plant

#: Maximum number of evaluations, those for Jacobians not counted.
PATIENCE = 100
#: Residual [standard deviations] of samples after the early stop of a free run: large enough to reject the point.
LOST = 1e4


@dataclass(frozen=True)
class Plain:
    """Result of `least_squares` on the package's engine, from start values 30 % off or from the truth.

    worst: largest error of a parameter [%], and its name. near: share of parameters within 3 % of the truth.
    covered: share within 1.96 standard deviations from the Jacobian. simulations: total number. ended: whether the
    search converged.
    """

    case: Case
    from_truth: bool
    reduced_cost: float
    worst: tuple[float, str]
    near: float
    covered: float
    evaluations: int
    jacobians: int
    simulations: int
    seconds: float
    ended: bool


def plain(case: Case, from_truth: bool = False) -> Plain:
    """Free runs from rest, residuals over the sensors' sd, SciPy's defaults: 2-point Jacobian, trust region.

    Parameters are multiples of their start values, from a twentieth to twenty times.
    """
    true = truth()
    begin = true if from_truth else start_plant(case.seed)
    log = bench_log(case.kind, case.amplitude, case.duration, case.seed)
    values = np.array([begin[name] for name in true.free])
    count = 0

    def residual(factors: Array) -> Array:
        nonlocal count
        count += 1
        return _missed(true.set(**dict(zip(true.free, factors * values, strict=True))), log)

    clock = time.perf_counter()
    found = least_squares(residual, np.ones(values.size), bounds=(0.05, 20.0), max_nfev=PATIENCE)
    clock = time.perf_counter() - clock
    error = found.x * values / [true[name] for name in true.free] - 1.0
    sd = np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac))) / found.x
    worst = int(np.argmax(np.abs(error)))
    return Plain(
        case=case,
        from_truth=from_truth,
        reduced_cost=float(2.0 * found.cost / (found.fun.size - values.size)),
        worst=(100.0 * float(error[worst]), true.free[worst]),
        near=float(np.mean(np.abs(error) <= 0.03)),
        covered=float(np.mean(np.abs(error) <= 1.96 * sd)),
        evaluations=int(found.nfev),
        jacobians=int(found.njev),
        simulations=count,
        seconds=clock,
        ended=found.status > 0,
    )


def _missed(plant: Plant, log: Log) -> Array:
    """Measured minus simulated in standard deviations of the sensors, all channels in one vector."""
    # Finite differences need a smaller integration error than the default tolerance gives.
    run = ehsa_ctrl.simulate(plant, log["current"], sample_time=DT, tolerance=1e-8, raise_on_failure=False)
    outputs = plant.structure.system.outputs
    missed = np.full((len(log), len(outputs)), LOST)
    for column, (channel, state) in enumerate(outputs.items()):
        missed[: len(run), column] = (log[channel][: len(run)] - run[state]) / plant.sensors[channel].sd
    return missed.ravel()


@dataclass(frozen=True)
class Peer:
    """python-control on the beginning of a log: CPU seconds per simulated second of a run and of a Jacobian.

    measured: seconds of log for each timing. error: largest deviation from the engine's run, over the state's peak.
    """

    run: float
    jacobian: float
    measured: tuple[float, float]
    error: float


def peer(case: Case, run_seconds: float = 2.0, jacobian_seconds: float = 0.5) -> Peer:
    """`input_output_response` of `to_iosystem`, LSODA at 1e-6 with one tolerance per state: its best, see engine.py.

    The Jacobian is by forward differences as in `least_squares`: one run per parameter.
    """
    plant = truth()
    current = bench_log(case.kind, case.amplitude, case.duration, case.seed)["current"]
    system = ehsa_ctrl.to_iosystem(plant)

    def simulate(seconds: float, **changed: float) -> Array:
        t = DT * np.arange(round(seconds / DT) + 1)
        # python-control interpolates linearly: each current is given twice, at both ends of its sample.
        ends = np.sort(np.concatenate([t, t[1:] - 1e-9]))
        held = np.repeat(current[: t.size], 2)[:-1]
        response = control.input_output_response(
            system, ends, [held, 0.0], plant.rest, params=changed, evaluation_times=t,
            solve_ivp_method="LSODA", solve_ivp_kwargs={"rtol": 1e-6, "atol": 1e-6 * SCALES},
        )  # fmt: skip
        states: Array = response.states.T
        return states

    clock = time.process_time()
    states = simulate(run_seconds)
    run = time.process_time() - clock
    exact = ehsa_ctrl.simulate(plant, current[: len(states)], sample_time=DT).states
    error = np.abs(states - exact).max(axis=0) / np.abs(exact - exact[0]).max(axis=0)
    clock = time.process_time()
    for name in plant.free:
        simulate(jacobian_seconds, **{name: plant[name] * (1.0 + 1e-4)})
    jacobian = time.process_time() - clock
    return Peer(run / run_seconds, jacobian / jacobian_seconds, (run_seconds, jacobian_seconds), float(error.max()))


def plain_runs(kinds: dict[str, float], duration: float, seeds: int, jobs: int) -> list[Plain]:
    """From 30 % off and from the truth, some seeds of each kind of log (kind -> amplitude)."""
    cases = [Case(kind, amplitude, duration, seed) for kind, amplitude in kinds.items() for seed in range(seeds)]
    with parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
        runs: list[Plain] = Parallel()(delayed(plain)(case, exact) for case in cases for exact in (False, True))
    return runs
