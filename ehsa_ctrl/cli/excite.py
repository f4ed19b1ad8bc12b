"""`ehsa-ctrl excite`: an input that makes a plant's free parameters determinable."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import InputError
from .complete import models, plants, several_symbols
from .options import Force, Json, Out, Settings, names, read_pairs

if TYPE_CHECKING:
    from ..identification.experiment import ExperimentDesign


def command(
    plant: Annotated[
        str, typer.Argument(help="Name of a plant, or the path of its TOML: what is believed.", autocompletion=plants)
    ],
    kind: Annotated[str, typer.Option(help="best, noise, multisine, steps, sine, chirp or ramp.")] = "best",
    duration: Annotated[float, typer.Option(metavar="S", help="Length of the experiment.")] = 20.0,
    model: Annotated[str, typer.Option(help="linear or nonlinear.", autocompletion=models)] = "nonlinear",
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    free: Annotated[
        str,
        typer.Option(
            metavar="K_T,beta", help="To be determined as well; also bias.p1.", autocompletion=several_symbols
        ),
    ] = "",
    fix: Annotated[str, typer.Option(metavar="M", help="Not to be determined.", autocompletion=several_symbols)] = "",
    amplitude: Annotated[float | None, typer.Option(metavar="A", help="Most current; else what limits allow.")] = None,
    criterion: Annotated[str, typer.Option(help="worst (relative sd of a parameter) or D (volume).")] = "worst",
    margin: Annotated[float, typer.Option(metavar="SHARE", help="Of each limit that is left unused.")] = 0.15,
    spread: Annotated[
        float, typer.Option(metavar="SHARE", help="Parameters may be this far off, and the limits still hold.")
    ] = 0.3,
    rehearsals: Annotated[
        int, typer.Option(help="Logs of the virtual bench on which the promise is checked.", min=0)
    ] = 6,
    seed: Annotated[int, typer.Option(help="Of noise and of the parameters' draws.", min=0)] = 0,
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Propose a current within the plant's limits, and say which standard deviations its log will give.

    Examples: ehsa-ctrl excite ehsa --out results/excite · ehsa-ctrl excite ehsa --kind noise --duration 40 ·
    ehsa-ctrl excite my/rig.toml --set load.stiffness=50e3 --free K_T --fix M --margin 0.3 --out results/excite
    """
    from ..core.result_folder import ResultFolder
    from ..identification.experiment import design_experiment
    from ..plant.load import load_plant
    from .output import rests_on, to_json, warn, warn_implausible
    from .progress import compiling, counting

    if model not in ("linear", "nonlinear"):
        raise InputError(f"--model {model!r}: expected linear or nonlinear")
    pairs = read_pairs(settings)
    loaded = load_plant(plant, model=model, settings=pairs)  # type: ignore[arg-type]
    warn_implausible([loaded])
    place = None
    if out is not None:
        place = ResultFolder(out, "excite", force).check(
            "excitation.json", "current.csv", "report.html", figures=["excitation"]
        )
    with compiling(), counting() as watch:
        found = design_experiment(
            loaded, duration=duration, kind=kind, free=names(free), fix=names(fix), amplitude=amplitude,
            criterion=criterion, margin=margin, spread=spread, rehearsals=rehearsals, seed=seed, watch=watch,
        )  # fmt: skip
    commands = next_commands(found, plant, pairs, out)
    result = {
        "plant": plant,
        "model": model,
        "settings": pairs,
        **found.to_dict(),
        "assumed": [name for name, p in loaded.parameters.items() if p.source == "assumed"],
        "next": commands,
        "current": str(out / "current.csv") if out is not None else None,
        "rests_on": rests_on([loaded]),
    }
    if place is not None:
        from ..report.figures import save
        from ..report.result_page import write_result_page

        with place.draft() as draft:
            found.write(draft / "current.csv")
            (draft / "excitation.json").write_text(to_json(result) + "\n")
            save(found.plot(), draft / "excitation")
            write_result_page(draft, "excitation.json")
    for name, trades in found.undetermined.items():
        warn(
            f"{name} is not determined by this input"
            + (f"; it trades places with {', '.join(trades)}: --fix one of them" if trades else "")
        )
    if found.check is not None and not found.check.passed:
        warn(str(found.check))
    if as_json:
        print(to_json(result))
        return
    print(found)
    if out is not None:
        print(f"written to {out}; then")
        print("\n".join(f"  {line}" for line in commands))
    else:
        print("say --out DIR to have the current as a file")


def next_commands(found: ExperimentDesign, plant: str, settings: dict[str, str], out: Path | None) -> list[str]:
    """What to call next: the virtual bench with this current, then identification from its log."""
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
