"""`ehsa-ctrl simulate`: the virtual bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from ..core.errors import InputError
from ..core.result import as_dict
from .options import Force, Json, Model, PlantArgument, Settings, read_pairs
from .output import OutputOptions, assumed_names, provenance, warn


def command(
    plant: PlantArgument,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for log.csv, simulation.json, report.html and figure.")
    ],
    input_file: Annotated[
        Path | None,
        typer.Option(
            "--input",
            metavar="CSV",
            help="Input to apply: columns t (s), current (A); for another machine the channels that drive it, found by "
            "name or by the plant's \\[log] table.",
        ),
    ] = None,
    excitation: Annotated[
        Literal["noise", "steps", "sine", "ramp", "chirp", "multisine", "white"] | None,
        typer.Option(help="Waveform of the input."),
    ] = None,
    amplitude: Annotated[float, typer.Option(help="Amplitude of the excitation, A (or the drive's unit).")] = 1.5,
    duration: Annotated[float, typer.Option(help="Duration of the excitation, s.")] = 10.0,
    resample: Annotated[
        float | None, typer.Option(metavar="HZ", help="Resample the input to this rate; also removes jitter.")
    ] = None,
    centre: Annotated[bool, typer.Option("--centre", help="Add a slow loop that keeps the rod in its stroke.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of noise and excitation.", min=0)] = 0,
    model: Model = "nonlinear",
    settings: Settings = [],
    no_noise: Annotated[bool, typer.Option("--no-noise", help="Log without sensor noise.")] = False,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Drive the plant from rest with a current (or its own input), and write the log that a test bench would record.

    Examples: ehsa-ctrl simulate ehsa --excitation steps --out results/steps ·
    ehsa-ctrl simulate ehsa --input current.csv --set load.stiffness=50e3 --out results/loaded
    """
    from ..core.log import CHANNELS
    from ..core.log_reader import read_log
    from ..identification.plant_log import held_channels
    from ..identification.preparation import resample as to_rate
    from ..simulation.bench import record
    from ..simulation.excitation import excitation as make
    from .inputs import load_model, print_notes
    from .progress import compiling

    if (input_file is None) == (excitation is None):
        raise InputError("give either --input current.csv or --excitation noise|steps|sine|ramp|chirp|multisine|white")
    pairs = read_pairs(settings)
    loaded = load_model(plant, model, pairs)
    system, second = loaded.structure.system, None
    if input_file is not None:
        given = read_log(
            input_file, [system.drive], columns=loaded.log, uniform=resample is None,
            rate=resample or 1.0 / loaded.sample_time, held=held_channels(loaded),
        )  # fmt: skip
        print_notes(given)
        if resample is not None:
            given, _ = to_rate(given, resample, held_channels(loaded))
        time, current = given.time, given[system.drive]
        second = given.channels.get(system.drives.get(system.inputs[1], ""))
    else:
        time, current = make(
            str(excitation), amplitude=amplitude, duration=duration, sample_time=loaded.sample_time, seed=seed
        )
    output = OutputOptions(as_json, out, force)
    output.check("simulate", "log.csv", "simulation.csv", "simulation.json", "report.html", figures=["simulation"])
    with compiling():
        log, run = record(loaded, time, current, seed=seed, sensor_noise=not no_noise, centre=centre, force=second)
    result = {
        "plant": plant,
        "model": model,
        "settings": pairs,
        "input": str(input_file)
        if input_file
        else f"{excitation}, {amplitude:g} {CHANNELS[system.drive].unit}, {duration:g} s",
        "centred": centre,
        "seed": seed,
        "samples": len(run),
        "sample_time": log.sample_time,
        "stopped": run.stopped,
        "limits_passed": [str(exceedance) for exceedance in run.exceeded],
        "warnings": run.warnings,
        "exceeded": [as_dict(exceedance, sentence=str(exceedance)) for exceedance in run.exceeded],
        **run.shown(),
        "pressure_level_drift": run.pressure_level_drift,
        "assumed": assumed_names(loaded),
        "provenance": run.provenance,
        "log": str(out / "log.csv"),
        "rests_on": provenance([loaded], [input_file]),
    }

    def write_files(draft: Path) -> None:
        from ..report.figures import save
        from ..report.result_tables import save_tables, simulation_tables

        log.write(draft / "log.csv")
        save_tables(simulation_tables(run), draft)
        save(run.plot(), draft / "simulation")

    def print_result() -> None:
        print(run.summary())
        for exceedance in run.exceeded:
            warn(f"limit exceeded: {exceedance}")
        for beyond in run.extrapolated:
            warn(str(beyond))
        if run.stopped:
            warn(f"the log ends early: {run.stopped}")
        if abs(run.pressure_level_drift) > 1e5:
            warn(
                f"the mean pressure drifted by {run.pressure_level_drift / 1e5:.2g} bar: model (12) conserves volume, "
                "not mass (see the effect mass_conserving)"
            )

    output.deliver("simulate", "simulation.json", result, print_result, files=write_files)
