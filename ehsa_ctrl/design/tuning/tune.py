"""Automatic tuning of a PID: the best response within bounds on robustness and noise.

    minimise    integrated error of a step response
    subject to  upper bounds on Ms, Mt and noise gain, lower bounds on disk margin and crossover

of the sampled loop, over k_p, k_i, k_d and T_f. IE = 1 / k_i under a bound on Ms is the design of
K. J. Astrom, H. Panagopoulos, T. Hagglund, "Design of PI controllers based on non-convex optimization", Automatica
34(5), 1998; with the filter as a variable and bounds on Mt and K S it is that of M. Hast, K. J. Astrom,
B. Bernhardsson, S. Boyd, "PID design by convex-concave optimization", ECC 2013. IE accepts a badly damped response,
whose positive and negative errors cancel; ITAE does not. The search itself is in search.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import InputError
from ..analysis.loop import LoopAnalysis, analyse_loop
from ..controller import SampledController
from ..kinds.pid import Gains, Pid
from .constraints import LOWER_BOUNDS, Tuning, position_plant
from .search import TOLERANCE, GainSearch

if TYPE_CHECKING:
    import control

#: Figures of a loop are clipped to this and its inverse, so that their logarithms are finite.
SMALLEST = 1e-12


@dataclass(frozen=True)
class TunedGains:
    """Result of the tuning.

    Attributes
    ----------
    gains: parallel form.
    loops: loop analysis on each model.
    objective: the minimised integral [m s, m s2 for ITAE; per A for a load step], on the first model.
    active: bounds that are active at the optimum.
    """

    gains: Gains
    loops: tuple[LoopAnalysis, ...]
    objective: float
    active: tuple[str, ...]

    def __str__(self) -> str:
        active = ", ".join(self.active) or "none"
        return f"{self.gains}, integral {self.objective:.4g}, active bounds: {active}\n{self.loops[0]}"


def tune(
    systems: control.StateSpace | Sequence[control.StateSpace],
    tuning: Tuning,
    *,
    sample_time: float,
    b: float = 1.0,
    c: float = 0.0,
) -> TunedGains:
    """Tune a PID.

    Parameters
    ----------
    systems: linear models, the current as first input, an output x. The criterion is for the first one, the bounds hold
        for all of them.
    tuning: criterion and bounds. b, c: setpoint weights of the proportional and the derivative part.

    Raises InputError if no gains satisfy the bounds, with the figures of the nearest ones.
    """
    models = list(systems) if isinstance(systems, Sequence) else [systems]
    nyquist = np.pi / sample_time
    if tuning.crossover is not None and not 0 < tuning.crossover < nyquist:
        raise InputError(
            f"crossover = {tuning.crossover:g} rad/s must lie between 0 and the Nyquist frequency {nyquist:.4g} rad/s "
            f"of sample_time = {sample_time:g} s"
        )
    plants = [position_plant(system, sample_time, lag=tuning.lag) for system in models]
    bounds = tuning.bounds()
    search = GainSearch(plants, tuning, b, c)
    gains = search.solve()
    for _ in range(4):
        found = tuple(loop_with(system, gains, sample_time, tuning.lag) for system in models)
        over = excess(found, bounds)
        if max(over.values()) <= TOLERANCE or not search.feasible(gains):
            break
        # Peaks between the points of the search's grid are slightly higher than on it: tighten by twice the excess.
        search.tighten({name: 2.0 * amount for name, amount in over.items() if amount > 0.0})
        gains = search.search(gains)
    if not all(one.stable for one in found) or max(over.values()) > 1e-3:
        raise InputError(_infeasible_message(found, bounds, over, tuning))
    active = tuple(name for name, amount in over.items() if amount > -2e-3)
    return TunedGains(gains, found, float(np.exp(search.objective(gains))), active)


def tune_once(system: control.StateSpace, tuning: Tuning, sample_time: float, b: float, c: float) -> TunedGains:
    """`tune` with a cache: a scenario, its linear prediction and a comparison load one controller for one model."""
    numbers = tuple(matrix.tobytes() for matrix in (system.A, system.B, system.C))
    key = numbers, tuple(system.output_labels), tuple(system.input_labels), tuning, sample_time, b, c
    if key not in _RESULTS:
        _RESULTS[key] = tune(system, tuning, sample_time=sample_time, b=b, c=c)
    return _RESULTS[key]


_RESULTS: dict[object, TunedGains] = {}


def loop_with(system: control.StateSpace, gains: Gains, sample_time: float, lag: int = 0) -> LoopAnalysis:
    """Loop analysis of a model with these gains."""
    law = Pid(gains, 1.0, 0.0, np.inf, np.inf, False, sample_time)
    return analyse_loop(system, SampledController("a PID", "pid", sample_time, np.inf, law), lag=lag)


def excess(found: Sequence[LoopAnalysis], bounds: Mapping[str, float]) -> dict[str, float]:
    """Violation (logarithm) of each bound on the worst model; negative where it holds."""
    over = {}
    for name, allowed in bounds.items():
        value = _worst(found, name)
        over[name] = float(np.log(allowed / value if name in LOWER_BOUNDS else value / allowed))
    return over


def _worst(found: Sequence[LoopAnalysis], name: str) -> float:
    values = [one.figure(name) for one in found]
    # A missing figure (no crossover, unstable loop) counts as the worst value.
    worst = SMALLEST if name in LOWER_BOUNDS else 1.0 / SMALLEST
    values = [worst if np.isnan(value) else float(np.clip(value, SMALLEST, 1.0 / SMALLEST)) for value in values]
    return min(values) if name in LOWER_BOUNDS else max(values)


def _infeasible_message(
    found: Sequence[LoopAnalysis], bounds: Mapping[str, float], over: dict[str, float], tuning: Tuning
) -> str:
    """Message for infeasible bounds, with the figures of the nearest gains."""
    wanted = ", ".join(
        f"{name} {'at least' if name in LOWER_BOUNDS else 'at most'} {value:.4g}" for name, value in bounds.items()
    )
    if not all(one.stable for one in found):
        return f"no {tuning.terms} controller was found that is stable with {wanted}; relax the bounds"
    missed = ", ".join(f"{name} = {_worst(found, name):.4g}" for name, amount in over.items() if amount > 1e-3)
    return (
        f"no {tuning.terms} controller satisfies {wanted}; the nearest one has {missed}: "
        "specify a lower crossover or relax the bounds"
    )
