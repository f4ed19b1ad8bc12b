"""`ehsa-ctrl excite`: design an input that makes a plant's free parameters identifiable."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .complete import several_symbols
from .options import Model, PlantArgument, Settings, read_pairs, split_names
from .output import OutputOptions, assumed_names, provenance, warn

if TYPE_CHECKING:
    from ..identification.experiment import ExperimentDesign


def command(
    plant: PlantArgument,
    output: OutputOptions,
    kind: Annotated[str, typer.Option(help="Input: best, noise, multisine, steps, sine, chirp or ramp.")] = "best",
    duration: Annotated[float, typer.Option(metavar="S", help="Length of the experiment.")] = 20.0,
    model: Model = "nonlinear",
    settings: Settings = [],
    free: Annotated[
        str,
        typer.Option(
            metavar="K_T,beta",
            help="Further parameters to identify; also sensor errors: bias.p1.",
            autocompletion=several_symbols,
        ),
    ] = "",
    fix: Annotated[
        str, typer.Option(metavar="M", help="Parameters to keep fixed.", autocompletion=several_symbols)
    ] = "",
    amplitude: Annotated[
        float | None,
        typer.Option(
            metavar="A",
            help="Largest current, or other drive in its SI unit; by default as large as the limits allow.",
        ),
    ] = None,
    criterion: Annotated[
        str,
        typer.Option(help="Minimise the largest relative sd (worst) or the volume of the confidence region (D)."),
    ] = "worst",
    margin: Annotated[float, typer.Option(metavar="SHARE", help="Share of each limit to keep in reserve.")] = 0.15,
    spread: Annotated[
        float, typer.Option(metavar="SHARE", help="Relative parameter errors for which the limits must still hold.")
    ] = 0.3,
    rehearsals: Annotated[
        int, typer.Option(help="Number of simulated logs that check the predicted standard deviations.", min=0)
    ] = 6,
    seed: Annotated[int, typer.Option(help="Seed of noise and parameter draws.", min=0)] = 0,
) -> None:
    """Design a current within the plant's limits, and predict the parameters' standard deviations from its log.

    Examples: ehsa-ctrl excite ehsa --out results/excite · ehsa-ctrl excite ehsa --kind noise --duration 40 ·
    ehsa-ctrl excite my/rig.toml --set load.stiffness=50e3 --free K_T --fix M --margin 0.3 --out results/excite
    """
    from ..identification.experiment import design_experiment
    from .inputs import load_model
    from .progress import compiling, counting

    pairs = read_pairs(settings)
    loaded = load_model(plant, model, pairs)
    output.check("excite", "excitation.json", "current.csv", "report.html", figures=["excitation"])
    with compiling(), counting() as watch:
        found = design_experiment(
            loaded, duration=duration, kind=kind, free=split_names(free), fix=split_names(fix), amplitude=amplitude,
            criterion=criterion, margin=margin, spread=spread, rehearsals=rehearsals, seed=seed, watch=watch,
        )  # fmt: skip
    commands = next_commands(found, plant, pairs, output.out)
    result = {
        "plant": plant,
        "model": model,
        "settings": pairs,
        **found.to_dict(),
        "assumed": assumed_names(loaded),
        "next": commands,
        "current": str(output.out / "current.csv") if output.out is not None else None,
        "rests_on": provenance([loaded]),
    }

    def write_files(draft: Path) -> None:
        from ..report.figures import save

        found.write(draft / "current.csv")
        save(found.plot(), draft / "excitation")

    def print_result() -> None:
        print(found)
        if output.out is None:
            print("add --out DIR to write the current to a file")

    for name, trades in found.undetermined.items():
        warn(
            f"{name} is not determined by this input"
            + (f"; it trades off against {', '.join(trades)}: --fix one of them" if trades else "")
        )
    if found.check is not None and not found.check.passed:
        warn(str(found.check))
    then = "".join(f"\n  {line}" for line in commands)
    output.deliver("excite", "excitation.json", result, print_result, files=write_files, then=f"; then{then}")


def next_commands(found: ExperimentDesign, plant: str, settings: dict[str, str], out: Path | None) -> list[str]:
    """The next commands: simulate with this current, then identify from that log."""
    folder = out or Path("results/excite")
    set_options = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    model = ["--model", found.plant.model]
    bench = folder / "bench"
    simulate = ["ehsa-ctrl", "simulate", plant, "--input", str(folder / "current.csv"), *model, *set_options]
    simulate += [*(["--centre"] if found.centre else []), "--out", str(bench)]
    free = [p.name for p in found.forecast.fit.parameters]
    more = [name for name in free if name not in found.plant.free]
    less = [name for name in found.plant.free if name not in free]
    identify = ["ehsa-ctrl", "identify", str(bench / "log.csv"), "--plant", plant, *model, *set_options]
    identify += [*(["--free", ",".join(more)] if more else []), *(["--fix", ",".join(less)] if less else [])]
    return [shlex.join(simulate), shlex.join(identify)]
