"""`ehsa-ctrl analyse`: the linear model through python-control."""

from __future__ import annotations

from typing import Annotated

import typer

from ..core.errors import InputError
from .options import Force, Json, Out, Settings, read_pairs


def command(
    plant: Annotated[str, typer.Argument(help="Name of a plant, or the path of its TOML.")],
    controller: Annotated[str | None, typer.Option(help="Show the margins of the loop with this controller.")] = None,
    model: Annotated[
        str, typer.Option(help="linear: the identified linear set; nonlinear: linearised while sliding.")
    ] = "linear",
    position: Annotated[float, typer.Option(help="Rod position of the operating point, m (nonlinear).")] = 0.0,
    velocity: Annotated[float, typer.Option(help="Rod speed of the operating point, m/s (nonlinear).")] = 0.05,
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Poles, zeros, damping, DC gains and Bode figure of the plant's linear model; margins with a controller.

    Examples: ehsa-ctrl analyse ehsa · ehsa-ctrl analyse ehsa --controller pid_position --out results/loop
    """
    from ..design.analysis import analyse, analyse_loop
    from ..design.load import load_controller
    from ..plant.linear import three_state
    from ..plant.linearise import linearise, reduce_to_difference
    from ..plant.plant import load_plant
    from .output import prepare_folder, to_json

    if model not in ("linear", "nonlinear"):
        raise InputError(f"--model {model!r}: expected linear or nonlinear")
    folder = prepare_folder(out, "analysis.json", force=force) if out is not None else None
    loaded = load_plant(plant, model=model, settings=read_pairs(settings))  # type: ignore[arg-type]
    if model == "linear":
        system = three_state(loaded)
    else:
        system = reduce_to_difference(linearise(loaded, position=position, velocity=velocity), loaded)
    analysis = analyse(system)
    loop = None
    if controller is not None:
        loop = analyse_loop(system, load_controller(controller, system))
    result = {"plant": plant, "model": model, **analysis.to_dict(), **({"loop": loop.to_dict()} if loop else {})}
    if folder is not None:
        from ..report.figures import bode_figure, loop_figure, save

        (folder / "analysis.json").write_text(to_json(result) + "\n")
        save(bode_figure(analysis), folder / "bode")
        if loop is not None:
            save(loop_figure(loop), folder / "loop")
    if as_json:
        print(to_json(result))
    else:
        print(analysis)
        if loop is not None:
            print(loop)
        if folder is not None:
            print(f"written to {folder}")
