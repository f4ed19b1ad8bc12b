"""Cost of the derivatives of a run: 12 parameters over 10 s of noise, by sensitivities and by finite differences."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from engine_cases import DT, START, Array, Case

import ehsa_ctrl

NAMES = ("J_M", "A_FM", "B_FM", "C_FM", "V_10", "V_20", "K_L", "M", "A_FR", "B_FR", "C_FR", "K_T")


@dataclass(frozen=True)
class Row:
    """Median CPU time [ms], and largest error relative to the peak of the same state and parameter."""

    method: str
    milliseconds: float
    error: float


def jacobian_rows(case: Case, rounds: int) -> list[Row]:
    """Forward sensitivities at three tolerances, forward differences at tight ones, against sensitivities at 1e-11."""
    plant = ehsa_ctrl.load_plant("ehsa")
    plant = plant.set(**{name: value for name, value in case.values.items() if name in plant.parameters})

    def exact(tolerance: float) -> Array:
        return ehsa_ctrl.sensitivities(
            plant, NAMES, case.current, start=START, sample_time=DT, tolerance=tolerance
        ).values

    def differences(tolerance: float, step: float) -> Array:
        names = plant.structure.equations.parameter_names
        rows = np.tile(plant.vector, (len(NAMES) + 1, 1))
        for k, name in enumerate(NAMES):
            rows[k + 1, names.index(name)] *= 1 + step
        start = np.tile(START, (len(rows), 1))
        states = ehsa_ctrl.simulate_batch(
            plant, rows, case.current, start=start, sample_time=DT, tolerance=tolerance, jobs=1
        ).states
        moves = [step * plant[name] for name in NAMES]
        return np.moveaxis((states[1:] - states[0]) / np.array(moves)[:, None, None], 0, 2)

    truth = exact(1e-11)
    peak = np.abs(truth).max(axis=0)
    methods: dict[str, Callable[[], Array]] = {
        f"sensitivities, {tolerance:.0e}": (lambda tolerance=tolerance: exact(tolerance))
        for tolerance in (1e-4, 1e-5, 1e-6)
    }
    methods["differences of 1e-6, 1e-06"] = lambda: differences(1e-6, 1e-6)
    methods["differences of 1e-6, 1e-08"] = lambda: differences(1e-8, 1e-6)
    times: dict[str, list[float]] = {method: [] for method in methods}
    errors = {}
    for _ in range(rounds):
        for method, compute in methods.items():
            begun = time.process_time()
            found = compute()
            times[method].append(1e3 * (time.process_time() - begun))
            errors[method] = float(np.max(np.abs(found - truth).max(axis=0) / peak))
    return [Row(method, float(np.median(times[method])), errors[method]) for method in methods]
