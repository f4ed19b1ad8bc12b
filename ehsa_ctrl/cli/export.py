"""`ehsa-ctrl export`: a controller as C99 source with a test vector."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .complete import controllers, plants
from .options import Force, Json, Settings, read_pairs
from .output import to_json, warn_implausible


def command(
    controller: Annotated[
        str, typer.Argument(help="Name of a controller, or the path of its TOML.", autocompletion=controllers)
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the C source, test vector and test.")],
    plant: Annotated[
        str, typer.Option(help="Name of a plant, or the path of its TOML.", autocompletion=plants)
    ] = "ehsa",
    settings: Settings = [],
    seed: Annotated[int, typer.Option(help="Seed of the test vector's sensor noise.", min=0)] = 0,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Write a controller as C99: the functions that the simulation runs, settings, a test vector and its test.

    The controller is designed on the plant's linear model; the test vector is a run on the nonlinear plant with noise,
    a force pulse and lost readings. `make -C DIR test` compiles the code and replays it.

    Examples: ehsa-ctrl export pid_position --out deploy/pid · ehsa-ctrl export mpc_position --plant my/rig.toml
    --set K_T=1.1 --out deploy/mpc
    """
    from ..core.result_folder import ResultFolder
    from ..design.export import FILES, export_controller
    from ..design.load import load_controller
    from ..plant.conditions import linear_model
    from ..plant.load import load_plant
    from ..simulation.exercise import exercise_controller
    from .progress import compiling

    pairs = read_pairs(settings)
    system = linear_model(load_plant(plant, model="linear", settings=pairs))
    checked = load_plant(plant, model="nonlinear", settings=pairs)
    warn_implausible([checked])
    chosen = load_controller(controller, system, sample_time=checked.sample_time)
    ResultFolder(out, "export", force).check("controller.c", *FILES)
    with compiling():
        reference, measured, limited = exercise_controller(checked, chosen, chosen.current_limit, seed)
    deployment = export_controller(chosen, reference, measured)
    deployment.write(out, force=force)
    if as_json:
        lost = int((measured != measured).any(axis=1).sum())
        result = {
            "controller": chosen.name,
            "plant": plant,
            "settings": pairs,
            "samples": len(reference),
            "samples_limited": limited,
            "samples_lost": lost,
            "tolerance": deployment.tolerance,
            "step_size": deployment.rho,
            "distance_from_exact": deployment.vector.distance,
            "samples_unsolved": deployment.vector.fallbacks,
            "files": sorted(str(out / name) for name in deployment.files),
        }
        print(to_json(result))
        return
    print(deployment)
    print(f"written to {out}; then\n  make -C {out} test")
