"""`ehsa-ctrl export`: a controller as C99 source with a test vector."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from .complete import controllers, plants
from .options import Force, Json, Settings, read_pairs
from .output import note, provenance, to_json, warn_implausible

#: Files of --check.
CHECK, PAGE = "check.json", "report.html"


def command(
    controller: Annotated[
        str, typer.Argument(help="Name of a controller, or the path of its TOML.", autocompletion=controllers)
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the C source, test vector and test.")],
    plant: Annotated[
        str, typer.Option(help="Name of a plant, or the path of its TOML.", autocompletion=plants)
    ] = "ehsa",
    number: Annotated[
        Literal["double", "float", "q31", "q15"],
        typer.Option(help="Numbers in the C; q31 and q15: fixed point in words of 32 or 16 bits."),
    ] = "double",
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Compile the code here, and report its error over all scenarios, its flops and stack; writes a page.",
        ),
    ] = False,
    settings: Settings = [],
    seed: Annotated[int, typer.Option(help="Seed of the test vector's sensor noise.", min=0)] = 0,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Write a controller as C99: the functions that the simulation runs, settings, a test vector and its test.

    The controller is designed on the plant's linear model; the test vector is a run on the nonlinear plant with noise,
    a force pulse and lost readings. `make -C DIR test` compiles the code and replays it.

    Examples: ehsa-ctrl export pid_position --out deploy/pid · ehsa-ctrl export mpc_position --plant my/rig.toml
    --set K_T=1.1 --out deploy/mpc · ehsa-ctrl export lqr_position --number q31 --check --out deploy/lqr
    """
    from ..core.catalogue import controllers as catalogue
    from ..core.catalogue import scenarios
    from ..core.result_folder import ResultFolder
    from ..design.export import FILES, FIXED, NUMBERS, check_code, export_controller
    from ..design.load import load_controller
    from ..plant.conditions import linear_model
    from ..plant.load import load_plant
    from ..scenario.recorded_runs import RecordedRun, recorded_runs
    from ..simulation.exercise import exercise_controller
    from .progress import compiling

    pairs = read_pairs(settings)
    system = linear_model(load_plant(plant, model="linear", settings=pairs))
    checked = load_plant(plant, model="nonlinear", settings=pairs)
    warn_implausible([checked])
    chosen = load_controller(controller, system, sample_time=checked.sample_time)
    ResultFolder(out, "export", force).check("controller.c", *FILES, *([CHECK, PAGE] if check else []))
    with compiling():
        reference, measured, limited = exercise_controller(checked, chosen, chosen.current_limit, seed)
    runs: list[RecordedRun] = []
    if check or number in FIXED:
        # The scales of fixed-point code are for what its numbers do in the scenarios.
        with compiling():
            runs, others = recorded_runs(scenarios.values(), chosen, checked)
        for name, why in others.items():
            note(f"{'not checked' if check else 'without the ranges'} over {name}: {why}")
    ranges = [(one.reference, one.measured) for one in runs]
    deployment = export_controller(chosen, reference, measured, number=NUMBERS[number], runs=ranges)
    report = check_code(deployment, chosen, NUMBERS[number], runs) if check else None

    def write_check(draft: Path) -> None:
        from ..report.results import write_result_page

        if report is not None:
            about = {"controller": chosen.name, "plant": plant, "settings": pairs}
            rests_on = provenance([checked], [catalogue.find(controller), checked.path])
            content = about | report.to_dict() | {"rests_on": rests_on}
            (draft / CHECK).write_text(to_json(content) + "\n", encoding="utf-8")
            write_result_page(draft, CHECK)

    deployment.write(out, force=force, more=write_check)
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
            "solver_iterations": None
            if deployment.vector.iterations is None
            else int(deployment.vector.iterations.max()),
            "distance_from_exact": deployment.vector.distance,
            "samples_unsolved": deployment.vector.fallbacks,
            "number": number,
            "check": report,
            "files": sorted(str(out / name) for name in (*deployment.files, *((CHECK, PAGE) if check else ()))),
        }
        print(to_json(result))
        return
    print(deployment)
    if report is not None:
        print(report)
    page = f" (open {out / PAGE})" if check else ""
    print(f"written to {out}{page}; then\n  make -C {out} test")
