"""`ehsa-ctrl montecarlo`: how likely a scenario passes on a plant that is not known exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError
from .complete import plants, scenarios, several_controllers, symbols
from .options import Json, read_pairs


def command(
    scenario: Annotated[str, typer.Argument(help="Name or TOML file.", autocompletion=scenarios)],
    controller: Annotated[
        str | None,
        typer.Option(help="Run these instead, names or files separated by commas.", autocompletion=several_controllers),
    ] = None,
    runs: Annotated[int, typer.Option(help="How many, for each controller.", min=1)] = 1000,
    seed: Annotated[int, typer.Option(help="Of the draws.", min=0)] = 0,
    plant: Annotated[
        str | None, typer.Option(help="Check on this plant instead of the scenario's.", autocompletion=plants)
    ] = None,
    design: Annotated[
        str | None, typer.Option(help="Design on this plant's linear set.", autocompletion=plants)
    ] = None,
    settings: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Believe another value of the plant that is checked on, as for run: K_T=1.1, load.stiffness=50e3. "
            "Repeatable.",
            autocompletion=symbols,
        ),
    ] = [],  # noqa: B006 - typer reads the default, nobody changes it
    identification: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw from the covariance of this identification.json.")
    ] = None,
    require: Annotated[
        float | None, typer.Option(metavar="P", help="Exit 1 unless the probability is at least P, with --confidence.")
    ] = None,
    confidence: Annotated[float, typer.Option(help="Of the interval of the probability.")] = 0.95,
    jobs: Annotated[int, typer.Option(help="Cores or workers to use; -1 for all.")] = 1,
    backend: Annotated[
        str | None, typer.Option(help="threading or loky on this machine; dask or ray on a cluster.")
    ] = None,
    address: Annotated[
        str | None, typer.Option(help="Of the cluster's scheduler; without one a cluster is started here.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder; runs in it are continued.")] = Path(
        "results/montecarlo"
    ),
    as_json: Json = False,
    force: Annotated[bool, typer.Option("--force", help="Begin anew instead of continuing.")] = False,
) -> None:
    """Draw what is not known exactly (plant, load, noise), run the scenario on each draw: pass probability with its
    interval, and the parameter that decides it. Interrupt it and call it again: it goes on where it was.

    Examples: ehsa-ctrl montecarlo spread_steps --jobs -1 · ehsa-ctrl montecarlo spread_steps --runs 5000
    --controller pid_position,my/pid.toml --require 0.95 · ehsa-ctrl montecarlo spread_steps --set load.stiffness=80e3
    · ehsa-ctrl montecarlo my/scenario.toml --identification results/rig/identification.json --backend dask
    --address tcp://head:8786 --jobs -1
    """
    from ..core.result_folder import ResultFolder
    from ..report.figures import save
    from ..report.result_page import write_result_page
    from ..scenario.montecarlo import monte_carlo
    from .output import rests_on, to_json
    from .progress import compiling, counting

    if not 0.0 < confidence < 1.0:
        raise InputError(f"--confidence {confidence:g}: expected more than 0 and less than 1")
    if require is not None and not 0.0 <= require <= 1.0:
        raise InputError(f"--require {require:g}: expected a probability, 0 to 1")
    pairs = read_pairs(settings)
    chosen: list[str | None] = [None]
    if controller is not None:
        chosen = [name.strip() for name in controller.split(",") if name.strip()]
        if not chosen:
            raise InputError(f"--controller {controller!r}: names no controller")
    stems = [Path(scenario).stem + (f"-{Path(name).stem}" if name else "") for name in chosen]
    # What was written of the runs so far is replaced as they are continued; figures of other campaigns stay.
    place = ResultFolder(out, "montecarlo", force=True, keep=True)
    place.check("montecarlo.json", "report.html", figures=stems)
    found = []
    for name, stem in zip(chosen, stems, strict=True):
        with compiling(), counting() as watch:
            result = monte_carlo(
                scenario, runs=runs, seed=seed, controller=name, plant=plant, design=design,
                settings=pairs, identification=identification, jobs=jobs, backend=backend, address=address,
                file=out / f"{stem}.jsonl", anew=force,
                watch=watch and (lambda done, total, stem=stem: watch(stem, done, total)),
            )  # fmt: skip
        found.append(result)
        if not as_json:
            print(result)
            if require is not None:
                print(f"  {demand(result.interval(confidence)[0], require, confidence)}")
        if result.interrupted:
            break
    grounds = rests_on(
        [result.plant for result in found if result.plant is not None],
        [*(file for result in found for file in result.files), identification],
    )
    campaigns = [{**result.to_dict(confidence), "required": require} for result in found]
    summary = {"campaigns": campaigns, "rests_on": grounds}
    with place.draft() as draft:
        for result, stem in zip(found, stems, strict=False):
            save(result.plot(), draft / stem)
        (draft / "montecarlo.json").write_text(to_json(summary) + "\n")
        write_result_page(draft, "montecarlo.json")
    if as_json:
        print(to_json(summary))
    else:
        print(f"written to {out}")
    if any(result.interrupted for result in found):
        raise KeyboardInterrupt(f"the runs that were done are kept in {out}, and the same call goes on from them")
    if require is not None and any(result.interval(confidence)[0] < require for result in found):
        raise typer.Exit(1)


def demand(low: float, required: float, confidence: float) -> str:
    """What was demanded of the probability and whether the runs show it: the interval's lower end counts."""
    shown = "shown" if low >= required else "NOT SHOWN"
    asked = f"at least {required:g} with {100 * confidence:g} % confidence"
    return f"demanded: {asked}: {shown}, the interval begins at {low:.3g}"
