"""Figures of results. Each function returns a new matplotlib Figure, without pyplot.

Importing this package registers the figures for `plot()` of the results, see `core.plotting`.
"""

from .diagnosis import candidates_figure, shrinkage_figure, unknown_inputs_figure, where_figure
from .estimates import correlation_figure, parameters_figure, residuals_figure
from .experiments import experiment_figure
from .free_runs import diagnosis_figure, identification_figure, overlay_figure, replay_figure
from .frequency import bode_figure, loop_figure
from .law import law_figure
from .learning import learning_figure
from .loop_replays import loop_replay_figure
from .loops import nyquist_figure, robustness_figure, step_figure
from .montecarlo import montecarlo_figure
from .responses import response_figure
from .runs import baseline_figure, closed_figure, scenario_figure, trajectory_figure
from .save import save, to_svg

__all__ = [
    "baseline_figure",
    "bode_figure",
    "candidates_figure",
    "closed_figure",
    "correlation_figure",
    "diagnosis_figure",
    "experiment_figure",
    "identification_figure",
    "law_figure",
    "learning_figure",
    "loop_figure",
    "loop_replay_figure",
    "montecarlo_figure",
    "nyquist_figure",
    "overlay_figure",
    "parameters_figure",
    "replay_figure",
    "residuals_figure",
    "response_figure",
    "robustness_figure",
    "save",
    "scenario_figure",
    "shrinkage_figure",
    "step_figure",
    "to_svg",
    "trajectory_figure",
    "unknown_inputs_figure",
    "where_figure",
]
