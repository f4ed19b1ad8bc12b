"""Automatic tuning of a PID: the best response within bounds on robustness and noise.

    minimise   integrated error of a response
    such that  Ms, Mt, noise gain at most, disk margin and crossover at least what is asked

on the sampled loop, over k_p, k_i, k_d and T_f together. IE = 1 / k_i under a bound on Ms is the design of
K. J. Astrom, H. Panagopoulos, T. Hagglund, "Design of PI controllers based on non-convex optimization", Automatica
34(5), 1998; with the filter as a variable and bounds on Mt and K S it is that of M. Hast, K. J. Astrom,
B. Bernhardsson, S. Boyd, "PID design by convex-concave optimization", ECC 2013. IE alone accepts a badly damped
response, whose parts cancel; ITAE does not. The search itself is in search.py.
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
from .constraints import LEAST, Tuning, position_plant
from .search import TOLERANCE, GainSearch

if TYPE_CHECKING:
    import control

#: Figures of a loop are clipped to this and its inverse before their logarithms are compared.
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
        held = ", ".join(self.active) or "no bound"
        return f"{self.gains}, integral {self.objective:.4g}, held back by {held}\n{self.loops[0]}"


def tune(
    systems: control.StateSpace | Sequence[control.StateSpace],
    asked: Tuning,
    *,
    sample_time: float,
    b: float = 1.0,
    c: float = 0.0,
) -> TunedGains:
    """Tune a PID.

    Parameters
    ----------
    systems: linear models, the current as first input, an output x. The criterion is that of the first one, the bounds
        hold on all of them.
    asked: criterion and bounds. b, c: setpoint weights of the proportional and the derivative part.

    Raises InputError if no gains keep the bounds; it tells the nearest ones.
    """
    models = list(systems) if isinstance(systems, Sequence) else [systems]
    nyquist = np.pi / sample_time
    if asked.crossover is not None and not 0 < asked.crossover < nyquist:
        raise InputError(
            f"crossover = {asked.crossover:g} rad/s must lie between 0 and the Nyquist frequency {nyquist:.4g} rad/s "
            f"of sample_time = {sample_time:g} s"
        )
    plants = [position_plant(system, sample_time, lag=asked.lag) for system in models]
    bounds = asked.bounds()
    search = GainSearch(plants, asked, b, c)
    gains = search.solve()
    for _ in range(4):
        found = tuple(loop_with(system, gains, sample_time, asked.lag) for system in models)
        over = excess(found, bounds)
        if max(over.values()) <= TOLERANCE or not search.feasible(gains):
            break
        # Peaks between the points of the search's grid are a little higher than it saw.
        search.tighten({name: 2.0 * amount for name, amount in over.items() if amount > 0.0})
        gains = search.search(gains)
    if not all(one.stable for one in found) or max(over.values()) > 1e-3:
        raise InputError(_nearest(found, bounds, over, asked))
    active = tuple(name for name, amount in over.items() if amount > -2e-3)
    return TunedGains(gains, found, float(np.exp(search.objective(gains))), active)


def tune_once(system: control.StateSpace, asked: Tuning, sample_time: float, b: float, c: float) -> TunedGains:
    """`tune` with memory: a scenario, its linear prediction and a comparison load one controller for one model."""
    numbers = tuple(matrix.tobytes() for matrix in (system.A, system.B, system.C))
    key = numbers, tuple(system.output_labels), tuple(system.input_labels), asked, sample_time, b, c
    if key not in _RESULTS:
        _RESULTS[key] = tune(system, asked, sample_time=sample_time, b=b, c=c)
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
        over[name] = float(np.log(allowed / value if name in LEAST else value / allowed))
    return over


def _worst(found: Sequence[LoopAnalysis], name: str) -> float:
    values = [one.figure(name) for one in found]
    # A missing figure (no crossover, not stable) is the worst possible.
    worst = SMALLEST if name in LEAST else 1.0 / SMALLEST
    values = [worst if np.isnan(value) else float(np.clip(value, SMALLEST, 1.0 / SMALLEST)) for value in values]
    return min(values) if name in LEAST else max(values)


def _nearest(found: Sequence[LoopAnalysis], bounds: Mapping[str, float], over: dict[str, float], asked: Tuning) -> str:
    """The error message for infeasible bounds."""
    wanted = ", ".join(
        f"{name} {'at least' if name in LEAST else 'at most'} {value:.4g}" for name, value in bounds.items()
    )
    if not all(one.stable for one in found):
        return f"no {asked.terms} controller was found that is stable with {wanted}; ask for less"
    missed = ", ".join(f"{name} = {_worst(found, name):.4g}" for name, amount in over.items() if amount > 1e-3)
    return (
        f"no {asked.terms} controller keeps {wanted}; the nearest one has {missed}: "
        "ask for a lower crossover or for less tight bounds"
    )
