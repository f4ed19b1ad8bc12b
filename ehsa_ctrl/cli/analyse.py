"""`ehsa-ctrl analyse`: the linear model and its loops through python-control, and the worst of many plants."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError
from .complete import models, plants, several_controllers
from .options import Force, Json, Out, Settings, read_pairs

if TYPE_CHECKING:
    from ..design.analysis.loop import LoopAnalysis
    from ..design.analysis.robustness import RobustMargins
    from ..design.analysis.system import Analysis
    from ..design.review import Known, Review
    from ..plant.plant import Plant


def command(
    plant: Annotated[str, typer.Argument(help="Name of a plant, or the path of its TOML.", autocompletion=plants)],
    controller: Annotated[
        str | None,
        typer.Option(
            metavar="A[,B]",
            help="Show the margins of the loop with these controllers.",
            autocompletion=several_controllers,
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="linear: the identified linear set; nonlinear: linearised while sliding.", autocompletion=models
        ),
    ] = "linear",
    position: Annotated[
        str, typer.Option(help="Rod position of the operating point, m (nonlinear); several: each is tried.")
    ] = "0",
    velocity: Annotated[
        str, typer.Option(help="Rod speed of the operating point, m/s (nonlinear); several: each is tried.")
    ] = "0.05",
    stiffness: Annotated[
        str, typer.Option(help="Springs to try the loop with, e.g. '0,50 kN/m,100 kN/m'; N/m without a unit.")
    ] = "",
    mass: Annotated[str, typer.Option(help="Masses of the load to try the loop with, e.g. '0,100 kg'.")] = "",
    draws: Annotated[int, typer.Option(min=0, help="Plants drawn from what is known of the parameters' errors.")] = 0,
    covariance: Annotated[
        Path | None, typer.Option(metavar="FILE", help="identification.json whose covariance the draws have.")
    ] = None,
    spread: Annotated[
        float, typer.Option(min=0, help="Relative sd taken for identified numbers of which none is known.")
    ] = 0.05,
    assumed: Annotated[
        bool, typer.Option("--assumed", help="Draw what is only assumed as well, evenly between its bounds.")
    ] = False,
    lag: Annotated[int, typer.Option(min=0, help="Samples between a measurement and the current from it.")] = 0,
    review: Annotated[bool, typer.Option("--review", help="Look through each design, friction included.")] = False,
    seed: Annotated[int, typer.Option(help="Of the draws.")] = 0,
    settings: Settings = [],  # noqa: B006 - typer reads the default, nobody changes it
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Poles, zeros, damping, DC gains and Bode figure of the plant's linear model; margins with a controller.

    With --draws or several conditions, also the worst margins among all of these plants, and which plant it is.

    Examples: ehsa-ctrl analyse ehsa · ehsa-ctrl analyse ehsa --controller pid_position --out results/loop ·
    ehsa-ctrl analyse ehsa --controller pid_position,lqr_position --draws 200 --stiffness '0,50 kN/m,100 kN/m' --review
    """
    from ..core.result_folder import ResultFolder
    from ..design.analysis.loop import analyse_loop
    from ..design.analysis.robustness import robust_margins
    from ..design.analysis.system import analyse
    from ..design.load import load_controller
    from ..design.review import review as look_through
    from ..plant.conditions import conditions
    from ..plant.load import load_plant
    from .output import rests_on, to_json, warn_implausible

    if model not in ("linear", "nonlinear"):
        raise InputError(f"--model {model!r}: expected linear or nonlinear")
    names = [name.strip() for name in controller.split(",") if name.strip()] if controller is not None else []
    at = conditions(
        positions=_numbers("--position", position, "m"),
        velocities=_numbers("--velocity", velocity, "m/s"),
        stiffnesses=_numbers("--stiffness", stiffness, "N/m"),
        masses=_numbers("--mass", mass, "kg"),
    )
    many = bool(draws) or len(at) > 1 or bool(stiffness or mass)
    if (many or review or lag) and not names:
        raise InputError("draws, conditions, --lag and --review are about a loop; give its --controller")
    if covariance is not None and not draws:
        raise InputError("--covariance is what plants are drawn from; say how many with --draws")
    place = None
    if out is not None:
        ends = [f"-{Path(name).stem}" for name in names] if len(names) > 1 else [""] * len(names)
        figures = ["bode", *(f"{word}{end}" for word in ("loop", "nyquist") for end in ends)]
        place = ResultFolder(out, "analyse", force).check("analysis.json", "report.html", figures=figures)
    pairs = read_pairs(settings)
    loaded = load_plant(plant, model=model, settings=pairs)  # type: ignore[arg-type]
    warn_implausible([loaded])
    system = conditions(positions=[at[0].position], velocities=[at[0].velocity])[0].model(loaded)
    analysis = analyse(system)
    known = _known(plant, loaded, pairs)
    models = {}
    if many:
        from ..plant.draws import draw, drawn_models, read_covariance

        spoken = read_covariance(covariance) if covariance is not None else None
        drawn = draw(loaded, draws, seed=seed, covariance=spoken, unknown=spread, assumed=assumed) if draws else []
        models = drawn_models(loaded, drawn, at)
    loops, robust, reviews = [], [], []
    for name in names:
        chosen = load_controller(name, system, sample_time=loaded.sample_time)
        loops.append(analyse_loop(system, chosen, lag=lag, noise=known.noise))
        robust.append(robust_margins(models, chosen, lag=lag) if models else None)
        if review:
            reviews.append(look_through(system, chosen, known=known, robust=robust[-1], lag=lag))
    result: dict[str, Any] = {"plant": plant, "model": model, **analysis.to_dict()}
    if loops:
        result |= {"loop": loops[0].to_dict(), "loops": [loop.to_dict() for loop in loops]}
    result |= {"robust": [margins.to_dict() for margins in robust if margins is not None]} if many else {}
    result |= {"reviews": [one.to_dict() for one in reviews]} if review else {}
    if place is not None:
        from ..core.catalogue import controllers
        from ..report.result_page import write_result_page

        result["rests_on"] = rests_on([loaded], [*map(controllers.find, names), covariance])
        with place.draft() as draft:
            (draft / "analysis.json").write_text(to_json(result) + "\n")
            _draw(draft, analysis, loops, robust)
            write_result_page(draft, "analysis.json")
    if as_json:
        print(to_json(result))
        return
    print(analysis)
    _print(loops, robust, reviews)
    if out is not None:
        print(f"written to {out}")


def _numbers(option: str, text: str, unit: str) -> list[float]:
    """Turn "0,50 kN/m" into [0.0, 50e3]. Raises InputError naming the option."""
    from ..core.unit import parse

    values = []
    for part in (part.strip() for part in text.split(",") if part.strip()):
        try:
            values.append(float(part))
        except ValueError:
            try:
                values.append(parse(part, unit))
            except InputError as error:
                raise InputError(f"{option} {text!r}: {error}") from None
    return values


def _known(name: str, plant: Plant, settings: dict[str, str]) -> Known:
    """What a review asks of a plant, from its nonlinear set where its file has one."""
    from ..plant.load import load_plant, models_of
    from ..scenario.plant_data import known_of

    if "nonlinear" not in models_of(name):
        return known_of(plant)
    symbols = load_plant(name).parameters
    return known_of(load_plant(name, settings={key: value for key, value in settings.items() if key in symbols}))


def _print(loops: Sequence[LoopAnalysis], robust: Sequence[RobustMargins | None], reviews: Sequence[Review]) -> None:
    for k, loop in enumerate(loops):
        print(loop)
        margins = robust[k]
        if margins is not None:
            print(margins)
        if reviews:
            print(reviews[k])


def _draw(
    folder: Path, analysis: Analysis, loops: Sequence[LoopAnalysis], robust: Sequence[RobustMargins | None]
) -> None:
    """Figures; with several controllers each has its name in the files' names."""
    from ..report.figures import bode_figure, loop_figure, nyquist_figure, robustness_figure, save

    save(bode_figure(analysis), folder / "bode")
    for loop, margins in zip(loops, robust, strict=True):
        end = f"-{loop.controller}" if len(loops) > 1 else ""
        save(loop_figure(loop), folder / f"loop{end}")
        save(nyquist_figure(loop, margins), folder / f"nyquist{end}")
        if margins is not None and any(one.stable for one in margins.loops.values()):
            save(robustness_figure(margins), folder / f"robustness{end}")
            margins.to_pandas().to_csv(folder / f"robustness{end}.csv")
