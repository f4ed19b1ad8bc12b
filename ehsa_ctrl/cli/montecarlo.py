"""`ehsa-ctrl montecarlo`: probability that a scenario passes on an uncertain plant."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError
from .complete import scenarios
from .options import Json, RunOptions, read_pairs
from .output import OutputOptions, provenance


def command(
    scenario: Annotated[
        str, typer.Argument(help="Name of a scenario, or the path of its TOML.", autocompletion=scenarios)
    ],
    run: RunOptions,
    runs: Annotated[int, typer.Option(help="Number of runs for each controller.", min=1)] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of the draws.", min=0)] = 0,
    identification: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw from the covariance of this identification.json.")
    ] = None,
    require: Annotated[
        float | None,
        typer.Option(metavar="P", help="Exit with 1 unless the interval of the pass probability begins at P or more."),
    ] = None,
    confidence: Annotated[float, typer.Option(help="Confidence level of that interval.")] = 0.95,
    jobs: Annotated[int, typer.Option(help="Number of cores to use; -1 for all.")] = 1,
    backend: Annotated[
        str | None, typer.Option(help="threading or loky (processes); by default what suits the controller.")
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of the result; runs in it are continued.")
    ] = Path("results/montecarlo"),
    as_json: Json = False,
    force: Annotated[bool, typer.Option("--force", help="Start again instead of continuing.")] = False,
) -> None:
    """Run a scenario on draws of uncertain parameters, load and noise: pass probability, most influential parameter.

    After an interruption, the same command continues.

    Examples: ehsa-ctrl montecarlo spread_steps --jobs -1 · ehsa-ctrl montecarlo spread_steps --runs 5000
    --controller pid_position,my/pid.toml --require 0.95 · ehsa-ctrl montecarlo spread_steps --set load.stiffness=80e3
    · ehsa-ctrl montecarlo my/scenario.toml --identification results/rig/identification.json --jobs -1
    """
    from ..core.parallel import parallel_backend
    from ..scenario.montecarlo import monte_carlo
    from .progress import compiling, continuing, counting

    if not 0.0 < confidence < 1.0:
        raise InputError(f"--confidence {confidence:g}: expected more than 0 and less than 1")
    if require is not None and not 0.0 <= require <= 1.0:
        raise InputError(f"--require {require:g}: expected a probability, 0 to 1")
    pairs, chosen = read_pairs(run.settings), run.controllers()
    stems = [Path(scenario).stem + (f"-{Path(name).stem}" if name else "") for name in chosen]
    # Continuing replaces the files of the earlier runs; figures of other campaigns in the folder stay.
    output = OutputOptions(as_json, out, force=True)
    output.check("montecarlo", "montecarlo.json", "report.html", figures=stems, keep=True)
    records = {stem: out / f"{stem}.jsonl" for stem in stems}
    found = []
    with continuing("runs", out, *records.values()):
        for name, stem in zip(chosen, stems, strict=True):
            with compiling(), counting() as watch, parallel_backend(backend):
                result = monte_carlo(
                    scenario, runs=runs, seed=seed, controller=name, plant=run.plant, design=run.design,
                    settings=pairs, identification=identification, jobs=jobs,
                    file=records[stem], anew=force,
                    watch=watch and (lambda done, total, stem=stem: watch(stem, done, total)),
                )  # fmt: skip
            found.append(result)
            if not as_json:
                print(result)
                print(f"  replay it: {replay_command(scenario, name, run, records[stem])}")
                if require is not None:
                    print(f"  {requirement_sentence(result.interval(confidence)[0], require, confidence)}")
            if result.interrupted:
                break
        summary = {
            "campaigns": [{**result.to_dict(confidence), "required": require} for result in found],
            "rests_on": provenance(
                [result.plant for result in found if result.plant is not None],
                [*(file for result in found for file in result.files), identification],
            ),
        }

        def write_files(draft: Path) -> None:
            from ..report.figures import save

            for result, stem in zip(found, stems, strict=False):
                save(result.plot(), draft / stem)

        output.deliver("montecarlo", "montecarlo.json", summary, lambda: None, files=write_files, keep=True)
        if any(result.interrupted for result in found):
            raise KeyboardInterrupt
    if require is not None and any(result.interval(confidence)[0] < require for result in found):
        raise typer.Exit(1)


def replay_command(scenario: str, controller: str | None, run: RunOptions, file: Path) -> str:
    """The command that repeats the worst run of a campaign."""
    given = {"--controller": controller, "--plant": run.plant, "--design": run.design}
    words = [f"{option} {value}" for option, value in given.items() if value]
    words += [f"--set {text}" for text in run.settings]
    return " ".join(["ehsa-ctrl run", scenario, *words, "--replay", str(file)])


def requirement_sentence(low: float, required: float, confidence: float) -> str:
    """Whether the lower end of the probability's interval reaches the required probability."""
    met = "met" if low >= required else "NOT MET"
    demand = f"at least {required:g} with {100 * confidence:g} % confidence"
    return f"required: {demand}: {met}, the interval begins at {low:.3g}"
