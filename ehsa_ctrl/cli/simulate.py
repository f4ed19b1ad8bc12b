"""`ehsa-ctrl simulate`: the virtual bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError
from .complete import excitations, models, plants
from .options import Force, Json, Settings, read_pairs


def command(
    plant: Annotated[str, typer.Argument(help="Name of a plant, or the path of its TOML.", autocompletion=plants)],
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for log.csv, simulation.json, report.html and figure.")
    ],
    input_file: Annotated[
        Path | None, typer.Option("--input", metavar="CSV", help="Current to apply: columns t, current.")
    ] = None,
    excitation: Annotated[
        str | None, typer.Option(help="noise, steps, sine, ramp, chirp or multisine.", autocompletion=excitations)
    ] = None,
    amplitude: Annotated[float, typer.Option(help="Of the excitation, A.")] = 1.5,
    duration: Annotated[float, typer.Option(help="Of the excitation, s.")] = 10.0,
    centre: Annotated[bool, typer.Option("--centre", help="Add a slow loop that keeps the rod in its stroke.")] = False,
    seed: Annotated[int, typer.Option(help="Of noise and excitation.", min=0)] = 0,
    model: Annotated[str, typer.Option(help="linear or nonlinear.", autocompletion=models)] = "nonlinear",
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    no_noise: Annotated[bool, typer.Option("--no-noise", help="Log without sensor noise.")] = False,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Drive the plant with a current, from rest, and log it as a bench would.

    Examples: ehsa-ctrl simulate ehsa --excitation steps --out results/steps ·
    ehsa-ctrl simulate ehsa --input current.csv --set load.stiffness=50e3 --out results/loaded
    """
    from ..core.log_reader import read_log
    from ..core.result_folder import ResultFolder
    from ..plant.load import load_plant
    from ..simulation.bench import record
    from ..simulation.excitation import excitation as make
    from .output import rests_on, to_json, warn_implausible
    from .prepared import say_notes
    from .progress import compiling

    if model not in ("linear", "nonlinear"):
        raise InputError(f"--model {model!r}: expected linear or nonlinear")
    if (input_file is None) == (excitation is None):
        raise InputError("give either --input current.csv or --excitation noise|steps|sine|ramp|chirp|multisine")
    loaded = load_plant(plant, model=model, settings=read_pairs(settings))  # type: ignore[arg-type]
    warn_implausible([loaded])
    if input_file is not None:
        given = read_log(input_file, ["current"])
        say_notes(given)
        time, current = given.time, given["current"]
    else:
        time, current = make(
            str(excitation), amplitude=amplitude, duration=duration, sample_time=loaded.sample_time, seed=seed
        )
    place = ResultFolder(out, "simulate", force).check(
        "log.csv", "simulation.json", "report.html", figures=["simulation"]
    )
    with compiling():
        log, run = record(loaded, time, current, seed=seed, sensor_noise=not no_noise, centre=centre)
    result = {
        "plant": plant,
        "model": model,
        "settings": read_pairs(settings),
        "input": str(input_file) if input_file else f"{excitation}, {amplitude:g} A, {duration:g} s",
        "centred": centre,
        "seed": seed,
        "samples": len(run),
        "sample_time": log.sample_time,
        "stopped": run.stopped,
        "limits_passed": [str(exceedance) for exceedance in run.exceeded],
        "pressure_level_drift": run.pressure_level_drift,
        "assumed": [name for name, p in loaded.parameters.items() if p.source == "assumed"],
        "provenance": run.provenance,
        "log": str(out / "log.csv"),
        "rests_on": rests_on([loaded], [input_file]),
    }
    from ..report.figures import save
    from ..report.result_page import write_result_page

    with place.draft() as draft:
        log.write(draft / "log.csv")
        (draft / "simulation.json").write_text(to_json(result) + "\n")
        save(run.plot(), draft / "simulation")
        write_result_page(draft, "simulation.json")
    if as_json:
        print(to_json(result))
    else:
        from .output import warn

        print(run.summary())
        for exceedance in run.exceeded:
            warn(f"limit passed: {exceedance}")
        if run.stopped:
            warn(f"the log ends early: {run.stopped}")
        if abs(run.pressure_level_drift) > 1e5:
            warn(
                f"the pressure level has moved by {run.pressure_level_drift / 1e5:.2g} bar: (12) conserves volume, not "
                "mass (see the effect mass_conserving)"
            )
        print(f"written to {out}")
