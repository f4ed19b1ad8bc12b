"""Automatic tuning of a PID: the best response that bounds on robustness and noise allow.

    minimise   integrated error of a response
    such that  Ms, Mt, noise gain at most, disk margin and crossover at least what is asked

on the sampled loop, over k_p, k_i, k_d and T_f together. IE = 1 / k_i under a bound on Ms is the design of
K. J. Astrom, H. Panagopoulos, T. Hagglund, "Design of PI controllers based on non-convex optimization", Automatica
34(5), 1998; with the filter as a variable and bounds on Mt and K S it is that of M. Hast, K. J. Astrom,
B. Bernhardsson, S. Boyd, "PID design by convex-concave optimization", ECC 2013. IE alone accepts a badly damped
response, whose parts cancel; ITAE does not.

How it is searched for: tuning_search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ...core.definition import Definition, In, RadianPerSecond
from ...core.errors import InputError
from ..analysis.loop import LoopAnalysis, analyse_loop
from ..controller import SampledController
from ..laws.pid import Pid
from ..laws.pid_forms import Gains
from .bounds import LEAST, Bounds
from .loop import position_plant
from .search import TOLERANCE, Search

if TYPE_CHECKING:
    import control

#: Figures of a loop are compared between this and its inverse.
SMALLEST = 1e-12


class Tuning(Definition):
    """A controller's [tuning]: what is minimised, and what the loop, broken at the current, must keep."""

    minimise: Literal["IE", "IAE", "ITAE"] = Field(
        default="ITAE",
        description="IE (integrated error, 1 / k_i), IAE (integrated absolute error) or ITAE (time-weighted IAE) of "
        "a step response",
    )
    response: Literal["load", "reference"] = Field(
        default="load",
        description="step of the load (a current added at the plant's input) or of the reference",
    )
    terms: Literal["P", "PI", "PD", "PID"] = Field(default="PID", description="terms of the controller")
    Ms: Annotated[float, Field(gt=1, allow_inf_nan=False)] | None = Field(
        default=1.5, description="largest sensitivity |S|"
    )
    Mt: Annotated[float, Field(gt=1)] | None = Field(default=1.4, description="largest complementary sensitivity |T|")
    disk_margin: Annotated[float, Field(gt=0, lt=2)] | None = Field(default=0.7, description="least disk margin")
    noise_gain: Annotated[float, In("A/m")] | None = Field(
        default=1e4,
        description="largest RMS current per RMS of white position noise",
    )
    crossover: RadianPerSecond | None = Field(default=None, description="least gain crossover frequency")
    lag: Annotated[int, Field(ge=0)] = Field(default=0, description="samples of delay between measurement and current")

    @model_validator(mode="after")
    def _fit(self) -> Tuning:
        if "I" not in self.terms and (self.minimise == "IE" or self.response == "load"):
            raise ValueError(
                f"terms = {self.terms!r} leaves a standing error after a load step, so that there is nothing to "
                "minimise; use PI or PID, or minimise IAE or ITAE of response = 'reference'"
            )
        if self.minimise == "IE" and self.response == "reference":
            raise ValueError("minimise = 'IE' is the integrated error of a load step; take response = 'load' or ITAE")
        if self.noise_gain is not None and self.noise_gain <= 0:
            raise ValueError("noise_gain must be greater than 0 A/m")
        if self.Ms is None and self.disk_margin is None:
            raise ValueError("give a bound on Ms or on the disk margin; without one the gains grow without end")
        return self

    def bounds(self) -> Bounds:
        return Bounds(self.Ms, self.Mt, self.disk_margin, self.noise_gain, self.crossover)


@dataclass(frozen=True)
class Tuned:
    """Gains that were found.

    Attributes
    ----------
    gains: parallel form.
    loops: of each model they were tuned for, by design.loop.
    objective: the integral that was minimised [m s, m s2 for ITAE; per A for a load step], on the first model.
    active: bounds that hold the optimum back.
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
) -> Tuned:
    """Tune a PID.

    Parameters
    ----------
    systems: linear models, the current as first input, an output x. The response of the first one is what counts,
        bounds hold on all of them.
    b, c: weights of the reference in the proportional and the derivative part.

    Raises
    ------
    InputError: no gains keep the bounds; says how near they come.
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
    problem = Search(plants, bounds, asked, b, c)
    gains = problem.solve()
    for _ in range(4):
        found = tuple(judged(system, gains, sample_time, asked.lag) for system in models)
        over = excess(found, bounds)
        if max(over.values()) <= TOLERANCE or not problem.kept(gains):
            break
        # Between the points of its grid the search saw a little less than there is.
        problem.tighten({name: 2.0 * amount for name, amount in over.items() if amount > 0.0})
        gains = problem.search(gains)
    if not all(one.stable for one in found) or max(over.values()) > 1e-3:
        raise InputError(_nearest(found, bounds, over, asked))
    active = tuple(name for name, amount in over.items() if amount > -2e-3)
    return Tuned(gains, found, float(np.exp(problem.objective(gains))), active)


def judged(system: control.StateSpace, gains: Gains, sample_time: float, lag: int = 0) -> LoopAnalysis:
    """The loop of a model with these gains."""
    law = Pid(gains, 1.0, 0.0, np.inf, np.inf, False, sample_time)
    return analyse_loop(system, SampledController("a PID", "pid", sample_time, np.inf, law), lag=lag)


def excess(found: Sequence[LoopAnalysis], bounds: Bounds) -> dict[str, float]:
    """By how much (logarithm) each bound is passed on the worst model; below zero it holds."""
    over = {}
    for name, allowed in bounds.asked().items():
        value = _worst(found, name)
        over[name] = float(np.log(allowed / value if name in LEAST else value / allowed))
    return over


def _worst(found: Sequence[LoopAnalysis], name: str) -> float:
    values = [one.noise_gain["position"] if name == "noise_gain" else getattr(one, name) for one in found]
    # What a loop does not have (no crossover, not stable) is the worst that can be.
    worst = SMALLEST if name in LEAST else 1.0 / SMALLEST
    values = [worst if np.isnan(value) else float(np.clip(value, SMALLEST, 1.0 / SMALLEST)) for value in values]
    return min(values) if name in LEAST else max(values)


def _nearest(found: Sequence[LoopAnalysis], bounds: Bounds, over: dict[str, float], asked: Tuning) -> str:
    """The sentence for bounds that nothing keeps."""
    wanted = ", ".join(
        f"{name} {'at least' if name in LEAST else 'at most'} {value:.4g}" for name, value in bounds.asked().items()
    )
    if not all(one.stable for one in found):
        return f"no {asked.terms} controller was found that is stable with {wanted}; ask for less"
    missed = ", ".join(f"{name} = {_worst(found, name):.4g}" for name, amount in over.items() if amount > 1e-3)
    return (
        f"no {asked.terms} controller keeps {wanted}; the nearest one has {missed}: "
        "ask for a lower crossover or for less tight bounds"
    )
