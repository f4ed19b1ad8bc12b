"""One figure a file. Every function returns a matplotlib Figure that is the caller's own; none of them uses pyplot."""

from .baseline import baseline_figure
from .bode import bode_figure
from .candidates import candidates_figure
from .closed import closed_figure
from .correlation import correlation_figure
from .diagnosis import diagnosis_figure
from .experiment import experiment_figure
from .identification import identification_figure
from .loop import loop_figure
from .montecarlo import montecarlo_figure
from .nyquist import nyquist_figure
from .overlay import overlay_figure
from .parameters import parameters_figure
from .replay import replay_figure
from .residuals import residuals_figure
from .robustness import robustness_figure
from .save import save, to_svg
from .scenario import scenario_figure
from .shrinkage import shrinkage_figure
from .step import step_figure
from .trajectory import trajectory_figure
from .unknown_inputs import unknown_inputs_figure
from .where import where_figure

__all__ = [
    "baseline_figure",
    "bode_figure",
    "candidates_figure",
    "closed_figure",
    "correlation_figure",
    "diagnosis_figure",
    "experiment_figure",
    "identification_figure",
    "loop_figure",
    "montecarlo_figure",
    "nyquist_figure",
    "overlay_figure",
    "parameters_figure",
    "replay_figure",
    "residuals_figure",
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
