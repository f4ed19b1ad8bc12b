"""Control design on an electro-hydrostatic actuator, from the paper's model to a checked closed loop.

Imports: cli -> report -> fleet -> diagnosis -> scenario, identification -> simulation -> plant -> physics -> core, and
beside it scenario -> design -> core.
Names are loaded on first use, so that `import ehsa_ctrl` is fast; their types are in __init__.pyi. For a plant, a log,
a linear model or a controller, functions also accept a name or a path; see `arguments`.
"""

from __future__ import annotations

import importlib
import types
from typing import Any

from .core.plotting import load_figures_from

__version__ = "0.1.0"

#: Module -> its public names.
_MODULES = {
    "core.catalogue": "plants controllers scenarios",
    "core.errors": "EhsaError InputError SimulationError",
    "plant.load": "load_plant",
    "plant.plant": "Plant",
    "plant.structure": "Structure",
    "plant.linear": "four_state three_state",
    "plant.linearise": "linearise",
    "plant.iosystem": "to_iosystem",
    "simulation.engine": "simulate simulate_batch",
    "simulation.sensitivity": "sensitivities",
    "simulation.reference": "simulate_reference",
    "simulation.closed_loop": "run_closed_loop",
    "simulation.stepped_run": "SteppedRun",
    "simulation.fmu.export": "export_fmu",
    "simulation.bench": "record",
    "core.log": "Log",
    "core.log_reader": "read_log",
    "identification.plant_log": "read_plant_log",
    "identification.checks": "check_log",
    "identification.frequency_response": "frequency_response",
    "identification.subspace": "identify_subspace",
    "identification.preparation": "Preparation",
    "identification.comparison": "replay fit_percent",
    "simulation.excitation": "excitation",
    "identification.experiment": "design_experiment",
    "identification.predicted_accuracy": "forecast",
    "identification.identify": "identify",
    "identification.refits": "profile",
    "diagnosis.diagnose": "diagnose",
    "diagnosis.diagnosis": "Diagnosis",
    "diagnosis.batch": "diagnose_many",
    "diagnosis.changed": "what_changed",
    "fleet.analyse": "analyse_fleet",
    "fleet.query": "query_store",
    "diagnosis.law.confirm": "confirm_law",
    "diagnosis.closed_loop_replay": "replay_closed_loop",
    "diagnosis.validation_segment": "gap",
    "report.write": "write_report",
    "report": "figures style",
    "design.load": "load_controller",
    "scenario.definition": "load_scenario",
    "scenario.log_controller": "log_controller",
    "scenario.run": "run",
    "scenario.montecarlo": "monte_carlo",
    "scenario.learning": "learn_reference",
    "scenario.plant_data": "known_of",
    "simulation.minimum_time": "shortest_time",
    "simulation.slip_quantum": "slip_quantum",
    "design.analysis.system": "analyse",
    "design.analysis.loop": "analyse_loop",
    "design.analysis.robustness": "robust_margins",
    "design.review": "review Known",
    "plant.draws": "draw drawn_models",
    "plant.conditions": "conditions",
    "plant.motion_current": "motion_current",
    "identification.plant_toml": "write_plant sliding_linear",
    "simulation.sensors": "Sensors",
    "scenario.response": "hunting",
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names.split()}

# Results don't import the report: it registers their figures by type when the first one is drawn.
load_figures_from("ehsa_ctrl.report.figures")

#: Class with a constructor for users -> methods whose arguments are converted like those of functions.
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
    home = importlib.import_module(f"ehsa_ctrl.{_WHERE[name]}")
    thing = getattr(home, name) if hasattr(home, name) else importlib.import_module(f"{home.__name__}.{name}")
    if isinstance(thing, types.FunctionType):
        from .arguments import convert_arguments

        thing = convert_arguments(thing)
    elif name in _BUILT:
        from .arguments import convert_method_arguments

        convert_method_arguments(thing, _BUILT[name])
    # Stored, so that the next access gives the same object without this function.
    globals()[name] = thing
    return thing


def __dir__() -> list[str]:
    return __all__
