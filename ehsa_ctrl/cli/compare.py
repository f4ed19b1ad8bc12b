"""`ehsa-ctrl compare`: a measured log against the simulation driven by its input."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ..core.errors import SimulationError
from .options import LogOptions, Models, PlantOption, Settings, read_pairs
from .output import OutputOptions, assumed_names, provenance, warn


def command(
    log: Annotated[Path, typer.Argument(help="Measured log: CSV, TDMS, MDF, MCAP, MAT ...")],
    plant: PlantOption,
    preparation: LogOptions,
    output: OutputOptions,
    model: Models = "both",
    settings: Settings = [],
) -> None:
    """Overlay a log with a free-run simulation driven by its input, and compute the fit; no diagnosis.

    Examples: ehsa-ctrl compare log.csv --plant ehsa · ehsa-ctrl compare log.csv --plant my/rig.toml --model nonlinear
    --set load.stiffness=50e3 --from 2 --to 12 --zero p1,p2 --out results/compare
    """
    from ..identification.checks import check_log, raise_on_error
    from ..identification.comparison import fit_words, replay
    from ..identification.plant_log import missing_information
    from ..report.write import comparison_dict
    from .inputs import fit_table, load_models, read_prepared
    from .progress import compiling

    pairs = read_pairs(settings)
    plants = load_models(plant, model, pairs)
    output.check("compare", "comparison.json", "compare.csv", "report.html", figures=["compare", "compare-detail"])
    how = preparation.preparation()
    last = plants[-1]
    with compiling():
        read = read_prepared(log, last, how)
        ready, steps = read.log, read.steps
        findings = check_log(ready, last)
        raise_on_error(ready, (finding for finding in findings if finding.kind == "time_unit"))
        replays = [replay(each, ready) for each in plants]
    for finding in findings:
        warn(str(finding))
    if all(run.stopped for run in replays):
        raise SimulationError("; ".join(run.stopped for run in replays))
    for run in replays:
        if run.stopped:
            warn(f"{run.plant.model} model: {run.stopped}; no fit is computed")
    missing = missing_information(read.raw, last)
    result: dict[str, Any] = {
        **comparison_dict(replays),
        "log": log,
        "plant": plant,
        "settings": pairs,
        "preparation": steps,
        "findings": findings,
        "untold": list(missing.values()),
        "assumed": assumed_names(last),
        "rests_on": provenance(plants, [log]),
    }

    def write_files(draft: Path) -> None:
        from ..report.result_figures import comparison_figures, save_all
        from ..report.result_tables import comparison_tables, save_tables

        save_tables(comparison_tables(replays), draft)
        save_all(comparison_figures(replays), draft)

    def print_result() -> None:
        print(f"{last.name} against {log.name}: {len(ready)} samples from {ready.time[0]:g} to {ready.time[-1]:g} s")
        for step in steps:
            if step.kind != "read":
                print(f"  {step}")
        fits = {channel: [run.fit_percent[channel] for run in replays] for channel in replays[0].fit_percent}
        print(fit_table("fit, %", [run.plant.model for run in replays], fits))
        for run in replays:
            words = fit_words(run.fit_percent)
            print(f"{run.plant.model} starts {run.start}" + (f"; its fit is {words}" if words else ""))
        if "force" in missing:
            print(missing["force"])

    output.deliver("compare", "comparison.json", result, print_result, files=write_files)
