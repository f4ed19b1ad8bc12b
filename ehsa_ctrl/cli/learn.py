"""`ehsa-ctrl learn`: iterative learning control over repeated runs of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError
from .complete import scenarios
from .options import RunOptions, read_pairs
from .output import OutputOptions, provenance, warn_implausible


def command(
    scenario: Annotated[
        str, typer.Argument(help="Name of a scenario, or the path of its TOML.", autocompletion=scenarios)
    ],
    run: RunOptions,
    output: OutputOptions,
    trials: Annotated[int, typer.Option(help="Number of corrections; there is one run more.", min=1)] = 8,
    cutoff: Annotated[str, typer.Option(help="Frequency up to which the correction is learnt.")] = "10 Hz",
    gain: Annotated[float, typer.Option(help="Learning gain; 1 learns in one trial, less averages noise.")] = 0.5,
    lead: Annotated[
        int | None,
        typer.Option(help="Samples by which the error is advanced; by default those that converge fastest.", min=0),
    ] = None,
    deadband: Annotated[str, typer.Option(help="Error that is not learnt, such as '40 um'.")] = "0 m",
) -> None:
    """Repeat a scenario and correct its reference by the error of each run (iterative learning control).

    The convergence is checked first, on the linear loop: a correction that would grow at any frequency is refused. With
    --out, trajectory.csv holds the corrected reference for a scenario with \\[reference] kind = "file".

    Examples: ehsa-ctrl learn press_cycle --controller cascade_friction --out results/learnt ·
    ehsa-ctrl learn trapezoid_moves --controller lqr_friction --trials 12 --cutoff '15 Hz' --deadband '40 um'
    """
    from ..core.unit import parse
    from ..scenario.learning import learn_reference
    from .progress import compiling

    chosen = run.controllers()
    if len(chosen) != 1:
        raise InputError("--controller: learn takes one controller at a time")
    output.check("learn", "learning.json", "report.html", "trajectory.csv", figures=["learning"])
    with compiling():
        found = learn_reference(
            scenario,
            controller=chosen[0],
            plant=run.plant,
            design=run.design,
            settings=read_pairs(run.settings),
            trials=trials,
            gain=gain,
            cutoff=parse(cutoff, "Hz"),
            lead=lead,
            deadband=parse(deadband, "m"),
        )
    warn_implausible([found.plant])
    result = found.to_dict() | {"rests_on": provenance([found.plant], found.files)}

    def write_files(draft: Path) -> None:
        from ..report.figures import save

        found.trajectory().to_csv(draft / "trajectory.csv", index=False, float_format="%.9g")
        save(found.plot(), draft / "learning")

    output.deliver("learn", "learning.json", result, lambda: print(found), files=write_files)
