"""Pages of the Python API: directives for mkdocstrings."""

from __future__ import annotations

import ehsa_ctrl

#: The API's pages in reading order: title, subject, names.
API = {
    "plants": ("Plants", "A plant, its structure and its linear models.", (
        "load_plant", "Plant", "Structure", "plants", "four_state", "three_state", "linearise", "to_iosystem",
        "conditions", "draw", "drawn_models", "motion_current",
    )),
    "simulation": ("Simulation", "One run, many runs, derivatives, and the virtual bench.", (
        "simulate", "simulate_batch", "sensitivities", "simulate_reference", "excitation", "record", "slip_quantum",
        "shortest_time", "SteppedRun", "Sensors", "export_fmu",
    )),
    "logs": ("Logs and identification", "From a log to parameters with their uncertainty.", (
        "Log", "read_log", "read_plant_log", "check_log", "Preparation", "replay", "fit_percent", "identify",
        "write_plant", "sliding_linear", "profile", "forecast", "design_experiment",
        "frequency_response", "identify_subspace",
    )),
    "control": ("Controllers and their analysis", "Designed on linear models, in the frequency domain.", (
        "controllers", "load_controller", "analyse", "analyse_loop", "robust_margins", "review", "Known",
    )),
    "scenarios": ("Closed loops and scenarios", "Controllers on the plant with friction.", (
        "scenarios", "load_scenario", "run", "run_closed_loop", "monte_carlo", "learn_reference", "known_of", "hunting",
    )),
    "diagnosis": ("Diagnosis", "Where rig and simulation differ, and why.", (
        "diagnose", "Diagnosis", "diagnose_many", "what_changed", "gap", "analyse_fleet", "query_store",
    )),
    "pages": ("Pages and figures", "Results as self-contained pages; figures and their style.", (
        "write_report", "figures", "style",
    )),
    "errors": ("Errors", "Exceptions and when they are raised.", ("EhsaError", "InputError", "SimulationError")),
}  # fmt: skip

WHERE = (
    "All of these are names of `ehsa_ctrl` itself: `import ehsa_ctrl as e`. A plant, log, linear model, controller or "
    'scenario can also be given by its name or path: `e.simulate("ehsa", current)`. Wrong arguments raise an '
    "`InputError` with one sentence."
)

#: Result types, shown below the functions of a page.
RESULTS = {
    "simulation": ("simulation.trajectory.Trajectory",),
    "logs": (
        "identification.identification.Identification",
        "identification.uncertainty.Estimate",
        "identification.frequency_response.FrequencyResponse",
        "identification.subspace.SubspaceModel",
    ),
    "control": ("design.controller.SampledController",),
    "scenarios": (
        "scenario.result.ScenarioResult",
        "scenario.comparison.ControllerComparison",
        "simulation.closed_loop.ClosedLoop",
    ),
    "diagnosis": ("diagnosis.diagnosis.Cause",),
}


def api_names() -> dict[str, list[str]]:
    """Page -> public names; a name missing in the table goes to the page of its package."""
    placed = {page: list(names) for page, (_, _, names) in API.items()}
    homes = {name: page for page, names in placed.items() for name in names}
    packages: dict[str, str] = {}
    for name, page in homes.items():
        packages.setdefault(ehsa_ctrl._WHERE[name].partition(".")[0], page)
    for name in ehsa_ctrl.__all__:
        if name not in homes and name != "__version__":
            placed[packages.get(ehsa_ctrl._WHERE[name].partition(".")[0], "scenarios")].append(name)
    return placed


def api(page: str) -> str:
    """Directives for mkdocstrings, one per name."""
    title, about, _ = API[page]
    lines = [f"# {title}", "", about, "", WHERE]
    for name in api_names()[page]:
        module = ehsa_ctrl._WHERE[name]
        if module == "core.catalogue":
            lines += ["", f"## `{name}` {{ #{name} }}", "", _catalogue(name)]
        else:
            lines += ["", f"::: ehsa_ctrl.{module}.{name}"]
    lines += [line for path in RESULTS.get(page, ()) for line in ("", f"::: ehsa_ctrl.{path}")]
    return "\n".join(lines) + "\n"


def _catalogue(name: str) -> str:
    return (
        f"All {name}: those in a folder `{name}/` beside your script first, then the shipped ones. "
        f"A mapping with attributes, `e.{name}.NAME` or `e.{name}['NAME']`; it prints as a table.\n\n"
        + "\n".join(f"- `{entry}`: {title}" for entry, title in getattr(ehsa_ctrl, name).titles().items())
    )
