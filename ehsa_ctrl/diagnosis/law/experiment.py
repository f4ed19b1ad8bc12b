"""The next experiment between the forms of a law that a log can't tell apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ...core.expression import put
from ...physics.effects import EFFECTS, LawFile, effect_of
from ..hypothesis_model import Setting
from ..next_experiment import N_CANDIDATES, NextExperiment, next_experiment
from ..objective import Objective
from .found import FoundLaw
from .free_run import model_with


def form_experiment(found: FoundLaw, objective: Objective, noise: Mapping[str, float]) -> NextExperiment | None:
    """The experiment that separates the forms of a law; None if there is one form, or if none separates any two.

    objective: of the hypotheses. noise: measured channel -> standard deviation, SI units. Each form is simulated with
    the nominal parameters and effects of its refit, and may refit them as a typical rig allows. Distances in the
    present logs are left out where a form has a memory, which begins at zero in a new experiment only.
    """
    forms = found.proposed.forms[:N_CANDIDATES]
    model = objective.model
    if len(forms) < 2 or model.plant.structure.system.prescribed:
        return None
    remembers = any(form.file.states for form in forms)
    present = [] if remembers else [record.model for record in objective.records]
    settings: dict[str, Setting] = {}
    for i, (form, values) in enumerate(zip(forms, found.settings, strict=False), 1):
        own = renamed(form.file, f"form{i}_")
        # Its numbers make the name differ between diagnoses of one process.
        name = f"form_{i}_{own.digest}"
        EFFECTS.keep(name, effect_of(name, own, "a form of a law"))
        model, present = model_with(model, EFFECTS[name]), [model_with(one, EFFECTS[name]) for one in present]
        others = {n: v for n, v in values.items() if n not in form.file.parameters}
        settings[form.file.form] = others | {n: one.value for n, one in own.parameters.items()}
    nominal = replace(objective.nominal, sd=objective.nominal.typical)
    return next_experiment(model.plant, settings, noise=noise, nominal=nominal, present=present)


def renamed(file: LawFile, prefix: str) -> LawFile:
    """The same law with a prefix before the names of its parameters and states, so that several fit one plant."""
    names = {name: f"{prefix}{name}" for name in (*file.parameters, *file.states)}
    parameters = {names[name]: one for name, one in file.parameters.items()}
    states = {names[name]: one.model_copy(update={"rate": put(one.rate, **names)}) for name, one in file.states.items()}
    expression = put(file.expression, **names)
    return file.model_copy(update={"expression": expression, "parameters": parameters, "states": states})
