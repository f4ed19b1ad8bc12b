"""`ehsa-ctrl export`: a controller as C99 source with a test vector."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .complete import controllers, plants
from .options import Force, Json, Settings, read_pairs

if TYPE_CHECKING:
    import numpy as np

    from ..design.controller import SampledController
    from ..plant.plant import Plant

#: Blows of the outer force [N] of which the least one is taken that asks the controller for all of its current.
BLOWS = (0.0, 10e3, 20e3, 40e3)


def command(
    controller: Annotated[
        str, typer.Argument(help="Name of a controller, or the path of its TOML.", autocompletion=controllers)
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the C source, test vector and test.")],
    plant: Annotated[
        str, typer.Option(help="Name of a plant, or the path of its TOML.", autocompletion=plants)
    ] = "ehsa",
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    seed: Annotated[int, typer.Option(help="Of the test vector's sensor noise.", min=0)] = 0,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Write a controller as C99: the functions that were simulated, its settings, a test vector and the test of it.

    The controller is designed on the plant's linear model; the test vector is a run on the nonlinear plant with noise,
    a blow, and readings that are lost. `make -C DIR test` compiles and replays it.

    Examples: ehsa-ctrl export pid_position --out deploy/pid · ehsa-ctrl export mpc_position --plant my/rig.toml
    --set K_T=1.1 --out deploy/mpc
    """
    from ..core.result_folder import ResultFolder
    from ..design.export import FILES, export_controller
    from ..design.load import load_controller
    from ..plant.linear import three_state
    from ..plant.load import load_plant
    from .output import to_json, warn_implausible
    from .progress import compiling

    pairs = read_pairs(settings)
    system = three_state(load_plant(plant, model="linear", settings=pairs))
    checked = load_plant(plant, model="nonlinear", settings=pairs)
    warn_implausible([checked])
    chosen = load_controller(controller, system, sample_time=checked.sample_time)
    ResultFolder(out, "export", force).check("controller.c", *FILES)
    with compiling():
        reference, measured, limited = exercise(checked, chosen, seed)
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


def exercise(plant: Plant, controller: SampledController, seed: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Reference (N, 3) and readings (N, 5) of a run, and in how many samples the current was at its limit.

    Two steps and a ramp, a blow of the outer force, readings that are lost for a moment, and at the end for good.
    """
    import numpy as np

    from ..core.controller_interface import MEASURED
    from ..simulation.closed_loop import run_closed_loop
    from ..simulation.faults import Faults, SensorFault
    from ..simulation.sensors import Sensors

    time = controller.sample_time * np.arange(round(3.0 / controller.sample_time))
    reference = np.zeros((time.size, 3))
    # A tenth of the stroke, of a long one 20 mm.
    size = min(0.02, 0.1 * plant.limits["stroke"].value) if "stroke" in plant.limits else 0.02
    reference[:, 0] = np.select([time < 0.2, time < 1.2, time < 1.6], [0.0, size, 0.0], 0.0)
    ramp = (time >= 1.8) & (time < 2.2)
    reference[ramp, 1] = size
    reference[:, 0] += size * np.clip(time - 1.8, 0.0, 0.4)
    end = float(time[-1])
    faults = Faults(
        [
            *(SensorFault(channel, "lost", 0.3, 5 * controller.sample_time) for channel in MEASURED),
            *(SensorFault(channel, "lost", end - 0.2) for channel in MEASURED),
        ]
    )
    for blow in BLOWS:
        force = np.where((time >= 2.4) & (time < 2.5), blow, 0.0)
        loop = run_closed_loop(
            plant,
            controller,
            reference,
            force=force,
            sensors=Sensors.of(plant, seed=seed),
            faults=faults,
            raise_on_failure=False,
        )
        limited = int(np.count_nonzero(np.abs(loop.asked) >= controller.current_limit))
        if limited:
            break
    return loop.reference, loop.measured, limited
