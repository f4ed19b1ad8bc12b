"""The sizes of the chosen causes and how well the log determines them.

The search keeps the nominal parameters near their nominal values, so that causes stay apart. Where the rig's parameters
differ, this pulls the sizes of the causes. Here all parameters are refitted once more, as uncertain as on a typical
rig, and so are the filters of the logger's channels: a rig has them, and they are no cause as long as they are short.

A standard deviation holds for the form of the laws that was chosen. Where the rod sticks and slips, a small change of a
parameter decides single slips, and the cost is a rough function of the parameters. Its scatter around the quadratic
model of the fit is measured, and widens the standard deviations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..plant.arrays import needed_to_simulate
from .model_selection import Selection
from .objective import TEMPER, NominalParameters, Objective
from .refit import HypothesisFit, covariance_of, deviations_of, refit_until_converged
from .scoring import Scoring

#: Time constant of a filter in a typical logger, in samples. Engineering judgement.
FILTER = 1.0
#: Pairs of random points at which the scatter of the cost is measured, their distance in standard deviations, and how
#: often the fit starts again from a better point. Engineering judgement.
PAIRS, DISTANCE, RESTARTS = 6, 0.5, 3
#: Largest increase of the gap on held-out data, as a share of the threshold. Engineering judgement.
MAX_LARGER = 0.1
#: The median of the absolute value of a normal variable, in standard deviations.
MEDIAN = 0.6745


def with_sizes(selection: Selection, scoring: Scoring) -> tuple[Selection, dict[str, float]]:
    """The selection with the final sizes of its causes, and the standard deviation of every number that was refitted.

    If the final fit clearly leaves a larger gap on held-out data, the sizes stay, and their difference adds to the
    standard deviations.
    """
    chosen = selection.chosen
    if not chosen.causes:
        return selection, {}
    fit, sd = fit_sizes(uncertain(scoring.objective, chosen.fit), chosen.fit)
    refined = scoring.score(fit)
    larger = refined.held_out_gap["total"] - chosen.held_out_gap["total"]
    if larger <= MAX_LARGER * scoring.threshold:
        known = {**chosen.own_gaps, **refined.own_gaps}
        selection = replace(selection, chosen=replace(refined, causes=chosen.causes, own_gaps=known))
    else:
        sd = {n: float(np.hypot(v, fit.values[n] - chosen.fit.values.get(n, fit.values[n]))) for n, v in sd.items()}
    return selection, sd


def of_causes(selection: Selection, scoring: Scoring, sd: Mapping[str, float]) -> dict[str, float]:
    """Of standard deviations by name those of the numbers of the selected causes."""
    chosen = selection.chosen
    names = {n for c in chosen.fit.candidates for n in c.names}
    names |= {n for n in sd if (scoring.ids.get(n), None) in chosen.causes}
    return {n: v for n, v in sd.items() if n in names}


def fit_sizes(objective: Objective, fit: HypothesisFit) -> tuple[HypothesisFit, dict[str, float]]:
    """Refit from a hypothesis' values until the cost no longer falls; standard deviation of each free parameter.

    It is infinite for a number of which the runs show nothing.
    """
    random = np.random.default_rng(0)
    fit = refit_until_converged(objective, fit.candidates, fit.values) or fit
    for restart in range(RESTARTS + 1):
        scale, lower, upper = (np.array([getattr(f, name) for f in fit.free]) for name in ("scale", "lower", "upper"))
        x = np.array([fit.values[f.name] for f in fit.free])
        information = fit.information(objective)
        covariance = covariance_of(information)
        half = random.multivariate_normal(np.zeros(x.size), DISTANCE**2 * covariance, PAIRS, method="eigh")
        points = np.clip(x + np.vstack([half, -half]) * scale, lower, upper)
        settings = [dict(zip(fit.values, point.tolist(), strict=True)) for point in points]
        costs = np.array(
            [
                np.inf if r is None else TEMPER * objective.loss(r) + replace(fit, values=setting).prior_cost
                for setting, r in zip(settings, objective.residuals(settings), strict=True)
            ]
        )
        steps = (points - x) / scale
        # The cost does not discount residuals by the level as the information does.
        prior = np.diag(np.arange(x.size) >= fit.n_effect).astype(float)
        curvature = objective.level * (information - prior) + prior
        predicted = fit.cost + np.einsum("ij,jk,ik->i", steps, curvature, steps)
        best = int(np.argmin(costs))
        if restart == RESTARTS or costs[best] >= fit.cost - objective.converged:
            break
        fit = refit_until_converged(objective, fit.candidates, settings[best]) or replace(fit, values=settings[best])
    known = np.isfinite(costs)
    scatter = float(np.median(np.abs(costs - predicted)[known])) / MEDIAN / objective.level if known.any() else 0.0
    sd = deviations_of(information) * np.sqrt(1.0 + scatter) * scale
    return fit, {f.name: float(v) for f, v in zip(fit.free, sd, strict=True) if not f.fixed}


def uncertain(objective: Objective, fit: HypothesisFit) -> Objective:
    """The objective with nominal parameters as uncertain as on a typical rig, and with more of them than in the search:
    the plant's parameters that the search holds, and a filter in each channel of the logger.
    """
    plant, known = objective.model.plant, objective.nominal
    held = {name for c in fit.candidates for name in c.names} | {*known.names}
    held |= objective.segment.own_parameters if objective.segment is not None else set()
    needed = needed_to_simulate(plant.structure.equations)
    added = {
        kind.name: (plant[kind.name], kind.prior * plant[kind.name])
        for kind in plant.structure.equations.parameters
        if kind.prior is not None and not kind.searched and kind.name in needed
    }
    sample_time = objective.model.log.sample_time
    added |= {f"filter.{c}": (0.0, FILTER * sample_time) for c in objective.model.channels if f"delay.{c}" not in held}
    added = {name: pair for name, pair in added.items() if name not in held}
    values, typical = (np.array([pair[i] for pair in added.values()]) for i in (0, 1))
    names, typical = (*known.names, *added), np.append(known.typical, typical)
    return replace(objective, nominal=NominalParameters(names, np.append(known.values, values), typical, typical))
