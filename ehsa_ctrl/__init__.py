"""Control design on an electro-hydrostatic actuator, from the paper's model to a checked closed loop.

Imports: cli -> report -> scenario -> simulation -> plant -> physics -> core, and beside it scenario -> design -> core.
Names are loaded on first use, so that `import ehsa_ctrl` is fast; their types are in __init__.pyi. Where a function
expects a plant, a log, a linear model or a controller, a name or a path will do; see `arguments`.
"""

from __future__ import annotations

import importlib
import types
from typing import Any

from .core.plotting import load_figures_from

__version__ = "0.1.0"

_WHERE = {
    "plants": "core.catalogue",
    "controllers": "core.catalogue",
    "scenarios": "core.catalogue",
    "EhsaError": "core.errors",
    "InputError": "core.errors",
    "SimulationError": "core.errors",
    "load_plant": "plant.load",
    "Plant": "plant.plant",
    "Structure": "plant.structure",
    "four_state": "plant.linear",
    "three_state": "plant.linear",
    "linearise": "plant.linearise",
    "to_iosystem": "plant.iosystem",
    "simulate": "simulation.engine",
    "simulate_batch": "simulation.engine",
    "sensitivities": "simulation.sensitivity",
    "simulate_reference": "simulation.reference",
    "run_closed_loop": "simulation.closed_loop",
    "SteppedRun": "simulation.stepped_run",
    "export_fmu": "simulation.fmu.export",
    "record": "simulation.bench",
    "Log": "core.log",
    "read_log": "core.log_reader",
    "read_plant_log": "identification.plant_log",
    "check_log": "identification.checks",
    "Preparation": "identification.preparation",
    "replay": "identification.comparison",
    "fit_percent": "identification.comparison",
    "excitation": "simulation.excitation",
    "design_experiment": "identification.experiment",
    "forecast": "identification.predicted_accuracy",
    "identify": "identification.identify",
    "write_plant": "identification.plant_toml",
    "profile": "identification.refits",
    "diagnose": "diagnosis.diagnose",
    "Diagnosis": "diagnosis.diagnosis",
    "diagnose_many": "diagnosis.batch",
    "what_changed": "diagnosis.changed",
    "gap": "diagnosis.validation_segment",
    "write_report": "report.write",
    "load_controller": "design.load",
    "load_scenario": "scenario.definition",
    "run": "scenario.run",
    "monte_carlo": "scenario.montecarlo",
    "known_of": "scenario.plant_data",
    "shortest_time": "simulation.minimum_time",
    "slip_quantum": "simulation.slip_quantum",
    "analyse": "design.analysis.system",
    "analyse_loop": "design.analysis.loop",
    "robust_margins": "design.analysis.robustness",
    "review": "design.review",
    "Known": "design.review",
    "draw": "plant.draws",
    "drawn_models": "plant.draws",
    "conditions": "plant.conditions",
}

# Results don't import the report: their figures are registered by type when the first one is drawn.
load_figures_from("ehsa_ctrl.report.figures")

#: Classes that users build by themselves, and the methods whose arguments are checked as those of functions are.
_BUILT = {
    "SteppedRun": ("__init__",),
    "Log": ("__init__", "from_pandas", "segment"),
    "Preparation": ("__init__",),
    "Structure": ("__init__",),
}

__all__ = sorted([*_WHERE, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'ehsa_ctrl' has no attribute {name!r}")
    thing = getattr(importlib.import_module(f"ehsa_ctrl.{_WHERE[name]}"), name)
    if isinstance(thing, types.FunctionType):
        from .arguments import convert_arguments

        thing = convert_arguments(thing)
    elif name in _BUILT:
        from .arguments import convert_method_arguments

        convert_method_arguments(thing, _BUILT[name])
    # Kept: asked for again, a name is the same thing.
    globals()[name] = thing
    return thing


def __dir__() -> list[str]:
    return __all__
