"""`ehsa-ctrl fmu`: a plant for other simulation tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.result import as_dict
from .options import Force, Json, Model, PlantArgument, Settings, read_pairs
from .output import to_json


def command(
    plant: PlantArgument,
    out: Annotated[Path, typer.Option("--out", metavar="PATH", help="File ending in .fmu, or a folder for PLANT.fmu.")],
    model: Model = "nonlinear",
    settings: Settings = [],
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Write a plant as an FMU (FMI 2.0, co-simulation) for Simulink, Modelica tools, FMPy and the like.

    Inputs are current (A) and F_D (N, external force on the rod), outputs speed, p1, p2, velocity, position, force
    and whether shaft and rod stick: true signals, without sensors. Each parameter of the plant can be set before the
    run. Communication steps may have any length; inputs are held over each, and sticking is exact within it.

    The FMU contains the plant and its equations, but not Python: the machine that runs it needs Python with ehsa_ctrl,
    on 64-bit Windows or Linux. On Linux, start a tool not written in Python with LD_PRELOAD=libpython3.X.so.
    Writing an FMU needs pythonfmu, from the extra `fmu` of ehsa_ctrl.

    Examples: ehsa-ctrl fmu ehsa --out rig.fmu · ehsa-ctrl fmu my/rig.toml --set load.stiffness=50e3 --out deploy
    """
    from ..core.result_folder import ResultFolder
    from ..simulation.fmu.export import export_fmu
    from ..simulation.fmu.variables import variables_of
    from .inputs import load_model

    pairs = read_pairs(settings)
    loaded = load_model(plant, model, pairs)
    path = out
    if out.suffix == ".fmu":
        export_fmu(loaded, out, force=force)
    else:
        # The user names only the folder: --force replaces nothing in it but an earlier FMU of this command.
        path = out / f"{loaded.name}.fmu"
        with ResultFolder(out, "fmu", force).check(path.name).draft() as draft:
            export_fmu(loaded, draft / path.name)
    variables = variables_of(loaded)
    if as_json:
        result = {
            "plant": plant,
            "model": model,
            "settings": pairs,
            "fmu": str(path),
            "fmi": "2.0 co-simulation",
            "step": loaded.sample_time,
            "variables": [as_dict(v, "name kind unit start meaning") for v in variables],
        }
        print(to_json(result))
        return
    for word, kinds in (("inputs", ("input",)), ("outputs", ("output", "flag")), ("parameters", ("parameter",))):
        named = [
            f"{v.name} ({v.unit})" if v.unit and word != "parameters" else v.name for v in variables if v.kind in kinds
        ]
        print(f"{word:<10} {', '.join(named)}")
    print(f"written to {path}; try it with\n  fmpy simulate {path} --show-plot")
